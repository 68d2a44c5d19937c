//! What comes in from judging a maneuver (its outputs, how they agree, what tolerances say) goes out as
//! one.

use super::judge::{Agreement, Output};
use super::proof::Judged;

/// A parameter's value in the run of a maneuver.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    pub name: String,
    pub unit: String,
    pub value: f64,
    pub sd: f64,
    /// Where it comes from: a word of the table `validation_values`.
    pub source: &'static str,
}

/// One validated maneuver.
#[derive(Debug)]
pub struct Validated {
    pub flight: String,
    pub segment: String,
    /// Labels of the maneuver; empty for a whole record.
    pub input: String,
    pub kind: String,
    /// Lines of which the abscissa lies outside their points, and the share of the maneuver in which
    /// that of one does.
    pub beyond: Vec<String>,
    pub outside: f64,
    pub outputs: Vec<(Output, Option<Agreement>)>,
    /// Zero shifts and initial states that followed, with their sizes, in words.
    pub followed: String,
    /// Every value of the run, by name.
    pub values: Vec<Value>,
    /// What the tolerances say of it.
    pub judged: Vec<Judged>,
}
