//! Maximum-likelihood output error: a model and records in; estimates with honest standard deviations, responses and a stop reason out.
//!
//! The cost is `J = 1/2 sum e' R^-1 e + N/2 ln|R|` (attas A4) with `R` re-estimated from the residuals `e = z - y` of all segments
//! together (or per group of segments), diagonal or full, every output scored at its own time stamps. Steps of Gauss and Newton, or of
//! Levenberg and Marquardt, are accepted on the concentrated likelihood (`R` at its optimum for the trial point), never on the cost at
//! a fixed `R`.
//!
//! | file | what it does |
//! |---|---|
//! | `segment` | records with labels; groups of segments; which samples belong together |
//! | `problem` | parameters in two parts, shared and per segment; what a segment hands over; the pass over all segments |
//! | `noise` | `R` per group of segments, with floor and missing samples, and the cost at it |
//! | `arrow` | the normal equations, every segment's own block eliminated first |
//! | `gauss` | the iteration: step, bounds, halving or damping, stopping |
//! | `rank` | which combinations of parameters the data cannot separate |
//! | `colour` | standard deviations under coloured residuals |
//! | `sigma` | products of a segment's sensitivities with the covariance of coloured noise |
//! | `filter` | products with the covariance matrix of an autoregressive process |
//! | `solution` | the four together: estimates and covariances by parameter index |
//! | `budget` | how the constants that a model assumes move the estimates |
//! | `profile` | intervals from the likelihood's profile |
//! | `repeats` | scatter of repeated estimates against their standard deviations |
//! | `regression` | starting values by regression on the rate and output equations |
//! | `choice` | settings against the model: what is free, where it starts |
//! | `prepare` | the model with shifts and feedback that the settings ask for, and records that feed it |
//! | `output_error` | a compiled model over segments, as such a problem; segments that cannot be used left out |
//! | `case` | that problem for the segments used |
//! | `result` | names put to the solution |

mod arrow;
mod budget;
mod case;
mod choice;
mod colour;
mod filter;
mod gauss;
mod noise;
mod output_error;
mod prepare;
mod problem;
mod profile;
mod rank;
pub mod regression;
pub mod repeats;
mod result;
mod segment;
mod sigma;
mod solution;
#[cfg(test)]
mod tests;

