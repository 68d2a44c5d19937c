//! The result of an estimation: the estimates with their uncertainty, how they were found, and what
//! was left out.

use super::budget::Influence;
use super::chords::Chords;
use super::coarse::Coarse;
use super::decision::Decision;
use super::edges::Edges;
use super::influential::Influential;
use super::modes::Mode;
use super::noisy_inputs::NoisyInputs;
use super::preroll::TooShort;
use super::profile::Profile;
use super::ramps::Ramps;
use super::rank::Verdict;
use super::reached::Reached;
use super::regression;
use super::segment::Label;
use super::skewed::Skewed;
use super::solution::NoisyStarts;
use super::terms::Step;
use super::trace::Trace;
use crate::least_squares::{Iteration, Stop};
use crate::noise::Modelled;

/// A segment that was not used, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// Index of the record.
    pub segment: usize,
    pub why: String,
}

/// A measured output of a segment that says little or nothing, and why. It is scored all the same,
/// as far as it has samples.
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
    /// The segment (index of the record) it belongs to; none for a value common to all, or to a
    /// group.
    pub segment: Option<usize>,
    /// The group of segments it belongs to; none for a value common to all, or of one segment.
    pub group: Option<Label>,
    /// Estimate; where the iteration did not converge, the best point reached.
    pub value: f64,
    /// Standard deviation that allows for coloured residuals; none unless converged, or on a bound.
    pub sd: Option<f64>,
    /// Cramer-Rao bound: the standard deviation if the residuals were white; none like `sd`.
    pub sd_crlb: Option<f64>,
    /// `sd` with the sd of the constants that the model assumes (`Estimation::budget`); none like
    /// `sd`.
    pub sd_total: Option<f64>,
    /// Ends of the interval from the likelihood's profile; none unless asked for, or open on that
    /// side.
    pub lower: Option<f64>,
    pub upper: Option<f64>,
    /// Where the iteration started.
    pub start: f64,
    /// The estimate sits on a bound of the model file; the other parameters' `sd` hold for it fixed
    /// there.
    pub at_bound: bool,
    /// No output notices it: it is held at its start, and the other parameters' `sd` hold for that.
    pub idle: bool,
}

/// Correlation of two estimates, `rows[a]` and `rows[b]`, `a < b`. Pairs from two different
/// segments are left out: they are correlated only through the common parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlation {
    pub a: usize,
    pub b: usize,
    /// With coloured residuals allowed for (belongs to `sd`).
    pub value: f64,
    /// Belongs to `sd_crlb`.
    pub crlb: f64,
}

/// What is known of one output's residuals over all segments that share an `R`.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputScatter {
    pub name: String,
    pub unit: String,
    /// The group of segments; 0 where all share one `R`.
    pub group: usize,
    /// Variance `R_jj` (`sum e^2 / N_j` unless it is on its floor, or fitted together with others),
    /// unit squared.
    pub r: f64,
    /// Samples scored, N_j.
    pub count: usize,
    /// Samples masked (not a number), not scored.
    pub masked: usize,
    /// Correlation of the noise with that of each output in the list; empty where outputs count as
    /// independent.
    pub correlation: Vec<f64>,
    /// The autoregressive model of the noise behind the residuals; none unless converged.
    pub colour: Option<Modelled>,
}

