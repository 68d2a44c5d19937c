//! How an estimation is run: the settings, every one with a default.

use crate::dynamics::Tier;
use crate::least_squares::{Method, StepControl, Undetermined};
use crate::noise::{OrderCriterion, Rule};
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How an estimation is run. Every field has a default; names are those of the model file.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// What is compared with the measurements: the motion of the model, or each of its equations
    /// (regression).
    pub by: By,
    /// Parameters to estimate. Without it: every parameter of the model that is not `fixed` there.
    pub free: Option<Vec<String>>,
    /// Parameters held at their start although the model (or `free`) would free them.
    pub fixed: Vec<String>,
    /// Parameters (sensor errors, for example) that are estimated only where the data support them,
    /// whatever the model says of them: those less than two standard deviations from their start
    /// are held there, the least significant first, and of those that the data cannot distinguish
    /// the last named one. Every decision is a row of the table `separability`.
    pub candidates: Vec<String>,
    /// How the candidates are gone through.
    pub search: Search,
    /// Least partial F of a candidate in a stepwise search: one with less does not come in, or goes
    /// out. 4 is the 5 % level where residuals are white; coloured ones ask for more.
    pub limit_f: f64,
    /// Start values that replace those of the model (the value itself for a parameter that is
    /// held). The centre of a prior stays where the model file has it.
    pub starts: IndexMap<String, f64>,
    /// Further starts of parameters for which the cost may have several minima (friction,
    /// thresholds, limits): the estimation is run from every combination and from the usual start,
    /// and the best is kept, `tries = { F_c = [0.0, 10.0, 30.0] }`.
    pub tries: IndexMap<String, Vec<f64>>,
    /// The start of one of them. Unlike `starts` it leaves priors where they are, so that the costs
    /// of all tries are of one likelihood.
    #[serde(skip)]
    pub tried: IndexMap<String, f64>,
    /// What is asked of the solution. No setting of a file.
    #[serde(skip)]
    pub asked: Asked,
    /// Where parameters start that no entry of `starts` speaks of.
    pub start: StartFrom,
    /// Of `by = "equation error"` and of `start = "equation error"`: the window, s, over which both
    /// sides of an equation are smoothed, or the rate of a state is taken (at least five points of the
    /// grid). Longer keeps noise out, shorter what inputs do fast. At most a minute.
    #[schemars(range(max = 60.0))]
    pub smoothing_s: f64,
    /// States whose initial value is estimated, one value per segment; all others begin where the
    /// model says.
    pub initial: Vec<String>,
    /// Where states begin that start "measured": each segment at its own first sample, or all at
    /// those of the first segment.
    pub initial_from: InitialFrom,
    /// Zero shifts of sensors that are estimated besides the model's parameters, sensor by sensor.
    pub shifts: Shifts,
    /// Stabilised output error, for aircraft that are unstable: gains (1/s) by which states are led
    /// back to what was measured of them, `stabilise = { alpha = 4.0, q = 4.0 }`. The measured
    /// noise then drives the model: estimates are biased by it, the more the larger the gains and
    /// the noise; take the smallest that keep the response from running away. They have no standard
    /// deviations.
    pub stabilise: IndexMap<String, f64>,
    /// Where one value of a parameter holds, instead of what the model file says:
    /// `per = { C_m_0 = "flap", dz_q = "flight" }`, with "campaign", "segment", or a column that
    /// describes segments.
    pub per: IndexMap<String, String>,
    /// Parameters that follow a condition of the segments as a straight line, in place of one
    /// value. No setting of a file: a pipeline estimates per maneuver and fits lines (`[[fit]]`),
    /// and whoever takes its maneuvers together says so here.
    #[serde(skip)]
    pub lines: IndexMap<String, Line>,
    /// Whether the noise of different outputs is independent, or correlated at the same instant.
    pub noise: NoiseKind,
    /// What the noise is estimated over: one covariance for all segments ("campaign"), one each
    /// ("segment"), or one for all that are alike in a column, such as "flight" (calm and turbulent
    /// air do not mix).
    pub noise_per: String,
    /// Smallest standard deviation that the noise of an output may be given, SI:
    /// `floor = { q = 1e-5 }`.
    pub floor: IndexMap<String, f64>,
    /// How steps are kept from going too far.
    pub step_control: StepControl,
    /// Stop when the relative change of det R in one iteration is below this (and the step is
    /// small, see `step_tolerance`).
    pub tolerance: f64,
    /// Stop only when, besides, no combination of parameters moved by more than this many of its
    /// standard deviations; 0 asks for nothing beyond `tolerance`.
    pub step_tolerance: f64,
    /// Stop only when, besides, no free parameter's gradient is larger than this share of the
    /// square root of its information (the slope of the likelihood per standard deviation that the
    /// parameter would have alone); 0 asks for nothing.
    pub gradient_tolerance: f64,
    /// Iterations after which the estimation ends as "iteration limit"; at most 100000.
    #[schemars(range(max = 100000))]
    pub max_iterations: usize,
    /// How the model's rates are evaluated: "auto" (machine code where the work is worth making
    /// it), "interpreter", "native". The results are the same to the bit.
    pub tier: Tier,
    /// What becomes of a common parameter that no output notices at the end, from its start or from
    /// other sizes (half, twice, a quarter, four times): a rate limit where all tests are slow.
    pub without_effect: WithoutEffect,
    /// Refusals of one step (each halves it, or raises its damping) after which the estimation ends
    /// as "no improvement".
    pub max_halvings: usize,
    /// Use the priors (`sd`) of the model's parameters.
    pub priors: bool,
    /// Highest order of the autoregressive model of the residuals of one output; at most 1000.
    #[schemars(range(max = 1000))]
    pub max_ar_order: usize,
    /// How that order is chosen.
    pub ar_order: OrderCriterion,
    /// Parameters whose interval is read from the likelihood's profile (all other parameters
    /// estimated again at each value): for those that enter so nonlinearly that `value +- 1.96 sd`
    /// would mislead, such as delays and thresholds. `"alpha(0)"` is the initial value of state
    /// `alpha`. Costs some ten estimations each.
    pub profile: Vec<String>,
    /// Level of these intervals, between 0 and 1.
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 1))]
    pub profile_level: f64,
}

