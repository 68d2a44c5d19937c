//! Nonlinear least squares over segments: what a model leaves and its sensitivities, segment by
//! segment, in; the parameters at which the likelihood is largest, the normal matrix there and the
//! history of the iteration out.
//!
//! Parameters come in two parts: those that segments share, and those that one segment has to
//! itself. The second are eliminated first, so that time and memory are linear in the number of
//! segments. The cost is `J = 1/2 sum e' R^-1 e + N/2 ln|R|` (attas A4) with `R` at its best for
//! every parameter vector, or with `R = 1` where the residuals come white. Steps of Gauss and
//! Newton, or of Levenberg and Marquardt, stay inside bounds and are taken only if they do not
//! raise the cost.
//!
//! | file | what it does |
//! |---|---|
//! | `method` | how it steps, and when it stops |
//! | `rows` | sums of products of sensitivities and residuals, eight columns at a time |
//! | `arrow` | the normal equations, every segment's own block eliminated first |
//! | `covariance` | `R` per group of segments, with floor and missing samples, and the cost at it |
//! | `layout` | parameters in two parts, their bounds and priors |
//! | `blocks` | what a segment hands over, instant by instant |
//! | `sums` | what is added over a segment, and over all of them |
//! | `problem` | the pass over all segments |
//! | `iteration` | how it went, and why it ended |
//! | `point` | cost, normal equations and the step inside the bounds at one parameter vector |
//! | `gauss` | the iteration: halving or damping, stopping |
//! | `fit` | where it ended |

mod arrow;
mod blocks;
mod covariance;
mod fit;
mod gauss;
mod iteration;
mod layout;
mod method;
mod point;
mod problem;
mod rows;
mod sums;

pub use arrow::{Arrow, Factor, Own, PIVOT, diagonal};
pub use blocks::{Block, Samples, at_instants, give_back};
#[cfg(test)]
pub use covariance::Scatter;
pub use covariance::{Covariance, Structure};
pub use fit::Fit;
pub use gauss::{brought, minimise};
pub use iteration::{Iteration, Stop};
pub use layout::{Layout, Part};
pub use method::{Method, StepControl, Undetermined};
pub use point::{cost, normal_equations, normal_matrix, stepped};
pub use problem::{Evaluate, SegmentSums, Wanted, each, segment_sums};
#[cfg(test)]
pub use problem::{pass, scatter, weighed};
