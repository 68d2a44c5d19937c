//! A chunk of a record, grid point by grid point: states in; values, and what the later passes need
//! of every stage, out.

use super::between::{Between, Column};
use super::evaluate::{Programs, Single};
use super::history::{self, Past};
use super::lead::Lead;
use super::modes::{Jump, Lost, Mode, Span};
use super::propagator::Propagator;
use super::sigma_filter::{Smooth, smoothed};
use super::tableau::OFFSET;
use super::{Interpolation, Record};
use crate::model::Delayed;

/// Everything of one run that the three passes share.
pub(super) struct Run<'p> {
    pub(super) propagator: &'p Propagator,
    pub(super) record: &'p Record,
    /// Time derivatives of the inputs on the grid (only where the model uses them).
    slopes: Vec<f64>,
    between: Between,
    /// Inputs without their small movements, per delay.
    smooth: Vec<Option<Smooth>>,
    /// Limits of the states at this instant: lower and upper of each, then how fast stops take each
    /// along.
    pub(super) bounds: Vec<f64>,
    /// How each `Moving` is at this instant, and whether it has moved at all.
    pub(super) modes: Vec<Mode>,
    pub(super) moved: Vec<bool>,
    /// Times at which steps begin; states and their rates there (delayed states need them).
    pub(super) times: Vec<f64>,
    pub(super) x_history: Vec<f64>,
    pub(super) f_history: Vec<f64>,
    pub(super) lead: Lead,
    /// Scratch of a step, and of a point.
    pub(super) stage: Vec<f64>,
    pub(super) sum: Vec<f64>,
    pub(super) begin: Vec<f64>,
    /// Where the stages of a grid step are, as shares of it.
    pub(super) shares: Vec<f64>,
    /// Limits at the begin and in the middle of a step, where they change.
    pub(super) passed: [Vec<f64>; 2],
    pub(super) scratch: Vec<f64>,
}

impl<'p> Run<'p> {
    pub(super) fn new(propagator: &'p Propagator, record: &'p Record, taus: &mut Single) -> Self {
        let smooth = if propagator.delays.iter().any(|d| matches!(d.of, Delayed::Smooth(_))) {
            // Their parameters are the same all along a record.
            taus.at(&vec![0.0; propagator.layout.time() + 1]);
            smoothed(
                &propagator.delays,
                &record.inputs[..record.n * propagator.layout.inputs],
                propagator.layout.inputs,
                record.dt,
                |k| taus.get(k),
            )
        } else {
            Vec::new()
        };
        let slopes = if propagator.uses_input_rates {
            input_slopes(record, propagator.layout.inputs)
        } else {
            Vec::new()
        };
        let nu = propagator.layout.inputs;
        let (times, x_history, f_history, stage, sum, begin, shares) = Default::default();
        let count = propagator.moving.len();
        Run {
            propagator,
            record,
            between: Between::new(if slopes.is_empty() { nu } else { 2 * nu }),
            slopes,
            smooth,
            bounds: Vec::new(),
            modes: vec![Mode::Free(0); count],
            moved: vec![false; count],
            times,
            x_history,
            f_history,
            lead: Lead::new(),
            stage,
            sum,
            begin,
            shares,
            passed: Default::default(),
            scratch: vec![0.0; propagator.layout.time() + 1],
        }
    }
}

/// What one chunk keeps for the later passes.
#[derive(Default)]
pub(super) struct Chunk {
    /// Arguments of every stage, rows of the layout's width.
    pub(super) stages: Vec<f64>,
    /// How every stage's delayed states were read: rows of delays.
    pub(super) pasts: Vec<Past>,
    /// Arguments at the grid points.
    pub(super) points: Vec<f64>,
    pub(super) point_pasts: Vec<Past>,
    /// Steps in each grid step: its sub-steps, and more where something begins or ceases to move
    /// inside one.
    pub(super) substeps: Vec<usize>,
    /// Length of each step, s; empty for a plain model, whose steps are alike.
    pub(super) lengths: Vec<f64>,
    /// Arguments at the end of each step, where limits change along a trajectory, and how their
    /// delayed states were read, where limits depend on them.
    pub(super) ends: Vec<f64>,
    pub(super) end_pasts: Vec<Past>,
    /// Per step and limited state: 0 free, 1 held at its minimum, 2 at its maximum; 4 and 5 taken
    /// along by them as fast as it may, upwards and downwards; 6 and 7 left behind by them, and at
    /// which share of the step, in turn.
    pub(super) held: Vec<u8>,
    pub(super) shares: Vec<f64>,
    /// Where sensitivities jump.
    pub(super) jumps: Vec<Jump>,
    /// Per stage and limited state, likewise: its stage value was put on its minimum or maximum. Of
    /// a first stage: 3 where it rests on a stop, so that the slope of its history is zero.
    pub(super) clipped: Vec<u8>,
}

