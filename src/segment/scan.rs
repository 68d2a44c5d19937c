//! Samples in, sequences of alternating excursions from the local trim out: the raw candidates for
//! maneuvers.

use super::Settings;
use crate::math::{mad_sd, median, quantile};
use crate::signal::resample::{Grid, linear};
use crate::signal::robust::median_filter;

/// The signal on a uniform grid, lightly smoothed; one piece between gaps.
pub(super) struct Work {
    pub t0: f64,
    /// Spacing, s.
    pub h: f64,
    pub v: Vec<f64>,
}

/// A stretch of grid points `start..end` on one side of the trim.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Excursion {
    pub start: usize,
    pub end: usize,
}

impl Work {
    /// The pieces between gaps; none where there are too few samples to hold a maneuver.
    pub fn pieces(t: &[f64], u: &[f64], settings: &Settings) -> Vec<Work> {
        let (t, u) = clean(t, u);
        if t.len() < 5 || !(settings.min_step_s > 0.0) {
            return vec![];
        }
        let dt = median(&t.windows(2).map(|w| w[1] - w[0]).collect::<Vec<f64>>());
        let gap = settings.max_gap_s.max(2.5 * dt);
        let mut cuts = vec![0];
        cuts.extend((1..t.len()).filter(|&i| t[i] - t[i - 1] > gap));
        cuts.push(t.len());
        let long_enough = cuts.windows(2).filter(|c| c[1] - c[0] >= 5);
        long_enough.map(|c| Work::new(&t[c[0]..c[1]], &u[c[0]..c[1]], dt, gap, settings)).collect()
    }

    fn new(t: &[f64], u: &[f64], dt: f64, gap: f64, settings: &Settings) -> Work {
        let finest = settings.min_step_s / 8.0;
        let h = dt.max(finest);
        let grid = Grid::covering(t[0], t[t.len() - 1], h);
        let raw = if dt > 0.67 * finest {
            linear(t, u, &grid, gap)
        } else {
            cell_means(t, u, &grid, gap)
        };
        let window = 2 * (settings.min_step_s / (4.0 * h) + 1e-6) as usize + 1;
        Work { t0: t[0], h, v: median_filter(&raw, window) }
    }

    /// Number of grid points in `seconds`.
    pub fn count(&self, seconds: f64) -> usize {
        (seconds / self.h).round().clamp(0.0, 1e9) as usize
    }

    pub fn time(&self, index: f64) -> f64 {
        self.t0 + index * self.h
    }
}

fn clean(t: &[f64], u: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut last = f64::NEG_INFINITY;
    t.iter()
        .zip(u)
        .filter(|(t, u)| {
            let keep = t.is_finite() && u.is_finite() && **t > last;
            if keep {
                last = **t;
            }
            keep
        })
        .unzip()
}

/// Mean of the samples within half a spacing of each grid point; linear interpolation where there
/// is none.
fn cell_means(t: &[f64], u: &[f64], grid: &Grid, gap: f64) -> Vec<f64> {
    let mut out = linear(t, u, grid, gap);
    let mut next = 0;
    for (i, v) in out.iter_mut().enumerate() {
        let end = grid.time(i) + 0.5 * grid.dt;
        let first = next;
        while next < t.len() && t[next] < end {
            next += 1;
        }
        if next > first {
            *v = u[first..next].iter().sum::<f64>() / (next - first) as f64;
        }
    }
    out
}

/// Excursions that the end of a piece cuts off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cut {
    /// Where the first of them begins.
    pub start: usize,
    /// How many there are, and the largest deviation from trim.
    pub count: usize,
    pub peak: f64,
}

