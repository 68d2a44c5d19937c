//! A piece of signal in, the sweeps flown in it out: slow triangles from trim to one side, to the
//! other, and back.
//!
//! A sweep is flown so slowly that the aircraft or its control system goes through steady states:
//! the input moves at one rate, up and down, between turning points equally far from trim, and rests
//! before and after. So a candidate is an even number of turning points at equal distances in time
//! and height, and it is measured by the straight lines between them: their rates are equal but for
//! the sign, the signal stays on them, and before and after it does not move on at that rate. A
//! multistep stands where a sweep moves, drift and a ramp to a new trim do not turn, and an
//! oscillation has no rest.

use super::cells::{Cells, Line, turning_points};
use super::kind::Kind;
use super::scan::Work;
use super::{Maneuver, Settings, Step};
use crate::math::interpolate::{between, held};
use crate::math::median;
use crate::signal::robust::noise_sd;

/// Cells of the signal in the shortest period.
const CELLS: f64 = 40.0;
/// Distances and heights of turning points differ from their mean by at most this share.
const REGULAR: f64 = 0.35;
/// Largest rms distance of the signal from the lines, as a share of the amplitude: a sine has 0.1,
/// a square wave 0.4.
const MISFIT: f64 = 0.2;
/// How often the least reversal that makes a turning point is halved from the whole range on.
const HALVINGS: i32 = 14;

/// A stretch of rest: the level and the rms distance from it.
#[derive(Clone, Copy)]
struct Rest {
    level: f64,
    rms: f64,
}

/// What is known of a sweep from its turning points alone.
struct Turns<'a> {
    at: &'a [usize],
    /// Mean distance in time, s.
    half: f64,
    /// Half the mean difference in height.
    size: f64,
    trim: f64,
}

/// All that might be a sweep in one piece; candidates may overlap.
pub(super) fn candidates(work: &Work, settings: &Settings) -> Vec<Maneuver> {
    let cells = Cells::of(work, settings.min_period_s / CELLS);
    let finite = cells.v.iter().copied().filter(|v| v.is_finite());
    let (low, high) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let least = (settings.threshold * noise_sd(&cells.v)).max(0.5 * settings.min_amplitude);
    let reversals = (1..=HALVINGS).map(|k| (high - low) / f64::from(1 << k));
    let mut found = Vec::new();
    for reversal in reversals.filter(|r| r.is_finite() && *r > least && *r > 0.0) {
        let turns = turning_points(&cells.v, reversal);
        for first in 0..turns.len() {
            found.extend(beginning_at(&cells, &turns[first..], settings));
        }
    }
    found
}

/// The sweeps whose first turning point is the first of `turns`.
fn beginning_at(cells: &Cells, turns: &[usize], settings: &Settings) -> Vec<Maneuver> {
    let mut found = Vec::new();
    for count in (2..=turns.len()).step_by(2) {
        let Some(turns) = Turns::of(cells, &turns[..count], settings) else { break };
        // Nothing that begins in motion becomes a sweep by going on.
        let Some(before) = turns.rest(cells, turns.ends(cells).0, -1.0, settings) else { break };
        if let Some(after) = turns.rest(cells, turns.ends(cells).1, 1.0, settings) {
            found.extend(measure(cells, &turns, before, after, settings));
        }
    }
    found
}

