//! Samples of a free response come in; period and decay of the damped sinusoid that fits them best
//! (least squares), or why they are not determined, go out.
//!
//! `y = a + exp(-s t) (b cos w t + c sin w t)`: for every pair `w`, `s` the rest is linear. A grid
//! finds the pair to begin with, a search over the four neighbours with ever smaller steps the best.

use crate::math::dense::solve;
use std::f64::consts::{LN_2, TAU};

/// Samples that the grid looks at, at most about; the search takes all of them.
const THINNED: usize = 800;
/// Periods in the record that the grid looks at: from less than one, so that a record that is too
/// short is noticed.
const CYCLES: [f64; 2] = [0.4, 30.0];
/// Distance of the grid's frequencies, in periods in the record.
const STEP: f64 = 0.2;
/// The grid's decays over the whole record.
const DECAYS: [f64; 7] = [-1.0, 0.0, 0.5, 1.0, 2.0, 4.0, 8.0];
/// Share of the variance that the sinusoid must tell, to be one.
const TOLD: f64 = 0.7;
/// Change of the logarithm of the amplitude over the record below which its rate is not determined.
const LITTLE: f64 = 0.1;

/// A damped sinusoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Oscillation {
    /// Time from peak to peak, s.
    pub period: f64,
    /// Rate of the amplitude's decay, 1/s; below zero where it grows.
    pub decay: f64,
    /// Length of the record, s.
    pub recorded: f64,
}

impl Oscillation {
    /// Share of the critical damping.
    pub fn damping_ratio(&self) -> f64 {
        let w = TAU / self.period;
        self.decay / (w * w + self.decay * self.decay).sqrt()
    }

    /// Time in which the amplitude halves, s; below zero: minus that in which it doubles.
    ///
    /// # Errors
    /// The amplitude hardly changes in the record.
    pub fn half_time(&self) -> Result<f64, String> {
        let change = self.decay * self.recorded;
        if change.abs() < LITTLE {
            return Err(format!("the amplitude changes by {:.1}% only", 100.0 * change.abs()));
        }
        Ok(LN_2 / self.decay)
    }
}

/// The damped sinusoid through samples `y` at times `t` (s, ascending), those that are not numbers
/// left out.
///
/// # Errors
/// Why there is none, in words.
pub fn oscillation(t: &[f64], y: &[f64]) -> Result<Oscillation, String> {
    let there: Vec<(f64, f64)> =
        t.iter().copied().zip(y.iter().copied()).filter(|(_, y)| y.is_finite()).collect();
    let (Some(first), Some(last)) = (there.first(), there.last()) else {
        return Err("nothing was recorded after the last input".into());
    };
    let recorded = last.0 - first.0;
    if there.len() < 10 || recorded <= 0.0 {
        return Err(format!("{} samples were recorded after the last input", there.len()));
    }
    let all: Vec<(f64, f64)> = there.iter().map(|(t, y)| (t - first.0, *y)).collect();
    let ([w, s], square, amplitude) = best(&all, recorded);
    let (periods, period) = (w * recorded / TAU, TAU / w);
    let n = all.len() as f64;
    let middle = all.iter().map(|(_, y)| y).sum::<f64>() / n;
    let whole = all.iter().map(|(_, y)| (y - middle) * (y - middle)).sum::<f64>();
    if !(square <= (1.0 - TOLD) * whole) {
        return Err("what follows the last input is no damped oscillation".into());
    }
    if periods < 1.0 {
        return Err(format!("{recorded:.1} s after the last input are less than one period"));
    }
    // Beyond its first period it has to be seen above what is left.
    if amplitude * libm::exp(-s * period) < 2.0 * (square / n).sqrt() {
        return Err("the oscillation is lost within its first period".into());
    }
    Ok(Oscillation { period, decay: s, recorded })
}

/// Frequency (rad/s) and decay (1/s) of the least sum of squares, that sum, and the amplitude at the
/// beginning.
fn best(all: &[(f64, f64)], recorded: f64) -> ([f64; 2], f64, f64) {
    let few: Vec<(f64, f64)> =
        all.iter().copied().step_by(all.len().div_ceil(THINNED).max(1)).collect();
    // Not above half of what the thinned samples can tell.
    let most = CYCLES[1].min(few.len() as f64 / 4.0);
    let count = ((most - CYCLES[0]) / STEP).max(0.0) as usize;
    let (mut at, mut least) = ([TAU / recorded, 0.0], f64::INFINITY);
    for i in 0..=count {
        let w = TAU * (CYCLES[0] + STEP * i as f64) / recorded;
        for decay in DECAYS {
            let pair = [w, decay / recorded];
            let square = left(&few, pair).0;
            if square < least {
                (at, least) = (pair, square);
            }
        }
    }
    let (mut step, mut now) = ([0.5 * TAU * STEP / recorded, 0.5 / recorded], left(all, at));
    while step[0] > 1e-7 * at[0] {
        let moves = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
        let moved = moves.map(|m| [at[0] + m[0] * step[0], at[1] + m[1] * step[1]]);
        let found = moved
            .into_iter()
            .filter(|pair| pair[0] > 0.0)
            .map(|pair| (pair, left(all, pair)))
            .min_by(|a, b| a.1.0.total_cmp(&b.1.0));
        match found {
            Some((pair, one)) if one.0 < now.0 => (at, now) = (pair, one),
            _ => step = step.map(|s| 0.5 * s),
        }
    }
    (at, now.0, now.1)
}

