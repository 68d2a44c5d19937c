//! A sampled signal in; single samples that stand far out of both neighbours, and two in a row that do,
//! as no motion and no noise of this signal does, out.
//!
//! A bit that flips, or a message that is half written, leaves one sample that has nothing to do with
//! those beside it. With `m_j = |y_j - (y_(j-1) + y_(j+1))/2|` over half a hundred samples around, of
//! which nine tenths are below `q` (1.645 of its sd in white noise), sample `k` is a spike where
//!
//! - it is above both neighbours, or below both, by more than `10 q` (more than twelve sd of the noise),
//! - both neighbours agree to half of that: a step goes one way,
//! - that is more than half of the range that 98 of 100 samples of the signal cover: less does little
//!   harm, and the ends of a signal that was differentiated or smoothed look like small spikes,
//! - that is more than four times the smallest change around: readings that flicker by one step of
//!   their resolution are none.
//!
//! Two samples in a row are wrong by the same measures, of both of them and the good samples around them,
//! where besides
//!
//! - the good samples are at most 0.1 s apart: no hand and no servo takes a surface out and back in that time,
//!   by more than half of what it does in the whole record, while a record at 20 Hz may have such a motion,
//! - they jump by more than three times what the signal does anywhere else from one sample to the next: in a
//!   command that steps, and after a shock that rings, others are alike,
//! - there are two such pairs at most, or one in 500 samples: more (a marker every second) are what the signal does.
//!
//! Noise has no such pairs: in white noise both samples would have to be beyond twelve sd. What is left is a true
//! pulse of less than 0.1 s, alone in a record whose every other step between samples is less than a third of it.
//!
//! Signals of four values or fewer (switches, commanded steps), and samples that do not come at a steady
//! rate (one message at each change), are not judged.

use super::round::beyond;
use std::collections::BTreeSet;

/// Samples on each side that show how much the signal moves.
const AROUND: usize = 25;
/// Those beside a spike that show nothing: the spike is in their neighbourhood.
const BESIDE: usize = 1;
/// A spike stands out by so many times what nine tenths of the others do.
const FACTOR: f64 = 10.0;
const SHARE: f64 = 0.9;
/// Neighbours of a spike differ by less than this share of it.
const BACK: f64 = 0.5;
/// Steps of the resolution that are no spike.
const RESOLUTION: f64 = 4.0;
/// A spike is more than this share of the range of the signal, from one to the other quantile.
const OF_RANGE: f64 = 0.5;
const QUANTILES: [f64; 2] = [0.01, 0.99];
/// Of a signal that stands still, a spike is at least this share of its value.
const OF_VALUE: f64 = 0.1;
/// A signal of so many values is a switch.
const SWITCH: usize = 4;
/// A rate is steady where this share of the spacings is within half of the median.
const STEADY: f64 = 0.9;
/// Fewer samples show nothing.
const FEWEST: usize = 20;
/// Good samples on either side of two wrong ones are so near in time, ns.
const TOGETHER: i64 = 100_000_000;
/// Two wrong samples jump by so many times what the signal does elsewhere.
const JUMP: f64 = 3.0;
/// So many pairs are wrong samples in any record, and one in so many samples in a long one.
const PAIRS: usize = 2;
const SAMPLES: usize = 500;

/// Indices of the spikes, in ascending order. Times ascend, in ns; `period` is that of an angle, which
/// neither rises nor falls where it goes round.
pub fn found(t: &[i64], y: &[f64], period: Option<f64>) -> Vec<usize> {
    let Some(longest) = longest_spacing(t) else { return Vec::new() };
    if y.len() < FEWEST || values(y) <= SWITCH {
        return Vec::new();
    }
    let signal = Signal { t, y, period, longest, least: OF_RANGE * range(y) };
    let single: Vec<usize> = (1..y.len() - 1).filter(|&k| signal.is_spike(k)).collect();
    let pairs = signal.pairs(&single);
    let all: BTreeSet<usize> =
        single.into_iter().chain(pairs.into_iter().flat_map(|k| [k, k + 1])).collect();
    all.into_iter().collect()
}

/// What is asked for spikes.
struct Signal<'a> {
    t: &'a [i64],
    y: &'a [f64],
    period: Option<f64>,
    /// Spacing beyond which samples are no neighbours.
    longest: i64,
    /// What is smaller does little harm.
    least: f64,
}

