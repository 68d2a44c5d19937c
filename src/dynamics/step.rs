//! One step of the classic Runge-Kutta method of fourth order, states on their stops where they
//! would be beyond them: states in, states at its end out.

use super::evaluate::{Programs, Single};
use super::modes::{Mode, Span};
use super::tableau::{AHEAD, OFFSET, WEIGHT};
use super::values::{Chunk, Run};
use std::ops::Range;

/// How a limited state is: on its stop, which it would leave outwards; taken along by a stop that
/// moves faster than the state may, upwards and downwards; left by it inside a step, likewise.
pub(super) const RESTS: u8 = 3;
pub(super) const UP: u8 = 4;
pub(super) const DOWN: u8 = 5;
pub(super) const LEFT_UP: u8 = 6;
pub(super) const LEFT_DOWN: u8 = 7;

impl Run<'_> {
    /// Takes the states `x` through a span, with the modes as they are.
    pub(super) fn step(
        &mut self,
        span: Span,
        x: &mut [f64],
        programs: &mut Programs,
        chunk: &mut Chunk,
    ) {
        let nx = x.len();
        let width = self.propagator.layout.time() + 1;
        let h = self.record.dt / span.m as f64 * (span.to - span.from);
        let mut stage_x = std::mem::take(&mut self.stage);
        stage_x.clear();
        stage_x.extend_from_slice(x);
        let mut sum = std::mem::take(&mut self.sum);
        sum.clear();
        sum.resize(nx, 0.0);
        for stage in 0..4 {
            let at = chunk.stages.len();
            chunk.stages.resize(at + width, 0.0);
            let point = &mut chunk.stages[at..];
            self.arguments(span.k, span.at(OFFSET[stage]), &stage_x, point);
            if stage == 0 {
                self.remember(point[width - 1], x);
            }
            self.delayed(point, &mut programs.taus, stage > 0, &mut chunk.pasts);
            if stage == 0 {
                self.limits_at(point, &mut programs.limits);
            } else {
                let since = (&*x, OFFSET[stage] * h);
                self.put(point, since, &mut programs.limits, &mut chunk.clipped, None);
            }
            if self.propagator.limits_move && stage % 2 == 0 {
                self.passed[stage / 2].clone_from(&self.bounds);
            }
            programs.rates.at(point);
            let rates = programs.rates.outputs();
            let weights = [WEIGHT[stage], AHEAD[stage] * h];
            self.lead.stage(rates, weights, x, &mut sum, &mut stage_x);
            if stage == 0 && self.keeps_history() {
                let from = self.f_history.len() - nx;
                self.f_history[from..].copy_from_slice(rates);
            }
            if stage == 0 {
                self.rests(x, &programs.rates, chunk);
            }
        }
        let mut begin = std::mem::take(&mut self.begin);
        begin.clear();
        begin.extend_from_slice(x);
        self.lead.end(&sum, h, x);
        if self.propagator.limits_move {
            let at = chunk.ends.len();
            chunk.ends.resize(at + width, 0.0);
            let end = &mut chunk.ends[at..];
            self.arguments(span.k, span.at(1.0), x, end);
            if self.propagator.limits_are_late {
                self.delayed(end, &mut programs.taus, true, &mut chunk.end_pasts);
            }
            let shares = Some(&mut chunk.shares);
            self.put(end, (&begin, h), &mut programs.limits, &mut chunk.held, shares);
            x.copy_from_slice(&end[..nx]);
        } else {
            self.clip(0..self.propagator.limited.len(), x, (&begin, h), &mut chunk.held);
        }
        chunk.lengths.push(h);
        (self.stage, self.sum, self.begin) = (stage_x, sum, begin);
    }

    /// Puts the states of a point on their stops where they would be beyond them, level by level;
    /// `since`: the states at the begin of the step, and how long ago that is. At its end, where
    /// there are `shares`, some have left their stops meanwhile.
    fn put(
        &mut self,
        point: &mut [f64],
        since: (&[f64], f64),
        limits: &mut Single,
        how: &mut Vec<u8>,
        mut shares: Option<&mut Vec<f64>>,
    ) {
        let (propagator, nx, told) = (self.propagator, self.propagator.layout.states, how.len());
        let mut from = 0;
        for &to in &propagator.level_ends {
            self.limits_at(point, limits);
            self.clip(from..to, &mut point[..nx], since, how);
            if let Some(shares) = &mut shares {
                self.leave(from..to, &mut point[..nx], since, &mut how[told + from..], shares);
            }
            from = to;
        }
    }

    /// The limits at a point, where they are not the same everywhere.
    pub(super) fn limits_at(&mut self, point: &[f64], limits: &mut Single) {
        if self.propagator.limits_move {
            limits.at(point);
            for (k, bound) in self.bounds.iter_mut().enumerate() {
                *bound = limits.get(k);
            }
        }
    }

    /// Puts states that are beyond a stop on it, or as near to it as it may take them since the
    /// step began, and says which. A position whose velocity may be held is on its stop, or is not,
    /// as its mode says.
    fn clip(
        &self,
        which: Range<usize>,
        x: &mut [f64],
        (begin, since): (&[f64], f64),
        how: &mut Vec<u8>,
    ) {
        let nx = self.propagator.layout.states;
        for &i in &self.propagator.limited[which] {
            let (low, high) = (self.bounds[2 * i], self.bounds[2 * i + 1]);
            let mover = self.propagator.moving.iter().position(|m| m.position == Some(i));
            let side = match mover.map(|k| self.modes[k]) {
                Some(Mode::Free(_)) if !self.propagator.limits_move => 0,
                Some(Mode::Free(_)) => {
                    let v = mover.map_or(0.0, |k| x[self.propagator.moving[k].velocity]);
                    beyond(x[i] < low && v >= 0.0, x[i] > high && v <= 0.0)
                }
                Some(Mode::AtMin) => 1,
                Some(Mode::AtMax) => 2,
                Some(Mode::Rests) | None => beyond(x[i] < low, x[i] > high),
            };
            let stop = [x[i], low, high][usize::from(side)];
            let reach = self.bounds[2 * nx + i] * since;
            let (put, said) = match stop - begin[i] {
                way if side > 0 && way > reach => (begin[i] + reach, UP),
                way if side > 0 && way < -reach => (begin[i] - reach, DOWN),
                _ => (stop, side),
            };
            how.push(said);
            x[i] = put;
        }
    }

    /// Notes which states rest on a stop at the start of a step: their history has no slope there.
    fn rests(&mut self, x: &[f64], rates: &Single, chunk: &mut Chunk) {
        let nx = x.len();
        for &i in &self.propagator.limited {
            let (low, high, f) = (self.bounds[2 * i], self.bounds[2 * i + 1], rates.get(i));
            let rests = x[i] >= high && f > 0.0 || x[i] <= low && f < 0.0;
            chunk.clipped.push(if rests { RESTS } else { 0 });
            if rests && self.keeps_history() {
                let end = self.f_history.len();
                self.f_history[end - nx + i] = 0.0;
            }
        }
    }
}

/// 1 beyond the lower stop, 2 beyond the upper one, also where they have crossed.
fn beyond(low: bool, high: bool) -> u8 {
    if high { 2 } else { u8::from(low) }
}
