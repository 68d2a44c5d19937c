//! The tables that no stage writes but the pipeline itself: `notes` and `stages`.

use super::provenance::{PROGRAM, Provenance};
use crate::error::{Error, Result};
use crate::stage::{Campaign, NOTES, Note, Part, STAGES_TABLE, Severity, Stage, Unit, notes_table};
use crate::table::Table;
use std::collections::BTreeMap;

/// The tables that the pipeline itself writes: notes, and where the other tables come from.
///
/// Notes on one flight stand in a part of that flight, so that its page changes with them and with no
/// other's.
pub fn own_tables(notes: &[Note], records: &[Provenance]) -> Result<Vec<(Part, Table)>> {
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
    let mut of: BTreeMap<&str, Vec<Note>> = BTreeMap::from([("", Vec::new())]);
    notes.iter().for_each(|note| of.entry(&note.flight).or_default().push(note.clone()));
    let notes = of.into_iter().map(|(flight, notes)| {
        let part = if flight.is_empty() { Part::Number(0) } else { Part::Of(0, flight.into()) };
        Ok((part, notes_table(&notes)?))
    });
    notes.chain([Ok((Part::Number(0), stages))]).collect()
}

/// Where the pipeline's own tables may stand: those of the campaign, and notes of each flight.
pub fn own_parts(campaign: &Campaign) -> Vec<String> {
    let whole = [NOTES, STAGES_TABLE].map(|table| Part::Number(0).path(table));
    let of = campaign.flights.iter().map(|flight| Part::Of(0, flight.clone()).path(NOTES));
    whole.into_iter().chain(of).collect()
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
