//! What a full fit found of one parameter, or gained in one maneuver, in; whether the flights
//! determine it, out.

use crate::diagnose::thresholds::Thresholds;
use crate::estimate::Label;

/// One added parameter after a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// What it is.
    pub doc: String,
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
    /// Of one that differs by a column: where it has this value, the furthest from null in its sd.
    pub of: Option<Label>,
    /// And the value of that column in which it is held at null, if there is one.
    pub from: Option<String>,
    /// Share of its information that is left once everything else is unknown too.
    pub left: Option<f64>,
    /// What physics expects: in words, the value, and within what share of it.
    pub check: Option<(String, f64, f64)>,
    /// The flights say what it is.
    pub is_determined: bool,
}

impl Value {
    /// With whether it is determined: a size is where its sd is a small share of it; a shape where
    /// its interval (2 sd) is narrower than what physics and the flights allow it.
    pub fn judged(mut self, thresholds: &Thresholds) -> Value {
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
