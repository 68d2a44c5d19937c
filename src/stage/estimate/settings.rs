//! The `[[estimate]]` sections of the pipeline file.

use super::chosen::{Chosen, Range};
use crate::dynamics::Interpolation;
use crate::estimate;
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One model estimated over maneuvers: one estimate per maneuver, per flight, or one for all.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Name in the tables (column `model`); the model file's name without its endings unless given.
    #[serde(default)]
    pub name: Option<String>,
    /// The model file, relative to the pipeline file.
    pub model: String,
    /// Name of the `[[segment.input]]` whose maneuvers are used, or several; left out, each
    /// flight's whole record is used, as one segment, or as several where an input of the model has
    /// a gap. Maneuvers of several inputs that overlap in
    /// time are one segment, named after the first.
    #[serde(default)]
    pub input: Option<Used>,
    /// Leaves out the maneuvers during which another input than these was moved as well.
    #[serde(default)]
    pub alone: bool,
    /// Flights that are used, by id; `*` stands for any characters: `["flight-01", "calm-*"]`. Empty
    /// for all.
    #[serde(default)]
    pub flights: Vec<String>,
    /// Flights or maneuvers that are left out, by id; `*` stands for any characters:
    /// `["flight-03", "flight-04.02"]`. Maneuvers are named in the `segments` table.
    #[serde(default)]
    pub except: Vec<String>,
    /// Maneuvers that are used, by conditions: the mean of a column in the quiet time before the
    /// maneuver is within a range (SI, both ends included), which may be open at one end:
    /// `{ alpha = [0.02, 0.06], V = { min = 80.0 } }`.
    #[serde(default)]
    pub r#where: IndexMap<String, Range>,
    /// Without `input`: the record is cut into equal segments of at most this length, s (0: one
    /// segment). What disturbs a model, such as noise of the signals that drive it, adds up over a
    /// long segment. At least 0.1 s, at most a day.
    #[serde(default)]
    #[schemars(range(max = 86400.0))]
    pub window_s: f64,
    /// Kinds of maneuvers used ("3211", "2211", "211", "doublet", "step", "multistep", "sweep");
    /// empty for all kinds.
    #[serde(default)]
    pub kinds: Vec<String>,
    /// What is estimated together.
    #[serde(default)]
    pub group: Group,
    /// Time before the first step that belongs to the segment, s; at most an hour.
    #[serde(default = "default_pre")]
    #[schemars(range(max = 3600.0))]
    pub pre_s: f64,
    /// Time after the last step that belongs to the segment, s; at most an hour. Where the segments of two
    /// maneuvers would overlap, they meet in the middle.
    #[serde(default = "default_post")]
    #[schemars(range(max = 3600.0))]
    pub post_s: f64,
    /// Time before that which only feeds delays in the model, s; at most an hour.
    #[serde(default)]
    #[schemars(range(max = 3600.0))]
    pub preroll_s: f64,
    /// Time before that in which the model runs already and is not scored, s: what remembers (a
    /// lag, separated flow) forgets how it began. For models driven by measurements; a state that
    /// starts "measured" would start too late. At most an hour.
    #[serde(default)]
    #[schemars(range(max = 3600.0))]
    pub settle_s: f64,
    /// Integration steps per step of the grid, at most 256; 0 lets the model's fastest mode decide.
    #[serde(default)]
    #[schemars(range(max = 256))]
    pub substeps: usize,
    /// How the inputs run between the points of the grid: "linear" (mid-step is the mean), "cubic"
    /// for smooth measured signals, "hold" for commands that are steps; one for all of them, or by
    /// input: `interpolation = { command_e = "hold" }` (the others are linear).
    #[serde(default)]
    pub interpolation: Between,
    /// Columns of the samples table for the model's inputs, where the names differ:
    /// `input of the model = "column"`.
    #[serde(default)]
    pub inputs: IndexMap<String, String>,
    /// Inputs of the model that are held over a maneuver at the mean of a column in the quiet time
    /// before it: `alpha_ref = "alpha"`.
    #[serde(default)]
    pub held: IndexMap<String, String>,
    /// Signals or columns that measure the model's outputs, where the names differ:
    /// `output of the model = "signal"`. A signal is scored at its own time stamps, a column (of
    /// what was reconstructed or derived) on the grid.
    #[serde(default)]
    pub outputs: IndexMap<String, String>,
    /// Conditions that take a few values only, and those values (SI): `flap = [0.0, 0.262]`. A
    /// maneuver is labelled with the nearest one to the mean of that column in the quiet time
    /// before it, and parameters can be `per = "flap"`.
    #[serde(default)]
    pub levels: IndexMap<String, Vec<f64>>,
    /// Outputs of the model that are not scored.
    #[serde(default)]
    pub unscored: Vec<String>,
    /// What the samples of its maneuvers may take in memory, MiB; those beyond are read from a scratch
    /// file (in the folder that the environment names for such files). No result depends on it. At most
    /// 1048576, a TiB.
    #[serde(default = "default_samples_memory")]
    #[schemars(range(max = 1048576))]
    pub samples_memory_mib: u64,
    /// How the estimation is run.
    #[serde(default)]
    pub method: estimate::Settings,
}

/// How inputs run between samples.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Between {
    /// All of them alike.
    All(Interpolation),
    /// By input of the model.
    Each(IndexMap<String, Interpolation>),
}

impl Default for Between {
    fn default() -> Self {
        Between::All(Interpolation::Linear)
    }
}

impl Between {
    /// The inputs that are named.
    pub fn named(&self) -> impl Iterator<Item = &str> {
        let each = if let Between::Each(each) = self { Some(each) } else { None };
        each.into_iter().flat_map(|each| each.keys().map(String::as_str))
    }

    /// Per input, in their order.
    pub fn of<'a>(&self, inputs: impl Iterator<Item = &'a str>) -> Vec<Interpolation> {
        inputs
            .map(|name| match self {
                Between::All(one) => *one,
                Between::Each(each) => each.get(name).copied().unwrap_or_default(),
            })
            .collect()
    }
}

/// One name, or several.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Used {
    One(String),
    Several(Vec<String>),
}

impl Used {
    pub fn names(&self) -> &[String] {
        match self {
            Used::One(name) => std::slice::from_ref(name),
            Used::Several(names) => names,
        }
    }
}

/// What is estimated together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Group {
    /// One estimate per maneuver.
    #[default]
    Segment,
    /// One estimate per flight.
    Flight,
    /// One estimate over all maneuvers.
    All,
}

fn default_pre() -> f64 {
    1.0
}

fn default_samples_memory() -> u64 {
    1024
}

fn default_post() -> f64 {
    2.0
}

/// Columns of the segments table that parameters can be `per`, besides `flight`.
pub const LABELS: &[&str] = &["kind", "input", "polarity"];

impl Settings {
    /// What parameters can be `per`.
    pub fn columns(&self) -> Vec<&str> {
        let mut known = vec!["campaign", "segment", "flight"];
        if self.input.is_some() {
            known.extend(LABELS);
        }
        known.extend(self.levels.keys().map(String::as_str));
        known
    }

    /// Which flights and maneuvers are used.
    pub fn chosen(&self) -> Chosen<'_> {
        Chosen { flights: &self.flights, except: &self.except, conditions: &self.r#where }
    }

    /// Name in the tables.
    pub fn name(&self) -> String {
        let file = self.model.rsplit('/').next().unwrap_or(&self.model);
        let stem = file.strip_suffix(".model.toml").or(file.strip_suffix(".toml")).unwrap_or(file);
        self.name.clone().unwrap_or_else(|| stem.to_string())
    }
}
