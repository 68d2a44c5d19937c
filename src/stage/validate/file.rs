//! A file of tolerances, as it stands there.

use crate::stage::estimate::chosen::Range;
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How far a model may be from what was measured, as a rule, a standard or a user asks.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct File {
    /// What the tolerances are.
    pub title: String,
    /// Where they come from.
    pub source: String,
    /// The tolerances.
    pub tolerance: Vec<Tolerance>,
}

/// One tolerance of one test.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tolerance {
    /// Name of the test that it belongs to: all groups of a test must pass.
    pub test: String,
    /// Tolerances of a test with the same group are alternatives: one of them suffices. Without a
    /// group it stands for itself.
    #[serde(default)]
    pub group: Option<String>,
    /// Names of the `[[segment.input]]`s whose maneuvers it is for; empty for all.
    #[serde(default)]
    pub input: Vec<String>,
    /// Kinds of maneuvers that it is for; empty for all.
    #[serde(default)]
    pub kinds: Vec<String>,
    /// By condition, the range (SI) that its mean in the quiet time before a maneuver must be in.
    #[serde(default, rename = "where")]
    pub conditions: IndexMap<String, Range>,
    /// Name of the output in the model file.
    pub output: String,
    /// What of the output is compared.
    #[serde(default)]
    pub of: Of,
    /// Largest error, in `unit`.
    #[serde(default)]
    pub within: Option<f64>,
    /// Unit of `within`.
    #[serde(default)]
    pub unit: Option<String>,
    /// Largest error as a share: of the largest change of the measured response, or of the measured
    /// period, half time or damping ratio.
    #[serde(default)]
    pub share: Option<f64>,
}

/// What of an output is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Of {
    /// Every sample of the maneuver: the largest error counts.
    #[default]
    Response,
    /// Period of the free oscillation after the last input, s.
    Period,
    /// Time in which its amplitude halves, s.
    HalfTime,
    /// Its damping ratio.
    DampingRatio,
}

impl Of {
    pub fn as_str(self) -> &'static str {
        match self {
            Of::Response => "response",
            Of::Period => "period",
            Of::HalfTime => "half-time",
            Of::DampingRatio => "damping-ratio",
        }
    }
}
