//! A chunk of a model with delays in; its sensitivities, taken through whole steps by machine code, out.

use super::super::delayed::{delayed, slope, state};
use super::super::rows::{LANES, product};
use super::super::sweep::Sweep;
use super::super::sweep_rows::{Goal, RowSweep};
use super::super::values::{Chunk, Run};
use super::{Late, Tangent, weights};

impl Tangent<'_> {
    /// A chunk of a model with delays, by machine code.
    pub(super) fn glide(&mut self, run: &Run, chunk: &Chunk, steps: &Sweep, rows: &RowSweep) {
        let (delays, history) = (self.propagator.delays.len(), run.keeps_history());
        let stride = (self.propagator.layout.states + delays) * self.lanes;
        let points = chunk.points.len() / (self.propagator.layout.time() + 1);
        let mut kept = std::mem::take(&mut self.work.kept);
        kept.resize(points * stride);
        let mut step = 0;
        for point in 0..points {
            if history {
                self.remembered.begin(&self.s);
            }
            self.delayed_at(run, chunk, point);
            kept[point * stride..][..stride].copy_from_slice(&self.s[..stride]);
            for s in 0..chunk.substeps.get(point).copied().unwrap_or(0) {
                if history && s > 0 {
                    self.remembered.begin(&self.s);
                }
                let (first, weights) = (4 * step, weights(chunk.lengths[step]));
                let pasts = &chunk.pasts[first * delays..][..4 * delays];
                if pasts.iter().any(|past| self.remembered.is_present(past)) {
                    self.rates_first(run, chunk, first);
                }
                self.late_step(run, chunk, first, (steps, weights.as_flattened()));
                step += 1;
            }
        }
        let mut goal = Goal::new(&mut self.rows);
        for first in (0..points).step_by(LANES) {
            let n = LANES.min(points - first);
            let registers = self.outputs.registers(&chunk.points, first);
            rows.points(registers, n, (&kept[first * stride..], stride), self.done, &mut goal);
            self.done += n;
        }
        if !goal.is_finite() {
            self.zeros = [f64::NAN; 8];
        }
        self.work.kept = kept;
    }

    /// The sensitivities of the rates at the begin of a step, for later stages of it that read them;
    /// `first`: its first stage in the chunk.
    fn rates_first(&mut self, run: &Run, chunk: &Chunk, first: usize) {
        let delays = self.propagator.delays.len();
        let pasts = &chunk.pasts[first * delays..(first + 1) * delays];
        let at = (self.delays.at(&chunk.stages, first), first);
        let s = &mut self.s;
        delayed(self.propagator, self.width, run, pasts, at, s, &mut self.remembered);
        let (block, k) = (self.rates.at(&chunk.stages, first), &mut self.work.k);
        // SAFETY: the width is this machine's.
        unsafe { product(self.width, block, first % LANES, &self.s, k) };
        self.remembered.rates(&self.work.k, |_| false);
    }

    /// One step by machine code, `first` its first stage in the chunk.
    fn late_step(
        &mut self,
        run: &Run,
        chunk: &Chunk,
        first: usize,
        (steps, weights): (&Sweep, &[f64]),
    ) {
        let (lanes, size) = (self.lanes, self.propagator.layout.states * self.lanes);
        let delays = &self.propagator.delays;
        let Late { from, to, numbers } = &mut self.late;
        from[..size].copy_from_slice(&self.s[..size]);
        from[size..].fill(0.0);
        numbers.clear();
        numbers.extend_from_slice(weights);
        let pasts = chunk.pasts[first * delays.len()..].chunks_exact(delays.len()).take(4);
        let rows = from[size..].chunks_exact_mut(lanes);
        for ((delay, past), row) in pasts.flat_map(|pasts| delays.iter().zip(pasts)).zip(rows) {
            numbers.push(-slope(run, delay, past));
            if let Some(state) = state(delay) {
                self.remembered.read(state, past, row);
            }
        }
        let rates = self.rates.registers(&chunk.stages, first);
        let times = self.delays.registers(&chunk.stages, first);
        steps.late_step([rates, times], first % LANES, numbers, from, to);
        self.s[..size].copy_from_slice(&to[..size]);
        self.remembered.rates_of(&to[size..]);
    }
}
