//! The numbers of the integration: the stages of a Runge-Kutta step, and how stiff a step may be.

/// Largest |lambda| h of a step.
pub(super) const STIFF: f64 = 0.5;
/// More sub-steps than this would not end: the trajectory is given up as not finite.
pub(crate) const MOST_SUBSTEPS: usize = 256;

/// The tableau: where a stage is in the step, its weight times six, and how far its rate leads to
/// the next stage's state.
pub(super) const OFFSET: [f64; 4] = [0.0, 0.5, 0.5, 1.0];
pub(crate) const WEIGHT: [f64; 4] = [1.0, 2.0, 2.0, 1.0];
pub(crate) const AHEAD: [f64; 4] = [0.5, 0.5, 1.0, 0.0];
