//! A sequence of excursions in, a maneuver with measured edges, levels, unit time and score out.

use super::kind::{Kind, classify};
use super::scan::{Excursion, Work};
use super::{Maneuver, Settings, Step};
use crate::math::interpolate::between;
use crate::math::{mad_sd, median};

/// How much of the flight around a maneuver its edges are compared with, s.
const CONTEXT_S: f64 = 20.0;
/// The contrast that halves the evidence, for several steps and for a single one, which chance
/// makes more often.
const CONTRAST: (f64, f64) = (6.0, 9.0);

/// Levels and edges of a sequence of steps, in grid points (fractional).
struct Shape {
    /// Edges, one more than steps.
    edges: Vec<f64>,
    /// Deviations from trim.
    levels: Vec<f64>,
    before: Quiet,
    after: Option<Quiet>,
    /// Times from 20 to 80% of each edge.
    rises: Vec<f64>,
}

/// A quiet window: its level, and the rms deviation from it.
#[derive(Clone, Copy)]
struct Quiet {
    level: f64,
    rms: f64,
}

/// The maneuver a sequence of excursions amounts to; `None` where its steps are too short, its
/// levels too unequal or no trim precedes it.
pub(super) fn maneuver(
    work: &Work,
    sequence: &[Excursion],
    settings: &Settings,
) -> Option<Maneuver> {
    let shape = refine(work, prune(sequence, work, settings)?, settings)?;
    let durations: Vec<f64> = shape.edges.windows(2).map(|e| (e[1] - e[0]) * work.h).collect();
    if durations.iter().any(|d| !(*d >= 0.8 * settings.min_step_s))
        || durations.iter().any(|d| *d > settings.max_step_s)
    {
        return None;
    }
    let found = classify(&durations, settings.timing_tolerance);
    let amplitude = shape.levels.iter().map(|l| l.abs()).sum::<f64>() / shape.levels.len() as f64;
    let edge = |k: usize| work.time(shape.edges[k]);
    let rise = |k: usize| shape.rises[k] * work.h;
    let steps = (0..durations.len())
        .map(|k| Step {
            start: edge(k),
            end: edge(k + 1),
            level: shape.levels[k],
            rises: (rise(k), rise(k + 1)),
        })
        .collect();
    Some(Maneuver {
        kind: found.kind,
        t_start: edge(0),
        t_end: edge(durations.len()),
        onset: work.time(onset(work, &shape, amplitude)),
        unit_time: found.unit_time,
        amplitude,
        polarity: shape.levels[0].signum(),
        trim: shape.before.level,
        score: score(work, &shape, amplitude, found.kind, found.deviation),
        steps,
        included: true,
        reason: String::new(),
    })
}

/// The sequence without leading and trailing twitches; `None` where nothing is left or a twitch is
/// inside.
fn prune<'a>(
    sequence: &'a [Excursion],
    work: &Work,
    settings: &Settings,
) -> Option<&'a [Excursion]> {
    let trim = window(work, sequence.first()?.start as f64, -settings.quiet_s)?.level;
    let size = |e: &Excursion| (median(&work.v[e.start..e.end]) - trim).abs();
    let sizes: Vec<f64> = sequence.iter().map(size).collect();
    let least = 0.35 * median(&sizes);
    let first = sizes.iter().position(|s| *s >= least)?;
    let last = sizes.iter().rposition(|s| *s >= least)?;
    sizes[first..=last].iter().all(|s| *s >= least).then_some(&sequence[first..=last])
}

/// Edges, levels and quiet windows by turns, three times: each needs the others, and the first
/// guess is close.
fn refine(work: &Work, sequence: &[Excursion], settings: &Settings) -> Option<Shape> {
    let mut edges: Vec<f64> = vec![sequence.first()?.start as f64];
    edges.extend(sequence.windows(2).map(|w| 0.5 * (w[0].end + w[1].start) as f64));
    edges.push(sequence.last()?.end as f64);
    let before = window(work, edges[0], -settings.quiet_s)?;
    let mut shape = Shape { edges, levels: vec![], before, after: None, rises: vec![] };
    for _pass in 0..3 {
        shape.levels = levels(work, &shape)?;
        shape.edges = edges_of(work, &shape)?;
        shape.rises = rises(work, &shape);
        let size = shape.levels.iter().map(|l| l.abs()).sum::<f64>() / shape.levels.len() as f64;
        shape.before = window(work, onset(work, &shape, size), -settings.quiet_s)?;
        let end =
            shape.edges[shape.edges.len() - 1] + 2.0 * shape.rises[shape.rises.len() - 1] + 1.0;
        shape.after = window(work, end, settings.quiet_s);
    }
    Some(shape)
}

