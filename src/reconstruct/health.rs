//! One logged signal by itself in; whether it is dead, frozen, saturated or has gaps out. No model
//! is asked.

use super::smoother::flight::spacing;
use crate::signal::still;

/// A run of equal samples shorter than this is never called frozen, s.
const FROZEN_S: f64 = 1.0;
/// A run is frozen where so many equal samples in a row are less likely than this, given how often
/// neighbours are equal elsewhere.
const UNLIKELY: f64 = 1e-9;
/// A signal that moved by at most so many steps of its resolution from one sample to the next may
/// as well have been still: the middle one of the last changes before a run, and what it comes away
/// with.
const STEPS: f64 = 1.5;
/// A signal whose last change before a run is this share of the usual one comes to rest.
const SLOWS: f64 = 0.5;
/// Changes before and after a run that are looked at.
const NEAR: usize = 5;
/// Equal samples in a row at the signal's largest or least value that make a stop.
const STOP: usize = 8;
/// A sample missing for more than this many usual spacings is a gap.
const GAP: f64 = 5.0;

/// What a signal shows of its sensor.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Health {
    pub samples: usize,
    /// Samples that are not numbers.
    pub masked: usize,
    /// Usual spacing, s.
    pub spacing: f64,
    /// Longest time without a sample, s, and how many gaps there are.
    pub longest_gap: f64,
    pub gaps: usize,
    /// The value never changes.
    pub dead: bool,
    /// Runs `begin..end` (indices of the series) in which the signal stands still although it moves
    /// elsewhere.
    pub frozen: Vec<std::ops::Range<usize>>,
    /// Their length together, s.
    pub frozen_s: f64,
    /// Samples in runs at the largest or least value of the signal, where these are stops.
    pub saturated: usize,
}

/// Looks at a signal with ascending times; NaN marks masked samples.
pub fn health(t: &[f64], y: &[f64]) -> Health {
    let good: Vec<usize> = (0..t.len()).filter(|&k| y[k].is_finite()).collect();
    let times: Vec<f64> = good.iter().map(|&k| t[k]).collect();
    let mut health = Health {
        samples: good.len(),
        masked: t.len() - good.len(),
        spacing: spacing(&times),
        ..Default::default()
    };
    if good.len() < 2 {
        health.dead = true;
        return health;
    }
    for pair in times.windows(2) {
        let step = pair[1] - pair[0];
        if step > GAP * health.spacing {
            health.gaps += 1;
            health.longest_gap = health.longest_gap.max(step);
        }
    }
    let runs = runs(&good, y);
    let (low, high) = good
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &k| (a.min(y[k]), b.max(y[k])));
    health.dead = low == high;
    if health.dead {
        return health;
    }
    let resolution = resolution(&good, y);
    let long = |run: &std::ops::Range<usize>| times[run.end - 1] - times[run.start] >= FROZEN_S;
    let values: Vec<f64> = good.iter().map(|&k| y[k]).collect();
    // Behind a run that lasts to the end nothing tells whether the quantity moved on: that the
    // signal flickered until then does.
    let stopped = still::longest(&times, &values).filter(|run| run.end == good.len());
    let count: usize = runs.iter().map(|r| r.len()).sum();
    // how likely so many equal samples in a row are, by how often neighbours are equal outside this
    // run
    let chance = |run: &std::ops::Range<usize>| {
        let (equal, pairs) = (count - run.len() - (runs.len() - 1), count - run.len());
        run.len() as f64 * libm::log((equal + 1) as f64 / (pairs + 2) as f64)
    };
    for (number, run) in runs.iter().enumerate() {
        let stands = y[good[run.start]];
        let excused = || {
            within_resolution(&runs, number, &good, y, resolution) && stopped.as_ref() != Some(run)
        };
        if long(run) && chance(run) < libm::log(UNLIKELY) && !excused() {
            health.frozen.push(good[run.start]..good[run.end - 1] + 1);
            health.frozen_s += times[run.end - 1] - times[run.start];
        } else if run.len() >= STOP
            && (stands == low || stands == high)
            && chance(run) < libm::log(UNLIKELY)
        {
            health.saturated += run.len();
        }
    }
    health
}

/// The step of a signal that takes few values: the lower quartile of the distances between
/// neighbouring ones. Where every sample has a value of its own that is next to nothing.
fn resolution(good: &[usize], y: &[f64]) -> f64 {
    let mut levels: Vec<f64> = good.iter().map(|&k| y[k]).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let mut steps: Vec<f64> = levels.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 4).copied().unwrap_or(0.0)
}

/// Whether a run tells no more than that the signal moved by less than it can show: it came to the
/// run step by step, and leaves it as it goes on. A sensor that stood still while its quantity
/// moved comes back with a jump.
fn within_resolution(
    runs: &[std::ops::Range<usize>],
    number: usize,
    good: &[usize],
    y: &[f64],
    resolution: f64,
) -> bool {
    let value = |run: &std::ops::Range<usize>| y[good[run.start]];
    let change = |pair: &[std::ops::Range<usize>]| (value(&pair[1]) - value(&pair[0])).abs();
    let before: Vec<f64> =
        runs[number.saturating_sub(NEAR)..=number].windows(2).map(change).collect();
    let after: Vec<f64> =
        runs[number..(number + 1 + NEAR).min(runs.len())].windows(2).map(change).collect();
    let middle = |changes: &[f64]| {
        let mut sorted = changes.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    };
    let fine = STEPS * resolution;
    // Where a recorder smooths what it holds in steps, the last change before a rest is a small
    // part of those before it.
    let slows = |usual: f64| before.last().is_some_and(|last| *last <= SLOWS * usual);
    let came = middle(&before).is_none_or(|usual| usual <= fine || slows(usual));
    let (leaves, goes_on) = (
        after.first().copied().unwrap_or(0.0),
        middle(after.get(1..).unwrap_or_default()).unwrap_or(0.0),
    );
    came && leaves <= fine.max(2.0 * goes_on)
}

