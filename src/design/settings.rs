//! The study file `design.toml`: which designs are flown, with which truth and sensors, and how they
//! are estimated.

use super::watch::{Limits, Watch};
use crate::dynamics::Interpolation;
use crate::estimate;
use crate::model::Constants;
use crate::units::{Dim, Unit};
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A study of input designs: each is flown by the truth model of a simulated campaign, recorded by
/// its sensors, and estimated.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// One line that says what the study is.
    pub title: String,
    /// Where the designs come from.
    #[serde(default)]
    pub source: String,
    /// Campaign file, relative to this file: its truth model, what drives it, its timing and its
    /// sensors. Its maneuvers and flights are not flown.
    pub campaign: String,
    /// Channel map, relative to this file: which topic and field of the campaign's recorder is which
    /// signal.
    pub channels: String,
    /// Files with values of constants of the estimated models, relative to this file; a later one
    /// overrides an earlier one.
    #[serde(default)]
    pub constants: Vec<String>,
    /// Constants of the truth model that have another value in this study.
    #[serde(default)]
    pub truth: Constants,
    /// Outputs of the truth model that are the true values of estimated parameters:
    /// `parameter = "output"`. Without one, a parameter has no error in the table.
    #[serde(default)]
    pub true_values: IndexMap<String, String>,
    /// Input of the truth model that all designs are flown on.
    pub input: String,
    /// Calibrated airspeed of the test point, kt.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub speed_kt: f64,
    /// Pressure altitude of the test point, ft.
    pub altitude_ft: f64,
    /// Intensity of the turbulence where the truth model has an input for it, m/s.
    #[serde(default)]
    #[schemars(range(min = 0))]
    pub turbulence: f64,
    /// Seed of the recorder in the first recording of every design; the next ones follow it. The
    /// random numbers of a recording are named by seed, design and sensor.
    pub seed: u64,
    /// Recordings of every design, each with its own noise.
    #[serde(default = "default_seeds")]
    #[schemars(range(min = 1, max = 10_000))]
    pub seeds: u32,
    /// Time before the first step that is estimated from as well, s.
    #[serde(default = "default_pre")]
    #[schemars(range(min = 0))]
    pub pre_s: f64,
    /// Time after the last step that is estimated from as well, s.
    #[serde(default = "default_post")]
    #[schemars(range(min = 0))]
    pub post_s: f64,
    /// Time before the first step over which `held` signals are averaged, s.
    #[serde(default = "default_quiet")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub quiet_s: f64,
    /// The grid that recorded signals are put on.
    pub grid: Grid,
    /// True signals whose excursions are told.
    #[serde(default)]
    pub watch: Watch,
    /// The estimates, by name: each has its own ranks.
    pub estimate: IndexMap<String, Estimate>,
    /// The designs; an entry with lists stands for all their combinations.
    pub row: Vec<Row>,
    /// Also search durations of steps that are better than the designs given; `[search]` says
    /// within which limits.
    #[serde(default)]
    pub optimise: bool,
    /// What is searched, and where.
    #[serde(default)]
    pub search: Option<Search>,
}

fn default_seeds() -> u32 {
    20
}

fn default_pre() -> f64 {
    1.0
}

fn default_post() -> f64 {
    2.0
}

fn default_quiet() -> f64 {
    2.0
}

/// The grid that recorded signals are put on, and what is made of them there.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Its rate, Hz.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub rate_hz: f64,
    /// A gap of a signal longer than this many of its usual spacings is masked, not bridged.
    #[serde(default = "default_gap")]
    pub max_gap: f64,
    /// Signals that are smoothed on the grid, by a cubic fitted to so many seconds around every
    /// point: `smooth = { alpha_vane = 0.2 }`.
    #[serde(default)]
    pub smooth: IndexMap<String, f64>,
    /// Time derivatives of signals as further columns:
    /// `rates = { qdot = { of = "q_imu", window_s = 0.2 } }`.
    #[serde(default)]
    pub rates: IndexMap<String, Rate>,
}

fn default_gap() -> f64 {
    5.0
}

/// The time derivative of a signal.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rate {
    /// The signal.
    pub of: String,
    /// Its slope is that of a cubic fitted to so many seconds around every point.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub window_s: f64,
}

impl Rate {
    /// Its unit, where the signal is in `unit`.
    pub fn unit(unit: &str) -> String {
        let second = Unit::parse("s").map_or(Dim::NONE, |u| u.dim);
        Unit::parse(unit).map_or(Dim::NONE, |u| u.dim.over(second)).to_string()
    }
}

