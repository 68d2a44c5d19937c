//! Where a model and flights disagree, and which missing effect explains it: a base model, maneuvers and candidate effects in; a verdict
//! with its evidence out. Numbers in, numbers out; how the flights were made is never known here.
//!
//! # How a verdict comes about
//!
//! 0. *Together*: what a pipeline estimates maneuver by maneuver, or flight by flight, becomes one estimation over all of them that claims the
//!    same: lines where the pipeline fits lines, one value each where it does not.
//! 1. *Base fit* of the training maneuvers by the estimator; an autoregressive model per output of what is left. `W` makes residuals and
//!    sensitivities white, segment by segment; `J = |W (z - y)|^2 / 2` is the cost everything below is measured in, so that differences
//!    of `J` are gains in log-likelihood.
//! 2. *Screening*: every candidate adds parameters `b` that are nothing at their null. With `H = W dy/db` and `G = W dy/dtheta` of all
//!    that is free in the base (shared parameters and what belongs to a maneuver), `H~ = (1 - G (G'G)^-1 G') H`, `u = H~'e`,
//!    `F = H~'H~`: the gain is `u'F^-1 u / 2` (score test), within the candidate's bounds. Where `H~` vanishes, the base absorbs the effect
//!    and it is no candidate.
//! 3. *Luck*: surrogate campaigns in which nothing is missing have `u ~ N(0, F)` for all candidates at once. The best candidate of each
//!    is noted; the 99% quantile is what a real one must exceed (gains less half the 99% quantile of chi-square for its number of parameters).
//! 4. *Refits* in full of the few best, with everything free; held-out maneuvers then, all derivatives frozen: the effect predicts
//!    the gain `d'd/2` from the whitened difference `d` of the two predictions, and has to bring it.
//! 5. *Evidence* of a candidate: gain of the training less luck, plus the gain realised on held-out maneuvers. Those that pass every
//!    test and come within `apart` of the best are not told from it (further, where the difference scatters more than noise lets it). Errors of
//!    sensors come before physics among equals.
//! 6. *Addition*: the best is added to the model, and all of it begins again, until nothing passes; then each one is taken out again and
//!    tested with everything else in place.
//! 7. *What is left* is asked without any candidate: does an output still answer to an input? Is a held-out maneuver missed by more than all
//!    others? Then something is located, not explained.
//!
//! | file | what it does |
//! |---|---|
//! | `effect` | the library of candidate effects and their attachment to a model |
//! | `settings` | how a diagnosis is run |
//! | `thresholds` | all numbers that decide |
//! | `together` | what a pipeline estimates one by one, as one estimation over all maneuvers |
//! | `timescale` | how fast the motion is: what lags, windows and bands are counted in |
//! | `looks` | windows and bands of the description of the gap |
//! | `noise` | the colour of the base's residuals, and whitening by it |
//! | `absorbed` | what the fit took of it |
//! | `joint` | what several outputs' residuals have in common |
//! | `base` | the base as it stands with what was added, its fit |
//! | `fit` | maximum of the likelihood of the whitened residuals, bounds kept |
//! | `probe` | a candidate's sensitivities where the base stands |
//! | `screen` | score tests of all candidates |
//! | `surrogate` | what luck gains |
//! | `refit` | a candidate in full, and on held-out maneuvers |
//! | `held_out` | which maneuvers are held out |
//! | `sources` | what an output may answer to |
//! | `located` | whether an output still answers to a source |
//! | `innovation` | whether a source foretells what is new in an output at each instant |
//! | `unseen` | held-out maneuvers that show what no other does |
//! | `decide` | the tests that a candidate must pass, and the class of those that pass alike |
//! | `found` | the base fitted as it stands |
//! | `round` | all candidates held against a base |
//! | `search` | round after round, forward and back; the verdict |
//! | `gaps` | how large the gap is, and where |
//! | `driven` | what goes away when a loop is closed by its measurement; what each rate equation lacks |
//! | `coefficient` | what each force and moment coefficient lacks, with its uncertainty |
//! | `relation` | correlation, lag and coherence of the residuals with what moves them |
//! | `closing`, `closure` | the gap before and after, and what the addition did to the other parameters |

pub mod effect;

mod absorbed;
mod base;
mod closing;
mod closure;
mod coefficient;
mod decide;
mod driven;
mod fit;
mod found;
mod gaps;
mod held_out;
mod innovation;
mod joint;
mod located;
mod looks;
mod noise;
mod probe;
mod refit;
mod relation;
mod round;
mod screen;
mod search;
mod settings;
mod sources;
mod surrogate;
#[cfg(test)]
mod tests;
pub mod thresholds;
mod timescale;
mod together;
mod unseen;

use crate::estimate::{self, Segment};
use crate::model::Model;

pub use closure::{Channel, Match, Overlay, Shift};
pub use decide::Standing;
pub use driven::{Driven, EquationError};
pub use gaps::Gap;
pub use held_out::{Rule, cut, held_out};
pub use located::Located;
pub use refit::{Consistency, Refit};
pub use relation::Relation;
pub use screen::Screened;
pub use search::diagnose;
pub use settings::{Base, Settings};
pub use thresholds::Thresholds;
pub use together::{Claim, Fitted, together};
pub use unseen::Missed;

/// What is diagnosed.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// The base model, as its file says it (without the shifts that `method` asks for).
    pub model: &'a Model,
    pub segments: &'a [Segment],
    /// Which of them are held out.
    pub held_out: &'a [bool],
    /// How the base is estimated.
    pub method: &'a estimate::Settings,
    /// Who plays which role in the model.
    pub context: &'a effect::Context,
    pub settings: &'a Settings,
}

