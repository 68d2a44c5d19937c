//! A base at its fit in; what candidates are screened against out.

use crate::diagnose::residual::whitening::Noise;
use crate::diagnose::thresholds::Thresholds;
use crate::estimate::{self, Case, Segment};

/// What is screened against.
pub struct Ground<'a> {
    pub case: &'a Case,
    pub noise: &'a Noise,
    pub method: &'a estimate::Settings,
    pub theta: &'a [f64],
    /// Places of the training segments among the segments of the case.
    pub segments: &'a [usize],
    /// Shared parameters that move.
    pub free: &'a [usize],
    /// The segments of the case.
    pub of: &'a [&'a Segment],
    pub thresholds: &'a Thresholds,
    /// Of what is drawn.
    pub seed: u64,
}
