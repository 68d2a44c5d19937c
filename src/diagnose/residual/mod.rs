//! Residuals of a base fit in; their noise, and what they answer to, out.

pub mod absorbed;
pub mod answers;
pub mod colour;
pub mod gain;
pub mod innovation;
pub mod instants;
pub mod joint;
pub mod located;
pub mod noise;
pub mod partly;
pub mod sources;
pub mod sums;
pub mod timescale;