impl Signal<'_> {
    fn step(&self, from: usize, to: usize) -> f64 {
        let step = self.y[to] - self.y[from];
        match self.period {
            Some(period) => step - beyond(step, period),
            None => step,
        }
    }

    fn is_near(&self, from: usize) -> bool {
        self.t[from + 1] - self.t[from] <= self.longest
    }

    fn is_spike(&self, k: usize) -> bool {
        let (before, after) = (self.step(k - 1, k), self.step(k + 1, k));
        let size = before.abs().min(after.abs());
        if before * after <= 0.0 || (before - after).abs() >= BACK * size || size <= self.least {
            return false;
        }
        self.is_near(k - 1) && self.is_near(k) && self.stands_out(size, k, k)
    }

    /// Whether this size is far beyond noise and resolution around the samples from `first` to `last`.
    fn stands_out(&self, size: f64, first: usize, last: usize) -> bool {
        let others: Vec<usize> = (first.saturating_sub(AROUND).max(1)..first - BESIDE)
            .chain(last + BESIDE + 1..(last + AROUND + 1).min(self.y.len() - 1))
            .collect();
        let bend = |&k: &usize| 0.5 * (self.step(k, k - 1) + self.step(k, k + 1)).abs();
        size > FACTOR * most(others.iter().map(bend).collect())
            && size > resolved(others.iter().map(|&j| self.step(j - 1, j).abs()), self.y[first - 1])
    }

    /// The first samples of the pairs that are wrong.
    fn pairs(&self, single: &[usize]) -> Vec<usize> {
        let candidates = (1..self.y.len() - 2).filter_map(|k| Some((k, self.pair(k)?)));
        let mut pairs: Vec<(usize, f64)> = Vec::new();
        for (k, size) in candidates {
            // What hangs together is no pair.
            let is_apart = pairs.last().is_none_or(|(last, _)| *last + 2 < k);
            if is_apart && [k, k + 1].iter().all(|k| single.binary_search(k).is_err()) {
                pairs.push((k, size));
            }
        }
        if pairs.len() > PAIRS && pairs.len() * SAMPLES > self.y.len() {
            return Vec::new();
        }
        let mut wrong = vec![false; self.y.len()];
        single.iter().for_each(|&k| wrong[k] = true);
        pairs.iter().for_each(|&(k, _)| wrong[k..k + 2].fill(true));
        let steps =
            (1..self.y.len()).filter(|&k| !wrong[k] && !wrong[k - 1] && self.is_near(k - 1));
        let elsewhere = steps.map(|k| self.step(k - 1, k).abs()).fold(0.0, f64::max);
        pairs.retain(|(_, size)| *size > JUMP * elsewhere);
        pairs.into_iter().map(|(k, _)| k).collect()
    }

    /// By how much the samples `k` and `k + 1` both stand out of the good ones beside them, if they do.
    fn pair(&self, k: usize) -> Option<f64> {
        let (from, to) = (k - 1, k + 2);
        let steps = [k, k + 1].map(|k| self.step(from, k).abs().min(self.step(to, k).abs()));
        let size = steps[0].min(steps[1]);
        if size <= self.least || self.step(from, to).abs() >= BACK * size {
            return None;
        }
        let near = (from..to).all(|k| self.is_near(k)) && self.t[to] - self.t[from] <= TOGETHER;
        (near && self.stands_out(size, k, k + 1)).then_some(size)
    }
}

/// Spacing beyond which samples are no neighbours; none where the rate is not steady.
fn longest_spacing(t: &[i64]) -> Option<i64> {
    let mut steps: Vec<i64> = t.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).collect();
    if steps.is_empty() {
        return None;
    }
    let middle = steps.len() / 2;
    let median = *steps.select_nth_unstable(middle).1;
    let steady = steps.iter().filter(|step| (2 * **step - 2 * median).abs() <= median).count();
    (steady as f64 >= STEADY * steps.len() as f64).then_some(median + median / 2)
}

/// The range that nearly all values cover.
fn range(y: &[f64]) -> f64 {
    let mut sorted = y.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let [low, high] = QUANTILES.map(|q| sorted[(q * (sorted.len() - 1) as f64) as usize]);
    high - low
}

/// How many different values there are, as far as it matters.
fn values(y: &[f64]) -> usize {
    let mut known: Vec<f64> = Vec::new();
    for &value in y {
        if !known.contains(&value) {
            known.push(value);
            if known.len() > SWITCH {
                break;
            }
        }
    }
    known.len()
}

/// What nine tenths of the numbers stay below.
fn most(mut of: Vec<f64>) -> f64 {
    let at = ((of.len() as f64 * SHARE) as usize).min(of.len().saturating_sub(1));
    if of.is_empty() { f64::INFINITY } else { *of.select_nth_unstable_by(at, f64::total_cmp).1 }
}

