//! Simulated and flown input channels in; whether the maneuvers on them, and only those, are found
//! out.

mod data;
mod edits;
mod flown;
mod simulated;
mod sweeps;