pub use budget::Influence;
pub use output_error::{estimate, estimate_segments};
pub use prepare::extended;
pub use profile::{End, Point, Profile};
pub use rank::{Combination, Term, Verdict};
pub use segment::Segment;

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How an estimation is run. Every field has a default; names are those of the model file.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Parameters to estimate. Without it: every parameter of the model that is not `fixed` there.
    pub free: Option<Vec<String>>,
    /// Parameters held at their start although the model (or `free`) would free them.
    pub fixed: Vec<String>,
    /// Start values that replace those of the model (the value itself for a parameter that is held).
    pub starts: IndexMap<String, f64>,
    /// Where parameters start that no entry of `starts` speaks of.
    pub start: StartFrom,
    /// Window of the smoothing for `start = "equation error"`, s (at least five points of the grid).
    pub smoothing_s: f64,
    /// States whose initial value is estimated, one value per segment; all others begin where the model says.
    pub initial: Vec<String>,
    /// Where states begin that start "measured": each segment at its own first sample, or all at those of the first segment.
    pub initial_from: InitialFrom,
    /// Zero shifts of sensors that are estimated besides the model's parameters, sensor by sensor.
    pub shifts: Shifts,
    /// Stabilised output error, for aircraft that are unstable: gains (1/s) by which states are led back to what was measured of them,
    /// `stabilise = { alpha = 4.0, q = 4.0 }`. The measured noise then drives the model: estimates are biased by it, the more the
    /// larger the gains and the noise; take the smallest that keep the response from running away.
    pub stabilise: IndexMap<String, f64>,
    /// Where one value of a parameter holds, instead of what the model file says: `per = { C_m_0 = "flap", dz_q = "flight" }`, with
    /// "campaign", "segment", or a column that describes segments.
    pub per: IndexMap<String, String>,
    /// Whether the noise of different outputs is independent, or correlated at the same instant.
    pub noise: NoiseKind,
    /// What the noise is estimated over: one covariance for all segments ("campaign"), one each ("segment"), or one for all that are
    /// alike in a column, such as "flight" (calm and turbulent air do not mix).
    pub noise_per: String,
    /// Smallest standard deviation that the noise of an output may be given, SI: `floor = { q = 1e-5 }`.
    pub floor: IndexMap<String, f64>,
    /// How steps are kept from going too far.
    pub step_control: StepControl,
    /// Stop when the relative change of det R in one iteration is below this (and the step is small, see `step_tolerance`).
    pub tolerance: f64,
    /// Stop only when, besides, no combination of parameters moved by more than this many of its standard deviations;
    /// 0 asks for nothing beyond `tolerance`.
    pub step_tolerance: f64,
    /// Stop only when, besides, no free parameter's gradient is larger than this share of the square root of its information (the
    /// slope of the likelihood per standard deviation that the parameter would have alone); 0 asks for nothing.
    pub gradient_tolerance: f64,
    /// Iterations after which the estimation ends as "iteration limit".
    pub max_iterations: usize,
    /// Refusals of one step (each halves it, or raises its damping) after which the estimation ends as "no improvement".
    pub max_halvings: usize,
    /// Use the priors (`sd`) of the model's parameters.
    pub priors: bool,
    /// Highest order of the autoregressive model of the residuals of one output.
    pub max_ar_order: usize,
    /// How that order is chosen.
    pub ar_order: OrderCriterion,
    /// Parameters whose interval is read from the likelihood's profile (all other parameters estimated again at each value): for
    /// those that enter so nonlinearly that `value +- 1.96 sd` would mislead, such as delays and thresholds. `"alpha(0)"` is the
    /// initial value of state `alpha`. Costs some ten estimations each.
    pub profile: Vec<String>,
    /// Level of these intervals, between 0 and 1.
    pub profile_level: f64,
}

/// Where states begin that start "measured".
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum InitialFrom {
    /// Each segment at its own first measured value.
    #[default]
    Own,
    /// All segments at the first measured value of the first one (some published results were found so).
    First,
}

/// Sensors whose zero shift is estimated: the output `alpha` gets a parameter `dz_alpha` (measured = modelled + shift), the input
/// `delta_e` a parameter `du_delta_e` (the model is driven by measured - shift). They start at zero.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Shifts {
    /// Outputs of the model.
    pub outputs: Vec<String>,
    /// Inputs of the model.
    pub inputs: Vec<String>,
    /// Where one value holds: "segment", "campaign", or a column that describes segments; `per` of the method overrides it for one.
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
    /// The result of a regression on the rate equations of measured states and on measured outputs, where it fits better than the model's
    /// starts; parameters that it does not reach keep those.
    #[serde(rename = "equation error")]
    EquationError,
}

/// Whether outputs share noise.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum NoiseKind {
    /// Every output has a variance; noise of different outputs is independent.
    #[default]
    Diagonal,
    /// Samples of the same instant have a full covariance matrix; with masked samples or outputs of different rates its likelihood's
    /// maximum is found from the pairs that are there.
    Full,
}

/// How steps are kept from going too far. Both ways take a step only if it does not raise the concentrated cost.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StepControl {
    /// The Gauss-Newton step, halved until it is good.
    #[default]
    Halving,
    /// Damped by a share of the information of every parameter, which follows from the gain of the last step: shorter and turned to
    /// the steepest descent. Helps where starts are poor or parameters hardly separable.
    LevenbergMarquardt,
}

