//! What a filter did to a record, chunk by chunk, in; the exact derivatives of its innovations and
//! their variances (the formulas stand in `innovations`), lanes of directions, out.

use super::delayed::delayed;
use super::filter::{Filter, Innovation, Measured, Taken, Way};
use super::gain::{Taking, take};
use super::propagator::Propagator;
use super::remembered::Remembered;
use super::rows::{LANES, product};
use super::steps::{Steps, steps};
use super::tangent::{Jacobian, starts, weights};
use super::values::Run;
use crate::math::simd::{Aligned, Width};

pub(super) struct Slopes<'p> {
    filter: &'p Filter,
    propagator: &'p Propagator,
    width: Width,
    rates: Jacobian<'p>,
    delays: Jacobian<'p>,
    /// Per output, of its value and slopes, and of the delay times at its samples.
    outputs: Vec<Jacobian<'p>>,
    sample_delays: Vec<Jacobian<'p>>,
    lanes: usize,
    /// `[state][lanes]`, behind them those of the delayed values.
    s: Aligned,
    between: [Aligned; 2],
    sum: Aligned,
    /// Per output the derivative of its noise's variance.
    noise: Vec<Aligned>,
    /// Of a sample: the output and its slopes; the motion's covariance with the innovation; the rows
    /// that go out.
    dc: Aligned,
    dh: Aligned,
    rows: [Aligned; 2],
    /// No state of a model that noise drives is read later.
    nothing: Remembered,
}

impl<'p> Slopes<'p> {
    /// `file`: register file of the evaluated start program.
    pub fn new(
        filter: &'p Filter,
        propagator: &'p Propagator,
        parameters: &[f64],
        file: &[[f64; 1]],
    ) -> Self {
        let lanes = propagator.directions.lanes();
        let zeros = |rows: usize| Aligned::of_zeros(rows * lanes);
        let (nx, both) =
            (propagator.layout.states, propagator.layout.states + propagator.delays.len());
        let mut s = zeros(both);
        starts(propagator, file, &mut s);
        let jacobian = |rows, program| Jacobian::new(rows, program, propagator, parameters);
        let delays = || {
            jacobian(&propagator.delay_rows, &propagator.linear.delays_program).by(propagator
                .native
                .entries
                .delays
                .as_ref())
        };
        let noise = |m: &Measured| {
            let mut row = zeros(1);
            m.direction.into_iter().for_each(|d| row[d] = 2.0 * parameters[m.sd]);
            row
        };
        let slopes = filter.measured.iter().map(|m| 1 + m.slopes.len()).max().unwrap_or(1);
        Slopes {
            width: Width::detect(),
            rates: jacobian(&propagator.rate_rows, &propagator.linear.rates_program).by(propagator
                .native
                .entries
                .rates
                .as_ref()),
            delays: delays(),
            outputs: filter.measured.iter().map(|m| jacobian(&m.rows, &m.program)).collect(),
            sample_delays: filter.measured.iter().map(|_| delays()).collect(),
            nothing: Remembered::default(),
            between: [zeros(both), zeros(both)],
            sum: zeros(nx),
            noise: filter.measured.iter().map(noise).collect(),
            dc: zeros(slopes),
            dh: zeros(filter.motion),
            rows: [zeros(1), zeros(1)],
            filter,
            propagator,
            lanes,
            s,
        }
    }

    /// Through a chunk.
    pub fn advance(&mut self, run: &Run, way: &Way, out: &mut [Innovation]) {
        let points = self.outputs.iter_mut().chain(&mut self.sample_delays);
        points.chain([&mut self.rates, &mut self.delays]).for_each(Jacobian::forget);
        let mut taken = way.taken.iter().enumerate().peekable();
        for step in 0..=way.chunk.lengths.len() {
            while let Some((e, sample)) = taken.next_if(|(_, t)| t.after == step) {
                self.sample(run, way, e, sample, &mut out[sample.channel]);
            }
            if step < way.chunk.lengths.len() {
                self.step(run, way, step);
            }
        }
    }

    /// One step of the Runge-Kutta method.
    fn step(&mut self, run: &Run, way: &Way, step: usize) {
        let (first, delays) = (4 * step, self.propagator.delays.len());
        let size = self.propagator.layout.states * self.lanes;
        let weights = weights(way.chunk.lengths[step]);
        if let Some((sweep, _)) = self.propagator.native.sweep.as_ref().filter(|_| delays == 0) {
            let registers = self.rates.registers(&way.chunk.stages, first);
            let at = first % LANES;
            return sweep.steps(registers, at..at + 4, &weights, &mut self.s, [0, 0]);
        }
        let stages = if delays == 0 { first..first + 1 } else { first..first + 4 };
        for stage in stages {
            let [a, b] = &mut self.between;
            if delays > 0 {
                let number = stage % 4;
                if number == 0 {
                    b[..size].copy_from_slice(&self.s[..size]);
                }
                let from = if number % 2 == 0 { &mut *b } else { &mut *a };
                let pasts = &way.chunk.pasts[stage * delays..(stage + 1) * delays];
                let at = (self.delays.at(&way.chunk.stages, stage), stage);
                let nothing = &mut self.nothing;
                delayed(self.propagator, self.width, run, pasts, at, from, nothing);
            }
            let mut job = Steps {
                s: &mut self.s,
                sum: &mut self.sum,
                between: [a, b],
                k: None,
                weights,
                plain: delays == 0,
                kept: &mut [],
                every: 0,
                phase: 0,
            };
            let at = stage % LANES;
            let these = at..at + if delays == 0 { 4 } else { 1 };
            // SAFETY: the width is this machine's.
            unsafe { steps(self.width, self.rates.at(&way.chunk.stages, stage), these, &mut job) };
        }
    }

    /// What sample `e` does.
    fn sample(&mut self, run: &Run, way: &Way, e: usize, sample: &Taken, out: &mut Innovation) {
        let (j, k, delays) = (sample.output, sample.point, self.propagator.delays.len());
        let (n, nx) = (self.filter.motion, self.propagator.layout.states);
        let (of, points) = (&self.filter.measured[j], &way.points[j]);
        if delays > 0 {
            let pasts = &way.pasts[e * delays..(e + 1) * delays];
            let at = (self.sample_delays[j].at(points, k), k);
            let nothing = &mut self.nothing;
            delayed(self.propagator, self.width, run, pasts, at, &mut self.s, nothing);
        }
        let taking = |dc| Taking {
            places: &self.filter.places,
            slopes: &of.slopes,
            bent: &of.bent,
            c: &way.c[e * n..(e + 1) * n],
            x: &way.x[e * nx..(e + 1) * nx],
            h: &way.h[e * n..(e + 1) * n],
            gain: &way.gain[e * n..(e + 1) * n],
            nu: sample.nu,
            s: sample.s,
            dr: &self.noise[j],
            dc,
            lanes: self.lanes,
        };
        let [dy, ds] = &mut self.rows;
        // SAFETY: the width is this machine's.
        unsafe {
            product(self.width, self.outputs[j].at(points, k), k % LANES, &self.s, &mut self.dc);
            take(self.width, taking(&self.dc), &mut self.s, &mut self.dh, [dy, ds]);
        }
        let nd = self.propagator.directions.len();
        let rows = sample.at * nd..(sample.at + 1) * nd;
        out.dy[rows.clone()].copy_from_slice(&dy[..nd]);
        out.ds[rows].copy_from_slice(&ds[..nd]);
    }
}