/// A straight line that a parameter follows: `value + slope (condition - centre)`. The parameter's
/// own name is that of its value at the centre; its start and its bounds are those of the model
/// there. The slope starts at zero, without bounds.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Line {
    /// The condition, by its name in `Segment::conditions`.
    pub against: String,
    /// SI unit of the condition.
    pub unit: String,
    pub centre: f64,
}

impl Line {
    /// Name of the slope of a parameter.
    pub fn slope(&self, parameter: &str) -> String {
        format!("{parameter} per {}", self.against)
    }

    /// Unit of the slope of a parameter with this unit.
    pub fn slope_unit(&self, unit: &str) -> String {
        let is_one = |unit: &str| unit.is_empty() || unit == "-";
        match (is_one(unit), is_one(&self.unit)) {
            (_, true) => unit.to_string(),
            (true, false) => format!("1/({})", self.unit),
            (false, false) => format!("{unit}/({})", self.unit),
        }
    }
}

/// What is compared with the measurements.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
pub enum By {
    /// The motion of the model over time: output error, or filter error where noise drives a state.
    #[default]
    #[serde(rename = "motion")]
    Motion,
    /// Each equation by itself: least squares on the rates of measured states, and on measured
    /// outputs (accelerations, coefficients). Nothing is integrated over time; noise in the measured
    /// states and inputs moves the estimates towards zero, by how much is said.
    #[serde(rename = "equation error")]
    EquationError,
}

/// How candidates are gone through.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Search {
    /// All are estimated, and the least significant is held, one after the other, with standard
    /// deviations that allow for coloured residuals.
    #[default]
    Backward,
    /// By equation error: one after the other comes in by its partial F, and goes out again where
    /// others have made it superfluous.
    Stepwise,
    /// By equation error: all come in, ordered by what each explains that those before did not, and
    /// their number is chosen where the predicted square error is least.
    Orthogonal,
}

