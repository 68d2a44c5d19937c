//! Residuals of a base fit in; their noise, and what they respond to, out.

pub mod absorbed;
pub mod colour;
pub mod columns;
pub mod evaluation;
pub mod gain;
pub mod innovation;
pub mod instants;
pub mod joint;
pub mod lagged;
pub mod located;
pub mod partly;
pub mod responses;
pub mod signals;
pub mod sources;
pub mod sums;
pub mod timescale;
pub mod whitening;
