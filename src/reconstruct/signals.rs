//! What was measured of a flight, as it is handed from one step to the next.

use std::borrow::Cow;

/// A measured signal: ascending times in s, values in SI.
pub type Series<'a> = (&'a [f64], &'a [f64]);

/// A measured output of the model: ascending times in s; values in SI, NaN where masked, angles
/// without jumps of a whole turn.
#[derive(Debug, Clone)]
pub struct Logged<'a> {
    pub output: usize,
    pub t: &'a [f64],
    pub z: Cow<'a, [f64]>,
}
