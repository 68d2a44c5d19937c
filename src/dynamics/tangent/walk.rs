//! A chunk of any model, values done, in; its sensitivities, stage by stage, with stops, delays and
//! jumps of velocities, out.

use super::super::delayed::delayed;
use super::super::history::Past;
use super::super::left::OF_LEFT;
use super::super::modes::{Event, Jump};
use super::super::rows::{Append, LANES, append, product};
use super::super::step::{LEFT_UP, RESTS};
use super::super::steps::{Steps, steps};
use super::super::tableau::OFFSET;
use super::super::values::{Chunk, Run};
use super::stops::{Put, is_put};
use super::{Tangent, Work, weights};

/// Where in a chunk: its step, and the place in the list of shares at which states left their stops.
#[derive(Default)]
pub(in super::super) struct Place {
    step: usize,
    left: usize,
}

impl Tangent<'_> {
    /// A chunk of any model, stage by stage.
    pub(super) fn walk(&mut self, run: &Run, chunk: &Chunk) {
        let propagator = self.propagator;
        let history = run.keeps_history();
        let points = chunk.points.len() / (propagator.layout.time() + 1);
        let mut at = Place::default();
        let mut jumps = chunk.jumps.iter().peekable();
        while let Some(jump) = jumps.next_if(|jump| jump.after == 0) {
            self.jump(jump, chunk, 0);
        }
        for point in 0..points {
            if history {
                self.remembered.begin(&self.s);
            }
            self.delayed_at(run, chunk, point);
            let to = Append {
                lists: &mut self.rows,
                directions: propagator.directions.len(),
                k: self.done,
                zeros: &mut self.zeros,
            };
            let lane = point % LANES;
            // SAFETY: the width is this machine's.
            unsafe {
                append(
                    self.width,
                    self.outputs.at(&chunk.points, point),
                    lane..lane + 1,
                    &self.s,
                    0,
                    to,
                )
            };
            self.done += 1;
            let Some(&steps) = chunk.substeps.get(point) else { continue };
            for s in 0..steps {
                if history && s > 0 {
                    self.remembered.begin(&self.s);
                }
                self.step(run, chunk, &mut at);
                while let Some(jump) = jumps.next_if(|jump| jump.after <= at.step) {
                    self.jump(jump, chunk, at.step);
                }
            }
        }
    }

    /// One step of a chunk, stage by stage.
    pub(in super::super) fn step(&mut self, run: &Run, chunk: &Chunk, at: &mut Place) {
        let (delays, limited) = (self.propagator.delays.len(), self.propagator.limited.len());
        let length = chunk.lengths[at.step];
        self.begin.iter_mut().zip(&self.s[..]).for_each(|(begin, s)| *begin = *s);
        let held = &chunk.held[at.step * limited..(at.step + 1) * limited];
        let leaves = OF_LEFT * held.iter().filter(|how| **how >= LEFT_UP).count();
        for stage in 4 * at.step..4 * at.step + 4 {
            let clipped = &chunk.clipped[stage * limited..(stage + 1) * limited];
            let pasts = &chunk.pasts[stage * delays..(stage + 1) * delays];
            self.stage(run, &chunk.stages, (stage, length), clipped, pasts, weights(length));
            if leaves > 0 && stage % 2 == 0 {
                self.pass(&chunk.stages, stage);
            }
        }
        let shares = &chunk.shares[at.left..at.left + leaves];
        self.end(run, chunk, at.step, held, shares);
        *at = Place { step: at.step + 1, left: at.left + leaves };
    }

    /// Keeps the sensitivities of the limits at the first or the third stage of a step, which is done.
    fn pass(&mut self, stages: &[f64], at: usize) {
        let block = self.stage_limits.at(stages, at);
        let Work { between: [_, b], .. } = &self.work;
        // SAFETY: the width is this machine's.
        unsafe { product(self.width, block, at % LANES, b, &mut self.passed[at % 4 / 2]) };
    }

    /// Puts states on their stops at the end of a step of a chunk; `shares`: of the step, at which
    /// some have left theirs.
    fn end(&mut self, run: &Run, chunk: &Chunk, step: usize, held: &[u8], shares: &[f64]) {
        let moves = self.propagator.limits_move && is_put(held);
        if moves && self.propagator.limits_are_late {
            let delays = self.propagator.delays.len();
            delayed(
                self.propagator,
                self.width,
                run,
                &chunk.end_pasts[step * delays..][..delays],
                (self.end_delays.at(&chunk.ends, step), step),
                &mut self.s,
                &mut self.remembered,
            );
        }
        let block = moves.then(|| (self.end_limits.at(&chunk.ends, step), step % LANES));
        let put = Put {
            propagator: self.propagator,
            width: self.width,
            how: held,
            begin: &self.begin,
            since: chunk.lengths[step],
            left: (&self.passed, shares),
        };
        put.on_stops(block, &mut self.limits, &mut self.s);
    }

    /// Stage `at` of a chunk's `stages`, and after the last one of a step the step, which takes
    /// `length` s. `pasts`: how its delayed values were read.
    fn stage(
        &mut self,
        run: &Run,
        stages: &[f64],
        (at, length): (usize, f64),
        clipped: &[u8],
        pasts: &[Past],
        weights: [[f64; 2]; 4],
    ) {
        let (number, history, size) =
            (at % 4, self.remembered.is_kept(), self.propagator.layout.states * self.lanes);
        let Work { between: [a, b], sum, k, .. } = &mut self.work;
        if number == 0 {
            b[..size].copy_from_slice(&self.s[..size]);
        }
        let from = if number % 2 == 0 { &mut *b } else { &mut *a };
        if !pasts.is_empty() {
            delayed(
                self.propagator,
                self.width,
                run,
                pasts,
                (self.delays.at(stages, at), at),
                from,
                &mut self.remembered,
            );
        }
        let moves = self.propagator.limits_move && is_put(clipped);
        let block = moves.then(|| (self.stage_limits.at(stages, at), at % LANES));
        let put = Put {
            propagator: self.propagator,
            width: self.width,
            how: clipped,
            begin: &self.begin,
            since: OFFSET[number] * length,
            left: (&self.passed, &[]),
        };
        put.on_stops(block, &mut self.limits, from);
        let k = history.then_some(&mut k[..]);
        let mut job = Steps {
            s: &mut self.s,
            sum,
            between: [a, b],
            k,
            weights,
            plain: false,
            kept: &mut [],
            every: 0,
            phase: 0,
        };
        // SAFETY: the width is this machine's.
        unsafe {
            steps(self.width, self.rates.at(stages, at), at % LANES..at % LANES + 1, &mut job)
        };
        if number == 0 && history {
            let limited = &self.propagator.limited;
            let rests = |i: usize| {
                limited.iter().zip(clipped).any(|(&limited, &how)| limited == i && how == RESTS)
            };
            self.remembered.rates(&self.work.k, rests);
        }
    }

    /// The sensitivities behind an instant at which a velocity jumps (see `contacts`); `done`: steps
    /// of the chunk before it.
    fn jump(&mut self, jump: &Jump, chunk: &Chunk, done: usize) {
        let (lanes, mover) = (self.lanes, self.propagator.moving[jump.moving]);
        let leaves = jump.event == Event::Loose;
        if self.propagator.limits_move && jump.limit.is_some() && done > 0 {
            let at = (done - 1) % LANES;
            // SAFETY: the width is this machine's.
            unsafe {
                let block = self.end_limits.at(&chunk.ends, done - 1);
                product(self.width, block, at, &self.s, &mut self.limits);
                let block = self.pushes.at(&chunk.ends, done - 1);
                product(self.width, block, at, &self.s, &mut self.pushed);
            }
        }
        for l in 0..lanes {
            let s = |state: usize| self.s[state * lanes + l];
            let of_limit = jump.limit.map_or(0.0, |limit| self.limits[limit * lanes + l]);
            let met = mover.position.zip(jump.limit).map(|(i, _)| i);
            // The sensitivity of the instant.
            let (gap, speed) = match met {
                Some(_) if leaves => {
                    let side =
                        if jump.limit.is_some_and(|limit| limit % 2 == 1) { 1.0 } else { -1.0 };
                    let of = |row: usize| self.pushed[(2 * jump.moving + row) * lanes + l];
                    (side * of(0) - of(1), jump.gap)
                }
                Some(i) => (s(i) - of_limit, jump.before[i] - jump.drift),
                None => (s(mover.velocity), jump.before[mover.velocity]),
            };
            let instant = if speed == 0.0 { 0.0 } else { -gap / speed };
            if let Some(i) = met.filter(|_| leaves) {
                self.s[i * lanes + l] += jump.drift * instant;
                continue;
            }
            for (state, (before, behind)) in jump.before.iter().zip(&jump.behind).enumerate() {
                self.s[state * lanes + l] += (before - behind) * instant;
            }
            self.s[mover.velocity * lanes + l] = -jump.behind[mover.velocity] * instant;
            if let Some(i) = met {
                self.s[i * lanes + l] = of_limit;
            }
        }
    }
}