/// The quiet window of `seconds` that ends (negative) or begins (positive) at grid point `at`; at
/// least half of it must be there.
fn window(work: &Work, at: f64, seconds: f64) -> Option<Quiet> {
    let length = work.count(seconds.abs()).max(3);
    let at = (at.max(0.0).round() as usize).min(work.v.len());
    let range = if seconds < 0.0 {
        at.saturating_sub(length)..at
    } else {
        at..(at + length).min(work.v.len())
    };
    let values: Vec<f64> = work.v[range].iter().copied().filter(|v| !v.is_nan()).collect();
    if 2 * values.len() < length {
        return None;
    }
    let level = median(&values);
    let rms = (values.iter().map(|v| (v - level) * (v - level)).sum::<f64>() / values.len() as f64)
        .sqrt();
    Some(Quiet { level, rms })
}

impl Shape {
    /// The trim at grid point `i`: a straight line between the quiet levels where they nearly
    /// agree, the level before otherwise.
    fn trim(&self, i: f64) -> f64 {
        let size =
            self.levels.iter().map(|l| l.abs()).sum::<f64>() / self.levels.len().max(1) as f64;
        let (start, end) = (self.edges[0], self.edges[self.edges.len() - 1]);
        match self.after {
            Some(after)
                if (after.level - self.before.level).abs() < 0.3 * size
                    && after.rms < 0.15 * size =>
            {
                let share = ((i - start) / (end - start)).clamp(0.0, 1.0);
                between(self.before.level, after.level, share)
            }
            _ => self.before.level,
        }
    }

    /// The grid points of step `k` where its level has been reached and the next edge has not
    /// begun.
    fn plateau(&self, k: usize) -> std::ops::RangeInclusive<usize> {
        let (start, end) = (self.edges[k], self.edges[k + 1]);
        let first = (start + 0.3 * (end - start)).ceil().max(0.0);
        let last = (start + 0.88 * (end - start)).floor().max(first);
        first as usize..=last as usize
    }

    /// Levels on both sides of edge `k`, from trim.
    fn sides(&self, k: usize) -> (f64, f64) {
        let at = |i: usize| self.levels.get(i).copied().unwrap_or(0.0);
        (if k == 0 { 0.0 } else { at(k - 1) }, at(k))
    }
}

fn deviation(work: &Work, shape: &Shape, i: usize) -> f64 {
    work.v.get(i).map_or(f64::NAN, |v| v - shape.trim(i as f64))
}

/// The median deviation from trim on each step's plateau; `None` where they do not alternate.
fn levels(work: &Work, shape: &Shape) -> Option<Vec<f64>> {
    let level = |k: usize| {
        median(&shape.plateau(k).map(|i| deviation(work, shape, i)).collect::<Vec<f64>>())
    };
    let levels: Vec<f64> = (0..shape.edges.len() - 1).map(level).collect();
    let alternate = levels.windows(2).all(|w| w[0] * w[1] < 0.0);
    (alternate && levels.iter().all(|l| l.is_finite() && *l != 0.0)).then_some(levels)
}

/// Where the signal crosses half way between neighbouring levels.
fn edges_of(work: &Work, shape: &Shape) -> Option<Vec<f64>> {
    let m = shape.levels.len();
    let middle = |k: usize| (0.5 * (shape.edges[k] + shape.edges[k + 1])).round() as usize;
    let mut edges = vec![];
    for k in 0..=m {
        let (a, b) = shape.sides(k);
        let half = 0.5 * (a + b);
        // Walk from the plateau next to the edge: back to the start of a step, forward to the end
        // of the last.
        let (from, forward, sign) = if k < m {
            (middle(k), false, (b - a).signum())
        } else {
            (middle(k - 1), true, (a - b).signum())
        };
        edges.push(cross(work, from, forward, |i| sign * (deviation(work, shape, i) - half))?);
    }
    edges.windows(2).all(|w| w[0] < w[1]).then_some(edges)
}

/// Walks from `from`, where `side` is positive, to where it vanishes (interpolated, in grid
/// points); `None` at a gap or the end.
fn cross(work: &Work, from: usize, forward: bool, side: impl Fn(usize) -> f64) -> Option<f64> {
    let (mut i, mut here) = (from, side(from));
    if !(here > 0.0) {
        return None;
    }
    loop {
        let next = if forward { i + 1 } else { i.checked_sub(1)? };
        if next >= work.v.len() {
            return None;
        }
        let there = side(next);
        if there.is_nan() {
            return None;
        }
        if there <= 0.0 {
            let share = here / (here - there);
            return Some(i as f64 + if forward { share } else { -share });
        }
        (i, here) = (next, there);
    }
}

