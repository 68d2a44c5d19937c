//! Exact sensitivities: the Runge-Kutta method applied to `S' = A S + B`, lanes of directions.

use super::history::Past;
use super::plan::Plan;
use super::propagate::{AHEAD, Chunk, Lanes, Many, RESTS, Run, WEIGHT};
use super::rows::{combine, stage_end, stage_rows};
use crate::math::simd::{Aligned, Width};
use crate::model::Delayed;

/// Directions are padded to whole vectors of this many.
const VECTOR: usize = 8;

pub struct Tangent<'p> {
    plan: &'p Plan,
    width: Width,
    rates: Many<'p>,
    outputs: Many<'p>,
    delays: Many<'p>,
    /// Directions, padded.
    lanes: usize,
    /// Sensitivities of the states `[state][lanes]`.
    s: Aligned,
    /// Sensitivities of the limits `[state][min, max][lanes]`.
    limits: Vec<f64>,
    /// Output sensitivities of all grid points so far, per output `[point][direction]` (and room for one vector more).
    pub rows: Vec<Vec<f64>>,
    /// Sensitivities of the states and their rates at the remembered step times.
    s_history: Vec<f64>,
    k_history: Vec<f64>,
    entries: Entries,
    work: Work,
}

/// Values of the Jacobians' entries.
#[derive(Default)]
struct Entries {
    rates: Lanes,
    outputs: Lanes,
    delays: Lanes,
    point_delays: Lanes,
}

#[derive(Default)]
struct Work {
    /// The direct parts `B`, `D` and of the delay times; entries that are not in the Jacobian stay zero.
    rates: Aligned,
    outputs: Aligned,
    delays: Aligned,
    /// Arguments of this stage and of the next.
    stage: Aligned,
    next: Aligned,
    k: Aligned,
    sum: Aligned,
    delayed: Aligned,
    row: Aligned,
}

