//! Exact sensitivities: the Runge-Kutta method applied to `S' = A S + B`, lanes of directions.

use super::delayed::delayed;
use super::evaluate::Many;
use super::history::Past;
use super::propagator::Propagator;
use super::remembered::Remembered;
use super::rows::{Append, Block, LANES, Rows, append, product};
use super::steps::{Steps, steps};
use super::sweep::Sweep;
use super::sweep_rows::{Goal, RowSweep};
use super::tableau::{AHEAD, WEIGHT};
use super::values::{Chunk, Run};
use crate::math::pool::{self, Lent};
use crate::math::simd::{Aligned, Width};
use crate::model::Program;
use crate::model::machine::Lanes;

mod glide;
mod stops;
mod walk;

pub(super) use walk::Place;

pub struct Tangent<'p> {
    propagator: &'p Propagator,
    pub(super) width: Width,
    rates: Jacobian<'p>,
    outputs: Jacobian<'p>,
    delays: Jacobian<'p>,
    point_delays: Jacobian<'p>,
    /// Of the delays at the ends of steps, where limits depend on delayed values.
    end_delays: Jacobian<'p>,
    /// Of the limits at stages and at the ends of steps, where they change along a trajectory.
    stage_limits: Jacobian<'p>,
    end_limits: Jacobian<'p>,
    /// Of what moves the movers, at the ends of steps, likewise, and what came out last.
    pushes: Jacobian<'p>,
    pushed: Vec<f64>,
    /// Directions, padded.
    pub(super) lanes: usize,
    /// Sensitivities of the states `[state][lanes]`, behind them those of the delayed values at a
    /// grid point.
    pub(super) s: Lent,
    /// Sensitivities of the limits `[row][lanes]`, rows as in `Model::limits_program`.
    limits: Vec<f64>,
    /// Those of the states at the begin of a step, where stops take states along.
    begin: Vec<f64>,
    /// Those of the limits at the begin and in the middle of a step, likewise.
    passed: [Vec<f64>; 2],
    /// Output sensitivities, per output `[point][direction]`, and how many points are done.
    pub rows: Vec<Vec<f64>>,
    done: usize,
    remembered: Remembered,
    work: Work,
    late: Late,
    /// Zeros as long as all rows are finite.
    zeros: [f64; 8],
}

/// A Jacobian along a list of points, some of which are evaluated at a time.
pub(super) struct Jacobian<'p> {
    rows: &'p Rows,
    program: Many<'p>,
    /// The block of points that the program was run for, if any.
    block: Option<usize>,
    /// Whether `direct` is of that block.
    is_spread: bool,
    /// Parts that act by themselves, once somebody asks for them: machine code does not.
    direct: Option<Lent>,
}

impl<'p> Jacobian<'p> {
    pub(super) fn new(
        rows: &'p Rows,
        program: &'p Program,
        propagator: &'p Propagator,
        parameters: &[f64],
    ) -> Self {
        let program = Many::new(program, propagator, parameters);
        Jacobian { rows, program, block: None, is_spread: false, direct: None }
    }

    /// One that nobody asks.
    fn idle(rows: &'p Rows, program: &'p Program, propagator: &'p Propagator) -> Self {
        let program = Many::idle(program, propagator);
        Jacobian { rows, program, block: None, is_spread: false, direct: None }
    }

    /// By machine code, if there is any.
    pub(super) fn by(self, lanes: Option<&'p Lanes>) -> Self {
        Jacobian { program: self.program.by(lanes), ..self }
    }

    /// The list of points is another one.
    pub(super) fn forget(&mut self) {
        self.block = None;
    }

    /// The registers at the block that holds point `k` of `points`.
    pub(super) fn registers(&mut self, points: &[f64], k: usize) -> &[[f64; LANES]] {
        let first = k / LANES * LANES;
        if self.block != Some(first) {
            self.program.block(points, first);
            (self.block, self.is_spread) = (Some(first), false);
        }
        self.program.registers()
    }