/// One added parameter after a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    pub name: String,
    /// SI unit.
    pub unit: String,
    pub value: f64,
    /// Under the noise of the base fit; none where it is held or the data do not determine it.
    pub sd: Option<f64>,
    /// The value at which it is nothing; none for a shape.
    pub null: Option<f64>,
    /// How wide an interval physics and the flights allow a shape; infinite where neither says.
    pub span: f64,
    /// It sits on a physical bound.
    pub at_bound: bool,
    /// It was not fitted.
    pub held: bool,
    /// There is one for every maneuver; `value` is the largest.
    pub own: bool,
    /// Share of its information that is left once everything else is unknown too.
    pub left: Option<f64>,
    /// What physics expects: in words, the value, and within what share of it.
    pub check: Option<(String, f64, f64)>,
    /// The flights say what it is.
    pub is_determined: bool,
}

impl Value {
    /// With whether it is determined: a size is where its sd is a small share of it; a shape where its interval (2 sd) is narrower than what
    /// physics and the flights allow it.
    fn judged(mut self, thresholds: &Thresholds) -> Value {
        self.is_determined = self.held
            || match (self.sd, self.null) {
                (None, _) => false,
                (Some(sd), Some(null)) => sd < thresholds.relative_sd * (self.value - null).abs(),
                (Some(sd), None) => thresholds.shape_sds * sd < self.span,
            };
        self
    }
}

/// Gain in log-likelihood of one maneuver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// Index among the segments of the subject.
    pub segment: usize,
    /// What the effect predicts; NaN for a training maneuver.
    pub predicted: f64,
    pub realised: f64,
}

/// One candidate in one round.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    pub name: String,
    pub effect: String,
    pub family: effect::Family,
    pub sentence: String,
    pub signature: String,
    /// The maneuver that would tell it from its rivals, in words.
    pub separate: String,
    pub screened: Screened,
    /// Gain of the screening less luck: what is compared with the round's limit.
    pub score: f64,
    pub refit: Option<Refit>,
    /// Log-likelihood for it, training and held out, less luck; NaN without a refit.
    pub evidence: f64,
    pub standing: Standing,
    /// The standing in words, with its figures.
    pub why: String,
}

/// One round: a base fit and all candidates held against it.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// What the best candidate's score must exceed.
    pub limit: f64,
    pub judged: Vec<Judged>,
    /// Those that pass alike, best evidence first; the first one is added.
    pub class: Vec<usize>,
    /// Outputs that answer to a source in this round's base.
    pub located: Vec<Located>,
    /// Candidates that this round's base has already.
    pub base: Vec<String>,
    /// It tests one effect with all others in place; otherwise it looks for the next.
    pub strict: bool,
}

/// An effect that is missing: the round that tested it, and its place there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Finding {
    pub round: usize,
    /// The candidate that was added; those of the round's class explain the flights as well.
    pub added: usize,
}

/// Why a diagnosis could not be carried through.
#[derive(Debug, Clone, PartialEq)]
pub enum Trouble {
    /// The base does not run or cannot be fitted; why.
    Base(String),
    /// There are no maneuvers to hold out, or none to train on.
    Segments(String),
}

/// What is known in the end.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Every effect added stands alone; what is left is noise, or little against what was explained (`Diagnosis::complete`).
    Named,
    /// The same, but at least one cannot be told from others.
    OneOfThese,
    /// Outputs answer to inputs and no candidate explains it, or not all of it.
    Located,
    NothingMissing,
    /// No verdict.
    None(Trouble),
}

impl Verdict {
    /// The stable text that tables carry.
    pub fn as_str(&self) -> &'static str {
        match self {
            Verdict::Named => "named",
            Verdict::OneOfThese => "one of these",
            Verdict::Located => "located but unexplained",
            Verdict::NothingMissing => "nothing missing",
            Verdict::None(_) => "no verdict",
        }
    }
}

/// The result.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    pub verdict: Verdict,
    /// Nothing is left that answers to an input.
    pub complete: bool,
    pub rounds: Vec<Round>,
    /// One per effect named.
    pub findings: Vec<Finding>,
    /// Candidates that are in the model and explain most of something, but are contradicted, and why.
    pub doubts: Vec<(String, String)>,
    /// What was added, in order: the candidates as they stand in the model.
    pub added: Vec<effect::Candidate>,
    /// Values of the added parameters in the last fit, with everything free.
    pub values: Vec<(String, f64)>,
    /// Outputs that still answer to a source in the end.
    pub located: Vec<Located>,
    /// Held-out maneuvers that show more than the training ones do, in the end.
    pub missed: Vec<Missed>,
    /// Effects of the library that could not be attached to this model, and why.
    pub skipped: Vec<(String, String)>,
    pub closing: Closing,
}

impl Diagnosis {
    /// Whether effects are named: what is only located makes no model.
    pub fn is_named(&self) -> bool {
        matches!(self.verdict, Verdict::Named | Verdict::OneOfThese)
    }
}

/// Where the gap is, and what the additions did to it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Closing {
    pub gaps_before: Vec<Gap>,
    pub gaps_after: Vec<Gap>,
    pub channels: Vec<Channel>,
    pub overlays: Vec<Overlay>,
    pub shifts: Vec<Shift>,
    /// Of the base, before anything was added.
    pub relations: Vec<Relation>,
    pub driven: Vec<Driven>,
    pub equations: Vec<EquationError>,
}
