//! Sampled signals in, signals on uniform grids, smoothed signals and derivatives out; NaN marks
//! what is not known.

pub mod adequacy;
pub mod oscillation;
pub mod resample;
pub mod robust;
pub mod round;
pub mod smooth;
pub mod spikes;
#[cfg(test)]
mod spikes_tests;
pub mod still;
pub mod trend;