/// A model that is estimated from every design.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Estimate {
    /// The model file, relative to this file. Its inputs are signals, rates, or outputs of `derive`;
    /// its outputs that are signals of the same name are scored.
    pub model: String,
    /// A model file without states, relative to this file: its outputs become columns.
    #[serde(default)]
    pub derive: Option<String>,
    /// Signals that are held, over each maneuver, at their mean over the quiet time before it: with
    /// the airspeed among them, the model is linear about the trimmed condition.
    #[serde(default)]
    pub held: Vec<String>,
    /// How the inputs run between the points of the grid.
    #[serde(default)]
    pub interpolation: Interpolation,
    /// How the estimation is run.
    #[serde(default)]
    pub method: estimate::Settings,
}

/// One design, or several: where a list is given, the designs are all combinations, the first key
/// below varying slowest.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Name of the design (of several: its beginning); without it, its number in the file.
    #[serde(default)]
    pub name: Option<String>,
    /// "step", "doublet", a multistep by its digits such as "3211", "multisine", "sweep" or
    /// "profile", as in a campaign file.
    pub kind: String,
    /// Time unit of a multistep, s.
    #[serde(default)]
    pub unit_time_s: Option<Each<f64>>,
    /// Height of the steps, or largest absolute value, in the input's (SI) unit.
    #[serde(default)]
    pub amplitude: Option<Each<f64>>,
    /// Height of each step of a multistep, one for each digit, instead of `amplitude`: amplitudes
    /// that rise as the steps get shorter.
    #[serde(default)]
    pub amplitudes: Option<Vec<f64>>,
    /// Sign of the first step: 1 or -1.
    #[serde(default)]
    pub polarity: Option<Each<i8>>,
    /// How many times it is flown, one after the other; all are estimated together.
    #[serde(default)]
    pub repeats: Option<Each<u32>>,
    /// Duration of one edge of a multistep, s.
    #[serde(default)]
    pub edge_s: f64,
    /// Duration of a multisine, s.
    #[serde(default)]
    pub duration_s: Option<Each<f64>>,
    /// Lowest and highest frequency of a multisine, Hz.
    #[serde(default)]
    pub band_hz: Option<[f64; 2]>,
    /// Time of one cycle of a sweep, s.
    #[serde(default)]
    pub period_s: Option<f64>,
    /// Times of the points of a profile since its beginning, s.
    #[serde(default)]
    pub times_s: Option<Vec<f64>>,
    /// Values at the points of a profile.
    #[serde(default)]
    pub values: Option<Vec<f64>>,
}

/// One value, or several.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Each<T> {
    /// One value.
    One(T),
    /// One design for each.
    Several(Vec<T>),
}

impl<T: Copy> Each<T> {
    /// The values; one without a value where nothing is given.
    pub fn all(of: Option<&Each<T>>) -> Vec<Option<T>> {
        match of {
            None => vec![None],
            Some(Each::One(value)) => vec![Some(*value)],
            Some(Each::Several(values)) => values.iter().map(|v| Some(*v)).collect(),
        }
    }
}

/// A search for durations of alternating steps with a smaller trace than the best 3211 that keeps
/// the limits.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Search {
    /// Name of the estimate whose trace is made small.
    pub estimate: String,
    /// Number of steps.
    #[serde(default = "default_steps")]
    #[schemars(range(min = 1, max = 20))]
    pub steps: u32,
    /// Shortest and longest duration of a step, s.
    pub step_s: [f64; 2],
    /// Longest duration of all steps together, s.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub total_s: f64,
    /// Height of all steps, in the input's (SI) unit.
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub amplitude: f64,
    /// Designs that are tried.
    #[serde(default = "default_tries")]
    #[schemars(range(min = 1, max = 100_000))]
    pub tries: u32,
    /// Recordings of each design that is tried; the best is recorded again, `seeds` times, with
    /// noise of its own.
    #[serde(default = "default_search_seeds")]
    #[schemars(range(min = 1, max = 10_000))]
    pub seeds: u32,
    /// Excursions (of `[watch]`) that no design may exceed.
    #[serde(default)]
    pub limits: Limits,
}

fn default_steps() -> u32 {
    4
}

fn default_tries() -> u32 {
    96
}

fn default_search_seeds() -> u32 {
    4
}