/// What is more than the resolution, of which the smallest change tells, or the value where nothing
/// changes.
fn resolved(changes: impl Iterator<Item = f64>, value: f64) -> f64 {
    let smallest = changes.filter(|change| *change > 0.0).fold(f64::INFINITY, f64::min);
    if smallest.is_finite() { RESOLUTION * smallest } else { OF_VALUE * value.abs() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Stream;

    fn times(n: usize) -> Vec<i64> {
        (0..n as i64).map(|k| k * 10_000_000).collect()
    }

    /// A motion with noise of this sd.
    fn motion(n: usize, sd: f64, seed: u64) -> Vec<f64> {
        let mut stream = Stream::new(seed, &["spikes"]);
        (0..n).map(|k| 0.1 * libm::sin(0.05 * k as f64) + sd * stream.normal()).collect()
    }

    #[test]
    fn one_wrong_sample_is_found_in_noise_without_noise_and_at_rest() {
        for sd in [0.0, 1e-4, 1e-3, 5e-3] {
            let mut y = motion(2000, sd, 1);
            y[700] = 0.35;
            y[1500] = -0.2;
            assert_eq!(found(&times(2000), &y, None), [700, 1500], "{sd}");
        }
        let mut thrust: Vec<f64> = (0..500).map(|k| 5000.0 + f64::from(k / 100)).collect();
        thrust[250] = 0.0;
        assert_eq!(found(&times(500), &thrust, None), [250]);
    }

    #[test]
    fn nothing_is_found_where_nothing_is_wrong() {
        let mut stream = Stream::new(3, &["spikes"]);
        for seed in 0..200 {
            let y = motion(1000, 10f64.powf(-5.0 + 0.02 * seed as f64), seed);
            assert_eq!(found(&times(1000), &y, None), [0; 0], "{seed}");
            // Heavier tails than noise has: Laplace.
            let y: Vec<f64> = (0..1000)
                .map(|_| -libm::log(1.0 - stream.uniform()) * stream.normal().signum())
                .collect();
            assert_eq!(found(&times(1000), &y, None), [0; 0], "{seed}");
            // Coarse readings.
            let y: Vec<f64> =
                motion(1000, 1e-3, seed).iter().map(|v| (v / 4e-3).round() * 4e-3).collect();
            assert_eq!(found(&times(1000), &y, None), [0; 0], "{seed}");
        }
    }

    #[test]
    fn steps_pulses_switches_and_angles_that_go_round_are_no_spikes() {
        let n = 1000;
        let noise = motion(n, 1e-4, 5);
        let with = |of: &dyn Fn(usize) -> f64| -> Vec<f64> {
            noise.iter().enumerate().map(|(k, v)| v + of(k)).collect()
        };
        let step = with(&|k| if k < 500 { 0.0 } else { 1.0 });
        let pulse = with(&|k| if (500..503).contains(&k) { 1.0 } else { 0.0 });
        for y in [step, pulse] {
            assert_eq!(found(&times(n), &y, None), [0; 0]);
        }
        let switch: Vec<f64> = (0..n).map(|k| f64::from(u8::from(k == 500))).collect();
        assert_eq!(found(&times(n), &switch, None), [0; 0]);
        // A heading about north.
        let full = 2.0 * std::f64::consts::PI;
        let heading: Vec<f64> =
            motion(n, 1e-2, 6).iter().map(|v| (0.001 * v).rem_euclid(full)).collect();
        assert_eq!(found(&times(n), &heading, Some(full)), [0; 0]);
        // A message at each change: every value stands out of its neighbours.
        let changes: Vec<i64> = (0..n as i64).map(|k| k * k * 1000).collect();
        let y: Vec<f64> = (0..n).map(|k| ((k * 7) % 11) as f64).collect();
        assert_eq!(found(&changes, &y, None), [0; 0]);
    }

    /// What recorders write for "no value": -999 deg in an angle, in one sample of forty.
    #[test]
    fn values_many_turns_away_are_found_however_many_there_are() {
        let full = 2.0 * std::f64::consts::PI;
        let mut y = motion(2000, 1e-3, 8);
        let wrong: Vec<usize> = (20..1990).step_by(40).collect();
        wrong.iter().for_each(|&k| y[k] = -999f64.to_radians());
        assert_eq!(found(&times(2000), &y, Some(full)), wrong);
    }

    #[test]
    fn what_is_small_against_the_motion_is_no_spike() {
        let mut y = motion(1000, 1e-5, 9);
        y[1] += 0.05;
        y[500] -= 0.08;
        assert_eq!(found(&times(1000), &y, None), [0; 0]);
    }

    #[test]
    fn a_spike_within_a_gap_is_not_judged() {
        let mut t = times(100);
        t[51..].iter_mut().for_each(|t| *t += 1_000_000_000);
        let mut y = motion(100, 1e-4, 7);
        y[50] = 3.0;
        assert_eq!(found(&t, &y, None), [0; 0]);
        assert!(found(&[], &[], None).is_empty() && found(&[1], &[1.0], None).is_empty());
    }
}
