//! One output of one segment: what was measured, and what the model says at the same times.

use crate::dynamics::Numbers;

/// Measured and modelled values of one output in one segment.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trace {
    /// Index into the model's outputs.
    pub output: usize,
    pub name: String,
    pub unit: String,
    /// Time stamps of the measurement, s.
    pub t: Numbers,
    /// As measured; NaN where masked.
    pub measured: Numbers,
    pub modelled: Vec<f64>,
    /// Standard deviation that the sensor's noise has in `measured`, where that was filtered.
    pub noise: Option<f64>,
    /// Where `modelled` is what a filter predicts from all samples before.
    pub filtered: Option<Filtered>,
}

/// What a filter says beside its predictions one sample ahead, at the same times.
#[derive(Debug, Clone, PartialEq)]
pub struct Filtered {
    /// Standard deviation of the innovation; NaN where nothing was measured.
    pub sd: Vec<f64>,
    /// The motion by itself, from its start, without noise and without a look at the measurements.
    pub simulated: Vec<f64>,
    /// Standard deviation of what the noise of the states and a start in doubt add to it.
    pub simulated_sd: Vec<f64>,
}
