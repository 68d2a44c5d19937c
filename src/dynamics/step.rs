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

/// The parabola through a stop at the begin, the middle and the end of a step, as weights of the
/// three at a share of the step.
pub(super) fn parabola(share: f64) -> [f64; 3] {
    let (s, r) = (share, 1.0 - share);
    [r * (r - s), 4.0 * s * r, s * (s - r)]
}

/// Where such a parabola is at a share of the step.
fn along(path: [f64; 3], share: f64) -> f64 {
    parabola(share).iter().zip(path).map(|(w, b)| w * b).sum()
}

/// Its slopes at both ends, per step.
fn ends([begin, middle, end]: [f64; 3]) -> [f64; 2] {
    [4.0 * middle - 3.0 * begin - end, begin - 4.0 * middle + 3.0 * end]
}

/// The share of a step at which such a parabola, which pushes upwards, meets what begins above it and
/// comes down by `down` per step, and how fast they come together there, per step.
fn met([begin, middle, end]: [f64; 3], above: f64, down: f64) -> Option<(f64, f64)> {
    let a = 2.0 * begin - 4.0 * middle + 2.0 * end;
    let b = 4.0 * middle - 3.0 * begin - end + down;
    let c = begin - above;
    if c >= 0.0 {
        return None;
    }
    let speed = (b * b - 4.0 * a * c).sqrt();
    let share = -2.0 * c / (b + speed);
    (share > 0.0 && share < 1.0 && speed > 0.0).then_some((share, speed))
}

/// A state that a stop left, at a share of the step, and where it is at the end. Where it met the
/// stop at that instant, `1` if it moved towards it before, and how the instant counts: see
/// `Put::on_stops`.
struct Left {
    share: f64,
    to: f64,
    upwards: bool,
    moved: f64,
    gain: f64,
}

/// Numbers that are kept of each.
pub(super) const OF_LEFT: usize = 3;

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
            for i in 0..nx {
                let f = programs.rates.get(i);
                sum[i] += WEIGHT[stage] * f;
                stage_x[i] = x[i] + AHEAD[stage] * h * f;
                if stage == 0 && self.keeps_history() {
                    let end = self.f_history.len();
                    self.f_history[end - nx + i] = f;
                }
            }
            if stage == 0 {
                self.rests(x, &programs.rates, chunk);
            }
        }
        let mut begin = std::mem::take(&mut self.begin);
        begin.clear();
        begin.extend_from_slice(x);
        for i in 0..nx {
            x[i] += h / 6.0 * sum[i];
        }
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

    /// States that left a stop inside the step: it became faster than they may, or it turned round
    /// and had taken along one that rests.
    fn leave(
        &self,
        which: Range<usize>,
        x: &mut [f64],
        (begin, h): (&[f64], f64),
        how: &mut [u8],
        shares: &mut Vec<f64>,
    ) {
        let (propagator, nx) = (self.propagator, self.propagator.layout.states);
        for (&i, how) in propagator.limited[which].iter().zip(how) {
            let reach = self.bounds[2 * nx + i] * h;
            let left = match reach.is_finite() {
                true => self.outrun(i, begin[i], reach, *how),
                false if propagator.rests[i] => self.turned(i, x[i]),
                false => None,
            };
            if let Some(left) = left {
                (x[i], *how) = (left.to, if left.upwards { LEFT_UP } else { LEFT_DOWN });
                shares.extend([left.share, left.moved, left.gain]);
            }
        }
    }

    /// Where a stop of state `i` was in the step: its lower one, or the upper one with signs
    /// reversed, so that it pushes upwards.
    fn path(&self, i: usize, upwards: bool) -> [f64; 3] {
        let (row, sign) = if upwards { (2 * i, 1.0) } else { (2 * i + 1, -1.0) };
        [&self.passed[0], &self.passed[1], &self.bounds].map(|limits| sign * limits[row])
    }

    /// A state that a stop pushes which is faster than `reach` per step: it began the step on it, or
    /// met it on the way.
    fn outrun(&self, i: usize, begin: f64, reach: f64, how: u8) -> Option<Left> {
        if how == 0 || how == RESTS {
            return None;
        }
        let upwards = matches!(how, 1 | UP);
        let (path, sign) = (self.path(i, upwards), if upwards { 1.0 } else { -1.0 });
        // It began on the stop but for rounding.
        if (sign * begin - path[0]).abs() <= 1e-9 * reach {
            let [first, last] = ends(path);
            let share = (reach - first) / (last - first);
            let to = || sign * (along(path, share) + (1.0 - share) * reach);
            let leaves = first < reach && last > reach;
            return leaves.then(|| Left { share, to: to(), upwards, moved: 0.0, gain: 0.0 });
        }
        self.overtaken(i, begin, reach, true).or_else(|| self.overtaken(i, begin, reach, false))
    }

    /// A state that began beyond the other stop and comes towards this one, or rests between them,
    /// and is taken back by this one, which is faster than it.
    fn overtaken(&self, i: usize, begin: f64, reach: f64, upwards: bool) -> Option<Left> {
        let (path, sign) = (self.path(i, upwards), if upwards { 1.0 } else { -1.0 });
        let begin = sign * begin;
        let moved = f64::from(begin > -self.path(i, !upwards)[0]);
        let (share, speed) = met(path, begin, moved * reach)?;
        let to = sign * (begin + (1.0 - share - moved * share) * reach);
        let gain = (1.0 + moved) * reach / speed;
        (gain < 1.0).then_some(Left { share, to, upwards, moved, gain })
    }

    /// A state at rest, which is at `x` at the end of the step, and was taken further by a stop that
    /// turned round.
    fn turned(&self, i: usize, x: f64) -> Option<Left> {
        let of = |upwards: bool| {
            let (path, sign) = (self.path(i, upwards), if upwards { 1.0 } else { -1.0 });
            let [first, last] = ends(path);
            let share = first / (first - last);
            let to = || along(path, share);
            let further = first > 0.0 && last < 0.0 && to() > sign * x;
            let left = || Left { share, to: sign * to(), upwards, moved: 0.0, gain: 0.0 };
            further.then(left)
        };
        of(true).or_else(|| of(false))
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
