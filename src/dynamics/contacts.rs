//! Friction and stops: the instants at which a velocity comes to rest, turns round, begins to move,
//! or meets a stop, are found inside a step.
//!
//! Between such instants every mover (`model::Moving`) has a mode, and its rate is smooth. A step is
//! tried with the modes as they are. Where at its end a mover has turned round, is beyond its stop,
//! or is pushed by more than friction holds, the first of these instants is sought by shorter steps
//! (regula falsi, Illinois); the step ends there, the modes change, and the rest of the step
//! follows. What comes to rest is at rest first, and is let go where friction cannot hold it: so
//! stopping, turning round and meeting a stop are one rule.
//!
//! Sensitivities jump where a velocity does: with `f-` and `f+` the rates before and after,
//! `S+ = S- + (f- - f+) dt`, where `dt` is the sensitivity of the instant: `-S-(v)/f-(v)` where `v`
//! crosses zero, `-(S-(x) - dB)/(v - B')` where `x` meets the stop `B`. On coming to rest `S(v)`
//! becomes 0, on turning round it is multiplied by the ratio of the accelerations after and before,
//! on beginning to move nothing jumps. What leaves a stop that itself moves had its velocity until
//! then, and has none afterwards; the instant is that at which what pushes it, less friction, is
//! zero.

use super::evaluate::Programs;
use super::modes::{Event, Jump, Lost, Mode, Span};
use super::values::{Chunk, Run};

/// Parts of a sub-step, at most, before the motion is given up as chattering.
const MOST_PARTS: usize = 64;
/// The longest part of a sub-step in which something happens. The sensitivity of an instant
/// supposes that the step's end moves with the rates there, which is true to the fourth power of the
/// step: with a quarter of it, to 1e-6 or so.
const FINE: f64 = 0.25;
/// Tries of regula falsi for one instant; more are halvings, so that the search ends.
const SMOOTH_TRIES: usize = 40;
/// An instant is known to within this share of a sub-step.
const INSTANT: f64 = 1e-12;

/// How far a mover is from an event: negative once it has happened.
#[derive(Debug, Clone, Copy)]
struct Watch {
    moving: usize,
    event: Event,
    gap: f64,
}

/// What is watched at both ends of a span of `h` seconds, and how fast the bounds move in it.
struct Pace {
    h: f64,
    start: Vec<Watch>,
    end: Vec<Watch>,
    bounds: Vec<f64>,
}

impl Pace {
    /// How fast a gap changes where it is zero, at a share of the span (the parabola through that
    /// and both ends), and how fast the bounds move.
    fn at(&self, event: usize, share: f64) -> (f64, &[f64]) {
        let (a, b) = (self.start[event].gap, self.end[event].gap);
        // Near an end that end says nothing.
        let slope = match (share, 1.0 - share) {
            (first, rest) if first > 1e-3 && rest > 1e-3 => b * first / rest - a * rest / first,
            _ => b - a,
        };
        (slope / self.h, &self.bounds)
    }
}

/// What a step that may be undone has begun with.
struct Mark {
    x: Vec<f64>,
    bounds: Vec<f64>,
    history: usize,
    lengths: [usize; 8],
}

