//! What a run tells while it works, and what became of it.

use crate::error::Errors;
use crate::stage::{Note, Severity, Stage, Unit};
use serde::Serialize;

/// What a watcher of a run hears. Flights run in parallel, so units of one stage interleave.
pub enum Event<'a> {
    /// A stage begins with so many units to run, those of some flights alone where they are named.
    Stage { stage: &'a Stage, to_run: usize, flights: Option<&'a [String]> },
    /// So many steps of so many inside a unit are done.
    Step { unit: &'a Unit, done: usize, of: usize },
    /// What a unit is doing, in words.
    Told { unit: &'a Unit, text: &'a str },
    /// A unit is done with, and how.
    Unit { unit: &'a Unit, ended: Ended<'a> },
    /// A stage ends.
    End,
}

/// What became of a unit.
pub enum Ended<'a> {
    /// It was run; what it notes.
    Made(&'a [Note]),
    /// It was fresh; what it noted when it was run.
    Kept(&'a [Note]),
    /// It was run and has no result.
    Failed(&'a Errors),
    /// It was not run; why.
    Blocked(&'a str),
}

/// Called with every event, from any thread.
pub type Watch<'a> = &'a (dyn Fn(Event) + Sync);

/// What became of one stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageResult {
    pub name: &'static str,
    pub ran: usize,
    pub fresh: usize,
    pub failed: usize,
    pub blocked: usize,
}

/// What became of a run.
#[derive(Debug, Default)]
pub struct RunResult {
    pub stages: Vec<StageResult>,
    /// Everything worth knowing, in order of stages and flights.
    pub notes: Vec<Note>,
    /// Why units failed.
    pub errors: Errors,
    /// The tables' files, relative to the output folder.
    pub files: Vec<String>,
    /// The units whose outputs were removed, and why: their flight, estimate or fit is no longer
    /// part of the campaign, or cannot be made.
    pub removed: Vec<String>,
}

impl RunResult {
    /// Whether everything asked for is there, and the report calls nothing a problem.
    pub fn complete(&self) -> bool {
        self.errors.is_empty() && self.notes.iter().all(|n| n.severity < Severity::Problem)
    }

    /// Whether every stage was fresh.
    pub fn nothing_done(&self) -> bool {
        self.removed.is_empty() && self.stages.iter().all(|s| s.ran == 0 && s.failed == 0)
    }
}