/// The result of one estimation, over one or several segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimation {
    pub stop: Stop,
    /// Parameters common to all segments or a group of them first, in the model's order; then,
    /// segment by segment, its parameters and initial states. Segments left out have none.
    pub rows: Vec<Row>,
    pub correlations: Vec<Correlation>,
    pub iterations: Vec<Iteration>,
    /// Determinant of `R`; of several groups of segments the geometric mean, weighted with their
    /// samples.
    pub det_r: f64,
    /// The scored outputs, in the model's order, for every group of segments with an `R` of its
    /// own.
    pub outputs: Vec<OutputScatter>,
    /// Group of every segment; none for one left out.
    pub noise_groups: Vec<Option<usize>>,
    /// `responses[segment]`: the traces of the record's channels, at the values of `rows`; empty
    /// for a segment left out.
    pub responses: Vec<Vec<Trace>>,
    pub verdict: Verdict,
    /// How the assumed constants move the estimates (in the order of `rows`).
    pub budget: Vec<Influence>,
    /// The regression that gave the starts, if it was asked for.
    pub regression: Option<regression::Regression>,
    /// The profiles asked for, by row.
    pub profiles: Vec<Profile>,
    /// The modes of the linearised model, segment by segment; empty unless converged.
    pub modes: Vec<Mode>,
    /// The search through the candidates, equation by equation; empty where there was none.
    pub searched: Vec<Step>,
    /// What became of the candidates: those that are held, in the order in which they were, then
    /// those that are estimated.
    pub decisions: Vec<Decision>,
    /// The colour of the residuals and what the fit absorbed of it agree with each other; false
    /// where the search for both was ended before.
    pub settled: bool,
    /// Segments that could not be used, ascending.
    pub left_out: Vec<LeftOut>,
    /// Measured outputs without a sample that is not masked, or that never change, segment by
    /// segment.
    pub doubtful: Vec<Doubtful>,
    /// Segments in which friction holds a state from beginning to end at the values of `rows`, and
    /// the state: nothing that would move it shows there.
    pub stuck: Vec<(usize, String)>,
    /// The limits of the states at the values of `rows`: where the motion reaches them, and how near
    /// it comes to the others.
    pub reached: Vec<Reached>,
    /// Limits of states that cross each other somewhere, in words.
    pub crossed: Vec<String>,
    /// Delays that reach back to before the record of a segment, whose input moves there.
    pub too_short: Vec<TooShort>,
    /// The sample on which a common parameter hangs, if it hangs on one.
    pub influential: Option<Influential>,
    /// What finer integration steps would move, where states have limits.
    pub coarse: Option<Coarse>,
    /// What the estimates owe to when inputs stepped between two of their samples.
    pub edges: Option<Edges>,
    /// What straight lines between the points of the grid move.
    pub chords: Option<Chords>,
    /// What the noise of measured inputs moves, and what it alone determines.
    pub noisy_inputs: Option<NoisyInputs>,
    /// Records that look late against the others.
    pub skewed: Option<Skewed>,
    /// What noise of the samples that states start at adds to the standard deviations.
    pub noisy_starts: Option<NoisyStarts>,
    /// Delayed inputs that run along straight lines.
    pub ramps: Option<Ramps>,
    /// Parameters whose standard deviations are too small because what is left of several outputs goes together,
    /// with the factor, the largest first.
    pub together: Vec<(String, f64)>,
    /// Parameters of the model that times of delays depend on.
    pub delaying: Vec<String>,
    /// Another start that ended elsewhere.
    pub elsewhere: Option<Elsewhere>,
    /// What became of the starts that were tried; empty where there was one.
    pub tried: Vec<Tried>,
    /// Why the model could not be run in the first of its segments, where none could be; what it means that the fit runs away.
    pub why: Option<String>,
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

/// Two minima whose costs differ by less are hardly to be told apart by the data: a likelihood ratio
/// of 20.
const CLOSE: f64 = 3.0;

/// What became of another start.
#[derive(Debug, Clone, PartialEq)]
pub struct Elsewhere {
    /// Where the iteration started that was not believed, or is worse.
    pub from: &'static str,
    /// Whether the estimate is the end of the other start.
    pub taken: bool,
    /// By how much the worse minimum is worse, `ln` of the likelihood ratio.
    pub worse: f64,
    /// Where parameters end there that differ most: name and value.
    pub ends: Vec<(String, f64)>,
}

/// What became of one start.
#[derive(Debug, Clone, PartialEq)]
pub struct Tried {
    /// The parameters tried and where they started.
    pub starts: Vec<(String, f64)>,
    pub stop: Stop,
    /// Negative log-likelihood at its end; NaN without one.
    pub cost: f64,
    /// Where the parameters tried ended.
    pub ends: Vec<f64>,
    /// Whether that is the estimate.
    pub there: bool,
}

impl Tried {
    /// Whether it is another minimum that is hardly worse than the best.
    pub fn rivals(&self, best: f64) -> bool {
        !self.there && self.stop == Stop::Converged && self.cost - best < CLOSE
    }
}
