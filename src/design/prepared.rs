//! An estimate of a study with everything that it needs to be run.

use super::settings::Estimate;
use crate::model::Model;

/// An estimate with its models.
#[derive(Debug)]
pub struct Prepared {
    pub name: String,
    pub settings: Estimate,
    pub model: Model,
    pub derive: Option<Model>,
    /// Columns that drive the models, in the order of their inputs.
    pub inputs: Vec<String>,
    pub derived_from: Vec<String>,
    /// Outputs that are scored (index into the model's) and the signals that measure them.
    pub scored: Vec<(usize, String)>,
}
