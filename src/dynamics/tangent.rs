//! Exact sensitivities: the Runge-Kutta method applied to `S' = A S + B`, lanes of directions.

use super::evaluate::{LANES, Lanes, Many};
use super::history::Past;
use super::plan::Plan;
use super::propagate::{AHEAD, Chunk, RESTS, Run, WEIGHT};
use super::rows::{At, Rows, SPREAD, Stage, append, product, stage};
use crate::math::pool;
use crate::math::simd::{Aligned, Width};
use crate::model::{Delayed, Program};

pub struct Tangent<'p> {
    plan: &'p Plan,
    width: Width,
    rates: Jacobian<'p>,
    outputs: Jacobian<'p>,
    delays: Jacobian<'p>,
    point_delays: Jacobian<'p>,
    /// Directions, padded.
    lanes: usize,
    /// Sensitivities of the states `[state][lanes]`.
    s: Aligned,
    /// Sensitivities of the limits `[state][min, max][lanes]`.
    limits: Vec<f64>,
    /// Output sensitivities, per output `[point][direction]`, and how many points are done.
    pub rows: Vec<Vec<f64>>,
    done: usize,
    /// Sensitivities of the states and their rates at the remembered step times.
    s_history: Vec<f64>,
    k_history: Vec<f64>,
    work: Work,
    /// The size of a step, and what `Stage` wants to know of it.
    step: f64,
    weights: [[f64; 2]; 4],
}

/// A Jacobian along a list of points, some of which are evaluated at a time.
struct Jacobian<'p> {
    rows: &'p Rows,
    program: Many<'p>,
    /// The block of points that the program was run for, if any.
    block: Option<usize>,
    /// The direct parts at some of them, and which.
    direct: Aligned,
    spread: Option<usize>,
}

impl<'p> Jacobian<'p> {
    fn new(rows: &'p Rows, program: &'p Program, plan: &'p Plan, parameters: &[f64]) -> Self {
        let mut direct = Aligned::default();
        direct.zeros(SPREAD * rows.size());
        Jacobian { rows, program: Many::new(program, plan, parameters), block: None, direct, spread: None }
    }

    /// At point `k` of `points`.
    fn at(&mut self, points: &[f64], k: usize) -> At<'_> {
        if self.block != Some(k / LANES) {
            self.program.block(points, k / LANES * LANES);
            self.block = Some(k / LANES);
            self.spread = None;
        }
        if self.spread != Some(k / SPREAD) {
            self.rows.spread(self.program.registers(), k / SPREAD * SPREAD % LANES, &mut self.direct);
            self.spread = Some(k / SPREAD);
        }
        At::new(self.rows, self.program.registers(), k % LANES, &self.direct)
    }
}

/// Sensitivities within a step.
struct Work {
    stage: Aligned,
    next: Aligned,
    k: Aligned,
    sum: Aligned,
    delayed: Aligned,
}

impl<'p> Tangent<'p> {
    /// `starts`: register file of the evaluated start program.
    pub fn new(plan: &'p Plan, parameters: &[f64], starts: &[[f64; 1]], points: usize) -> Self {
        let (nx, nd, ny) = (plan.layout.states, plan.directions.len(), plan.outputs.len());
        let lanes = plan.directions.lanes();
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
        let mut limits = vec![0.0; if plan.limited.is_empty() { 0 } else { nx * 2 * lanes }];
        let mut values = Lanes::default();
        let point = vec![0.0; plan.layout.time() + 1];
        Many::new(&plan.linear.limits_program, plan, parameters).over(&point, &mut values);
        for &(state, is_max, column, output) in &plan.linear.limits {
            limits[(2 * state + usize::from(is_max)) * lanes + column] = values.get(0, output);
        }
        let jacobian = |rows, program| Jacobian::new(rows, program, plan, parameters);
        Tangent {
            plan,
            width: Width::detect(),
            rates: jacobian(&plan.rate_rows, &plan.linear.rates_program),
            outputs: jacobian(&plan.output_rows, &plan.linear.outputs_program),
            delays: jacobian(&plan.delay_rows, &plan.linear.delays_program),
            point_delays: jacobian(&plan.delay_rows, &plan.linear.delays_program),
            lanes,
            s,
            limits,
            rows: (0..ny).map(|_| pool::take(points * nd)).collect(),
            done: 0,
            s_history: Vec::new(),
            k_history: Vec::new(),
            work: Work { stage: zeros(nx), next: zeros(nx), k: zeros(nx), sum: zeros(nx), delayed: zeros(plan.delays.len()) },
            step: 0.0,
            weights: [[0.0; 2]; 4],
        }
    }