impl<'a> Turns<'a> {
    /// Turning points at equal distances and heights; `None` where they differ too much, or where
    /// the period is too short or too long.
    fn of(cells: &Cells, at: &'a [usize], settings: &Settings) -> Option<Turns<'a>> {
        let times: Vec<f64> = at.windows(2).map(|w| (w[1] - w[0]) as f64 * cells.h).collect();
        let heights: Vec<f64> =
            at.windows(2).map(|w| (cells.v[w[1]] - cells.v[w[0]]).abs()).collect();
        let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
        let regular = |x: &[f64]| x.iter().all(|x_k| (x_k - mean(x)).abs() <= REGULAR * mean(x));
        let (half, size) = (mean(&times), 0.5 * mean(&heights));
        let periods = 0.9 * settings.min_period_s..=1.1 * settings.max_period_s;
        let trim = at.iter().map(|i| cells.v[*i]).sum::<f64>() / at.len() as f64;
        (regular(&times) && regular(&heights) && periods.contains(&(2.0 * half))).then_some(Turns {
            at,
            half,
            size,
            trim,
        })
    }

    /// When the sweep begins and ends if its first and last ramps are as fast as the others, s; a
    /// little outside, so that it is surely at rest there.
    fn ends(&self, cells: &Cells) -> (f64, f64) {
        let turn = |i: usize| cells.time(self.at[i]);
        (turn(0) - 0.55 * self.half, turn(self.at.len() - 1) + 0.55 * self.half)
    }

    /// The rest before (`side` -1) or after (1) the time `t`, s: a sixteenth of a period, and at
    /// least the quiet time; `None` where the signal is away from trim, moves on at half the rate
    /// of a ramp or more, or half of the time is not there.
    fn rest(&self, cells: &Cells, t: f64, side: f64, settings: &Settings) -> Option<Rest> {
        let length = (self.half / 8.0).max(settings.quiet_s);
        let (from, to) = if side < 0.0 { (t - length, t) } else { (t, t + length) };
        let (times, values) = cells.values(cells.range(from, to));
        let there = 2.0 * times.len() as f64 * cells.h >= length;
        let rate = cells.line(from, to)?.rate;
        let level = median(&values);
        let square = values.iter().map(|v| (v - level) * (v - level)).sum::<f64>();
        let rest = Rest { level, rms: (square / values.len() as f64).sqrt() };
        let still = rate.abs() <= 0.5 * 2.0 * self.size / self.half;
        (there && still && (level - self.trim).abs() <= 0.3 * self.size).then_some(rest)
    }
}

/// The sweep with these turning points: its lines, its times and how sure it is.
fn measure(
    cells: &Cells,
    turns: &Turns,
    mut before: Rest,
    mut after: Rest,
    settings: &Settings,
) -> Option<Maneuver> {
    let (mut start, mut end) = turns.ends(cells);
    let mut lines = Vec::new();
    // Ends and levels of rest need each other: three times is enough.
    for _pass in 0..3 {
        lines = ramps(cells, turns, start, end)?;
        start = lines.first()?.when(before.level);
        end = lines.last()?.when(after.level);
        before = turns.rest(cells, start, -1.0, settings)?;
        after = turns.rest(cells, end, 1.0, settings)?;
    }
    let (mut t, mut value) = (vec![start], vec![before.level]);
    for pair in lines.windows(2) {
        let (when, level) = pair[0].meet(&pair[1]);
        t.push(when);
        value.push(level);
    }
    t.push(end);
    value.push(after.level);
    if t.windows(2).any(|w| !(w[0] < w[1])) {
        return None;
    }
    let trim = |t: f64| between(before.level, after.level, (t - start) / (end - start));
    let levels: Vec<f64> = turns.at.iter().map(|i| cells.v[*i] - trim(cells.time(*i))).collect();
    let amplitude = levels.iter().map(|l| l.abs()).sum::<f64>() / levels.len() as f64;
    let misfit = misfit(cells, &t, &value) / amplitude;
    if !(misfit <= MISFIT) {
        return None;
    }
    let spread = |x: &[f64]| {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        (x.iter().map(|x| (x / mean - 1.0) * (x / mean - 1.0)).sum::<f64>() / x.len() as f64).sqrt()
    };
    let size = |x: &f64| x.abs();
    let score = score(&[
        (misfit, 0.15),
        (spread(&lines.iter().map(|l| l.rate.abs()).collect::<Vec<f64>>()), 0.25),
        (spread(&levels.iter().map(size).collect::<Vec<f64>>()), 0.25),
        (before.rms / amplitude, 0.2),
        (after.rms / amplitude, 0.4),
        ((after.level - before.level) / amplitude, 0.5),
    ]);
    let middles = lines[1..lines.len() - 1].iter().map(|l| l.when(trim(l.t)));
    let edges: Vec<f64> = [start].into_iter().chain(middles).chain([end]).collect();
    let steps: Vec<Step> = edges
        .windows(2)
        .zip(&levels)
        .map(|(w, level)| Step { start: w[0], end: w[1], level: *level })
        .collect();
    Some(Maneuver {
        kind: Kind::Sweep,
        t_start: start,
        t_end: end,
        onset: start,
        unit_time: (end - start) / (2 * levels.len()) as f64,
        amplitude,
        polarity: levels[0].signum(),
        trim: before.level,
        steps,
        score,
        included: true,
        reason: String::new(),
    })
}

/// The line of every ramp, through its middle part: the turning points themselves may be round or
/// cut off. `None` where they do not go up and down by turns.
fn ramps(cells: &Cells, turns: &Turns, start: f64, end: f64) -> Option<Vec<Line>> {
    let mut corners = vec![start];
    corners.extend(turns.at.iter().map(|i| cells.time(*i)));
    corners.push(end);
    let middle = |w: &[f64]| {
        cells.line(
            between(w[0], w[1], 0.2) - 0.5 * cells.h,
            between(w[0], w[1], 0.8) + 0.5 * cells.h,
        )
    };
    let lines = corners.windows(2).map(middle).collect::<Option<Vec<Line>>>()?;
    lines.windows(2).all(|w| w[0].rate * w[1].rate < 0.0).then_some(lines)
}

/// Rms distance of the signal from the lines between corners `t`, `value`.
fn misfit(cells: &Cells, t: &[f64], value: &[f64]) -> f64 {
    let (Some(from), Some(to)) = (t.first(), t.last()) else { return f64::NAN };
    let (times, values) = cells.values(cells.range(*from, *to));
    let distance = |(t_k, v): (&f64, &f64)| (v - held(t, value, *t_k)) * (v - held(t, value, *t_k));
    (times.iter().zip(&values).map(distance).sum::<f64>() / times.len() as f64).sqrt()
}

/// 0 to 1: the root of a product of factors, each falling from 1 with one defect; its second number
/// halves it.
fn score(defects: &[(f64, f64)]) -> f64 {
    defects.iter().map(|(x, half)| 1.0 / (1.0 + (x / half) * (x / half))).product::<f64>().sqrt()
}
