//! Programs with their registers: points of a trajectory in; what a model says there, one by one or
//! side by side, out.

use super::lead::Lead;
use super::propagator::Compiled;
use super::propagator::Propagator;
use super::rows::LANES;
use super::tableau::{AHEAD, WEIGHT};
use crate::math::pool::Lent;
use crate::model::machine::Lanes;
use crate::model::{Program, Tables};

/// A program with its register file for one evaluation at a time.
pub(super) struct Single<'p> {
    program: &'p Program,
    native: Option<&'p Compiled>,
    tables: &'p Tables,
    file: Vec<[f64; 1]>,
    /// Outputs, of the machine code or gathered.
    out: Vec<f64>,
    lead: Lead,
}

impl<'p> Single<'p> {
    pub(super) fn new(
        program: &'p Program,
        propagator: &'p Propagator,
        parameters: &[f64],
    ) -> Self {
        let mut file = program.registers::<1>();
        for (i, p) in parameters.iter().enumerate().take(propagator.layout.parameters) {
            file[propagator.layout.parameter() + i] = [*p];
        }
        program.prepare(&mut file, &propagator.tables);
        Single {
            program,
            native: None,
            tables: &propagator.tables,
            file,
            out: vec![0.0; program.outputs()],
            lead: Lead::new(),
        }
    }

    /// Evaluates at `point` (states, inputs, input rates, delayed values, time).
    pub(super) fn at(&mut self, point: &[f64]) {
        if let Some(Compiled::Points(native)) = self.native {
            return native.run(&self.file, point, &mut self.out, self.tables);
        }
        for (slot, x) in self.file.iter_mut().zip(point) {
            slot[0] = *x;
        }
        self.program.run(&mut self.file, self.tables);
    }

    /// Runge-Kutta steps of a plain model: `rows` has four points per step, whose states are filled
    /// in; `x` goes from the first step's start to the last one's end.
    pub(super) fn march(
        &mut self,
        rows: &mut [f64],
        width: usize,
        h: f64,
        x: &mut [f64],
        sum: &mut [f64],
    ) {
        if let Some(Compiled::Steps(native)) = self.native {
            let [a, b, c, d] = AHEAD.map(|ahead| ahead * h);
            let [p, q, r, s] = WEIGHT;
            return native.march(
                &self.file,
                rows,
                x,
                &[p, a, q, b, r, c, s, d, h / 6.0],
                self.tables,
            );
        }
        for step in rows.chunks_exact_mut(4 * width) {
            sum.fill(0.0);
            step[..x.len()].copy_from_slice(x);
            for stage in 0..4 {
                let (row, next) = step[stage * width..].split_at_mut(width);
                for (slot, value) in self.file.iter_mut().zip(row.iter()) {
                    slot[0] = *value;
                }
                self.program.run(&mut self.file, self.tables);
                // the last stage leads to the end of the step only
                let next = &mut next[..if stage < 3 { x.len() } else { 0 }];
                let lead = self.lead;
                lead.stage(self.outputs(), [WEIGHT[stage], AHEAD[stage] * h], x, sum, next);
            }
            self.lead.end(sum, h, x);
        }
    }

    /// All outputs.
    pub(super) fn outputs(&mut self) -> &[f64] {
        if !matches!(self.native, Some(Compiled::Points(_))) {
            let (program, file) = (self.program, &self.file);
            self.out.iter_mut().enumerate().for_each(|(k, out)| *out = program.output(file, k)[0]);
        }
        &self.out
    }

    pub(super) fn get(&self, k: usize) -> f64 {
        if let Some(Compiled::Points(_)) = self.native {
            self.out[k]
        } else {
            self.program.output(&self.file, k)[0]
        }
    }
}

/// The programs that a trajectory needs, point by point.
pub(super) struct Programs<'p> {
    pub rates: Single<'p>,
    pub taus: Single<'p>,
    /// Limits of the states: lower and upper in turn.
    pub limits: Single<'p>,
    /// Per `Moving` what would move it, and its friction.
    pub moving: Single<'p>,
}