/// Sequences of alternating excursions, each from the trim of the quiet window before it; sequences
/// of different starts may overlap. Behind them the longest one that the end of the piece cuts off.
pub(super) fn sequences(work: &Work, settings: &Settings) -> (Vec<Vec<Excursion>>, Option<Cut>) {
    let trims = trailing_trims(work, settings);
    let spreads: Vec<f64> = trims.iter().filter_map(|t| t.map(|t| t.1)).collect();
    // A window that happens to be calmer than nearly all others says little about the noise.
    let floor = if spreads.is_empty() { 0.0 } else { 0.7 * quantile(&spreads, 0.25) };
    let (mut found, mut cut): (_, Option<Cut>) = (vec![], None);
    let mut next = 0;
    for i in 0..work.v.len().saturating_sub(1) {
        let Some((trim, spread)) = trims[i].filter(|_| i >= next) else { continue };
        let threshold = (settings.threshold * spread.max(floor)).max(0.5 * settings.min_amplitude);
        let (now, then) = (work.v[i] - trim, work.v[i + 1] - trim);
        if now.abs() > threshold && then.abs() > threshold && now * then > 0.0 {
            match follow(work, i, trim, threshold, settings) {
                Followed::Back(sequence) => found.push(sequence),
                Followed::Ends(new) if cut.is_none_or(|cut| new.count > cut.count) => {
                    cut = Some(new)
                }
                _ => {}
            }
            next = i + work.count(0.25 * settings.quiet_s).max(1);
        }
    }
    (found, cut)
}

/// Median and MAD sd of a quiet window before each grid point; `None` where it touches a gap or is
/// shorter than half its length.
///
/// The window ends somewhat before the point, so that a slow edge does not widen its own threshold.
fn trailing_trims(work: &Work, settings: &Settings) -> Vec<Option<(f64, f64)>> {
    let length = work.count(settings.quiet_s).max(3);
    let lead = work.count(0.4 * settings.quiet_s);
    let mut known = 0;
    (0..work.v.len())
        .map(|i| {
            let window = &work.v[i - known.min(length + lead)..i - known.min(lead)];
            known = if work.v[i].is_nan() { 0 } else { known + 1 };
            (known > 0 && 2 * window.len() >= length).then(|| (median(window), mad_sd(window)))
        })
        .collect()
}

/// What became of excursions that were followed.
enum Followed {
    Back(Vec<Excursion>),
    Ends(Cut),
    /// The signal does not come back, or alternates too long.
    Lost,
}

/// The alternating excursions that begin at grid point `start`.
fn follow(work: &Work, start: usize, trim: f64, threshold: f64, settings: &Settings) -> Followed {
    let mut sign = (work.v[start] - trim).signum();
    let mut sequence: Vec<Excursion> = vec![];
    let mut begin = start;
    let mut largest = 0.0f64;
    loop {
        let (end, peak) = match excursion(work, begin, trim, sign, settings) {
            Side::Back { end, peak } => (end, peak),
            Side::Ends(peak) => {
                let peak = largest.max(peak);
                return Followed::Ends(Cut { start, count: sequence.len() + 1, peak });
            }
            Side::Stays => return Followed::Lost,
        };
        sequence.push(Excursion { start: begin, end });
        largest = largest.max(peak);
        if sequence.len() > settings.max_steps {
            return Followed::Lost;
        }
        let pause = (3 * (end - begin) / 4).max(work.count(0.5 * settings.min_step_s)).max(3);
        sign = -sign;
        match other_side(work, end, pause, trim, sign, threshold.max(0.35 * largest)) {
            Some(next) => begin = next,
            None => return Followed::Back(sequence),
        }
    }
}

/// How an excursion ends.
enum Side {
    /// It has fallen to half its peak at `end`.
    Back {
        end: usize,
        peak: f64,
    },
    /// It has not when the piece ends; its peak so far.
    Ends(f64),
    Stays,
}

/// The end of the excursion on the side `sign` that is under way at `begin`.
fn excursion(work: &Work, begin: usize, trim: f64, sign: f64, settings: &Settings) -> Side {
    let limit = begin + work.count(settings.max_step_s);
    let mut peak = 0.0f64;
    for i in begin..work.v.len().min(limit) {
        let side = sign * (work.v[i] - trim);
        let then = work.v.get(i + 1).map_or(f64::NAN, |v| sign * (v - trim));
        if side.is_nan() {
            return Side::Stays;
        }
        peak = peak.max(side);
        if side < 0.5 * peak && (then < 0.5 * peak || then.is_nan()) {
            return Side::Back { end: i, peak };
        }
    }
    if work.v.len() < limit { Side::Ends(peak) } else { Side::Stays }
}

/// The first of at most `pause` grid points from `from` on that is beyond `threshold` on the side
/// `sign`.
fn other_side(
    work: &Work,
    from: usize,
    pause: usize,
    trim: f64,
    sign: f64,
    threshold: f64,
) -> Option<usize> {
    (from..(from + pause).min(work.v.len())).find(|&i| sign * (work.v[i] - trim) > threshold)
}