/// Where states begin that start "measured".
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum InitialFrom {
    /// Each segment at its own first measured value.
    #[default]
    Own,
    /// All segments at the first measured value of the first one (some published results were found
    /// so).
    First,
}

/// Sensors whose zero shift is estimated: the output `alpha` gets a parameter `dz_alpha` (measured
/// = modelled + shift), the input `delta_e` a parameter `du_delta_e` (the model is driven by
/// measured - shift). They start at zero.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Shifts {
    /// Outputs of the model.
    pub outputs: Vec<String>,
    /// Inputs of the model.
    pub inputs: Vec<String>,
    /// Where one value holds: "segment", "campaign", or a column that describes segments; `per` of
    /// the method overrides it for one.
    pub per: String,
}

impl Default for Shifts {
    fn default() -> Self {
        Shifts { outputs: Vec::new(), inputs: Vec::new(), per: "segment".to_string() }
    }
}

/// Where the iteration starts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
pub enum StartFrom {
    /// The starts of the model file (and `starts`).
    #[default]
    #[serde(rename = "model")]
    Model,
    /// The result of a regression on the rate equations of measured states and on measured outputs,
    /// where it fits better than the model's starts; parameters that it does not reach keep those.
    #[serde(rename = "equation error")]
    EquationError,
}

/// What becomes of a common parameter without effect.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum WithoutEffect {
    /// It is held at its start, which is said, and the others are estimated.
    #[default]
    Hold,
    /// The estimation ends as "singular".
    Refuse,
}

/// Whether outputs share noise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum NoiseKind {
    /// Every output has a variance; noise of different outputs is independent.
    #[default]
    Diagonal,
    /// Samples of the same instant have a full covariance matrix; with masked samples or outputs of
    /// different rates its likelihood's maximum is found from the pairs that are there.
    Full,
}

impl Settings {
    /// How the colour of residuals is modelled.
    pub fn colour(&self) -> Rule {
        Rule { highest: self.max_ar_order, criterion: self.ar_order }
    }

    /// How the likelihood's maximum is looked for.
    pub fn method(&self) -> Method {
        Method {
            control: self.step_control,
            tolerance: self.tolerance,
            step_tolerance: self.step_tolerance,
            gradient_tolerance: self.gradient_tolerance,
            max_iterations: self.max_iterations,
            max_halvings: self.max_halvings,
            undetermined: match self.without_effect {
                WithoutEffect::Hold => Undetermined::SetAside,
                WithoutEffect::Refuse => Undetermined::Refused,
            },
            ..Method::default()
        }
    }
}

/// What is asked of a solution besides its values and their standard deviations: that takes longer than
/// to find it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Asked {
    /// Whether another start leads lower, and what its standard deviations do not know of.
    #[default]
    All,
    /// Whether another start leads lower: for estimates that others go on from.
    Minimum,
    /// Nothing: for runs that are one of many.
    Nothing,
}

impl Default for Settings {
    fn default() -> Self {
        let method = Method::default();
        Settings {
            by: By::default(),
            asked: Asked::default(),
            free: None,
            fixed: Vec::new(),
            candidates: Vec::new(),
            search: Search::default(),
            limit_f: 20.0,
            starts: IndexMap::new(),
            tries: IndexMap::new(),
            tried: IndexMap::new(),
            start: StartFrom::default(),
            smoothing_s: 0.5,
            initial: Vec::new(),
            initial_from: InitialFrom::default(),
            shifts: Shifts::default(),
            stabilise: IndexMap::new(),
            per: IndexMap::new(),
            lines: IndexMap::new(),
            noise: NoiseKind::default(),
            noise_per: "campaign".to_string(),
            floor: IndexMap::new(),
            step_control: method.control,
            tolerance: method.tolerance,
            step_tolerance: method.step_tolerance,
            gradient_tolerance: method.gradient_tolerance,
            max_iterations: method.max_iterations,
            tier: Tier::Auto,
            max_halvings: method.max_halvings,
            without_effect: WithoutEffect::default(),
            priors: true,
            max_ar_order: Rule::default().highest,
            ar_order: Rule::default().criterion,
            profile: Vec::new(),
            profile_level: 0.95,
        }
    }
}