impl<'p> Programs<'p> {
    pub(super) fn new(propagator: &'p Propagator, parameters: &[f64]) -> Self {
        let single = |program, native: &'p Option<Compiled>| Single {
            native: native.as_ref(),
            ..Single::new(program, propagator, parameters)
        };
        let native = &propagator.native;
        Programs {
            rates: single(&propagator.rates, &native.rates),
            taus: single(&propagator.delay_values, &native.taus),
            limits: single(&propagator.limits, &native.limits),
            moving: single(&propagator.moving_values, &native.moving),
        }
    }
}

/// A program evaluated at many points: lanes are points.
pub(super) struct Many<'p> {
    program: &'p Program,
    /// The same as machine code, where it was worth making.
    lanes: Option<&'p Lanes>,
    tables: &'p Tables,
    /// Registers `[register][lane]`.
    file: Lent,
    width: usize,
    /// The numbers of a point that the program reads.
    read: Vec<usize>,
}

impl<'p> Many<'p> {
    pub(super) fn new(
        program: &'p Program,
        propagator: &'p Propagator,
        parameters: &[f64],
    ) -> Self {
        let (width, tables) = (propagator.layout.time() + 1, &propagator.tables);
        let mut registers = Lent::zeros(program.file_len() * LANES);
        let file = registers.rows::<LANES>();
        program.constants_into(file);
        for (i, p) in parameters.iter().enumerate().take(propagator.layout.parameters) {
            file[propagator.layout.parameter() + i] = [*p; LANES];
        }
        program.prepare(file, tables);
        let read = program.reads(width);
        Many { program, lanes: None, tables, file: registers, width, read }
    }

    /// Of a program that nobody runs: without registers.
    pub(super) fn idle(program: &'p Program, propagator: &'p Propagator) -> Self {
        let (tables, file) = (&propagator.tables, Lent::zeros(0));
        Many { program, lanes: None, tables, file, width: 0, read: Vec::new() }
    }

    /// By machine code, if there is any.
    pub(super) fn by(self, lanes: Option<&'p Lanes>) -> Self {
        Many { lanes, ..self }
    }

    /// Runs the program at the `LANES` points from `first` on (rows of `width`; fewer at the end),
    /// and hands out its registers.
    pub(super) fn block(&mut self, points: &[f64], first: usize) -> &[[f64; LANES]] {
        let live = LANES.min(points.len() / self.width - first);
        let rows: [&[f64]; LANES] = std::array::from_fn(|l| {
            &points[(first + l.min(live - 1)) * self.width..][..self.width]
        });
        let file = self.file.rows::<LANES>();
        for &slot in &self.read {
            file[slot] = std::array::from_fn(|l| rows[l][slot]);
        }
        match self.lanes {
            Some(lanes) => lanes.run(file, self.tables),
            None => self.program.run(file, self.tables),
        }
        file
    }

    /// The registers as the last run left them.
    pub(super) fn registers(&self) -> &[[f64; LANES]] {
        self.file.rows_of()
    }

    /// All outputs at one point.
    pub(super) fn at(&mut self, point: &[f64], out: &mut [f64]) {
        let program = self.program;
        let file = self.block(point, 0);
        out.iter_mut().enumerate().for_each(|(k, out)| *out = program.output(file, k)[0]);
    }

    /// All outputs at all `points`, each into its own of `out`, from place `begin` on.
    pub(super) fn over(&mut self, points: &[f64], out: &mut [Vec<f64>], begin: usize) {
        let n = points.len() / self.width;
        for first in (0..n).step_by(LANES) {
            let (program, live) = (self.program, LANES.min(n - first));
            let file = self.block(points, first);
            for (k, out) in out.iter_mut().enumerate() {
                let lanes = &program.output(file, k)[..live];
                out[begin + first..][..live].copy_from_slice(lanes);
            }
        }
    }
}
