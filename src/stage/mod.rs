//! The stages: tables and a slice of the checked configuration come in, tables come out. No stage
//! opens a path.
//!
//! [`STAGES`] is the one list of them, in the order in which they run. Adding a stage is adding a
//! file here and a line there.

mod campaign;
mod channels;
pub mod check;
mod inputs;
mod told;

pub mod derive;
pub mod diagnose;
pub mod estimate;
pub mod fit;
pub mod ingest;
pub mod reconstruct;
pub mod report;
pub mod rerun;
pub mod segment;

use crate::error::{Errors, Result};
use crate::model::Model;
use crate::report::Section;
use crate::table::Table;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

pub use campaign::Campaign;
pub use channels::Channels;
pub use inputs::{Inputs, Part};
pub use told::{Check, Key, Known, Told};

use inputs::series;

/// One stage of the main job.
#[derive(Debug)]
pub struct Stage {
    pub name: &'static str,
    /// What it does, in a few words, for people who watch.
    pub about: &'static str,
    /// Its key in the pipeline file, which has the stage's name; none where its settings are fields
    /// of `pipeline::Settings`, or there are none.
    pub key: Option<Key>,
    /// Finds the mistakes in what the pipeline file says under that key.
    pub check: Check,
    /// What it is run for in this campaign: flights, entries of the pipeline file, the campaign;
    /// nothing where it is not wanted.
    pub units: fn(&Campaign) -> Vec<Unit>,
    /// Tables it may write; a unit need not write all of them.
    pub writes: &'static [&'static str],
    /// Sections of the report about what it writes; they stand behind those of
    /// [`crate::report::SECTIONS`].
    pub sections: &'static [Section],
    /// Tables (and parts of them) that a unit reads.
    pub reads: fn(&Campaign, &Unit) -> Vec<Read>,
    /// Whether it reads the flight's log.
    pub reads_log: bool,
    /// The configuration that a unit depends on: part of its cache key, and nothing else of the
    /// configuration may be used.
    pub slice: fn(&Campaign, &Unit) -> Value,
    pub run: fn(&Campaign, &Unit, &Inputs) -> std::result::Result<Output, Errors>,
    /// Whether it reads the tables that the pipeline itself writes from what all stages before it
    /// recorded: notes and provenance.
    pub reads_records: bool,
    /// The settings of a unit that a command asked for, not the pipeline file: later runs keep its
    /// results as long as they are fresh.
    pub asked: fn(&Campaign, &Unit) -> Option<Value>,
    /// Whether its units hand their own work to the engine and are run where the run is, instead
    /// of being handed to it whole.
    pub spreads: bool,
    /// Why a unit that is not fresh is not run now, although the campaign has it.
    pub idle: fn(&Campaign, &Unit) -> Option<&'static str>,
}

impl Stage {
    /// What most stages have in common; the rest of a stage is written in its file:
    /// `Stage { name: "toy", .., ..Stage::PLAIN }`.
    pub const PLAIN: Stage = Stage {
        name: "",
        about: "",
        key: None,
        check: |_, _| Errors::default(),
        units: |_| Vec::new(),
        writes: &[],
        sections: &[],
        reads: |_, _| Vec::new(),
        reads_log: false,
        slice: |_, _| Value::Null,
        run: |_, _, _| Ok(Output::default()),
        reads_records: false,
        asked: |_, _| None,
        spreads: false,
        idle: |_, _| None,
    };

    /// Hash of everything that this stage is made from: its file and what that uses, dependencies,
    /// compiler, target. Part of its cache keys. A stage that is not in [`STAGES`] has that of all
    /// sources.
    pub fn code(&self) -> &'static str {
        code(self.name)
    }
}

mod codes {
    // `CODES` and `ALL`, written by `build.rs`.
    include!(concat!(env!("OUT_DIR"), "/codes.rs"));

    /// The hash of a stage by its name.
    pub fn code(stage: &str) -> &'static str {
        CODES.iter().find(|(name, _)| *name == stage).map_or(ALL, |(_, hash)| hash)
    }
}

pub use codes::code;

/// One run of a stage: for a flight, an entry of the pipeline file, or the campaign.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Unit {
    /// Flight id, name of the entry, or `campaign`.
    pub name: String,
    /// Place in the list of flights or entries; reruns follow the estimates.
    pub index: usize,
    /// The part of its tables that this unit writes.
    pub part: Part,
}

impl Unit {
    /// One unit per flight of the campaign.
    pub fn flights(campaign: &Campaign) -> Vec<Unit> {
        let unit = |(index, name): (usize, &String)| Unit {
            name: name.clone(),
            index,
            part: Part::Flight(name.clone()),
        };
        campaign.flights.iter().enumerate().map(unit).collect()
    }

    /// One unit per entry of a list, by name: they write the parts `0..`.
    pub fn entries(names: impl IntoIterator<Item = String>) -> Vec<Unit> {
        names.into_iter().enumerate().map(|(index, name)| Unit::entry(index, name)).collect()
    }

