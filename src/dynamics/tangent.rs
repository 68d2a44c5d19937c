//! Exact sensitivities: the Runge-Kutta method applied to `S' = A S + B`, lanes of directions.

use super::history::Past;
use super::plan::Plan;
use super::propagate::{AHEAD, Chunk, Many, RESTS, Run, WEIGHT};
use crate::model::Delayed;
use crate::model::linear::Sparse;

/// Directions are padded to whole vectors of this many.
const VECTOR: usize = 8;

pub struct Tangent<'p> {
    plan: &'p Plan,
    rates: Many<'p>,
    outputs: Many<'p>,
    delays: Many<'p>,
    /// Directions, padded.
    lanes: usize,
    /// Sensitivities of the states `[state][lanes]`.
    s: Vec<f64>,
    /// Sensitivities of the limits `[state][min, max][lanes]`.
    limits: Vec<f64>,
    /// Output sensitivities of all grid points so far `[point][output][direction]`.
    pub rows: Vec<f64>,
    /// Sensitivities of the states and their rates at the remembered step times.
    s_history: Vec<f64>,
    k_history: Vec<f64>,
    entries: Buffers,
    work: Work,
}

#[derive(Default)]
struct Buffers {
    rates: Vec<f64>,
    outputs: Vec<f64>,
    delays: Vec<f64>,
    point_delays: Vec<f64>,
}

#[derive(Default)]
struct Work {
    stage: Vec<f64>,
    k: Vec<f64>,
    sum: Vec<f64>,
    delayed: Vec<f64>,
    row: Vec<f64>,
}

/// `y += a x`, lane by lane.
#[inline(always)]
fn add(y: &mut [f64], a: f64, x: &[f64]) {
    for (y, x) in y.chunks_exact_mut(VECTOR).zip(x.chunks_exact(VECTOR)) {
        for l in 0..VECTOR {
            y[l] += a * x[l];
        }
    }
}

impl<'p> Tangent<'p> {
    /// `starts`: register file of the evaluated start program.
    pub fn new(plan: &'p Plan, parameters: &[f64], starts: &[[f64; 1]], points: usize) -> Self {
        let (nx, nd) = (plan.layout.states, plan.directions.len());
        let lanes = nd.div_ceil(VECTOR) * VECTOR;
        let free = plan.directions.parameters.len();
        let mut s = vec![0.0; nx * lanes];
        for e in &plan.starts.entries {
            let column = if e.column < free {
                Some(e.column)
            } else {
                let state = plan.starts.given[e.column - free];
                plan.directions.starts.iter().position(|&i| i == state).map(|p| free + p)
            };
            if let Some(column) = column {
                s[e.row * lanes + column] = plan.starts.program.output(starts, e.output)[0];
            }
        }
        let mut limits = vec![0.0; nx * 2 * lanes];
        let mut values = Vec::new();
        let point = vec![0.0; plan.layout.time() + 1];
        Many::new(&plan.linear.limits_program, plan, parameters).over(&point, &mut values);
        for &(state, is_max, column, output) in &plan.linear.limits {
            limits[(2 * state + usize::from(is_max)) * lanes + column] = values[output];
        }
        Tangent {
            plan,
            rates: Many::new(&plan.linear.rates_program, plan, parameters),
            outputs: Many::new(&plan.linear.outputs_program, plan, parameters),
            delays: Many::new(&plan.linear.delays_program, plan, parameters),
            lanes,
            s,
            limits,
            rows: Vec::with_capacity(points * plan.outputs.len() * nd),
            s_history: Vec::new(),
            k_history: Vec::new(),
            entries: Buffers::default(),
            work: Work::default(),
        }
    }

    /// Takes the sensitivities through a chunk whose values are done.
    pub fn advance(&mut self, run: &Run, chunk: &Chunk) {
        let mut entries = std::mem::take(&mut self.entries);
        let mut work = std::mem::take(&mut self.work);
        self.rates.over(&chunk.stages, &mut entries.rates);
        self.outputs.over(&chunk.points, &mut entries.outputs);
        self.delays.over(&chunk.stages, &mut entries.delays);
        self.delays.over(&chunk.points, &mut entries.point_delays);
        let plan = self.plan;
        let (delays, history) = (plan.delays.len(), run.keeps_history());
        let (per_stage, per_point) = (plan.linear.rates_program.outputs(), plan.linear.outputs_program.outputs());
        let per_delay = plan.linear.delays_program.outputs();
        let points = chunk.points.len() / (plan.layout.time() + 1);
        let (mut stage, mut substep) = (0, 0);
        for point in 0..points {
            if history {
                self.remember();
            }
            let taus = &entries.point_delays[point * per_delay..(point + 1) * per_delay];
            self.delayed(run, &chunk.point_pasts[point * delays..(point + 1) * delays], taus, &self.s, &mut work.delayed);
            self.output_rows(&entries.outputs[point * per_point..(point + 1) * per_point], &mut work);
            let Some(&m) = chunk.substeps.get(point) else { continue };
            for s in 0..m {
                if history && s > 0 {
                    self.remember();
                }
                let h = run.record.dt / m as f64;
                for at in 0..4 {
                    let jacobian = &entries.rates[stage * per_stage..(stage + 1) * per_stage];
                    let taus = &entries.delays[stage * per_delay..(stage + 1) * per_delay];
                    let pasts = &chunk.pasts[stage * delays..(stage + 1) * delays];
                    let clipped = &chunk.clipped[stage * plan.limited.len()..(stage + 1) * plan.limited.len()];
                    self.stage(run, at, h, jacobian, pasts, taus, clipped, &mut work);
                    stage += 1;
                }
                add(&mut self.s, h / 6.0, &work.sum);
                let limited = plan.limited.len();
                let mut state = std::mem::take(&mut self.s);
                self.put_on_stops(&chunk.held[substep * limited..(substep + 1) * limited], &mut state);
                self.s = state;
                substep += 1;
            }
        }
        (self.entries, self.work) = (entries, work);
    }

