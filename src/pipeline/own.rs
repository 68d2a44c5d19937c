//! The tables that no stage writes but the pipeline itself: `notes` and `stages`.

use super::provenance::{PROGRAM, Provenance};
use crate::error::{Error, Result};
use crate::stage::{Note, STAGES_TABLE, Severity, Stage, Unit};
use crate::table::Table;

/// The tables that the pipeline itself writes: notes, and where the other tables come from.
pub fn own_tables(notes: &[Note], records: &[Provenance]) -> Result<[Table; 2]> {
    let rows: Vec<(&Provenance, &String, &String)> = records
        .iter()
        .flat_map(|r| r.ingredients.iter().map(move |(name, hash)| (r, name, hash)))
        .collect();
    let stages = Table::build(STAGES_TABLE)
        .strings("stage", rows.iter().map(|(r, _, _)| &r.stage))
        .strings("unit", rows.iter().map(|(r, _, _)| &r.unit))
        .strings("key", rows.iter().map(|(r, _, _)| &r.key))
        .strings(
            "code",
            rows.iter().map(|(r, _, _)| r.ingredients.get(PROGRAM).map_or("", String::as_str)),
        )
        .strings("ingredient", rows.iter().map(|(_, name, _)| name))
        .strings("hash", rows.iter().map(|(_, _, hash)| hash))
        .finish()?;
    Ok([crate::stage::notes_table(notes)?, stages])
}

/// The row of the table `notes` for a unit that failed.
pub fn failure_note(stage: &Stage, unit: &Unit, error: &Error) -> Note {
    Note {
        flight: unit.flight().to_string(),
        stage: stage.name.to_string(),
        severity: Severity::Missing,
        subject: unit.name.clone(),
        count: 1,
        text: without_folder(error).to_string(),
    }
}

/// The error with the name of its file alone: tables do not depend on where a campaign lies.
fn without_folder(error: &Error) -> Error {
    let mut error = error.clone();
    if let Some(place) = &mut error.place {
        let name =
            std::path::Path::new(&place.file).file_name().map(|n| n.to_string_lossy().into_owned());
        place.file = name.unwrap_or_else(|| place.file.clone());
    }
    error
}