    /// Takes the sensitivities through a chunk whose values are done.
    pub fn advance(&mut self, run: &Run, chunk: &Chunk) {
        for jacobian in [&mut self.rates, &mut self.outputs, &mut self.delays, &mut self.point_delays] {
            jacobian.block = None;
        }
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
                let past = [&self.s_history, &self.k_history];
                delayed(
                    plan,
                    self.width,
                    run,
                    pasts,
                    self.point_delays.at(&chunk.points, point),
                    &self.s,
                    past,
                    &mut self.work.delayed,
                );
            }
            let (at, nd) = (self.outputs.at(&chunk.points, point), plan.directions.len());
            // SAFETY: the width is this machine's.
            unsafe { append(self.width, at, &self.s, &self.work.delayed, nd, self.done, &mut self.rows) };
            self.done += 1;
            let Some(&m) = chunk.substeps.get(point) else { continue };
            let h = run.record.dt / m as f64;
            if self.step != h {
                self.step = h;
                self.weights = std::array::from_fn(|i| [WEIGHT[i], if i < 3 { AHEAD[i] * h } else { h / 6.0 }]);
            }
            for s in 0..m {
                if history && s > 0 {
                    self.remember();
                }
                for number in 0..4 {
                    let clipped = &chunk.clipped[stage * limited..(stage + 1) * limited];
                    if delays > 0 {
                        let pasts = &chunk.pasts[stage * delays..(stage + 1) * delays];
                        self.stage(&chunk.stages, stage, number, clipped, Some((run, pasts)));
                    } else {
                        self.stage(&chunk.stages, stage, number, clipped, None);
                    }
                    stage += 1;
                }
                let held = &chunk.held[substep * limited..(substep + 1) * limited];
                put_on_stops(plan, &self.limits, self.lanes, held, &mut self.s);
                substep += 1;
            }
        }
    }

    /// Stage `at` of a chunk's `stages`, the `number`th of its step, and after the last one the step. `pasts`: how its delayed values were read.
    fn stage(&mut self, stages: &[f64], at: usize, number: usize, clipped: &[u8], pasts: Option<(&Run, &[Past])>) {
        let history = !self.s_history.is_empty();
        let weights = &self.weights;
        let Work { stage: from, next, k, sum, delayed: past } = &mut self.work;
        // where states may be on stops or delayed, the first stage is not simply the start of the step
        let plain = number == 0 && clipped.is_empty() && pasts.is_none();
        if number == 0 && !plain {
            from.copy_from_slice(&self.s);
        }
        put_on_stops(self.plan, &self.limits, self.lanes, clipped, from);
        if let Some((run, pasts)) = pasts {
            let lists = [&self.s_history, &self.k_history];
            delayed(self.plan, self.width, run, pasts, self.delays.at(stages, at), from, lists, past);
        }
        let job = Stage { s: &mut self.s, sum, next, k: history.then_some(&mut **k), number, weights };
        // SAFETY: the width is this machine's.
        unsafe { stage(self.width, self.rates.at(stages, at), (!plain).then_some(&**from), past, job) };
        std::mem::swap(from, next);
        if number == 0 && history {
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
}

/// The sensitivity of a state that was put on a stop is that of the stop.
fn put_on_stops(plan: &Plan, limits: &[f64], lanes: usize, how: &[u8], s: &mut [f64]) {
    for (&i, &how) in plan.limited.iter().zip(how).filter(|(_, how)| (1..RESTS).contains(*how)) {
        let from = (2 * i + usize::from(how) - 1) * lanes;
        s[i * lanes..(i + 1) * lanes].copy_from_slice(&limits[from..from + lanes]);
    }
}

/// Sensitivities of the delayed values: dX(t - tau) = S(t - tau) - X'(t - tau) dtau. `history`: sensitivities of the states and of their
/// rates at the remembered times.
#[allow(clippy::too_many_arguments)]
fn delayed(plan: &Plan, width: Width, run: &Run, pasts: &[Past], taus: At, s: &[f64], history: [&Vec<f64>; 2], out: &mut Aligned) {
    let (nx, lanes) = (plan.layout.states, plan.directions.lanes());
    let [s_history, k_history] = history;
    // SAFETY: the width is this machine's; delay times do not depend on delayed values.
    unsafe { product(width, taus, s, &[], out) };
    for (k, (delay, past)) in plan.delays.iter().zip(pasts).enumerate() {
        let row = &mut out[k * lanes..(k + 1) * lanes];
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