impl Run<'_> {
    /// The modes at the start of the record. Those that are held have no velocity, whatever it
    /// depends on.
    pub(super) fn begin(&mut self, x: &[f64], programs: &mut Programs) -> Result<(), Lost> {
        if self.modes.is_empty() {
            return Ok(());
        }
        self.remember(0.0, x);
        for k in 0..self.modes.len() {
            let v = x[self.propagator.moving[k].velocity];
            self.modes[k] = if v == 0.0 { Mode::Rests } else { self.free(k, v) };
        }
        self.settle((0, 0.0), x, programs)
    }

    /// The velocities that are held now.
    pub(super) fn held(&self) -> impl Iterator<Item = usize> {
        let all = self.propagator.moving.iter().zip(&self.modes);
        all.filter(|(_, mode)| mode.held() > 0.0).map(|(m, _)| m.velocity)
    }

    /// The velocities that were held all along.
    pub(super) fn stuck(&self) -> Vec<usize> {
        let all = self.propagator.moving.iter().zip(&self.moved);
        all.filter(|(_, moved)| !**moved).map(|(m, _)| m.velocity).collect()
    }

    /// Mover `k` on its way in the direction of `v`.
    fn free(&self, k: usize, v: f64) -> Mode {
        let rubs = self.propagator.moving[k].friction.is_some();
        Mode::Free(if rubs { v.signum() as i8 } else { 0 })
    }

    /// Takes the states through a sub-step, in parts where modes change.
    pub(super) fn through(
        &mut self,
        mut span: Span,
        x: &mut [f64],
        programs: &mut Programs,
        chunk: &mut Chunk,
    ) -> Result<(), Lost> {
        if span.begins() {
            // Inputs that are held jump here.
            self.settle((span.k, 0.0), x, programs)?;
        }
        let mut longest = 1.0;
        for _ in 0..MOST_PARTS {
            let mark = self.mark(x, chunk);
            span.to = if 1.0 - span.from <= longest { 1.0 } else { span.from + longest };
            self.step(span, x, programs, chunk);
            if x.iter().any(|v| !v.is_finite()) {
                return Err(Lost::Diverges);
            }
            for (moved, mode) in self.moved.iter_mut().zip(&self.modes) {
                *moved |= matches!(mode, Mode::Free(_));
            }
            let end = self.watched(span, 1.0, x, programs)?;
            if end.iter().any(|w| w.gap < 0.0) {
                if longest > FINE {
                    longest = FINE;
                    self.undo(&mark, x, chunk);
                    continue;
                }
                let pace = self.pace(span, &mark, end, chunk, programs)?;
                let (to, event) = self.locate(span, &pace, &mark, x, programs, chunk)?;
                let share = (to - span.from) / (span.to - span.from);
                span.to = to;
                self.happen(span, event, pace.at(event, share), x, programs, chunk)?;
            }
            if 1.0 - span.to < INSTANT {
                return Ok(());
            }
            span.from = span.to;
        }
        let moves = |k: &usize| matches!(self.modes[*k], Mode::Free(_));
        let k = (0..self.modes.len()).find(moves).unwrap_or(0);
        Err(Lost::Chatters { state: self.propagator.moving[k].velocity })
    }

    /// What may happen to any mover, and how far each of it is, at `offset` of a span.
    fn watched(
        &mut self,
        span: Span,
        offset: f64,
        x: &[f64],
        programs: &mut Programs,
    ) -> Result<Vec<Watch>, Lost> {
        self.forces((span.k, span.at(offset)), x, programs);
        let mut all = Vec::with_capacity(2 * self.modes.len());
        for (moving, (m, mode)) in self.propagator.moving.iter().zip(&self.modes).enumerate() {
            let (f, friction) = self.force(moving, programs)?;
            let mut watch = |event, gap| all.push(Watch { moving, event, gap });
            match mode {
                Mode::Free(side) => {
                    if *side != 0 {
                        watch(Event::Turns, f64::from(*side) * x[m.velocity]);
                    }
                    if let Some(i) = m.position {
                        // A stop that comes after what moves away from it pushes it (`step::clip`).
                        let pushed =
                            |away: bool, gap: f64| match self.propagator.limits_move && away {
                                true => gap.max(0.0),
                                false => gap,
                            };
                        let v = x[m.velocity];
                        watch(Event::Min, pushed(v >= 0.0, x[i] - self.bounds[2 * i]));
                        watch(Event::Max, pushed(v <= 0.0, self.bounds[2 * i + 1] - x[i]));
                    }
                }
                Mode::Rests => watch(Event::Loose, friction - f.abs()),
                Mode::AtMin => watch(Event::Loose, -f - friction),
                Mode::AtMax => watch(Event::Loose, f - friction),
            }
        }
        Ok(all)
    }

    /// Evaluates what moves the movers at a fraction of a grid step.
    fn forces(&mut self, (k, c): (usize, f64), x: &[f64], programs: &mut Programs) {
        let mut point = std::mem::take(&mut self.scratch);
        self.arguments(k, c, x, &mut point);
        self.delayed(&mut point, &mut programs.taus, true, &mut Vec::new());
        self.limits_at(&point, &mut programs.limits);
        programs.moving.at(&point);
        self.scratch = point;
    }

    /// What would move mover `k`, and its friction.
    fn force(&self, k: usize, programs: &Programs) -> Result<(f64, f64), Lost> {
        let (f, friction) = (programs.moving.get(2 * k), programs.moving.get(2 * k + 1));
        match friction < 0.0 {
            true => Err(Lost::Negative { state: self.propagator.moving[k].velocity }),
            false => Ok((f, friction)),
        }
    }

    /// How gaps and bounds change over a span that has been tried.
    fn pace(
        &mut self,
        span: Span,
        mark: &Mark,
        end: Vec<Watch>,
        chunk: &Chunk,
        programs: &mut Programs,
    ) -> Result<Pace, Lost> {
        let h = chunk.lengths.last().copied().unwrap_or(f64::INFINITY);
        let bounds = self.bounds.iter().zip(&mark.bounds).map(|(b, a)| (b - a) / h).collect();
        let start = self.watched(span, 0.0, &mark.x, programs)?;
        Ok(Pace { h, start, end, bounds })
    }

    /// The end of the span at which the first event has just happened; the states are taken there.
    fn locate(
        &mut self,
        span: Span,
        pace: &Pace,
        mark: &Mark,
        x: &mut [f64],
        programs: &mut Programs,
        chunk: &mut Chunk,
    ) -> Result<(f64, usize), Lost> {
        // The one that straight lines reach first.
        let gap = |w: &usize| (pace.start[*w].gap.max(0.0), pace.end[*w].gap);
        let share = |w: &usize| gap(w).0 / (gap(w).0 - gap(w).1);
        let over = (0..pace.end.len()).filter(|w| pace.end[*w].gap < 0.0);
        let Some(mut event) = over.min_by(|a, b| share(a).total_cmp(&share(b))) else {
            return Ok((span.to, 0));
        };
        let (mut low, mut high) =
            ((span.from, pace.start[event].gap), (span.to, pace.end[event].gap));
        let (mut last, mut tries) = (0, 0);
        while high.0 - low.0 > INSTANT {
            tries += 1;
            // A gap that begins at zero opens first: halve until it is open.
            let guess = match low.1 > 0.0 && tries <= SMOOTH_TRIES {
                true => low.0 + (high.0 - low.0) * low.1 / (low.1 - high.1),
                false => 0.5 * (low.0 + high.0),
            };
            let margin = 0.1 * INSTANT;
            let to = guess.clamp(low.0 + margin, high.0 - margin);
            let now = self.again(Span { to, ..span }, mark, x, programs, chunk)?;
            if now[event].gap >= 0.0
                && let Some(other) = now.iter().position(|w| w.gap < 0.0)
            {
                // Another one is earlier.
                (event, low.1) = (other, 0.0);
            }
            let gap = now[event].gap;
            // Illinois: an end that stays twice counts half.
            if gap < 0.0 {
                if last < 0 {
                    low.1 *= 0.5;
                }
                (high, last) = ((to, gap), -1);
            } else {
                if last > 0 {
                    high.1 *= 0.5;
                }
                (low, last) = ((to, gap), 1);
            }
        }
        self.again(Span { to: high.0, ..span }, mark, x, programs, chunk)?;
        Ok((high.0, event))
    }

    /// Another try of a step from its mark.
    fn again(
        &mut self,
        span: Span,
        mark: &Mark,
        x: &mut [f64],
        programs: &mut Programs,
        chunk: &mut Chunk,
    ) -> Result<Vec<Watch>, Lost> {
        self.undo(mark, x, chunk);
        self.step(span, x, programs, chunk);
        self.watched(span, 1.0, x, programs)
    }

    /// What happens at the end of a span: the mover comes to rest, and moves on where nothing holds
    /// it.
    fn happen(
        &mut self,
        span: Span,
        event: usize,
        (gap, bounds): (f64, &[f64]),
        x: &mut [f64],
        programs: &mut Programs,
        chunk: &mut Chunk,
    ) -> Result<(), Lost> {
        let at = (span.k, span.at(1.0));
        let watch = self.watched(span, 1.0, x, programs)?[event];
        let (m, mode) = (self.propagator.moving[watch.moving], self.modes[watch.moving]);
        // The limit that it is on, or meets.
        let limit = match (watch.event, mode) {
            (Event::Min, _) | (Event::Loose, Mode::AtMin) => m.position.map(|i| 2 * i),
            (Event::Max, _) | (Event::Loose, Mode::AtMax) => m.position.map(|i| 2 * i + 1),
            _ => None,
        };
        let jump = Jump {
            after: chunk.lengths.len(),
            moving: watch.moving,
            event: watch.event,
            limit,
            drift: limit.filter(|_| self.propagator.limits_move).map_or(0.0, |b| bounds[b]),
            gap,
            before: self.rates(at, x, programs),
            behind: Vec::new(),
        };
        if watch.event != Event::Loose {
            if let (Some(i), Some(limit)) = (m.position, limit) {
                x[i] = self.bounds[limit];
            }
            x[m.velocity] = 0.0;
            self.modes[watch.moving] = Mode::Rests;
        }
        self.settle(at, x, programs)?;
        let behind = self.rates(at, x, programs);
        // What is let go where nothing moved has no jump.
        if watch.event != Event::Loose || jump.drift != 0.0 {
            chunk.jumps.push(Jump { behind, ..jump });
        }
        Ok(())
    }

    /// The rates of all states with the modes as they are.
    fn rates(&mut self, (k, c): (usize, f64), x: &[f64], programs: &mut Programs) -> Vec<f64> {
        let mut point = std::mem::take(&mut self.scratch);
        self.arguments(k, c, x, &mut point);
        self.delayed(&mut point, &mut programs.taus, true, &mut Vec::new());
        programs.rates.at(&point);
        self.scratch = point;
        (0..x.len()).map(|i| programs.rates.get(i)).collect()
    }

    /// Lets go of what is held and cannot be. What moves then may move others.
    fn settle(&mut self, at: (usize, f64), x: &[f64], programs: &mut Programs) -> Result<(), Lost> {
        for _ in 0..=2 * self.modes.len() {
            self.forces(at, x, programs);
            let mut changed = false;
            for k in 0..self.modes.len() {
                let (f, friction) = self.force(k, programs)?;
                let mode = match self.modes[k] {
                    Mode::Rests if f.abs() > friction => self.let_go(k, f, x),
                    Mode::AtMax if f < friction => Mode::Rests,
                    Mode::AtMin if -f < friction => Mode::Rests,
                    mode => mode,
                };
                changed |= mode != self.modes[k];
                self.modes[k] = mode;
            }
            if !changed {
                break;
            }
        }
        Ok(())
    }

    /// Mover `k` where friction does not hold it: on a stop if it is pushed there, else on its way.
    fn let_go(&self, k: usize, f: f64, x: &[f64]) -> Mode {
        match self.propagator.moving[k].position {
            Some(i) if f > 0.0 && x[i] >= self.bounds[2 * i + 1] => Mode::AtMax,
            Some(i) if f < 0.0 && x[i] <= self.bounds[2 * i] => Mode::AtMin,
            _ => self.free(k, f),
        }
    }

    fn mark(&self, x: &[f64], chunk: &Chunk) -> Mark {
        Mark {
            x: x.to_vec(),
            bounds: self.bounds.clone(),
            history: self.times.len(),
            lengths: [
                chunk.stages.len(),
                chunk.pasts.len(),
                chunk.clipped.len(),
                chunk.held.len(),
                chunk.ends.len(),
                chunk.end_pasts.len(),
                chunk.shares.len(),
                chunk.lengths.len(),
            ],
        }
    }

    fn undo(&mut self, mark: &Mark, x: &mut [f64], chunk: &mut Chunk) {
        let nx = x.len();
        x.copy_from_slice(&mark.x);
        self.bounds.copy_from_slice(&mark.bounds);
        self.times.truncate(mark.history);
        self.x_history.truncate(mark.history * nx);
        self.f_history.truncate(mark.history * nx);
        let [stages, pasts, clipped, held, ends, end_pasts, shares, lengths] = mark.lengths;
        chunk.stages.truncate(stages);
        chunk.pasts.truncate(pasts);
        chunk.clipped.truncate(clipped);
        chunk.held.truncate(held);
        chunk.ends.truncate(ends);
        chunk.end_pasts.truncate(end_pasts);
        chunk.shares.truncate(shares);
        chunk.lengths.truncate(lengths);
    }
}