impl Chunk {
    pub(super) fn clear(&mut self) {
        self.stages.clear();
        self.pasts.clear();
        self.points.clear();
        self.point_pasts.clear();
        self.substeps.clear();
        self.lengths.clear();
        self.ends.clear();
        self.end_pasts.clear();
        self.shares.clear();
        self.jumps.clear();
        self.held.clear();
        self.clipped.clear();
    }

    /// The same for a plain model, which writes the next chunk's stages over the last one's.
    pub(super) fn clear_plain(&mut self) {
        let stages = std::mem::take(&mut self.stages);
        self.clear();
        self.stages = stages;
    }
}

/// Central differences of the inputs on the grid, one-sided at the ends.
fn input_slopes(record: &Record, nu: usize) -> Vec<f64> {
    let n = record.n;
    let mut out = vec![0.0; n * nu];
    for k in 0..n {
        let (a, b) = (k.saturating_sub(1), (k + 1).min(n - 1));
        if a == b {
            continue;
        }
        for j in 0..nu {
            out[k * nu + j] = (record.inputs[b * nu + j] - record.inputs[a * nu + j])
                / ((b - a) as f64 * record.dt);
        }
    }
    out
}

impl Run<'_> {
    /// Fills states, inputs, input rates and time of the point at grid step k (from the start
    /// point) and fraction c.
    pub(super) fn arguments(&mut self, k: usize, c: f64, x: &[f64], point: &mut [f64]) {
        let (l, nu) = (&self.propagator.layout, self.propagator.layout.inputs);
        point[..l.states].copy_from_slice(x);
        let k = self.record.start + k;
        let row = self.between.at(self.record, &self.slopes, k, c);
        point[l.input()..][..nu].copy_from_slice(&row[..nu]);
        if row.len() > nu {
            point[l.input_rate()..][..nu].copy_from_slice(&row[nu..]);
        }
        for (k, mode) in self.modes.iter().enumerate() {
            point[l.held() + k] = mode.held();
            point[l.side() + k] = mode.side();
        }
        point[l.time()] = (k as f64 - self.record.start as f64 + c) * self.record.dt;
    }

    /// The limits at the start.
    pub(super) fn limit(&mut self, x: &[f64], programs: &mut Programs) {
        let mut point = vec![0.0; self.propagator.layout.time() + 1];
        self.arguments(0, 0.0, x, &mut point);
        programs.limits.at(&point);
        self.bounds = (0..3 * x.len()).map(|k| programs.limits.get(k)).collect();
    }

    /// Fills the delayed values of a point and says how the states among them were read.
    pub(super) fn delayed(
        &self,
        point: &mut [f64],
        taus: &mut Single,
        slope_known: bool,
        pasts: &mut Vec<Past>,
    ) {
        let (propagator, l, record) = (self.propagator, &self.propagator.layout, self.record);
        if propagator.delays.is_empty() {
            return;
        }
        taus.at(point);
        let now = point[l.time()];
        for (k, delay) in propagator.delays.iter().enumerate() {
            let t = now - taus.get(k);
            let mut past = Past { i: 0, j: 0, w: [0.0; 4], slope: [0.0; 4] };
            point[l.delayed() + k] = match delay.of {
                Delayed::Input(j) => {
                    let at = t / record.dt + record.start as f64 - record.behind(j);
                    let read = match record.interpolation.get(j) {
                        Some(Interpolation::Ramps) => history::on_lines,
                        _ => history::input,
                    };
                    let inputs = &record.inputs[..record.n * l.inputs];
                    let (value, slope) = read(inputs, l.inputs, j, record.dt, at);
                    past.slope[0] = slope;
                    value
                }
                Delayed::Smooth(_) => {
                    let of = |k: usize| propagator.delays.get(k).map(|d| d.of);
                    let ago = Delayed::ago(k, of).map_or(0.0, |at| taus.get(at));
                    let at = (now - ago) / record.dt + record.start as f64;
                    let [value, by_reach, by_width, slope] =
                        self.smooth[k].as_ref().map_or([f64::NAN; 4], |smooth| smooth.at(at));
                    past.slope = [by_reach, by_width, slope / record.dt, 0.0];
                    value
                }
                Delayed::Within(_) | Delayed::Ago(_) => 0.0,
                Delayed::State(i) => {
                    past = history::locate(&self.times, t, slope_known);
                    self.past_value(i, &past, &past.w)
                }
            };
            pasts.push(past);
        }
    }

    /// The grid points of a chunk and the steps between them, one by one: the point where the
    /// states were lost, and why, if they were.
    pub(super) fn walk(
        &mut self,
        points: std::ops::Range<usize>,
        m: usize,
        x: &mut [f64],
        programs: &mut Programs,
        chunk: &mut Chunk,
    ) -> Option<(usize, Lost)> {
        let last = self.record.n - self.record.start - 1;
        for k in points {
            self.point(k, x, &mut programs.taus, chunk);
            if x.iter().any(|v| !v.is_finite()) {
                return Some((k, Lost::Diverges));
            }
            if k == last {
                continue;
            }
            let before = chunk.lengths.len();
            for s in 0..m {
                let span = Span::whole(k, s, m);
                if self.modes.is_empty() {
                    self.step(span, x, programs, chunk);
                } else if let Err(lost) = self.through(span, x, programs, chunk) {
                    return Some((k, lost));
                }
            }
            chunk.substeps.push(chunk.lengths.len() - before);
        }
        None
    }

    /// The same for a plain model: all arguments but the states are laid out first.
    pub(super) fn march(
        &mut self,
        points: std::ops::Range<usize>,
        m: usize,
        x: &mut [f64],
        rates: &mut Single,
        chunk: &mut Chunk,
    ) -> Option<usize> {
        let width = self.propagator.layout.time() + 1;
        let (first, n) = (points.start, self.record.n - self.record.start);
        let steps = points.end.min(n - 1) - first;
        chunk.substeps.resize(steps, m);
        chunk.stages.resize(steps * m * 4 * width, 0.0);
        self.lay_out(first, m, &mut chunk.stages);
        self.sum.resize(x.len(), 0.0);
        rates.march(&mut chunk.stages, width, self.record.dt / m as f64, x, &mut self.sum);
        for step in 0..steps {
            let from = step * m * 4 * width;
            chunk.points.extend_from_slice(&chunk.stages[from..from + width]);
        }
        if first + steps < points.end {
            chunk.points.resize((steps + 1) * width, 0.0);
            self.arguments(first + steps, 0.0, x, &mut chunk.points[steps * width..]);
        }
        // A state that is not finite stays so: where the last ones are, all are.
        if x.iter().all(|v| v.is_finite()) {
            return None;
        }
        let lost = |row: &[f64]| row[..x.len()].iter().any(|v| !v.is_finite());
        let at = chunk.points.chunks_exact(width).position(lost).map(|k| first + k);
        at.or(Some(points.end).filter(|&end| end < n))
    }

    /// Inputs, their rates and time of all stages of the steps from grid step `first` on, `m` steps
    /// in each. Column by column: how one runs between its points is asked once.
    fn lay_out(&mut self, first: usize, m: usize, rows: &mut [f64]) {
        let (l, record) = (&self.propagator.layout, self.record);
        let (nu, width) = (l.inputs, l.time() + 1);
        let share = |i: usize| ((i / 4) as f64 + OFFSET[i % 4]) / m as f64;
        self.shares.clear();
        self.shares.extend((0..4 * m).map(share));
        let shares = &self.shares;
        let columns = [(&*record.inputs, l.input()), (&*self.slopes, l.input_rate())];
        for (from, to) in columns.into_iter().filter(|(from, _)| !from.is_empty()) {
            for j in 0..nu {
                let column = Column::of(record, from, nu, j);
                for (k, step) in rows.chunks_exact_mut(4 * m * width).enumerate() {
                    let k = record.start + first + k;
                    let values = step.chunks_exact_mut(width).map(|row| &mut row[to + j]);
                    column.over(k, shares, values);
                }
            }
        }
        for (k, step) in rows.chunks_exact_mut(4 * m * width).enumerate() {
            for (row, &c) in step.chunks_exact_mut(width).zip(shares) {
                row[l.time()] = ((first + k) as f64 + c) * record.dt;
            }
        }
    }

    pub(super) fn past_value(&self, state: usize, p: &Past, w: &[f64; 4]) -> f64 {
        let nx = self.propagator.layout.states;
        let (i, j) = (p.i * nx + state, p.j * nx + state);
        w[0] * self.x_history[i]
            + w[1] * self.f_history[i]
            + w[2] * self.x_history[j]
            + w[3] * self.f_history[j]
    }

    pub(super) fn keeps_history(&self) -> bool {
        self.propagator.delays.iter().any(|d| matches!(d.of, Delayed::State(_)))
    }

    /// The arguments at grid point `k` where the states have always been `x`.
    pub(super) fn at_rest(&mut self, k: usize, x: &[f64], taus: &mut Single) -> Chunk {
        let mut chunk = Chunk::default();
        (self.times, self.x_history, self.f_history) = (vec![0.0], x.to_vec(), vec![0.0; x.len()]);
        self.point(k, x, taus, &mut chunk);
        chunk
    }

    /// The arguments at a grid point.
    fn point(&mut self, k: usize, x: &[f64], taus: &mut Single, chunk: &mut Chunk) {
        let width = self.propagator.layout.time() + 1;
        let at = chunk.points.len();
        chunk.points.resize(at + width, 0.0);
        self.arguments(k, 0.0, x, &mut chunk.points[at..]);
        self.remember(chunk.points[at + width - 1], x);
        self.delayed(&mut chunk.points[at..], taus, false, &mut chunk.point_pasts);
    }

    /// Adds a step time and the states there to the history, once.
    pub(super) fn remember(&mut self, time: f64, x: &[f64]) {
        if self.keeps_history() && self.times.last() != Some(&time) {
            self.times.push(time);
            self.x_history.extend_from_slice(x);
            self.f_history.resize(self.x_history.len(), 0.0);
        }
    }
}
