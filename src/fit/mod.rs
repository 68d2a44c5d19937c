//! Estimates with standard deviations at values of a variable in, straight lines with honest bands
//! out.

mod bands;
mod line;
mod repeats;
mod together;
mod weights;

pub use bands::{Band, bands, half_95};
pub use line::{LineFit, Points, Settings, Unfit, carried, line};
pub use repeats::{Repeats, repeats};
pub use together::correlations;
pub use weights::Shared;