/// How the order of the residuals' autoregressive model is chosen. Slow noise of a small part of the white noise's size widens
/// intervals a lot and is easily missed: the figures are the coverage of intervals said to be 95%, measured over 500 simulated
/// campaigns with white noise and a third of it with correlation 0.97 between samples (`estimate::tests::coverage`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum OrderCriterion {
    /// The order of `bic`, raised until the residuals it leaves pass as white: the sum of squares of the partial autocorrelations of all
    /// higher orders is below its median for white noise. Covers 94 to 95%.
    White,
    /// Least `N ln(variance) + 2 p`. Covers 93 to 94%.
    Aic,
    /// Least `N ln(variance) + p ln N`. Covers 83 to 87%.
    Bic,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            free: None,
            fixed: Vec::new(),
            starts: IndexMap::new(),
            start: StartFrom::default(),
            smoothing_s: 0.5,
            initial: Vec::new(),
            initial_from: InitialFrom::default(),
            shifts: Shifts::default(),
            stabilise: IndexMap::new(),
            per: IndexMap::new(),
            noise: NoiseKind::default(),
            noise_per: "campaign".to_string(),
            floor: IndexMap::new(),
            step_control: StepControl::default(),
            tolerance: 1e-6,
            step_tolerance: 0.01,
            gradient_tolerance: 0.01,
            max_iterations: 50,
            max_halvings: 20,
            priors: true,
            max_ar_order: 24,
            ar_order: OrderCriterion::White,
            profile: Vec::new(),
            profile_level: 0.95,
        }
    }
}

/// Why the iteration ended. Only `Converged` comes with standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The stopping rule holds.
    Converged,
    /// `max_iterations` reached before the stopping rule held.
    IterationLimit,
    /// The data cannot separate some parameters (see the verdict).
    Singular,
    /// No step length down to `2^-max_halvings` improves the likelihood.
    NoImprovement,
    /// The model is not finite at the start values.
    NotFinite,
    /// No finite measured sample, or nothing to estimate.
    NoData,
}

impl Stop {
    /// The stable text that tables carry.
    pub fn as_str(self) -> &'static str {
        match self {
            Stop::Converged => "converged",
            Stop::IterationLimit => "iteration limit",
            Stop::Singular => "singular",
            Stop::NoImprovement => "no improvement",
            Stop::NotFinite => "not finite",
            Stop::NoData => "no data",
        }
    }
}

impl std::fmt::Display for Stop {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// What a group of segments has in common.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Label {
    pub column: String,
    pub value: String,
}

impl std::fmt::Display for Label {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{} {}", self.column, self.value)
    }
}

/// A segment that was not used, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// Index of the record.
    pub segment: usize,
    pub why: String,
}

/// A measured output of a segment that says little or nothing, and why. It is scored all the same, as far as it has samples.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Doubtful {
    /// Index of the record.
    pub segment: usize,
    pub output: String,
    pub why: String,
}

/// One estimated parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Name in the model file; `alpha(0)` for the initial value of state `alpha`.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// The segment (index of the record) it belongs to; none for a value common to all, or to a group.
    pub segment: Option<usize>,
    /// The group of segments it belongs to; none for a value common to all, or of one segment.
    pub group: Option<Label>,
    /// Estimate; where the iteration did not converge, the best point reached.
    pub value: f64,
    /// Standard deviation that allows for coloured residuals; none unless converged, or on a bound.
    pub sd: Option<f64>,
    /// Cramer-Rao bound: the standard deviation if the residuals were white; none like `sd`.
    pub sd_crlb: Option<f64>,
    /// `sd` with the sd of the constants that the model assumes (`Estimation::budget`); none like `sd`.
    pub sd_total: Option<f64>,
    /// Ends of the interval from the likelihood's profile; none unless asked for, or open on that side.
    pub lower: Option<f64>,
    pub upper: Option<f64>,
    /// Where the iteration started.
    pub start: f64,
    /// The estimate sits on a bound of the model file; the other parameters' `sd` hold for it fixed there.
    pub at_bound: bool,
}

/// Correlation of two estimates, `rows[a]` and `rows[b]`, `a < b`. Pairs from two different segments are left out: they are
/// correlated only through the common parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlation {
    pub a: usize,
    pub b: usize,
    /// With coloured residuals allowed for (belongs to `sd`).
    pub value: f64,
    /// Belongs to `sd_crlb`.
    pub crlb: f64,
}

