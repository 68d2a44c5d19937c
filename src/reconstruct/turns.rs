//! Body rates and attitude as they were measured, in; from sample to sample of the attitude, how far the
//! aircraft turned by it and by the gyros, out.
//!
//! Between two samples of the attitude the aircraft turns about its axes by
//!
//! ```text
//! a_p = dphi - dpsi sin(theta)
//! a_q = dtheta cos(phi) + dpsi cos(theta) sin(phi)          angles in the middle of the two
//! a_r = dpsi cos(theta) cos(phi) - dtheta sin(phi)
//! ```
//!
//! and the gyros say `g = int w dt`.

use super::signals::Series;
use crate::math::interpolate::{between, locate};

pub const GYROS: [&str; 3] = ["p_imu", "q_imu", "r_imu"];
/// Time over which the aircraft turns, s.
const TURN: f64 = 0.4;
/// Turns that are compared, at least.
pub const FEWEST: usize = 30;

/// From one sample of the attitude to the next: its end and length, s, the turns about the three axes by
/// the attitude and by the gyros, rad, and what the gyros read in the end, rad/s.
pub struct Step {
    pub t: f64,
    length: f64,
    pub attitude: [f64; 3],
    pub gyros: [f64; 3],
    pub rates: [f64; 3],
    /// Roll, pitch and heading change by so much, by the angles and by the gyros at these angles, rad.
    angles: [[f64; 3]; 2],
}

pub fn all<T>(of: [Option<T>; 3]) -> Option<[T; 3]> {
    let [a, b, c] = of;
    Some([a?, b?, c?])
}

/// Samples that are numbers, with straight lines between them, and what is below these.
struct Lines {
    t: Vec<f64>,
    y: Vec<f64>,
    sum: Vec<f64>,
}

impl Lines {
    fn new(t: &[f64], y: &[f64]) -> Lines {
        let good = || t.iter().zip(y).filter(|(_, y)| y.is_finite());
        let (t, y): (Vec<f64>, Vec<f64>) =
            (good().map(|s| *s.0).collect(), good().map(|s| *s.1).collect());
        let mut sum = vec![0.0; t.len()];
        for k in 1..t.len() {
            sum[k] = sum[k - 1] + 0.5 * (y[k - 1] + y[k]) * (t[k] - t[k - 1]);
        }
        Lines { t, y, sum }
    }

    /// The place of a time; none outside, or in a gap.
    fn place(&self, t: f64) -> Option<(usize, f64)> {
        let inside = self.t.len() > 1 && t >= self.t[0] && t <= self.t[self.t.len() - 1];
        let (k, share, _) = if inside { locate(&self.t, t) } else { return None };
        (self.t[k + 1] - self.t[k] < TURN).then_some((k, share))
    }

    fn at(&self, t: f64) -> Option<f64> {
        self.place(t).map(|(k, share)| between(self.y[k], self.y[k + 1], share))
    }

    fn integral(&self, from: f64, to: f64) -> Option<f64> {
        let (first, last) = (self.place(from)?, self.place(to)?);
        let whole = (first.0..last.0).all(|k| self.t[k + 1] - self.t[k] < TURN);
        let below = |(k, share): (usize, f64)| {
            let (h, end) = (self.t[k + 1] - self.t[k], between(self.y[k], self.y[k + 1], share));
            self.sum[k] + 0.5 * (self.y[k] + end) * share * h
        };
        whole.then(|| below(last) - below(first))
    }
}

/// The steps from sample to sample of the roll angle, in runs without a gap.
pub fn runs(gyros: [Series; 3], angles: [Series; 3]) -> Vec<Vec<Step>> {
    let rates = gyros.map(|(t, y)| Lines::new(t, y));
    let angles = angles.map(|(t, y)| Lines::new(t, y));
    let mut out: Vec<Vec<Step>> = vec![Vec::new()];
    let mut last: Option<(f64, [f64; 3])> = None;
    for &t in &angles[0].t {
        let now = all(angles.each_ref().map(|angle| angle.at(t)));
        let step = last.zip(now).and_then(|((t0, before), now)| {
            let (length, attitude) = (t - t0, turned(before, now));
            let gyros = all(rates.each_ref().map(|rate| rate.integral(t0, t)))?;
            let rates = all(rates.each_ref().map(|rate| rate.at(t)))?;
            let by_angles = [now[0] - before[0], now[1] - before[1], now[2] - before[2]];
            let angles = [by_angles, euler(before, now, gyros)];
            (length < TURN).then_some(Step { t, length, attitude, gyros, rates, angles })
        });
        match (step, out.last_mut()) {
            (Some(step), Some(run)) => run.push(step),
            _ => out.push(Vec::new()),
        }
        last = now.map(|now| (t, now));
    }
    out
}

/// Mean rates over at least `TURN`, one behind the other, of each of what a step has turned by the attitude
/// and by the gyros.
fn means(runs: &[Vec<Step>], of: impl Fn(&Step) -> [[f64; 3]; 2]) -> Vec<[[f64; 3]; 2]> {
    let mut out = Vec::new();
    for run in runs {
        let (mut length, mut sum) = (0.0, [[0.0; 3]; 2]);
        for step in run {
            length += step.length;
            let turned = of(step);
            (0..2).for_each(|by| (0..3).for_each(|i| sum[by][i] += turned[by][i]));
            if length > TURN - 1e-9 {
                out.push(sum.map(|turn| turn.map(|angle| angle / length)));
                (length, sum) = (0.0, [[0.0; 3]; 2]);
            }
        }
    }
    out
}

/// Rates about the body's axes: by the attitude, and by the gyros.
pub fn turns(runs: &[Vec<Step>]) -> Vec<[[f64; 3]; 2]> {
    means(runs, |step| [step.attitude, step.gyros])
}

/// Rates of roll angle, pitch angle and heading: by the angles, and by the gyros.
pub fn angles(runs: &[Vec<Step>]) -> Vec<[[f64; 3]; 2]> {
    means(runs, |step| step.angles)
}

/// The turn about the body's axes between two attitudes (phi, theta, psi).
pub fn turned(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    let [phi, theta] = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let (sf, cf, st, ct) = (libm::sin(phi), libm::cos(phi), libm::sin(theta), libm::cos(theta));
    [d[0] - d[2] * st, d[1] * cf + d[2] * ct * sf, d[2] * ct * cf - d[1] * sf]
}

/// What the angles change by where the body turns by `g` (`dphi = g_p + tan(theta) s`,
/// `dtheta = g_q cos(phi) - g_r sin(phi)`, `dpsi = s/cos(theta)`, `s = g_q sin(phi) + g_r cos(phi)`).
fn euler(a: [f64; 3], b: [f64; 3], g: [f64; 3]) -> [f64; 3] {
    let [phi, theta] = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    let (sf, cf, tt, ct) = (libm::sin(phi), libm::cos(phi), libm::tan(theta), libm::cos(theta));
    let s = g[1] * sf + g[2] * cf;
    [g[0] + tt * s, g[1] * cf - g[2] * sf, s / ct]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_change_by_what_the_body_turns() {
        let (a, b) = ([0.3, 0.2, 1.0], [0.31, 0.195, 1.02]);
        let back = euler(a, b, turned(a, b));
        assert!((0..3).all(|i| (back[i] - (b[i] - a[i])).abs() < 1e-12), "{back:?}");
    }
}
