//! One stretch of flight as a model sees it: inputs on a uniform grid, measured outputs at their
//! own times.

use super::numbers::Numbers;
use crate::math::median;

/// What was measured of one model output, at its own time stamps.
#[derive(Debug, Clone, Default, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Channel {
    /// Index into the model's outputs.
    pub output: usize,
    /// Seconds, on the clock of the record's grid; ascending.
    pub t: Numbers,
    /// Values in SI; NaN marks a masked sample.
    pub z: Numbers,
}

impl Channel {
    /// The usual time between two samples, s; not a number where there are none.
    pub fn spacing(&self) -> f64 {
        median(&self.t.windows(2).map(|w| w[1] - w[0]).collect::<Vec<f64>>())
    }

    /// The same in steps of a grid, one at least.
    pub fn every(&self, dt: f64) -> usize {
        (self.spacing() / dt).round().max(1.0) as usize
    }
}

/// How inputs run between two grid points.
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    serde::Deserialize,
    serde::Serialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// Straight: the value at mid-step is the mean of both ends.
    #[default]
    Linear,
    /// A smooth cubic through the neighbours: better for measured signals that are smooth, wrong
    /// for steps.
    Cubic,
    /// The last value until the next one: for commands, which are steps. A `delay()` of it reads the smooth
    /// cubic half a step of the grid later, so that the delay has a gradient: a value that holds from one
    /// point to the next stands in the middle between them.
    Hold,
    /// Straight lines, which a `delay()` reads too, where it reads a smooth cubic otherwise: for commands made
    /// of ramps, whose corners a cubic overshoots.
    Ramps,
}

/// Inputs on a uniform grid and what was measured meanwhile.
#[derive(Debug, Clone, Default, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct Record {
    /// Time of grid point 0, s.
    pub t0: f64,
    /// Grid spacing, s.
    pub dt: f64,
    /// Number of grid points.
    pub n: usize,
    /// Inputs `[n][nu]`, row by row, in the order of the model's inputs.
    pub inputs: Numbers,
    /// The grid point where the states start; the points before it only feed delays (pre-roll).
    pub start: usize,
    /// The channels scored, in the order of the model's outputs; outputs that are not measured are
    /// absent.
    pub channels: Vec<Channel>,
    /// How each input runs between grid points; those that are not listed are linear.
    pub interpolation: Vec<Interpolation>,
    /// Time between two samples of what each input was brought to the grid from, s; NaN where nobody
    /// knows. Those that are not listed were sampled at the grid points.
    pub spacings: Vec<f64>,
    /// Integration steps per grid step; 0 lets the model's Jacobian decide along the way.
    pub substeps: usize,
}

/// A sample's prediction as a combination of grid values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// First grid point (counted from the record's start point).
    pub first: usize,
    /// How many of the weights count.
    pub len: usize,
    pub w: [f64; 4],
}

impl Weights {
    /// The combination of values at grid points.
    pub fn value(&self, at: impl Fn(usize) -> f64) -> f64 {
        (0..self.len).map(|k| self.w[k] * at(self.first + k)).sum()
    }
}

/// A sample so near a point of the grid, in steps of it, is at the point.
const AT_POINT: f64 = 1e-6;

impl Record {
    /// How far behind its grid point a value of input `j` stands where the input is read as a smooth curve,
    /// in steps of the grid.
    pub fn behind(&self, j: usize) -> f64 {
        match self.interpolation.get(j) {
            Some(Interpolation::Hold) => 0.5,
            _ => 0.0,
        }
    }

    /// Where the samples of a channel lie on the grid, to `places`; false, and none there, where there is one at
    /// every grid point from the start point on.
    pub fn sampling(&self, channel: &Channel, places: &mut Vec<Option<Weights>>) -> bool {
        let n = self.n.saturating_sub(self.start);
        let there = |(k, &t): (usize, &f64)| (self.place(t) - k as f64).abs() < AT_POINT;
        let is_grid = channel.t.len() == n && channel.t.iter().enumerate().all(there);
        places.clear();
        if !is_grid {
            places.extend(channel.t.iter().map(|&t| self.weights(t)));
        }
        !is_grid
    }

    /// Steps of the grid from the start point to time `t`.
    fn place(&self, t: f64) -> f64 {
        (t - self.t0) / self.dt - self.start as f64
    }

    /// Weights of the grid values for time `t`; `None` outside the grid.
    pub fn weights(&self, t: f64) -> Option<Weights> {
        let n = self.n.saturating_sub(self.start);
        let at = self.place(t);
        let nearest = at.round();
        if (at - nearest).abs() < AT_POINT && nearest >= 0.0 && (nearest as usize) < n {
            return Some(Weights { first: nearest as usize, len: 1, w: [1.0, 0.0, 0.0, 0.0] });
        }
        if !(at >= 0.0 && at <= (n as f64) - 1.0) {
            return None;
        }
        let left = at.floor() as usize;
        if n < 4 {
            let f = at - left as f64;
            return Some(Weights { first: left, len: 2, w: [1.0 - f, f, 0.0, 0.0] });
        }
        let first = left.saturating_sub(1).min(n - 4);
        let s = at - first as f64;
        // Lagrange's cubic through points 0, 1, 2, 3
        let (a, b, c, d) = (s, s - 1.0, s - 2.0, s - 3.0);
        Some(Weights {
            first,
            len: 4,
            w: [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0],
        })
    }

    /// First finite measured value of an output.
    pub fn first_measured(&self, output: usize) -> Option<f64> {
        self.channels.iter().find(|c| c.output == output)?.z.iter().copied().find(|z| z.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_interpolated_exactly() {
        let record = Record { t0: 2.0, dt: 0.5, n: 20, start: 3, ..Default::default() };
        let f = |t: f64| 1.0 + t - 0.3 * t * t + 0.1 * t * t * t;
        for t in [3.5, 3.6, 3.75, 5.3, 10.9, 11.4, 11.5] {
            let w = record.weights(t).unwrap();
            let value: f64 =
                (0..w.len).map(|k| w.w[k] * f(2.0 + 0.5 * (3 + w.first + k) as f64)).sum();
            assert!((value - f(t)).abs() < 1e-9, "{t}");
        }
        assert!(record.weights(3.4).is_none());
        assert!(record.weights(11.6).is_none());
        assert_eq!(record.weights(4.0).unwrap().len, 1);
    }

    #[test]
    fn places_of_one_channel_leave_nothing_in_those_of_the_next() {
        let record = Record { t0: 2.0, dt: 0.5, n: 20, start: 3, ..Default::default() };
        let mut places = Vec::new();
        for (n, from, by) in
            [(40, 3.2, 0.21), (7, 2.0, 0.9), (17, 3.5, 0.5), (0, 0.0, 1.0), (25, 3.5, 0.5)]
        {
            let t: Vec<f64> = (0..n).map(|k| from + by * f64::from(k)).collect();
            let channel = Channel { t: t.clone().into(), ..Default::default() };
            let is_grid = (n, from, by) == (17, 3.5, 0.5);
            assert_eq!(record.sampling(&channel, &mut places), !is_grid, "{n}");
            let want: Vec<Option<Weights>> = t.iter().map(|&t| record.weights(t)).collect();
            assert_eq!(places, if is_grid { Vec::new() } else { want }, "{n}");
        }
    }
}
