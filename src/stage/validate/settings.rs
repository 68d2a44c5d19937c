//! `[[validate]]` of the pipeline file, as it stands there, and how its maneuvers are run.

use crate::estimate::{SEGMENT, Shifts};
use crate::stage::estimate::chosen::Range;
use crate::stage::estimate::{self, Between, Group, Used};
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The stage's name, and its key in the pipeline file.
pub const NAME: &str = "validate";

/// A model with values that are held, run through maneuvers that were not used to find them. Only
/// initial states and zero shifts of sensors are estimated.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Name in the tables; `<estimate>-validation` unless given.
    #[serde(default)]
    pub name: Option<String>,
    /// Name of the `[[estimate]]` whose values are held; what is not said here is as it says.
    pub estimate: String,
    /// Names of `[[fit]]`s: each of their parameters has, in every maneuver, the value of its line
    /// at the condition of that maneuver.
    #[serde(default)]
    pub lines: Vec<String>,
    /// Another model than that of the estimate, for example a nonlinear one. Nothing about the names
    /// in it is taken from the estimate then: its `inputs`, `held`, `outputs`, `unscored`,
    /// `initial` and `shifts` are those given here.
    #[serde(default)]
    pub model: Option<String>,
    /// Where parameters of the model have their values from, if not from the one of their own name:
    /// a parameter of the estimate or of a line, or a line's own `"C_h_delta.slope"` and
    /// `"C_h_delta.intercept"`.
    #[serde(default)]
    pub take: IndexMap<String, String>,
    /// Name of the `[[segment.input]]` whose maneuvers are used, or several; `input = []`: whole
    /// records.
    #[serde(default)]
    pub input: Option<Used>,
    /// Flights used, with `*` for any characters; empty for all: those of the estimate are not taken
    /// over, a proof is made on what was not used.
    #[serde(default)]
    pub flights: Vec<String>,
    /// Flights or maneuvers left out of them, with `*` for any characters.
    #[serde(default)]
    pub except: Vec<String>,
    /// By condition, the range (SI) that its mean in the quiet time before a maneuver must be in.
    #[serde(default, rename = "where")]
    pub conditions: IndexMap<String, Range>,
    /// Kinds of maneuvers used; empty for all kinds.
    #[serde(default)]
    pub kinds: Option<Vec<String>>,
    /// Time before the first step that belongs to the segment, s; at most an hour.
    #[serde(default)]
    #[schemars(range(max = 3600.0))]
    pub pre_s: Option<f64>,
    /// Time after the last step that belongs to the segment, s; at most an hour.
    #[serde(default)]
    #[schemars(range(max = 3600.0))]
    pub post_s: Option<f64>,
    /// How the inputs run between the points of the grid, as in an estimate.
    #[serde(default)]
    pub interpolation: Option<Between>,
    /// Columns of the samples table for the model's inputs, where the names differ.
    #[serde(default)]
    pub inputs: IndexMap<String, String>,
    /// Inputs of the model that are held over a maneuver at the mean of a column before it.
    #[serde(default)]
    pub held: IndexMap<String, String>,
    /// Signals or columns that measure the model's outputs, where the names differ.
    #[serde(default)]
    pub outputs: IndexMap<String, String>,
    /// Outputs of the model that are not looked at.
    #[serde(default)]
    pub unscored: Vec<String>,
    /// States whose initial value is estimated, maneuver by maneuver.
    #[serde(default)]
    pub initial: Vec<String>,
    /// Parameters of the model that are estimated all the same, maneuver by maneuver: what is another
    /// number every time, such as a zero shift that the model has itself.
    #[serde(default)]
    pub free: Vec<String>,
    /// Zero shifts of sensors that are estimated, maneuver by maneuver.
    #[serde(default)]
    pub shifts: Option<Shifts>,
    /// Half-width within which an output is not known, because of friction for example: an output of
    /// the model that gives it, `band = { delta_e = "friction_band" }`.
    #[serde(default)]
    pub band: IndexMap<String, String>,
    /// Share of the samples that must lie within the interval that the model predicts for them, but
    /// for what chance allows (three standard deviations).
    #[serde(default = "default_within")]
    #[schemars(range(min = 0, max = 1))]
    pub within: f64,
    /// Largest inequality coefficient (Theil) of an output that is called good.
    #[serde(default = "default_theil")]
    #[schemars(range(min = 0, max = 1))]
    pub theil: f64,
    /// A file of tolerances (`[[tolerance]]`) that the maneuvers are judged by; none unless given.
    #[serde(default)]
    pub tolerances: Option<String>,
    /// The tests of that file that are judged by; empty for all.
    #[serde(default)]
    pub tests: Vec<String>,
    /// Length of the moving average of the residuals that is held against the sensor's noise, s; at most an
    /// hour.
    #[serde(default = "default_smooth")]
    #[schemars(range(min = 0, max = 3600))]
    pub smooth_s: f64,
}

fn default_smooth() -> f64 {
    0.2
}

fn default_within() -> f64 {
    0.95
}

fn default_theil() -> f64 {
    0.1
}

impl Settings {
    /// Name in the tables.
    pub fn name(&self) -> String {
        self.name.clone().unwrap_or_else(|| format!("{}-validation", self.estimate))
    }

    /// How the maneuvers are run: as in the estimate, but for what is said here, with nothing of the
    /// model free.
    pub fn run(&self, base: &estimate::Settings) -> estimate::Settings {
        let mut run = base.clone();
        let method = &mut run.method;
        (method.free, method.fixed, method.candidates) = (None, Vec::new(), Vec::new());
        (method.profile, method.priors) = (Vec::new(), false);
        method.tries.clear();
        method.per = self.free.iter().map(|name| (name.clone(), SEGMENT.to_string())).collect();
        method.start = crate::estimate::StartFrom::Model;
        // The proof of match is the motion, however the values were found.
        method.by = crate::estimate::By::Motion;
        if let Some(model) = &self.model {
            run.model = model.clone();
            run.unscored = Vec::new();
            [&mut run.inputs, &mut run.held, &mut run.outputs]
                .into_iter()
                .for_each(IndexMap::clear);
            (method.initial, method.shifts) = (Vec::new(), Shifts::default());
            (method.starts, method.floor, method.stabilise) = Default::default();
            // One kind for all inputs speaks of no name.
            if matches!(run.interpolation, Between::Each(_)) {
                run.interpolation = Between::default();
            }
        }
        run.interpolation = self.interpolation.clone().unwrap_or(run.interpolation);
        run.inputs.extend(self.inputs.clone());
        run.held.extend(self.held.clone());
        run.outputs.extend(self.outputs.clone());
        run.unscored.extend(self.unscored.clone());
        // What gives a band is looked at, and measured by nothing.
        run.unscored.extend(self.band.values().cloned());
        method.initial.extend(self.initial.clone());
        method.shifts = self.shifts.clone().unwrap_or_else(|| method.shifts.clone());
        method.shifts.per = SEGMENT.to_string();
        if let Some(input) = &self.input {
            run.input = Some(input.clone()).filter(|used| !used.names().is_empty());
        }
        run.kinds = self.kinds.clone().unwrap_or(run.kinds);
        run.pre_s = self.pre_s.unwrap_or(run.pre_s);
        run.post_s = self.post_s.unwrap_or(run.post_s);
        run.flights = self.flights.clone();
        run.except = self.except.clone();
        run.r#where = self.conditions.clone();
        run.name = Some(self.name());
        run.group = Group::Segment;
        run
    }
}
