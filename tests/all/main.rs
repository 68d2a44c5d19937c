//! One integration-test binary: linking is the hidden cost of many.

mod floors;
mod language;
mod models;
