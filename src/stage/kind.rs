//! What a stage is: a campaign and one of its units come in, tables go out.

use super::channels::Channels;
use super::check::{Columns, Given};
use super::inputs::{Inputs, Output, Part};
use super::told::{Key, Told};
use super::{derive, estimate, fit, reconstruct, segment};
use crate::error::Errors;
use crate::report::Section;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::sync::OnceLock;

/// A model by its name in the tables, and the columns of the samples table that drive it.
pub type Columned = (String, Vec<String>);

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
    /// The models that it runs, by their names in the tables, and the columns of the samples table
    /// that drive each.
    pub models: fn(&Campaign) -> Vec<Columned>,
    /// Adds to what the pipeline file says under the stage's key what a command asked for earlier,
    /// as [`Stage::asked`] gave it; the names are those of the estimates.
    pub again: fn(&mut Value, Vec<Value>, &[String]),
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
        check: |_, _| {},
        units: |_| Vec::new(),
        writes: &[],
        sections: &[],
        reads: |_, _| Vec::new(),
        reads_log: false,
        slice: |_, _| Value::Null,
        run: |_, _, _| Ok(Output::default()),
        reads_records: false,
        asked: |_, _| None,
        models: |_| Vec::new(),
        again: |_, _, _| {},
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
        self.part.flight().unwrap_or_default()
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
}

/// Entries of a list of the pipeline file by name, and what is checked of each: none where it has
/// mistakes.
pub struct Named<'a, C> {
    pub names: &'a [String],
    pub checked: &'a [Option<C>],
}

/// What the check of a stage's settings may hold them against.
pub struct Known<'a> {
    /// The pipeline file, which says where a key stands, what is beside it, and the mistakes found
    /// so far.
    pub given: &'a mut Given,
    /// Ids of the flights.
    pub flights: &'a [String],
    /// Signals and columns of the samples table.
    pub columns: &'a Columns,
    /// The channel map; none where it has mistakes.
    pub channels: Option<&'a Channels>,
    /// Names of the inputs in which maneuvers are searched.
    pub searched: &'a [String],
    pub estimates: Named<'a, estimate::Config>,
    pub fits: Named<'a, fit::Config>,
    /// Names of the tables that stages write.
    pub tables: Vec<&'static str>,
}

/// Finds the mistakes in a stage's settings, and may keep what it makes of them.
pub type Check = fn(&mut Told, &mut Known);

/// The checked configuration of a campaign: names resolved, models compiled, units agreed.
#[derive(Debug)]
pub struct Campaign {
    pub title: String,
    /// Flight ids in alphabetical order.
    pub flights: Vec<String>,
    pub channels: Channels,
    pub reconstruct: Option<reconstruct::Config>,
    pub derive: derive::Config,
    pub segment: Option<segment::Config>,
    pub estimates: Vec<estimate::Config>,
    pub fits: Vec<fit::Config>,
    /// What the pipeline file says under the names of stages.
    pub told: Told,
    /// The stages that are run, in this order: [`super::STAGES`].
    pub stages: &'static [Stage],
    /// What `written` found.
    pub written: OnceLock<Vec<&'static str>>,
}

// What these give belongs into the slice of the stage that asks: a stage's code does not count what
// another stage's settings are made of.
impl Campaign {
    /// The parts of a table that this campaign's units write: whatever stage they belong to, all of
    /// them.
    pub fn parts(&self, table: &str) -> Vec<Part> {
        let writers = self.stages.iter().filter(|stage| stage.writes.contains(&table));
        writers.flat_map(|stage| (stage.units)(self)).map(|unit| unit.part).collect()
    }

    /// The tables that stages with anything to do write. Every page of a report wants them, and every stage
    /// has a unit for every flight: they are asked once.
    pub fn written(&self) -> &[&'static str] {
        self.written.get_or_init(|| {
            let at_work = self.stages.iter().filter(|stage| !(stage.units)(self).is_empty());
            at_work.flat_map(|stage| stage.writes).copied().collect()
        })
    }
}
