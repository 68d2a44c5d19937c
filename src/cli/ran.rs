//! What became of a run comes in; it goes out as one document, and where its report is.

use super::words::End;
use crate::error::Errors;
use crate::pipeline::{RunResult, StageResult};
use crate::stage::Note;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// What became of a run.
pub struct Ran<'a> {
    pub result: &'a RunResult,
    /// The time that passed in each stage, s.
    pub seconds: &'a BTreeMap<&'static str, f64>,
    /// What was not asked for, in words.
    pub left_out: &'a [String],
}

/// The same as one document.
#[derive(Serialize)]
pub struct Answer<'a> {
    stages: &'a [StageResult],
    seconds: &'a BTreeMap<&'static str, f64>,
    removed: &'a [String],
    left_out: &'a [String],
    notes: &'a [Note],
    errors: &'a Errors,
    report: Option<String>,
    tables: String,
    exit_code: u8,
}

impl Ran<'_> {
    /// Of a run that ended so and wrote into `out`.
    pub fn answer(&self, out: &Path, end: End) -> Answer<'_> {
        Answer {
            stages: &self.result.stages,
            seconds: self.seconds,
            removed: &self.result.removed,
            left_out: self.left_out,
            notes: &self.result.notes,
            errors: &self.result.errors,
            report: self.report(out),
            tables: out.display().to_string(),
            exit_code: end.code(),
        }
    }

    /// Where the report is, where there is one.
    pub fn report(&self, out: &Path) -> Option<String> {
        const REPORT: &str = "report/index.html";
        let is_there = self.result.files.iter().any(|file| file == REPORT);
        is_there.then(|| out.join(REPORT).display().to_string())
    }
}
