//! What a filter did to a record, chunk by chunk, in; the exact derivatives of its innovations and
//! their variances (the formulas stand in `innovations`), lanes of directions, out.

use super::filter::{Filter, Innovation, Measured, Taken, Way};
use super::gain::{Taking, take};
use super::propagator::Propagator;
use super::rows::{LANES, product};
use super::tangent::{Jacobian, Place, Tangent};
use super::values::Run;
use crate::math::simd::Aligned;

pub(super) struct Slopes<'p> {
    filter: &'p Filter,
    propagator: &'p Propagator,
    /// Of the states, between two samples.
    tangent: Tangent<'p>,
    /// Per output, of its value and slopes, and of the delay times at its samples.
    outputs: Vec<Jacobian<'p>>,
    sample_delays: Vec<Jacobian<'p>>,
    /// Per output the derivative of its noise's variance.
    noise: Vec<Aligned>,
    /// Of a sample: the output and its slopes; the motion's covariance with the innovation; the rows
    /// that go out.
    dc: Aligned,
    dh: Aligned,
    rows: [Aligned; 2],
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
        let jacobian = |rows, program| Jacobian::new(rows, program, propagator, parameters);
        let made = propagator.native.entries.delays.as_ref();
        let delays =
            || jacobian(&propagator.delay_rows, &propagator.linear.delays_program).by(made);
        let noise = |m: &Measured| {
            let mut row = zeros(1);
            m.direction.into_iter().for_each(|d| row[d] = 2.0 * parameters[m.sd]);
            row
        };
        let slopes = filter.measured.iter().map(|m| 1 + m.slopes.len()).max().unwrap_or(1);
        Slopes {
            tangent: Tangent::new(propagator, parameters, file, 0),
            outputs: filter.measured.iter().map(|m| jacobian(&m.rows, &m.program)).collect(),
            sample_delays: filter.measured.iter().map(|_| delays()).collect(),
            noise: filter.measured.iter().map(noise).collect(),
            dc: zeros(slopes),
            dh: zeros(filter.motion),
            rows: [zeros(1), zeros(1)],
            filter,
            propagator,
        }
    }

    /// Through a chunk.
    pub fn advance(&mut self, run: &Run, way: &Way, out: &mut [Innovation]) {
        let points = self.outputs.iter_mut().chain(&mut self.sample_delays);
        points.for_each(Jacobian::forget);
        self.tangent.forget();
        let mut place = Place::default();
        let mut taken = way.taken.iter().enumerate().peekable();
        for step in 0..=way.chunk.lengths.len() {
            while let Some((e, sample)) = taken.next_if(|(_, t)| t.after == step) {
                self.sample(run, way, e, sample, &mut out[sample.channel]);
            }
            if step == way.chunk.lengths.len() {
                break;
            }
            match self.propagator.plain() {
                true => self.tangent.plain_step(&way.chunk, step),
                false => self.tangent.step(run, &way.chunk, &mut place),
            }
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
            self.tangent.delayed_by(run, pasts, at);
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
            lanes: self.tangent.lanes,
        };
        let ([dy, ds], width, s) = (&mut self.rows, self.tangent.width, &mut self.tangent.s);
        // SAFETY: the width is this machine's.
        unsafe {
            product(width, self.outputs[j].at(points, k), k % LANES, s, &mut self.dc);
            take(width, taking(&self.dc), s, &mut self.dh, [dy, ds]);
        }
        let nd = self.propagator.directions.len();
        let rows = sample.at * nd..(sample.at + 1) * nd;
        out.dy[rows.clone()].copy_from_slice(&dy[..nd]);
        out.ds[rows].copy_from_slice(&ds[..nd]);
    }
}