    /// A unit that writes the part with the number `index`.
    pub fn entry(index: usize, name: String) -> Unit {
        Unit { name, index, part: Part::Number(index) }
    }

    /// One unit: the whole campaign.
    pub fn campaign() -> Vec<Unit> {
        Unit::entries(["campaign".to_string()])
    }

    /// The flight that it is about; empty where it is about more.
    pub fn flight(&self) -> &str {
        if let Part::Flight(id) = &self.part { id } else { "" }
    }
}

/// A part of a table that a unit reads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Read {
    pub table: &'static str,
    pub part: Part,
    /// Whether the unit can run without it, because the stage that writes it failed or had nothing
    /// to write.
    pub optional: bool,
}

impl Read {
    /// These tables of one flight, all of them needed.
    pub fn flight(tables: &[&'static str], flight: &str) -> Vec<Read> {
        tables
            .iter()
            .map(|table| Read { table, part: Part::Flight(flight.to_string()), optional: false })
            .collect()
    }

    /// These tables of all flights, without those of flights that failed.
    pub fn flights(tables: &[&'static str], campaign: &Campaign) -> Vec<Read> {
        let part = |flight: &String| Part::Flight(flight.clone());
        let of = |table: &&'static str| -> Vec<Read> {
            campaign.flights.iter().map(|f| Read { table, part: part(f), optional: true }).collect()
        };
        tables.iter().flat_map(of).collect()
    }

    /// Numbered parts `0..n` of these tables, without those that failed.
    pub fn parts(tables: &[&'static str], n: usize) -> Vec<Read> {
        let of = |table: &&'static str| -> Vec<Read> {
            (0..n).map(|i| Read { table, part: Part::Number(i), optional: true }).collect()
        };
        tables.iter().flat_map(of).collect()
    }
}

/// What a stage hands back: the pipeline files it.
#[derive(Debug, Default)]
pub struct Output {
    /// Tables by name; each becomes the unit's part of that table.
    pub tables: Vec<(&'static str, Table)>,
    /// Other files, by path relative to the output folder.
    pub files: Vec<(String, Vec<u8>)>,
    pub notes: Vec<Note>,
}

/// Something counted that a reader of the results should know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Note {
    /// Flight concerned; empty for the campaign.
    pub flight: String,
    pub stage: String,
    pub severity: Severity,
    /// What it is about: a topic, a signal, a segment, a parameter.
    pub subject: String,
    /// How many there were.
    pub count: u64,
    pub text: String,
}

/// How much a note matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing.
    Info,
    /// Something was lost; the results asked for are there.
    Warning,
    /// The report calls it a problem: the exit code says so too.
    Problem,
    /// Something asked for is missing: the exit code says so too.
    Missing,
}

impl Severity {
    pub fn as_str(self) -> &'static str {
        match self {
            Severity::Info => "info",
            Severity::Warning => "warning",
            Severity::Problem => "problem",
            Severity::Missing => "missing",
        }
    }
}

/// The stages in the order in which they run.
pub const STAGES: &[Stage] = &[
    ingest::STAGE,
    reconstruct::STAGE,
    derive::STAGE,
    segment::STAGE,
    estimate::STAGE,
    fit::STAGE,
    diagnose::STAGE,
    rerun::STAGE,
    report::STAGE,
];

/// The table that the pipeline itself writes from the notes of all stages, before the report.
pub const NOTES: &str = "notes";

/// The notes of all stages as a table.
///
/// # Errors
/// The table's schema does not fit.
pub fn notes_table(notes: &[Note]) -> Result<Table> {
    Table::build(NOTES)
        .strings("flight", notes.iter().map(|n| &n.flight))
        .strings("stage", notes.iter().map(|n| &n.stage))
        .strings("severity", notes.iter().map(|n| n.severity.as_str()))
        .strings("subject", notes.iter().map(|n| &n.subject))
        .i64(
            "count",
            notes.iter().map(|n| i64::try_from(n.count).unwrap_or(i64::MAX)).collect::<Vec<_>>(),
        )
        .strings("text", notes.iter().map(|n| &n.text))
        .finish()
}

/// What a model says, as a slice of the configuration: its text with fragments, and the values of
/// its constants.
pub(crate) fn said(model: &Model) -> Value {
    let constants: IndexMap<&str, [f64; 2]> =
        model.constants.iter().map(|c| (c.quantity.name.as_str(), [c.value, c.sd])).collect();
    json!({ "text": model.text, "constants": constants })
}

/// Settings as a slice of the configuration; what cannot be written as JSON (there is none) counts
/// as null.
pub(crate) fn slice_of<T: Serialize>(settings: &T) -> Value {
    serde_json::to_value(settings).unwrap_or(Value::Null)
}

/// The table that the pipeline itself writes from the records of all stages before the report.
pub const STAGES_TABLE: &str = "stages";
