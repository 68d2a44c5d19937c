//! The tables that no stage writes but the pipeline itself: `notes` and `stages`.

use super::provenance::{PROGRAM, Provenance, hash_bytes};
use crate::error::{Error, Result};
use crate::stage::{
    self, Campaign, NOTES, Note, Part, STAGES_TABLE, Severity, Stage, Unit, notes_table,
};
use crate::table::Table;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A part of a table that the pipeline itself writes: notes, or where the other tables come from.
pub struct Own<'a> {
    part: Part,
    told: Told<'a>,
}

enum Told<'a> {
    Notes(Vec<&'a Note>),
    Stages(&'a [Arc<Provenance>]),
}

/// A file of such a table that a run filed.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Filed {
    /// Hash of its bytes.
    pub hash: String,
    /// Hash of what it tells, and of the program that wrote it: the table need not be made to know that
    /// it is the same. None where an earlier program did not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
}

/// The parts of these tables.
///
/// Notes on one flight stand in a part of that flight, so that its page changes with them and with no
/// other's.
pub fn own_tables<'a>(notes: &'a [Note], records: &'a [Arc<Provenance>]) -> Vec<Own<'a>> {
    let mut of: BTreeMap<&str, Vec<&Note>> = BTreeMap::from([("", Vec::new())]);
    notes.iter().for_each(|note| of.entry(&note.flight).or_default().push(note));
    let notes = of.into_iter().map(|(flight, notes)| Own {
        part: if flight.is_empty() { Part::Number(0) } else { Part::Of(0, flight.into()) },
        told: Told::Notes(notes),
    });
    notes.chain([Own { part: Part::Number(0), told: Told::Stages(records) }]).collect()
}

impl Own<'_> {
    /// The table's name.
    pub fn name(&self) -> &'static str {
        match self.told {
            Told::Notes(_) => NOTES,
            Told::Stages(_) => STAGES_TABLE,
        }
    }

    /// Where it stands, relative to the output folder.
    pub fn path(&self) -> String {
        self.part.path(self.name())
    }

    /// Hash of what it tells and of the program.
    pub fn of(&self) -> String {
        // Of no stage: the hash of all sources.
        let mut text = stage::code("").as_bytes().to_vec();
        let mut add = |parts: &[&str]| {
            for part in parts {
                text.extend_from_slice(part.as_bytes());
                text.push(0);
            }
        };
        match &self.told {
            Told::Notes(notes) => notes.iter().for_each(|n| {
                let (severity, count) = (n.severity.as_str(), n.count.to_string());
                add(&[&n.flight, &n.stage, severity, &n.subject, &count, &n.text]);
            }),
            // The key is a hash over the ingredients.
            Told::Stages(records) => {
                records.iter().for_each(|r| add(&[&r.stage, &r.unit, &r.key]));
            }
        }
        hash_bytes(&text)
    }

    /// The table itself.
    ///
    /// # Errors
    /// Columns do not fit its schema.
    pub fn table(&self) -> Result<Table> {
        match &self.told {
            Told::Notes(notes) => notes_table(notes),
            Told::Stages(records) => stages(records),
        }
    }

    /// The hash of its file's bytes: that of the last run's where it tells the same.
    ///
    /// # Errors
    /// As `table`.
    pub fn hash(&self, filed: &BTreeMap<String, Filed>) -> Result<String> {
        match filed.get(&self.path()).filter(|filed| filed.of.as_ref() == Some(&self.of())) {
            Some(filed) => Ok(filed.hash.clone()),
            None => Ok(hash_bytes(&self.table()?.to_parquet()?)),
        }
    }
}

/// One row per ingredient of every unit.
fn stages(records: &[Arc<Provenance>]) -> Result<Table> {
    let rows: Vec<(&Arc<Provenance>, &String, &String)> = records
        .iter()
        .flat_map(|r| r.ingredients.iter().map(move |(name, hash)| (r, name, hash)))
        .collect();
    Table::build(STAGES_TABLE)
        .strings("stage", rows.iter().map(|(r, _, _)| &r.stage))
        .strings("unit", rows.iter().map(|(r, _, _)| &r.unit))
        .strings("key", rows.iter().map(|(r, _, _)| &r.key))
        .strings(
            "code",
            rows.iter().map(|(r, _, _)| r.ingredients.get(PROGRAM).map_or("", String::as_str)),
        )
        .strings("ingredient", rows.iter().map(|(_, name, _)| name))
        .strings("hash", rows.iter().map(|(_, _, hash)| hash))
        .finish()
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
