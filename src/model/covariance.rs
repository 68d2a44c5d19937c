//! Where the covariance of the states of a filtered model stands among its states, and what is asked
//! of the noise of its outputs.

/// Where the covariance stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// States of the motion; the lower triangle of their covariance, row by row, stands behind them.
    pub motion: usize,
    /// Per output the parameter that is the standard deviation of its noise, if it is scored.
    pub sd: Vec<Option<usize>>,
}

impl Covariance {
    /// The state that is the covariance of states `i` and `j`.
    pub fn place(&self, i: usize, j: usize) -> usize {
        let (row, column) = (i.max(j), i.min(j));
        self.motion + row * (row + 1) / 2 + column
    }
}

/// An output with noise: where its standard deviation starts, and the least that it may be, SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scored {
    pub output: usize,
    pub start: f64,
    pub floor: f64,
}

/// Name of the standard deviation of an output's noise.
pub fn noise_of(output: &str) -> String {
    format!("sd_{output}")
}
