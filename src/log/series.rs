//! The raw samples of one signal in file order in; a series sorted in time and the account of what
//! was dropped out.

use super::turned::{Back, turned_back};

/// A signal: values at times, ascending.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Series {
    /// Seconds since the flight's earliest log time, strictly ascending before a delay of zero
    /// resolution; never twice the same stamp.
    pub t_s: Vec<f64>,
    /// SI.
    pub value: Vec<f64>,
}

/// What became of the messages of one signal.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Account {
    pub topic: String,
    pub field: String,
    /// Unit in the log; `min` and `max` are in SI.
    pub unit: String,
    /// Messages of the topic.
    pub messages: u64,
    /// Samples that are left.
    pub count: u64,
    /// Samples dropped because an earlier one in the file has the same time stamp.
    pub dropped_duplicate: u64,
    /// Samples that stood in the file after a later one; they were sorted in, not dropped.
    pub reordered: u64,
    /// Samples dropped because they are NaN, infinite or null.
    pub dropped_nan: u64,
    /// Messages without a number in this field (or without a time stamp).
    pub dropped_unreadable: u64,
    /// Those of them that are sound: without this field, with a shorter list, or with no number there.
    pub lacking: u64,
    /// Samples dropped because they are outside the range that the map gives.
    pub dropped_out_of_range: u64,
    /// Samples dropped because they stand far out of their neighbours, alone or two in a row.
    pub dropped_spikes: u64,
    /// Samples dropped because the sensor stands still.
    pub dropped_still: u64,
    /// From when to when it does, s, kept or dropped.
    pub still: Option<[f64; 2]>,
    /// Samples dropped because their stamps are more than a day from the others, in a time that came
    /// twice as the clock was set back, or of the clock that gave few of two.
    pub dropped_times: u64,
    /// Those of them that lay in a time that came twice.
    pub dropped_twice: u64,
    /// Those of them that another clock gave.
    pub dropped_clock: u64,
    /// Places where the stamp moved against the log time (or the log time moved backwards) by more
    /// than a second.
    pub clock_jumps: u64,
    /// Spacings above three times the median one (and above 5 ms).
    pub gaps: u64,
    /// The longest spacing, s; 0 with less than two samples.
    pub longest_gap_s: f64,
    /// One over the median spacing; 0 with less than two samples.
    pub rate_hz: f64,
    /// NaN where there is no sample, as are the next three.
    pub t_first_s: f64,
    pub t_last_s: f64,
    pub min: f64,
    pub max: f64,
}

/// Nanoseconds to seconds: exact up to 104 days, then one rounding.
pub(super) fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}

/// A jump of the clock is a change of more than this between two messages, ns.
const JUMP_NS: i64 = 1_000_000_000;

/// Counts clock jumps of one topic, in file order: changes of (stamp - log time) where the stamp is
/// not the log time itself, and backward steps of the log time.
pub(super) fn clock_jumps(log_ns: &[i64], stamp_ns: &[i64]) -> u64 {
    let pairs = log_ns.windows(2).zip(stamp_ns.windows(2));
    let jumped = |(l, s): &(&[i64], &[i64])| {
        let offset = |i: usize| s[i].saturating_sub(l[i]);
        offset(1).saturating_sub(offset(0)).abs() > JUMP_NS || l[0].saturating_sub(l[1]) > JUMP_NS
    };
    pairs.filter(jumped).count() as u64
}

/// Drops samples, in file order, in a time that came twice as the clock was set back.
pub(super) fn drop_twice(samples: &mut Vec<(i64, f64)>, account: &mut Account) -> Vec<Back> {
    if samples.is_sorted_by_key(|s| s.0) {
        return Vec::new();
    }
    let times: Vec<i64> = samples.iter().map(|s| s.0).collect();
    let twice = turned_back(&times, |a, b| samples[a].1 == samples[b].1);
    let before = samples.len();
    samples.retain(|s| !twice.iter().any(|back| back.holds(s.0)));
    account.dropped_twice = (before - samples.len()) as u64;
    account.dropped_times += account.dropped_twice;
    twice
}

/// Sorts by stamp (stable), drops samples that repeat a stamp (the first in the file stays), and
/// files the counts.
pub(super) fn order(samples: &mut Vec<(i64, f64)>, account: &mut Account) {
    let mut latest = i64::MIN;
    for &(stamp, _) in samples.iter() {
        account.reordered += u64::from(stamp < latest);
        latest = latest.max(stamp);
    }
    if account.reordered > 0 {
        samples.sort_by_key(|s| s.0);
    }
    let before = samples.len();
    samples.dedup_by_key(|s| s.0);
    account.dropped_duplicate = (before - samples.len()) as u64;
}

