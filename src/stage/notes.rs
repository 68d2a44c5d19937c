//! What readers of the results should know, as the stages say it, in; as a table, out.

use crate::error::Result;
use crate::table::Table;
use serde::{Deserialize, Serialize};

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

/// The table that the pipeline itself writes from the notes of all stages, before the report.
pub const NOTES: &str = "notes";

/// The table that the pipeline itself writes from the records of all stages before the report.
pub const STAGES_TABLE: &str = "stages";

/// The notes of all stages as a table.
///
/// # Errors
/// The table's schema does not fit.
pub fn notes_table(notes: &[&Note]) -> Result<Table> {
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
