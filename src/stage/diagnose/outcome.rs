//! A diagnosis, and what its rows are named by.

use super::config::Config;
use crate::diagnose::{Diagnosis, Rule};

/// A diagnosis and what its rows are named by.
pub struct Outcome<'a> {
    pub config: &'a Config,
    pub model: &'a str,
    /// Segment ids, in the order of the subject's segments.
    pub names: Vec<String>,
    pub rule: Rule,
    /// How the parameters are taken where the pipeline does not estimate all maneuvers together, in
    /// words.
    pub base: String,
    pub diagnosis: Diagnosis,
}