/// Runs of equal samples, as ranges of positions in `good`.
fn runs(good: &[usize], y: &[f64]) -> Vec<std::ops::Range<usize>> {
    let (mut out, mut begin) = (Vec::new(), 0);
    for k in 1..=good.len() {
        if k == good.len() || y[good[k]] != y[good[begin]] {
            out.push(begin..k);
            begin = k;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(n: usize) -> (Vec<f64>, Vec<f64>) {
        let t: Vec<f64> = (0..n).map(|k| 0.01 * k as f64).collect();
        let y = t.iter().map(|t| libm::sin(3.0 * t) + 0.01 * libm::sin(1234.5 * t)).collect();
        (t, y)
    }

    #[test]
    fn a_moving_signal_is_well() {
        let (t, y) = wave(2000);
        let h = health(&t, &y);
        assert_eq!((h.dead, h.frozen.len(), h.gaps, h.saturated), (false, 0, 0, 0));
    }

    #[test]
    fn fault_a_coarse_signal_is_not_called_frozen() {
        // one step of resolution every few seconds, as a slow temperature
        let t: Vec<f64> = (0..4000).map(|k| 0.02 * k as f64).collect();
        let y: Vec<f64> = t.iter().map(|t| (2.0 * libm::sin(0.1 * t)).round() * 0.5).collect();
        assert!(health(&t, &y).frozen.is_empty());
    }

    /// Still, then a maneuver, then still, in steps of a fifth of a degree; `noise` moves it
    /// between two values now and then.
    fn coarse(noise: f64) -> (Vec<f64>, Vec<f64>) {
        let t: Vec<f64> = (0..6000).map(|k| 0.02 * k as f64).collect();
        let flown = |t: f64| {
            if (40.0..70.0).contains(&t) { 4.0 * libm::sin(1.5 * (t - 40.0)) } else { 0.0 }
        };
        let y = t
            .iter()
            .map(|&t| ((flown(t) + noise * libm::sin(1.0 + 777.7 * t)) / 0.2).round() * 0.2);
        let y = y.collect();
        (t, y)
    }

    #[test]
    fn fault_a_channel_that_holds_still_within_its_resolution_is_not_frozen() {
        for noise in [0.0, 0.05, 0.0999, 0.101] {
            let (t, y) = coarse(noise);
            let h = health(&t, &y);
            assert!(h.frozen.is_empty() && !h.dead, "{noise}: {:?}", h.frozen);
        }
    }

    #[test]
    fn fault_a_coarse_channel_that_freezes_in_a_maneuver_is_frozen() {
        let (t, mut y) = coarse(0.02);
        let held = y[2200];
        y[2200..2600].fill(held);
        let h = health(&t, &y);
        assert_eq!(h.frozen.len(), 1, "{:?}", h.frozen);
        assert!((7.9..8.2).contains(&h.frozen_s), "{}", h.frozen_s);
    }

    #[test]
    fn fault_a_coarse_channel_that_freezes_in_calm_air_is_told_by_its_jump() {
        let (t, mut y) = coarse(0.11);
        // from calm air into the maneuver
        let held = y[1700];
        y[1700..2300].fill(held);
        assert_eq!(health(&t, &y).frozen.len(), 1, "{:?}", health(&t, &y).frozen);
    }

    #[test]
    fn fault_a_coarse_noisy_channel_that_freezes_for_good_is_frozen() {
        let noise = |k: usize| {
            libm::sin(1.0 + 777.7 * 0.02 * k as f64) + libm::sin(2.0 + 1234.5 * 0.02 * k as f64)
        };
        for resolution in [0.01, 0.1, 0.2] {
            let t: Vec<f64> = (0..6000).map(|k| 0.02 * k as f64).collect();
            let motion = |t: f64| 2.0 * libm::sin(0.1 * t);
            let y: Vec<f64> = (0..6000)
                .map(|k| ((motion(t[k]) + 0.1 * noise(k)) / resolution).round() * resolution)
                .collect();
            assert!(health(&t, &y).frozen.is_empty(), "{resolution}");
            for begin in 3000..3010 {
                let mut y = y.clone();
                let held = y[begin];
                y[begin..].fill(held);
                assert_eq!(health(&t, &y).frozen.len(), 1, "{resolution}, {begin}");
            }
        }
    }

    #[test]
    fn fault_standing_still_stopping_and_missing_are_told_apart() {
        let (t, mut y) = wave(2000);
        let held = y[700];
        y[700..900].fill(held);
        let h = health(&t, &y);
        assert_eq!(h.frozen, vec![700..900]);
        assert!((h.frozen_s - 1.99).abs() < 1e-9);
        let (t, y) = wave(2000);
        let clipped: Vec<f64> = y.iter().map(|y| y.min(0.9)).collect();
        assert!(health(&t, &clipped).saturated > 100 && health(&t, &clipped).frozen.is_empty());
        let (mut t, y) = wave(2000);
        t[1000..].iter_mut().for_each(|t| *t += 2.0);
        let h = health(&t, &y);
        assert_eq!(h.gaps, 1);
        assert!((h.longest_gap - 2.01).abs() < 1e-9);
        assert!(health(&t, &vec![0.3; 2000]).dead);
    }
}
