//! Where a filter is, and where it linearises.

use crate::math::simd::Aligned;

/// Where a filter is: time, mean, covariance, and the next sample of everything.
#[derive(Debug, Clone, Default)]
pub struct State {
    pub t: f64,
    /// States, then free parameters.
    pub x: Vec<f64>,
    /// `[n][m]`.
    pub p: Aligned,
    /// The last sample of every clock at or before `t`.
    pub clocks: Vec<usize>,
    /// The next sample of every packet.
    pub packets: Vec<usize>,
    /// Nodes before this one.
    pub node: usize,
}

impl State {
    pub fn finite(&self) -> bool {
        self.x.iter().chain(self.p.iter()).all(|v| v.is_finite())
    }
}

/// Where a filter linearises; without one it does so where it is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct About {
    /// The smoothed means of an earlier run over the first nodes, `[node][n]`.
    pub means: Vec<f64>,
    /// Beyond those, where the filter knows its states: sensor errors as an earlier run found them,
    /// `[n]` (the states are not read). NaN, or nothing: what the filter has.
    pub known: Vec<f64>,
}

impl About {
    /// The point of linearisation of a filter at `state` with `nx` states.
    pub fn at(&self, state: &State, nx: usize, out: &mut [f64]) {
        let n = out.len();
        if let Some(means) = self.means.get(state.node * n..(state.node + 1) * n) {
            out.copy_from_slice(means);
            return;
        }
        out.copy_from_slice(&state.x);
        for (x, known) in
            out.iter_mut().zip(&self.known).skip(nx).filter(|(_, known)| known.is_finite())
        {
            *x = *known;
        }
    }
}
