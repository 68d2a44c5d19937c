//! Estimates with standard deviations at values of a variable in, straight lines with honest bands
//! out.

mod line;

pub use line::{Band, LineFit, Settings, Unfit, bands, carried, correlated, correlations, line};