/// Sum of squares that the best `a`, `b`, `c` leave at a pair, and the amplitude at the beginning.
fn left(all: &[(f64, f64)], [w, s]: [f64; 2]) -> (f64, f64) {
    let basis = |t: f64| {
        let e = libm::exp(-s * t);
        [1.0, e * libm::cos(w * t), e * libm::sin(w * t)]
    };
    let (mut normal, mut right) = ([0.0; 9], [0.0; 3]);
    for (t, y) in all {
        let f = basis(*t);
        for i in 0..3 {
            right[i] += f[i] * y;
            (0..3).for_each(|j| normal[3 * i + j] += f[i] * f[j]);
        }
    }
    let Some(x) = solve(&normal, 3, &right) else { return (f64::INFINITY, 0.0) };
    let error = |(t, y): &(f64, f64)| {
        let f = basis(*t);
        y - (x[0] * f[0] + x[1] * f[1] + x[2] * f[2])
    };
    let square = all.iter().map(|one| error(one) * error(one)).sum::<f64>();
    if square.is_finite() {
        (square, (x[1] * x[1] + x[2] * x[2]).sqrt())
    } else {
        (f64::INFINITY, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `n` samples over `length` seconds, with noise of a made-up but fixed sequence.
    fn record(length: f64, n: usize, period: f64, decay: f64, noise: f64) -> [Vec<f64>; 2] {
        let t: Vec<f64> = (0..n).map(|k| 7.0 + length * k as f64 / (n - 1) as f64).collect();
        let mut state = 1u64;
        let y = t.iter().map(|t| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let uniform = (state >> 33) as f64 / f64::from(1u32 << 31) - 0.5;
            let tau = t - 7.0;
            0.3 + 0.1 * libm::exp(-decay * tau) * libm::cos(TAU * tau / period + 0.4)
                + noise * uniform
        });
        let y = y.collect();
        [t, y]
    }

    #[test]
    fn period_and_decay_are_those_it_was_made_with() {
        for (period, decay) in [(4.0, 0.1), (4.0, 0.0), (3.1, -0.05), (9.0, 0.2), (0.9, 0.5)] {
            let [t, y] = record(12.0, 600, period, decay, 0.0);
            let found = oscillation(&t, &y).expect("determined");
            assert!((found.period / period - 1.0).abs() < 1e-4, "{period} {decay}: {found:?}");
            assert!((found.decay - decay).abs() < 1e-4, "{period} {decay}: {found:?}");
            let w = TAU / period;
            let ratio = decay / (w * w + decay * decay).sqrt();
            assert!((found.damping_ratio() - ratio).abs() < 1e-4);
        }
    }

    #[test]
    fn noise_and_missing_samples_move_it_little() {
        let [t, mut y] = record(20.0, 2000, 5.0, 0.08, 0.02);
        (300..500).for_each(|k| y[k] = f64::NAN);
        let found = oscillation(&t, &y).expect("determined");
        assert!((found.period - 5.0).abs() < 0.03 && (found.decay - 0.08).abs() < 0.005);
        assert!((found.half_time().expect("it decays") - LN_2 / 0.08).abs() < 0.6);
    }

    #[test]
    fn what_is_not_recorded_is_not_determined() {
        let why = |[t, y]: [Vec<f64>; 2]| oscillation(&t, &y).expect_err("not determined");
        let short = why(record(6.0, 300, 10.0, 0.05, 0.0));
        assert!(short.contains("less than one period"), "{short}");
        let noise = why(record(12.0, 600, 4.0, 0.1, 3.0));
        assert!(noise.contains("no damped oscillation"), "{noise}");
        let gone = why(record(12.0, 600, 4.0, 2.0, 0.02));
        assert!(gone.contains("within its first period"), "{gone}");
        assert!(why([Vec::new(), Vec::new()]).contains("nothing was recorded"));
        let [t, y] = record(12.0, 600, 4.0, 0.001, 0.0);
        let steady = oscillation(&t, &y).expect("it has a period");
        assert!(steady.half_time().expect_err("too little").contains("1.2% only"));
    }
}
