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
//! | `gram` | sums of products of sensitivities and residuals, eight columns at a time |
//! | `gauss` | the iteration: step, bounds, halving or damping, stopping |
//! | `rank` | which combinations of parameters the data cannot separate |
//! | `colour` | standard deviations under coloured residuals |
//! | `sigma` | products of a segment's sensitivities with the covariance of coloured noise, and its rows made white |
//! | `solution` | the four together: estimates and covariances by parameter index |
//! | `budget` | how the constants that a model assumes move the estimates |
//! | `profile` | intervals from the likelihood's profile |
//! | `selection` | candidates that the data do not support are held, one after the other |
//! | `repeats` | scatter of repeated estimates against their standard deviations |
//! | `regression` | starting values by regression on the rate and output equations |
//! | `settings` | how an estimation is run |
//! | `choice` | settings against the model: what is free, where it starts |
//! | `prepare` | the model with shifts and feedback that the settings ask for, and records that feed it |
//! | `prepared` | the same without an estimation: a model over the segments that can be used, to be evaluated anywhere |
//! | `output_error` | a compiled model over segments, as such a problem; segments that cannot be used left out |
//! | `case` | that problem for the segments used |
//! | `result` | names put to the solution |

mod arrow;
mod budget;
mod case;
mod choice;
mod colour;
mod gauss;
mod gram;
mod noise;
mod output_error;
mod prepare;
mod prepared;
mod problem;
mod profile;
mod rank;
pub mod regression;
pub mod repeats;
mod result;
mod segment;
mod selection;
mod settings;
mod sigma;
mod solution;
#[cfg(test)]
mod tests;

use crate::noise::Modelled;

pub use budget::Influence;
pub use case::{Case, Unknown};
pub use output_error::{estimate, estimate_segments};
pub use prepare::extended;
pub use prepared::Prepared;
pub use problem::{Block, Layout, Part};
pub use profile::{End, Point, Profile};
pub use rank::{Combination, Term, Verdict};
pub use segment::{Grouping, SEGMENT, Segment, Stretch};
pub use selection::{Decision, Support};
pub use settings::{InitialFrom, Line, NoiseKind, Settings, Shifts, StartFrom, StepControl};

/// Why the iteration ended. Only `Converged` comes with standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The stopping rule holds, or nothing is gained by a step, a damped one, or their opposite: the bottom of a kink.
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
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
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
    /// The autoregressive model of the noise behind the residuals; none unless converged.
    pub colour: Option<Modelled>,
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
    /// What became of the candidates: those that are held, in the order in which they were, then those that are estimated.
    pub decisions: Vec<Decision>,
    /// The colour of the residuals and what the fit absorbed of it agree with each other; false where the search for both was ended before.
    pub settled: bool,
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