impl<'p> Tangent<'p> {
    /// `starts`: register file of the evaluated start program.
    pub fn new(plan: &'p Plan, parameters: &[f64], starts: &[[f64; 1]], points: usize) -> Self {
        let (nx, nd, ny) = (plan.layout.states, plan.directions.len(), plan.outputs.len());
        let lanes = nd.div_ceil(VECTOR) * VECTOR;
        let free = plan.directions.parameters.len();
        let zeros = |rows: usize| {
            let mut out = Aligned::default();
            out.zeros(rows * lanes);
            out
        };
        let mut s = zeros(nx);
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
        let mut values = Lanes::default();
        let point = vec![0.0; plan.layout.time() + 1];
        Many::new(&plan.linear.limits_program, plan, parameters).over(&point, &mut values);
        for &(state, is_max, column, output) in &plan.linear.limits {
            limits[(2 * state + usize::from(is_max)) * lanes + column] = values.get(0, output);
        }
        let work = Work {
            rates: zeros(nx),
            outputs: zeros(ny),
            delays: zeros(plan.delays.len()),
            stage: zeros(nx),
            next: zeros(nx),
            k: zeros(nx),
            sum: zeros(nx),
            delayed: zeros(plan.delays.len()),
            row: zeros(ny),
        };
        Tangent {
            plan,
            width: Width::detect(),
            rates: Many::new(&plan.linear.rates_program, plan, parameters),
            outputs: Many::new(&plan.linear.outputs_program, plan, parameters),
            delays: Many::new(&plan.linear.delays_program, plan, parameters),
            lanes,
            s,
            limits,
            rows: (0..ny).map(|_| Vec::with_capacity(points * nd)).collect(),
            s_history: Vec::new(),
            k_history: Vec::new(),
            entries: Entries::default(),
            work,
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
        let limited = plan.limited.len();
        let points = chunk.points.len() / (plan.layout.time() + 1);
        let (mut stage, mut substep) = (0, 0);
        for point in 0..points {
            if history {
                self.remember();
            }
            if delays > 0 {
                let pasts = &chunk.point_pasts[point * delays..(point + 1) * delays];
                let values = entries.point_delays.at(point);
                delayed(self.plan, self.width, run, pasts, values, &self.s, &self.s_history, &self.k_history, &mut work);
            }
            self.output_rows(entries.outputs.at(point), &mut work);
            let Some(&m) = chunk.substeps.get(point) else { continue };
            let h = run.record.dt / m as f64;
            for s in 0..m {
                if history && s > 0 {
                    self.remember();
                }
                work.stage.copy_from_slice(&self.s);
                for at in 0..4 {
                    let clipped = &chunk.clipped[stage * limited..(stage + 1) * limited];
                    put_on_stops(plan, &self.limits, self.lanes, clipped, &mut work.stage);
                    if delays > 0 {
                        let pasts = &chunk.pasts[stage * delays..(stage + 1) * delays];
                        let stage_s = std::mem::take(&mut work.stage);
                        let values = entries.delays.at(stage);
                        delayed(plan, self.width, run, pasts, values, &stage_s, &self.s_history, &self.k_history, &mut work);
                        work.stage = stage_s;
                    }
                    self.stage(at, h, entries.rates.at(stage), clipped, &mut work);
                    stage += 1;
                }
                let held = &chunk.held[substep * limited..(substep + 1) * limited];
                put_on_stops(plan, &self.limits, self.lanes, held, &mut self.s);
                substep += 1;
            }
        }
        (self.entries, self.work) = (entries, work);
    }

    /// One Runge-Kutta stage of the sensitivities, and after the last one the step.
    fn stage(&mut self, at: usize, h: f64, jacobian: *const f64, clipped: &[u8], work: &mut Work) {
        let Work { rates, stage, next, k, sum, delayed, .. } = work;
        // SAFETY: `jacobian` is a column of lanes with all entries of the program; the matrices have the sizes of the plan; the width is
        // this machine's.
        unsafe {
            stage_rows(self.width, &self.plan.rate_rows, jacobian, rates, stage, delayed, self.lanes, k);
            if at < 3 {
                combine(self.width, k, &self.s, WEIGHT[at], AHEAD[at] * h, at == 0, sum, next);
            } else {
                stage_end(self.width, k, sum, h / 6.0, &mut self.s);
            }
        }
        std::mem::swap(stage, next);
        if at == 0 && !self.k_history.is_empty() {
            let end = self.k_history.len();
            self.k_history[end - k.len()..].copy_from_slice(k);
            for (&i, _) in self.plan.limited.iter().zip(clipped).filter(|(_, how)| **how == RESTS) {
                let row = end - k.len() + i * self.lanes;
                self.k_history[row..row + self.lanes].fill(0.0);
            }
        }
    }

    fn remember(&mut self) {
        self.s_history.extend_from_slice(&self.s);
        self.k_history.resize(self.s_history.len(), 0.0);
    }

    /// Appends the output sensitivities of a grid point.
    fn output_rows(&mut self, jacobian: *const f64, work: &mut Work) {
        let nd = self.plan.directions.len();
        let Work { outputs, delayed, row, .. } = work;
        // SAFETY: as in `stage`.
        unsafe { stage_rows(self.width, &self.plan.output_rows, jacobian, outputs, &self.s, delayed, self.lanes, row) };
        for (rows, row) in self.rows.iter_mut().zip(row.chunks_exact(self.lanes.max(1))) {
            rows.extend_from_slice(&row[..nd]);
        }
    }
}

/// The sensitivity of a state that was put on a stop is that of the stop.
fn put_on_stops(plan: &Plan, limits: &[f64], lanes: usize, how: &[u8], s: &mut [f64]) {
    for (&i, &how) in plan.limited.iter().zip(how).filter(|(_, how)| (1..RESTS).contains(*how)) {
        let from = (2 * i + usize::from(how) - 1) * lanes;
        s[i * lanes..(i + 1) * lanes].copy_from_slice(&limits[from..from + lanes]);
    }
}

/// Sensitivities of the delayed values: dX(t - tau) = S(t - tau) - X'(t - tau) dtau.
#[allow(clippy::too_many_arguments)]
fn delayed(
    plan: &Plan,
    width: Width,
    run: &Run,
    pasts: &[Past],
    taus: *const f64,
    s: &Aligned,
    s_history: &[f64],
    k_history: &[f64],
    work: &mut Work,
) {
    let nx = plan.layout.states;
    let lanes = s.len().checked_div(nx).unwrap_or(0);
    let lanes = if nx == 0 { work.delayed.len() / plan.delays.len() } else { lanes };
    let Work { delays, delayed, .. } = work;
    // SAFETY: as in `Tangent::stage`; delay times do not depend on delayed values.
    unsafe { stage_rows(width, &plan.delay_rows, taus, delays, s, &Aligned::default(), lanes, delayed) };
    for (k, (delay, past)) in plan.delays.iter().zip(pasts).enumerate() {
        let row = &mut delayed[k * lanes..(k + 1) * lanes];
        let slope = match delay.of {
            Delayed::Input(_) => past.slope[0],
            Delayed::State(i) => run.past_value(i, past, &past.slope),
        };
        row.iter_mut().for_each(|v| *v *= -slope);
        if let Delayed::State(i) = delay.of {
            let at = |step: usize| (step * nx + i) * lanes..(step * nx + i + 1) * lanes;
            let parts = [
                (past.w[0], s_history, past.i),
                (past.w[1], k_history, past.i),
                (past.w[2], s_history, past.j),
                (past.w[3], k_history, past.j),
            ];
            for (w, list, step) in parts.into_iter().filter(|p| p.0 != 0.0) {
                row.iter_mut().zip(&list[at(step)]).for_each(|(r, v)| *r += w * v);
            }
        }
    }
}