    /// One Runge-Kutta stage of the sensitivities.
    #[allow(clippy::too_many_arguments)]
    fn stage(
        &mut self,
        run: &Run,
        at: usize,
        h: f64,
        jacobian: &[f64],
        pasts: &[Past],
        taus: &[f64],
        clipped: &[u8],
        work: &mut Work,
    ) {
        if at == 0 {
            work.stage.clone_from(&self.s);
            work.sum.clear();
            work.sum.resize(self.s.len(), 0.0);
        }
        self.put_on_stops(clipped, &mut work.stage);
        self.delayed(run, pasts, taus, &work.stage, &mut work.delayed);
        work.k.clear();
        work.k.resize(self.s.len(), 0.0);
        accumulate(&self.plan.linear.rates, jacobian, self.lanes, &work.stage, &work.delayed, &mut work.k);
        add(&mut work.sum, WEIGHT[at], &work.k);
        work.stage.clone_from(&self.s);
        add(&mut work.stage, AHEAD[at] * h, &work.k);
        if at == 0 && run.keeps_history() {
            let end = self.k_history.len();
            self.k_history[end - work.k.len()..].copy_from_slice(&work.k);
            for (&i, _) in self.plan.limited.iter().zip(clipped).filter(|(_, how)| **how == RESTS) {
                let row = end - work.k.len() + i * self.lanes;
                self.k_history[row..row + self.lanes].fill(0.0);
            }
        }
    }

    /// The sensitivity of a state that was put on a stop is that of the stop.
    fn put_on_stops(&self, how: &[u8], s: &mut [f64]) {
        for (&i, &how) in self.plan.limited.iter().zip(how).filter(|(_, how)| (1..RESTS).contains(*how)) {
            let from = (2 * i + usize::from(how) - 1) * self.lanes;
            s[i * self.lanes..(i + 1) * self.lanes].copy_from_slice(&self.limits[from..from + self.lanes]);
        }
    }

    fn remember(&mut self) {
        self.s_history.extend_from_slice(&self.s);
        self.k_history.resize(self.s_history.len(), 0.0);
    }

    /// Sensitivities of the delayed values: dX(t - tau) = S(t - tau) - X'(t - tau) dtau.
    fn delayed(&self, run: &Run, pasts: &[Past], taus: &[f64], s: &[f64], out: &mut Vec<f64>) {
        let (lanes, nx) = (self.lanes, self.plan.layout.states);
        out.clear();
        out.resize(self.plan.delays.len() * lanes, 0.0);
        if self.plan.delays.is_empty() {
            return;
        }
        accumulate(&self.plan.linear.delays, taus, lanes, s, &[], out); // dtau
        for (k, (delay, past)) in self.plan.delays.iter().zip(pasts).enumerate() {
            let row = &mut out[k * lanes..(k + 1) * lanes];
            let slope = match delay.of {
                Delayed::Input(_) => past.slope[0],
                Delayed::State(i) => run.past_value(i, past, &past.slope),
            };
            for v in row.iter_mut() {
                *v *= -slope;
            }
            if let Delayed::State(i) = delay.of {
                let at = |step: usize| (step * nx + i) * lanes..(step * nx + i + 1) * lanes;
                for (w, list, step) in [
                    (past.w[0], &self.s_history, past.i),
                    (past.w[1], &self.k_history, past.i),
                    (past.w[2], &self.s_history, past.j),
                    (past.w[3], &self.k_history, past.j),
                ] {
                    if w != 0.0 {
                        add(row, w, &list[at(step)]);
                    }
                }
            }
        }
    }

    /// Appends the output sensitivities of a grid point.
    fn output_rows(&mut self, jacobian: &[f64], work: &mut Work) {
        let (ny, nd) = (self.plan.outputs.len(), self.plan.directions.len());
        work.row.clear();
        work.row.resize(ny * self.lanes, 0.0);
        accumulate(&self.plan.linear.outputs, jacobian, self.lanes, &self.s, &work.delayed, &mut work.row);
        for j in 0..ny {
            self.rows.extend_from_slice(&work.row[j * self.lanes..j * self.lanes + nd]);
        }
    }
}

/// `out = J_x S + J_p + J_d D` for sparse entries `values` of the three parts, with the widest vectors this machine has (nothing is
/// fused: the width changes no bit).
fn accumulate(entries: &Sparse, values: &[f64], lanes: usize, s: &[f64], delayed: &[f64], out: &mut [f64]) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the feature was just found on this machine.
        return unsafe { accumulate_avx2(entries, values, lanes, s, delayed, out) };
    }
    accumulate_plain(entries, values, lanes, s, delayed, out)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn accumulate_avx2(entries: &Sparse, values: &[f64], lanes: usize, s: &[f64], delayed: &[f64], out: &mut [f64]) {
    accumulate_plain(entries, values, lanes, s, delayed, out)
}

#[inline(always)]
fn accumulate_plain(entries: &Sparse, values: &[f64], lanes: usize, s: &[f64], delayed: &[f64], out: &mut [f64]) {
    for e in &entries.states {
        add(&mut out[e.row * lanes..(e.row + 1) * lanes], values[e.output], &s[e.column * lanes..(e.column + 1) * lanes]);
    }
    for e in &entries.parameters {
        out[e.row * lanes + e.column] += values[e.output];
    }
    for e in &entries.delayed {
        add(&mut out[e.row * lanes..(e.row + 1) * lanes], values[e.output], &delayed[e.column * lanes..(e.column + 1) * lanes]);
    }
}