    /// The block that holds point `k` of `points`.
    pub(super) fn at(&mut self, points: &[f64], k: usize) -> Block<'_> {
        self.registers(points, k);
        let size = self.rows.direct_size();
        let direct = self.direct.get_or_insert_with(|| Lent::zeros(size));
        if !self.is_spread {
            self.rows.spread(self.program.registers(), direct);
            self.is_spread = true;
        }
        Block { rows: self.rows, registers: self.program.registers(), direct }
    }
}

/// Sensitivities within a step: at its stages those of the states, behind them those of the delayed
/// values.
struct Work {
    between: [Lent; 2],
    k: Lent,
    sum: Lent,
    /// Those of the states at the grid points of a chunk.
    kept: Lent,
}

/// What a step of a model with delays hands to its machine code, and gets back (see `Sweep`).
#[derive(Default)]
struct Late {
    from: Aligned,
    to: Aligned,
    numbers: Vec<f64>,
}

impl<'p> Tangent<'p> {
    /// `starts`: register file of the evaluated start program.
    pub fn new(
        propagator: &'p Propagator,
        parameters: &[f64],
        starts: &[[f64; 1]],
        points: usize,
    ) -> Self {
        let (nd, ny) = (propagator.directions.len(), propagator.outputs.len());
        let lanes = propagator.directions.lanes();
        let zeros = |rows: usize| Lent::zeros(rows * lanes);
        let (nx, both) =
            (propagator.layout.states, propagator.layout.states + propagator.delays.len());
        let mut s = zeros(both);
        self::starts(propagator, starts, &mut s);
        let (linear, made) = (&propagator.linear, &propagator.native.entries);
        let jacobian = |rows, program, lanes: &'p Option<Lanes>| {
            Jacobian::new(rows, program, propagator, parameters).by(lanes.as_ref())
        };
        // A plain model has neither delays nor limits nor movers.
        let beyond = |rows, program, lanes: &'p Option<Lanes>| match propagator.plain() {
            true => Jacobian::idle(rows, program, propagator),
            false => jacobian(rows, program, lanes),
        };
        let delays = || beyond(&propagator.delay_rows, &linear.delays_program, &made.delays);
        let limits = || beyond(&propagator.limit_rows, &linear.limits_program, &made.limits);
        let of_limits = vec![0.0; if propagator.limited.is_empty() { 0 } else { 3 * nx * lanes }];
        let mut tangent = Tangent {
            propagator,
            width: Width::detect(),
            rates: jacobian(&propagator.rate_rows, &linear.rates_program, &made.rates),
            outputs: jacobian(&propagator.output_rows, &linear.outputs_program, &made.outputs),
            delays: delays(),
            point_delays: delays(),
            end_delays: delays(),
            stage_limits: limits(),
            end_limits: limits(),
            pushes: beyond(&propagator.moving_rows, &linear.moving_program, &made.moving),
            pushed: vec![0.0; 2 * propagator.moving.len() * lanes],
            lanes,
            s,
            limits: of_limits,
            begin: vec![0.0; if propagator.limits_move { nx * lanes } else { 0 }],
            passed: std::array::from_fn(|_| {
                vec![0.0; if propagator.limits_move { 3 * nx * lanes } else { 0 }]
            }),
            rows: (0..ny).map(|_| pool::take(points * nd)).collect(),
            done: 0,
            remembered: Remembered::of(propagator, points),
            work: Work {
                between: [zeros(both), zeros(both)],
                k: zeros(nx),
                sum: zeros(nx),
                kept: Lent::any(),
            },
            late: Late::default(),
            zeros: [0.0; 8],
        };
        if !propagator.plain() && propagator.native.sweep.is_some() {
            let late = |rows: usize| Aligned::of_zeros(rows * lanes);
            tangent.late.from = late(nx + 4 * propagator.delays.len());
            tangent.late.to = late(nx + tangent.remembered.count());
        }
        if !tangent.limits.is_empty() && !propagator.limits_move {
            let point = vec![0.0; propagator.layout.time() + 1];
            let block = tangent.end_limits.at(&point, 0);
            // SAFETY: the width is this machine's.
            unsafe { product(tangent.width, block, 0, &tangent.s, &mut tangent.limits) };
        }
        tangent
    }

    /// A state that is held at the start has no sensitivity.
    pub fn hold(&mut self, state: usize) {
        self.s[state * self.lanes..(state + 1) * self.lanes].fill(0.0);
    }

    /// Whether all that was written so far is finite.
    pub fn is_finite(&self) -> bool {
        self.zeros.iter().all(|zero| *zero == 0.0)
    }

    /// Takes the sensitivities through a chunk whose values are done.
    pub fn advance(&mut self, run: &Run, chunk: &Chunk) {
        self.forget();
        match (self.propagator.plain(), &self.propagator.native.sweep) {
            (true, Some((steps, rows))) => self.sweep(run, chunk, steps, rows),
            (true, None) => self.march(run, chunk),
            (false, Some((steps, rows))) => self.glide(run, chunk, steps, rows),
            (false, None) => self.walk(run, chunk),
        }
    }

    /// The points are those of another chunk.
    pub(super) fn forget(&mut self) {
        let points =
            [&mut self.outputs, &mut self.point_delays, &mut self.end_limits, &mut self.pushes];
        let points = points.into_iter().chain([&mut self.end_delays]);
        let stages = [&mut self.rates, &mut self.delays, &mut self.stage_limits];
        points.chain(stages).for_each(Jacobian::forget);
    }

    /// Sensitivities of the delayed values at a point of a chunk, behind those of the states.
    fn delayed_at(&mut self, run: &Run, chunk: &Chunk, point: usize) {
        let delays = self.propagator.delays.len();
        if delays == 0 {
            return;
        }
        let pasts = &chunk.point_pasts[point * delays..(point + 1) * delays];
        let at = (self.point_delays.at(&chunk.points, point), point);
        let s = &mut self.s;
        delayed(self.propagator, self.width, run, pasts, at, s, &mut self.remembered);
    }

    /// The same at any point, of a Jacobian of the delays at such points.
    pub(super) fn delayed_by(&mut self, run: &Run, pasts: &[Past], at: (Block<'_>, usize)) {
        let (s, remembered) = (&mut self.s, &mut self.remembered);
        delayed(self.propagator, self.width, run, pasts, at, s, remembered);
    }

    /// A chunk of a plain model, by machine code.
    fn sweep(&mut self, run: &Run, chunk: &Chunk, steps: &Sweep, rows: &RowSweep) {
        let size = self.propagator.layout.states * self.lanes;
        let (points, whole) =
            (chunk.points.len() / (self.propagator.layout.time() + 1), chunk.substeps.len());
        let m = chunk.substeps.first().copied().unwrap_or(1);
        // S at the grid points, and behind it a place for S at steps between them
        let kept = &mut self.work.kept;
        kept.resize((whole + 2) * size);
        kept[..size].copy_from_slice(&self.s[..size]);
        let place = |step: usize| size * if step.is_multiple_of(m) { step / m } else { whole + 1 };
        let weights = weights(run.record.dt / m as f64);
        // of grid steps with steps inside them each goes somewhere else
        let together = if m == 1 { LANES / 4 } else { 1 };
        for block in (0..m * whole).step_by(LANES / 4) {
            let registers = self.rates.registers(&chunk.stages, 4 * block);
            let end = (block + LANES / 4).min(m * whole);
            for first in (block..end).step_by(together) {
                let stages = 4 * (first - block)..4 * (end.min(first + together) - block);
                let places = [place(first), place(first + 1)];
                steps.steps(registers, stages, &weights, kept, places);
            }
        }
        self.s[..size].copy_from_slice(&kept[whole * size..][..size]);
        let mut goal = Goal::new(&mut self.rows);
        for first in (0..points).step_by(LANES) {
            let n = LANES.min(points - first);
            let registers = self.outputs.registers(&chunk.points, first);
            rows.points(registers, n, (&kept[first * size..], size), self.done, &mut goal);
            self.done += n;
        }
        if !goal.is_finite() {
            self.zeros = [f64::NAN; 8];
        }
    }

    /// One step of a plain model.
    pub(super) fn plain_step(&mut self, chunk: &Chunk, step: usize) {
        let (first, weights) = (4 * step, weights(chunk.lengths[step]));
        let at = first % LANES;
        if let Some((sweep, _)) = &self.propagator.native.sweep {
            let registers = self.rates.registers(&chunk.stages, first);
            return sweep.steps(registers, at..at + 4, &weights, &mut self.s, [0, 0]);
        }
        let Work { between: [a, b], sum, .. } = &mut self.work;
        let mut job = Steps {
            s: &mut self.s,
            sum,
            between: [a, b],
            k: None,
            weights,
            plain: true,
            kept: &mut [],
            every: 0,
            phase: 0,
        };
        // SAFETY: the width is this machine's.
        unsafe { steps(self.width, self.rates.at(&chunk.stages, first), at..at + 4, &mut job) };
    }

    /// A chunk of a plain model, a block of stages at a time.
    fn march(&mut self, run: &Run, chunk: &Chunk) {
        let size = self.propagator.layout.states * self.lanes;
        let (points, whole) =
            (chunk.points.len() / (self.propagator.layout.time() + 1), chunk.substeps.len());
        let m = chunk.substeps.first().copied().unwrap_or(1);
        let Work { between: [a, b], sum, kept, .. } = &mut self.work;
        kept.resize(points * size);
        let weights = weights(run.record.dt / m as f64);
        for first in (0..4 * m * whole).step_by(LANES) {
            let stages = 0..LANES.min(4 * m * whole - first);
            let mut job = Steps {
                s: &mut self.s,
                sum,
                between: [a, b],
                k: None,
                weights,
                plain: true,
                kept: &mut kept[(first / 4).div_ceil(m) * size..],
                every: m,
                phase: first / 4 % m,
            };
            // SAFETY: the width is this machine's.
            unsafe { steps(self.width, self.rates.at(&chunk.stages, first), stages, &mut job) };
        }
        if points > whole {
            kept[whole * size..points * size].copy_from_slice(&self.s[..size]);
        }
        for first in (0..points).step_by(LANES) {
            let n = LANES.min(points - first);
            let to = Append {
                lists: &mut self.rows,
                directions: self.propagator.directions.len(),
                k: self.done,
                zeros: &mut self.zeros,
            };
            // SAFETY: as above.
            unsafe {
                append(
                    self.width,
                    self.outputs.at(&chunk.points, first),
                    0..n,
                    &kept[first * size..],
                    size,
                    to,
                )
            };
            self.done += n;
        }
    }
}

/// Sensitivities of the start values, `[state][lanes]`; `file`: register file of the evaluated start
/// program.
pub(super) fn starts(propagator: &Propagator, file: &[[f64; 1]], s: &mut [f64]) {
    let (lanes, free) = (propagator.directions.lanes(), propagator.directions.parameters.len());
    for e in &propagator.starts.entries {
        let column = if e.column < free {
            Some(e.column)
        } else {
            let state = propagator.starts.given[e.column - free];
            propagator.directions.starts.iter().position(|&i| i == state).map(|p| free + p)
        };
        if let Some(column) = column {
            s[e.row * lanes + column] = propagator.starts.program.output(file, e.output)[0];
        }
    }
}

/// What `Steps` wants to know of steps of length `h`.
pub(super) fn weights(h: f64) -> [[f64; 2]; 4] {
    std::array::from_fn(|i| [WEIGHT[i], if i < 3 { AHEAD[i] * h } else { h / 6.0 }])
}