/// No flight lasts longer, ns.
pub(super) const DAY_NS: i64 = 86_400_000_000_000;

/// Drops samples whose stamps are more than a day from the middle one: a clock that was wrong for a
/// message would make years of a flight.
pub(super) fn drop_stray_times(samples: &mut Vec<(i64, f64)>, account: &mut Account) {
    let before = samples.len();
    if let Some(&(middle, _)) = samples.get(before / 2) {
        samples.retain(|s| s.0.saturating_sub(middle).saturating_abs() <= DAY_NS);
    }
    account.dropped_times += (before - samples.len()) as u64;
}

/// Files spacing, range and extent of ordered samples.
pub(super) fn describe(series: &Series, stamps: &[(i64, f64)], account: &mut Account) {
    account.count = series.value.len() as u64;
    account.t_first_s = series.t_s.first().copied().unwrap_or(f64::NAN);
    account.t_last_s = series.t_s.last().copied().unwrap_or(f64::NAN);
    account.min = series.value.iter().copied().fold(f64::NAN, f64::min);
    account.max = series.value.iter().copied().fold(f64::NAN, f64::max);
    let spacing = Spacing::of(stamps.iter().map(|s| s.0));
    account.rate_hz = spacing.rate_hz;
    account.gaps = spacing.gaps;
    account.longest_gap_s = spacing.longest_s;
}

/// How a sequence of ascending stamps is spaced.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Spacing {
    pub rate_hz: f64,
    pub gaps: u64,
    pub longest_s: f64,
}

impl Spacing {
    pub fn of(stamps: impl Iterator<Item = i64>) -> Spacing {
        let mut steps = Vec::new();
        let mut last = None;
        for stamp in stamps {
            steps.extend(last.map(|l: i64| stamp.saturating_sub(l)));
            last = Some(stamp);
        }
        if steps.is_empty() {
            return Spacing::default();
        }
        let middle = steps.len() / 2;
        let median = *steps.clone().select_nth_unstable(middle).1;
        let limit = median.saturating_mul(3).max(5_000_000);
        Spacing {
            rate_hz: if median > 0 { 1e9 / median as f64 } else { 0.0 },
            gaps: steps.iter().filter(|&&s| s > limit).count() as u64,
            longest_s: seconds(steps.iter().copied().max().unwrap_or(0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duplicates_and_late_samples_are_counted_and_the_first_in_the_file_stays() {
        let mut samples = vec![(10, 1.0), (30, 3.0), (20, 2.0), (30, 99.0), (40, 4.0), (5, 0.5)];
        let mut account = Account::default();
        order(&mut samples, &mut account);
        assert_eq!(samples, [(5, 0.5), (10, 1.0), (20, 2.0), (30, 3.0), (40, 4.0)]);
        assert_eq!((account.reordered, account.dropped_duplicate), (2, 1));
    }

    #[test]
    fn jitter_is_no_gap_and_a_gap_is_one() {
        let jittered = (0..100i64).map(|i| i * 10_000_000 + (i * 7919 % 13 - 6) * 500_000);
        let s = Spacing::of(jittered.clone());
        assert_eq!(s.gaps, 0);
        assert!((s.rate_hz - 100.0).abs() < 20.0, "{}", s.rate_hz);
        let s = Spacing::of(jittered.filter(|t| !(300_000_000..400_000_000).contains(t)));
        assert_eq!(s.gaps, 1);
        assert!((s.longest_s - 0.11).abs() < 0.01, "{}", s.longest_s);
    }

    #[test]
    fn clock_jumps_are_seen_in_the_stamp_and_in_the_log_time() {
        let log: Vec<i64> = (0..10).map(|i| i * 100_000_000).collect();
        assert_eq!(clock_jumps(&log, &log), 0);
        let mut stamp = log.clone();
        stamp[5..].iter_mut().for_each(|s| *s += 3_600_000_000_000);
        assert_eq!(clock_jumps(&log, &stamp), 1);
        let mut back = log.clone();
        back[5..].iter_mut().for_each(|s| *s -= 5_000_000_000);
        assert_eq!(clock_jumps(&back, &back), 1);
    }

    #[test]
    fn no_sample_and_one_sample_have_no_rate() {
        assert_eq!(Spacing::of([].into_iter()), Spacing::default());
        assert_eq!(Spacing::of([7].into_iter()).rate_hz, 0.0);
    }
}