/// One line of the iteration's history; iteration 0 is the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    pub iteration: usize,
    /// Negative log-likelihood without its constants (`sum_j N_j/2 ln R_jj` where `R` is diagonal), and half the squared deviations
    /// from priors.
    pub cost: f64,
    /// Determinant of `R`; of several groups of segments the geometric mean, weighted with their samples.
    pub det_r: f64,
    /// Relative change of `det_r`; 0 for the start.
    pub change: f64,
    /// Length of the full Gauss-Newton step that led here, in standard deviations: `sqrt(d' M d)`; 0 for the start.
    pub step: f64,
    /// Steepest slope here over the parameters that are free to move: `max |g_i| / sqrt(M_ii)`.
    pub gradient: f64,
    /// Trial points refused before this one (halvings of the step, or raises of the damping).
    pub halvings: usize,
    /// Share of the information's diagonal added to it (Levenberg-Marquardt); 0 without damping.
    pub damping: f64,
}

/// What is known of one output's residuals over all segments that share an `R`.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputScatter {
    pub name: String,
    pub unit: String,
    /// The group of segments; 0 where all share one `R`.
    pub group: usize,
    /// Variance `R_jj` (`sum e^2 / N_j` unless it is on its floor, or fitted together with others), unit squared.
    pub r: f64,
    /// Samples scored, N_j.
    pub count: usize,
    /// Samples masked (not a number), not scored.
    pub masked: usize,
    /// Correlation of the noise with that of each output in the list; empty where outputs count as independent.
    pub correlation: Vec<f64>,
    /// Coefficients `a_1..a_p` of the residuals' autoregressive model `r_k = a_1 r_{k-1} + ... + w_k`; empty for white.
    pub ar: Vec<f64>,
}

/// Measured and modelled values of one output in one segment.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Index into the model's outputs.
    pub output: usize,
    pub name: String,
    pub unit: String,
    /// Time stamps of the measurement, s.
    pub t: Vec<f64>,
    /// As measured; NaN where masked.
    pub measured: Vec<f64>,
    pub modelled: Vec<f64>,
}

/// The result of one estimation, over one or several segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimation {
    pub stop: Stop,
    /// Parameters common to all segments or a group of them first, in the model's order; then, segment by segment, its parameters and
    /// initial states. Segments left out have none.
    pub rows: Vec<Row>,
    pub correlations: Vec<Correlation>,
    pub iterations: Vec<Iteration>,
    /// Determinant of `R`; of several groups of segments the geometric mean, weighted with their samples.
    pub det_r: f64,
    /// The scored outputs, in the model's order, for every group of segments with an `R` of its own.
    pub outputs: Vec<OutputScatter>,
    /// Group of every segment; none for one left out.
    pub noise_groups: Vec<Option<usize>>,
    /// `responses[segment]`: the traces of the record's channels, at the values of `rows`; empty for a segment left out.
    pub responses: Vec<Vec<Trace>>,
    pub verdict: Verdict,
    /// How the assumed constants move the estimates (in the order of `rows`).
    pub budget: Vec<Influence>,
    /// The regression that gave the starts, if it was asked for.
    pub regression: Option<regression::Regression>,
    /// The profiles asked for, by row.
    pub profiles: Vec<Profile>,
    /// Segments that could not be used, ascending.
    pub left_out: Vec<LeftOut>,
    /// Measured outputs without a sample that is not masked, or that never change, segment by segment.
    pub doubtful: Vec<Doubtful>,
}

impl Estimation {
    /// The profile of one of the rows, if it was asked for.
    pub fn profile(&self, row: &Row) -> Option<&Profile> {
        self.profiles.iter().find(|p| self.rows.get(p.row) == Some(row))
    }

    /// What is known of an output's residuals in the group of a segment.
    pub fn scatter(&self, segment: usize, output: &str) -> Option<&OutputScatter> {
        let group = self.noise_groups.get(segment).copied().flatten()?;
        self.outputs.iter().find(|o| o.group == group && o.name == output)
    }
}
