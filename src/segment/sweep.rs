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
use super::{Maneuver, NO_RISES, Settings, Step};
use crate::math::interpolate::{between, held};
use crate::math::median;

/// Cells of the signal in the shortest period.
const CELLS: f64 = 40.0;
/// Distances and heights of turning points differ from their mean by at most this share.
const REGULAR: f64 = 0.35;
/// The level of rest is this near to the mean of the turning points, as a share of the amplitude.
const AWAY: f64 = 0.3;
/// Largest rms distance of the signal from the lines, as a share of the amplitude: a square wave is
/// beyond it.
const MISFIT: f64 = 0.2;
/// How often the least reversal that makes a turning point is halved from the whole range on.
const HALVINGS: i32 = 14;

/// A stretch of rest: the level, and the rms distance from it over twice the time.
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
    let least = (settings.threshold * cells.noise).max(0.5 * settings.min_amplitude);
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
        let start = turns.end(cells, -1.0);
        if start.and_then(|t| turns.rest(cells, t, -1.0, settings)).is_none() {
            break;
        }
        found.extend(corners(cells, &turns, settings).and_then(|c| measure(cells, &turns, &c)));
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

    /// When the line through a ramp at an end (`side` -1: the first, 1: the last) is at trim, s.
    fn end(&self, cells: &Cells, side: f64) -> Option<f64> {
        let turn = if side < 0.0 { self.at.first() } else { self.at.last() };
        let turn = cells.time(*turn?);
        let (near, far) = (turn + 0.1 * side * self.half, turn + 0.4 * side * self.half);
        Some(cells.line(near.min(far), near.max(far))?.when(self.trim))
    }

    /// The rest before (`side` -1) or after (1) the time `t`, s: a sixteenth of a period, and at
    /// least the quiet time; less where the record ends. `None` where not even the quiet time is
    /// there, or the signal is away from trim or moves on at half the rate of a ramp or more.
    fn rest(&self, cells: &Cells, t: f64, side: f64, settings: &Settings) -> Option<Rest> {
        let length = (self.half / 8.0).max(settings.quiet_s);
        let span = |length: f64| if side < 0.0 { (t - length, t) } else { (t, t + length) };
        let (from, to) = span(length);
        let values = cells.values(cells.range(from, to)).1;
        let there = (values.len() + 1) as f64 * cells.h >= settings.quiet_s;
        let line = cells.line(from, to)?;
        let still = line.rate.abs() - 2.0 * line.rate_sd <= 0.5 * self.rate();
        let level = median(&values);
        let (from, to) = span(2.0 * length);
        let rms = cells.rms(cells.range(from, to), |_| level);
        (there && still && (level - self.trim).abs() <= AWAY * self.size)
            .then_some(Rest { level, rms })
    }

    /// The rate of a ramp.
    fn rate(&self) -> f64 {
        2.0 * self.size / self.half
    }
}

/// The lines of a sweep and the corners between them, from rest to rest.
struct Corners {
    lines: Vec<Line>,
    /// Two more than turning points, s.
    t: Vec<f64>,
    value: Vec<f64>,
    before: Rest,
    after: Rest,
}

/// Lines and rest of a sweep: each needs the other, and three times is enough.
fn corners(cells: &Cells, turns: &Turns, settings: &Settings) -> Option<Corners> {
    let (mut start, mut end) = (turns.end(cells, -1.0)?, turns.end(cells, 1.0)?);
    let mut before = turns.rest(cells, start, -1.0, settings)?;
    let mut after = turns.rest(cells, end, 1.0, settings)?;
    let mut lines = Vec::new();
    for _pass in 0..3 {
        lines = ramps(cells, turns, start, end)?;
        start = lines.first()?.when(before.level);
        end = lines.last()?.when(after.level);
        before = turns.rest(cells, start, -1.0, settings)?;
        after = turns.rest(cells, end, 1.0, settings)?;
    }
    let between = lines.windows(2).map(|pair| pair[0].meet(&pair[1]));
    let ends = [(start, before.level), (end, after.level)];
    let all = ends[..1].iter().copied().chain(between).chain(ends[1..].iter().copied());
    let (t, value): (Vec<f64>, Vec<f64>) = all.unzip();
    let ascend = t.windows(2).all(|w| w[0] < w[1]);
    ascend.then_some(Corners { lines, t, value, before, after })
}

impl Corners {
    /// The level of rest at `t`, on the straight line from that before to that after.
    fn trim(&self, t: f64) -> f64 {
        let (start, end) = (self.t[0], self.t[self.t.len() - 1]);
        between(self.before.level, self.after.level, (t - start) / (end - start))
    }

    /// When the lines cross the level of rest: the begin, once in every ramp between two turning
    /// points, the end; s.
    fn crossings(&self) -> Vec<f64> {
        let inner = &self.lines[1..self.lines.len() - 1];
        let crossings = inner.iter().map(|l| l.when(self.trim(l.t)));
        let ends = [self.t[0], self.t[self.t.len() - 1]];
        ends[..1].iter().copied().chain(crossings).chain(ends[1..].iter().copied()).collect()
    }
}

/// The sweep with these corners, and how sure it is; `None` where the signal is not on its lines.
fn measure(cells: &Cells, turns: &Turns, corners: &Corners) -> Option<Maneuver> {
    let level = |i: &usize| cells.v[*i] - corners.trim(cells.time(*i));
    let levels: Vec<f64> = turns.at.iter().map(level).collect();
    let sizes: Vec<f64> = levels.iter().map(|l| l.abs()).collect();
    let amplitude = sizes.iter().sum::<f64>() / sizes.len() as f64;
    let edges = corners.crossings();
    let (start, end) = (edges[0], edges[edges.len() - 1]);
    let on_lines = |t: f64| held(&corners.t, &corners.value, t);
    let misfit = cells.rms(cells.range(start, end), on_lines) / amplitude;
    if !(misfit <= MISFIT) {
        return None;
    }
    let rates: Vec<f64> = corners.lines.iter().map(|l| l.rate.abs()).collect();
    let (before, after) = (corners.before, corners.after);
    let step = |(w, level): (&[f64], &f64)| Step {
        start: w[0],
        end: w[1],
        level: *level,
        rises: NO_RISES,
    };
    Some(Maneuver {
        kind: Kind::Sweep,
        t_start: start,
        t_end: end,
        onset: start,
        unit_time: (end - start) / (2 * levels.len()) as f64,
        amplitude,
        polarity: levels[0].signum(),
        trim: before.level,
        steps: edges.windows(2).zip(&levels).map(step).collect(),
        score: score(&[
            (misfit, 0.08),
            (spread(&rates), 0.25),
            (spread(&sizes), 0.25),
            (before.rms / amplitude, 0.15),
            (after.rms / amplitude, 0.15),
            ((after.level - before.level) / amplitude, 0.5),
        ]),
        included: true,
        reason: String::new(),
    })
}

/// Rms deviation from the mean, as a share of it.
fn spread(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    (x.iter().map(|x| (x / mean - 1.0) * (x / mean - 1.0)).sum::<f64>() / x.len() as f64).sqrt()
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

/// 0 to 1: a product of factors, each falling from 1 with one defect; its second number halves it.
fn score(defects: &[(f64, f64)]) -> f64 {
    defects.iter().map(|(x, half)| 1.0 / (1.0 + (x / half) * (x / half))).product()
}
