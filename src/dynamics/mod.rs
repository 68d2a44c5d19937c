//! A compiled model over a record: trajectories and exact sensitivities.
//!
//! # How a trajectory and its sensitivities are computed
//!
//! 1. *Values*: classic Runge-Kutta of fourth order on the record's grid, with as many equal
//!    sub-steps as the fastest mode asks for (`|lambda| h <= 0.5`, lambda from the compiled
//!    Jacobian). Inputs are linear between grid points (mid-step is the mean), or cubic where the
//!    record says so. Every stage's arguments are kept. A plain model (no delays, no stops) is
//!    marched through a whole chunk at once, in machine code where that is worth making.
//! 2. *Jacobians*: the non-zero entries of A = df/dx, B = df/dp and of the outputs' C, D at all
//!    stages of a chunk, evaluated over lanes of sixteen points. No sequence here, so the lanes are
//!    always full.
//! 3. *Sensitivities*: `S' = A S + B` through the same Runge-Kutta stages, so the result is the
//!    exact derivative of the computed values, not an approximation of the derivative of the true
//!    ones. Lanes are directions. Of a plain model a kernel takes a block of stages at once (S of
//!    up to four states stays in registers) and leaves S at the grid points, for the outputs'
//!    kernel; of others both go point by point.
//!
//! A chunk of grid steps goes through 1 to 3 before the next one begins: the working set stays in
//! cache, memory does not grow with the record (except for the outputs themselves, and the history
//! of delayed states).
//!
//! Delayed inputs are read from the grid by cubic interpolation (smooth in the delay), delayed
//! states from their own history by cubic Hermite interpolation; sensitivities of the history go
//! along. Within an unfinished step (delay shorter than the step) the history is extrapolated along
//! its slope.
//!
//! A state with a stop is put on it wherever it would be beyond it: in the arguments of every
//! stage, and at the end of every step. Its sensitivity there is that of the stop. So values
//! change continuously when contacts come and go with a parameter, and what other states see of it
//! is never beyond the stop. A stop may move with inputs, their past and other states; those that
//! have stops themselves are put on them first. It takes the state along, but no faster than the
//! state's `rate_max`: `x = x_0 +- R t` since the step began. So play is a state at rest between
//! two stops, and a rate limit one whose stops are where it should be: neither is stiff.
//!
//! A velocity with friction, and one whose position has a stop, is held and let go at instants that
//! are found inside a step (`contacts`): the step ends there, and another one takes its rest.
//!
//! Measured outputs keep their own time stamps: a prediction between grid points is the cubic
//! through the four nearest grid values, a fixed linear map, so values and sensitivities stay
//! exactly consistent; on a grid point it is the value itself.

mod between;
#[cfg(test)]
mod contact_tests;
mod contacts;
mod delayed;
mod evaluate;
mod few;
mod filed;
mod filter;
mod gain;
mod history;
mod innovation_slopes;
mod innovations;
mod job;
mod lead;
mod left;
mod modes;
mod numbers;
mod propagate;
mod propagator;
mod record;
mod remembered;
mod respond;
mod rows;
mod scratch;
mod sigma_filter;
mod starts;
mod step;
mod steps;
mod stiffness;
mod substeps;
mod sweep;
mod sweep_rows;
#[cfg(test)]
mod sweep_tests;
mod tableau;
#[cfg(test)]
mod taken_along_tests;
mod tangent;
mod values;

pub use filter::{Filter, Innovation, Innovations};
pub use history::value as between_samples;
pub use modes::Lost;
pub use numbers::Numbers;
pub use propagator::{Directions, Propagator, Tier};
pub use scratch::Scratch;

pub(crate) use lead::Lead;
pub use record::{Channel, Interpolation, Record};
pub use sigma_filter::{Smooth, smoothed};
pub(crate) use tableau::{AHEAD, MOST_SUBSTEPS, WEIGHT};

/// Outputs on the record's grid from its start point on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Grid {
    /// Number of points.
    pub n: usize,
    /// Values `[n][outputs of the propagator]`.
    pub y: Vec<f64>,
    /// Sensitivities `[n][outputs][directions]`; empty unless asked for.
    pub dy: Vec<f64>,
    /// States at the last point.
    pub x_end: Vec<f64>,
    /// False if a state or an output stopped being finite; what follows is NaN.
    pub finite: bool,
    /// Why, where the trajectory was given up.
    pub lost: Option<Lost>,
    /// Velocities that friction held all along: states.
    pub stuck: Vec<usize>,
}

/// Predictions at the samples of the record's channels.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Response {
    /// Per channel, per sample; NaN outside the grid.
    pub y: Vec<Vec<f64>>,
    /// Per channel `[sample][direction]`; empty unless asked for.
    pub dy: Vec<Vec<f64>>,
    pub finite: bool,
}
