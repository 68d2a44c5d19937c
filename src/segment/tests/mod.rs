//! Simulated and flown input channels in; whether the maneuvers on them, and only those, are found
//! out.

mod data;
mod edits;
mod flown;
mod simulated;
mod sweeps;

use super::{Maneuver, Settings, search};

/// The maneuvers on a channel.
fn find(t: &[f64], u: &[f64], settings: &Settings) -> Vec<Maneuver> {
    search(t, u, settings).maneuvers
}