/// Time from 20 to 80% of each edge, in grid points; an edge that never gets there counts half its
/// shorter neighbour.
fn rises(work: &Work, shape: &Shape) -> Vec<f64> {
    let m = shape.levels.len();
    let duration = |k: usize| shape.edges[k + 1] - shape.edges[k];
    let one = |k: usize| {
        let (a, b) = shape.sides(k);
        // share of the edge passed at grid point i
        let share = |i: usize| (deviation(work, shape, i) - a) / (b - a);
        let low = cross(work, shape.edges[k].ceil() as usize, false, |i| share(i) - 0.2);
        let high = cross(work, shape.edges[k].floor().max(0.0) as usize, true, |i| 0.8 - share(i));
        let slowest = 0.5 * duration(k.min(m - 1)).min(duration(k.saturating_sub(1)));
        match (low, high) {
            (Some(low), Some(high)) if high >= low => high - low,
            _ => slowest,
        }
    };
    (0..=m).map(one).collect()
}

/// The least ratio, over the edges, of the change between 20 and 80% to the sd of changes over the
/// same time in the `CONTEXT_S` seconds before and after the maneuver: slow or noisy activity makes
/// levels, but no change that stands out.
fn contrast(work: &Work, shape: &Shape) -> f64 {
    let context = work.count(CONTEXT_S);
    let first = (shape.edges[0] - shape.rises[0] - 1.0).max(0.0) as usize;
    let last = (shape.edges[shape.edges.len() - 1] + 2.0 * shape.rises[shape.rises.len() - 1] + 1.0)
        as usize;
    let before = &work.v[first.saturating_sub(context)..first];
    let after = &work.v[last.min(work.v.len())..(last + context).min(work.v.len())];
    let one = |k: usize| {
        let lag = (shape.rises[k].ceil() as usize).max(1);
        let change = |part: &[f64]| {
            part.iter().zip(part.iter().skip(lag)).map(|(a, b)| b - a).collect::<Vec<f64>>()
        };
        let changes: Vec<f64> =
            [change(before), change(after)].concat().into_iter().filter(|d| !d.is_nan()).collect();
        let (a, b) = shape.sides(k);
        0.6 * (b - a).abs() / mad_sd(&changes)
    };
    (0..shape.edges.len()).map(one).filter(|c| !c.is_nan()).fold(f64::INFINITY, f64::min)
}

/// The last grid point before the first edge where the signal is still at trim.
fn onset(work: &Work, shape: &Shape, size: f64) -> f64 {
    let near = (2.0 * shape.before.rms).max(0.05 * size).min(0.4 * size);
    let from = shape.edges[0].floor().max(0.0) as usize;
    // A smooth edge begins about one rise before its middle; beyond two it is something else.
    let longest = (0.5 * (shape.edges[1] - shape.edges[0])).min(2.0 * shape.rises[0] + 2.0);
    let found =
        (0..=from).rev().find(|&i| !((deviation(work, shape, i)).abs() > near)).unwrap_or(0);
    (found as f64).max(shape.edges[0] - longest)
}

/// 0 to 1: the root of a product of factors, each falling from 1 with one defect of the maneuver.
fn score(work: &Work, shape: &Shape, size: f64, kind: Kind, timing: Option<f64>) -> f64 {
    let factor = |x: f64, half: f64| 1.0 / (1.0 + (x / half) * (x / half));
    let count = shape.levels.len() as f64;
    let unequal = (shape.levels.iter().map(|l| (l.abs() - size) * (l.abs() - size)).sum::<f64>()
        / count)
        .sqrt();
    let shortest = shape.edges.windows(2).map(|e| e[1] - e[0]).fold(f64::INFINITY, f64::min);
    let timing = if kind == Kind::Multistep { 0.5 } else { factor(timing.unwrap_or(0.0), 0.25) };
    let after = shape.after.map_or(0.5, |a| {
        factor(a.rms / size, 0.4) * factor((a.level - shape.before.level) / size, 0.5)
    });
    let product = timing
        * factor(unequal / size, 0.4)
        * factor(roughness(work, shape) / size, 0.25)
        * factor(shape.rises.iter().sum::<f64>() / (count + 1.0) / shortest, 0.6)
        * factor(
            1.0 / contrast(work, shape),
            1.0 / if kind == Kind::Step { CONTRAST.1 } else { CONTRAST.0 },
        )
        * factor(shape.before.rms / size, 0.2)
        * after;
    product.sqrt()
}

/// Rms deviation of the plateaus from their levels.
fn roughness(work: &Work, shape: &Shape) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (k, level) in shape.levels.iter().enumerate() {
        for i in shape.plateau(k) {
            let r = deviation(work, shape, i) - level;
            sum += r * r;
            count += 1.0;
        }
    }
    (sum / f64::max(count, 1.0)).sqrt()
}
