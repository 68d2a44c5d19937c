//! Smoothed nodes, latest first, in; the model's outputs and their standard deviations on a uniform
//! grid out.
//!
//! Between two nodes the smoothed states follow the cubic through both ends with the model's own
//! rates there (nodes are at most some hundredths of a second apart). Standard deviations follow by
//! the delta method from the exact derivatives of the outputs with respect to states, parameters,
//! inputs and input rates; they change slowly, so they are computed at every so many points and run
//! straight between.

use super::backward::Visit;
use super::flight::Flight;
use super::kinematics::{Evaluator, Kinematics};
use super::matrix::padded;
use super::tape::Tape;
use crate::math::interpolate::between;
use crate::signal::resample::Grid;

/// Points evaluated together.
const LANES: usize = 8;

/// Outputs on a grid, NaN where there is no path.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outputs {
    /// `[output][point]`.
    pub value: Vec<Vec<f64>>,
    /// `[output][point]`.
    pub sd: Vec<Vec<f64>>,
    /// Standard deviations of states and free parameters where they were computed, latest first:
    /// `[n][]`.
    pub x_sd: Vec<Vec<f64>>,
}

impl Outputs {
    pub fn empty(outputs: usize, n: usize, points: usize) -> Outputs {
        let columns = |k: usize| vec![vec![f64::NAN; points]; k];
        Outputs { value: columns(outputs), sd: columns(outputs), x_sd: vec![Vec::new(); n] }
    }
}

/// Fills outputs while the backward pass goes by.
pub struct Sampler<'a> {
    kinematics: &'a Kinematics<'a>,
    flight: &'a Flight,
    grid: Grid,
    /// Every so many points a standard deviation.
    every: usize,
    out: &'a mut Outputs,
    /// Points at or after this one are done.
    next: usize,
    /// Time and smoothed mean of the node after.
    after: Option<(f64, Vec<f64>)>,
    rates: Evaluator<'a, 1>,
    values: Evaluator<'a, LANES>,
    derivatives: Evaluator<'a, 1>,
    batch: Vec<usize>,
    p: Vec<f64>,
    u: Vec<f64>,
    slope: Vec<f64>,
    f: [Vec<f64>; 2],
    x: Vec<f64>,
    g: Vec<f64>,
}

impl<'a> Sampler<'a> {
    pub fn new(
        kinematics: &'a Kinematics<'a>,
        flight: &'a Flight,
        grid: Grid,
        every: usize,
        out: &'a mut Outputs,
    ) -> Self {
        let model = kinematics.model;
        let (nx, nu) = (kinematics.states(), model.inputs.len());
        Sampler {
            rates: Evaluator::new(model, &kinematics.rates),
            values: Evaluator::new(model, &kinematics.outputs),
            derivatives: Evaluator::new(model, &kinematics.output_jacobian.program),
            next: grid.n,
            batch: Vec::with_capacity(LANES),
            after: None,
            p: Vec::new(),
            u: vec![0.0; nu],
            slope: vec![0.0; nu],
            f: [vec![0.0; nx], vec![0.0; nx]],
            x: vec![0.0; kinematics.size()],
            g: vec![0.0; padded(kinematics.size()) + 2 * nu],
            kinematics,
            flight,
            grid,
            every: every.max(1),
            out,
        }
    }

    fn rate(&mut self, which: usize, t: f64, x: &[f64]) {
        let nx = self.kinematics.states();
        self.flight.inputs_at(t, &self.flight.locate(t), &mut self.u, &mut self.slope);
        self.rates.point(0, &x[..nx], &self.u, &self.slope, t);
        self.rates.parameters(0, &self.kinematics.free, &x[nx..]);
        self.rates.run();
        for i in 0..nx {
            self.f[which][i] = self.rates.get(i, 0);
        }
    }

    /// Puts the point `at`, whose smoothed mean is `self.x`, into the batch.
    fn put(&mut self, at: usize, covariance: &mut dyn FnMut(&mut Vec<f64>)) {
        let (nx, t) = (self.kinematics.states(), self.grid.time(at));
        self.flight.inputs_at(t, &self.flight.locate(t), &mut self.u, &mut self.slope);
        let lane = self.batch.len();
        self.values.point(lane, &self.x[..nx], &self.u, &self.slope, t);
        self.values.parameters(lane, &self.kinematics.free, &self.x[nx..]);
        self.batch.push(at);
        if at.is_multiple_of(self.every) {
            let mut p = std::mem::take(&mut self.p);
            covariance(&mut p);
            self.deviations(at, t, &p);
            self.p = p;
        }
        if self.batch.len() == LANES {
            self.flush();
        }
    }

    fn flush(&mut self) {
        if self.batch.is_empty() {
            return;
        }
        self.values.run();
        for (k, column) in self.out.value.iter_mut().enumerate() {
            for (lane, &at) in self.batch.iter().enumerate() {
                column[at] = self.values.get(k, lane);
            }
        }
        self.batch.clear();
    }

    /// Standard deviations at a point, given the smoothed covariance.
    fn deviations(&mut self, at: usize, t: f64, p: &[f64]) {
        let (n, nx, nu) = (self.kinematics.size(), self.kinematics.states(), self.u.len());
        let m = padded(n);
        let d = &self.kinematics.output_jacobian;
        self.derivatives.point(0, &self.x[..nx], &self.u, &self.slope, t);
        self.derivatives.parameters(0, &self.kinematics.free, &self.x[nx..]);
        self.derivatives.run();
        let mut e = 0;
        for k in 0..d.rows {
            let first = e;
            while e < d.entries.len() && d.entries[e].0 == k {
                self.g[e - first] = self.derivatives.get(d.rows + e, 0);
                e += 1;
            }
            let mine = &d.entries[first..e];
            let mut variance = 0.0;
            for (i, &(_, a)) in mine.iter().enumerate() {
                if a < n {
                    for (j, &(_, b)) in mine.iter().enumerate().filter(|(_, (_, b))| *b < n) {
                        variance += self.g[i] * p[a * m + b] * self.g[j];
                    }
                } else {
                    let (input, part) = ((a - n) % nu, (a - n) / nu);
                    variance += self.g[i] * self.g[i] * self.flight.inputs[input].direct[part];
                }
            }
            self.out.sd[k][at] = variance.max(0.0).sqrt();
        }
        for (i, column) in self.out.x_sd.iter_mut().enumerate() {
            column.push(p[i * m + i].max(0.0).sqrt());
        }
    }

    /// Ends the pass: what waits is evaluated, standard deviations run straight between the points
    /// where they are known.
    pub fn finish(mut self, from: usize, to: usize) {
        self.flush();
        for column in &mut self.out.sd {
            let known: Vec<usize> = (from..to).filter(|&k| column[k].is_finite()).collect();
            for pair in known.windows(2) {
                for k in pair[0] + 1..pair[1] {
                    let w = (k - pair[0]) as f64 / (pair[1] - pair[0]) as f64;
                    column[k] = between(column[pair[0]], column[pair[1]], w);
                }
            }
            if let (Some(&first), Some(&last)) = (known.first(), known.last()) {
                let (a, b) = (column[first], column[last]);
                column[from..first].fill(a);
                column[last..to].fill(b);
            }
        }
    }
}

impl Visit for Sampler<'_> {
    fn node(
        &mut self,
        tape: &Tape,
        k: usize,
        x: &[f64],
        _: &[f64],
        covariance: &mut dyn FnMut(&mut Vec<f64>),
    ) {
        let t = tape.t[k];
        let after = self.after.take();
        if self.next > 0 && self.grid.time(self.next - 1) >= t - super::flight::SAME {
            if let Some((t1, x1)) = &after {
                self.rate(0, t, x);
                self.rate(1, *t1, x1);
            }
            while self.next > 0 && self.grid.time(self.next - 1) >= t - super::flight::SAME {
                let at = self.next - 1;
                self.next = at;
                let now = self.grid.time(at);
                match &after {
                    Some((t1, x1)) if now <= *t1 + super::flight::SAME => {
                        hermite(
                            &mut self.x,
                            ((now - t) / (t1 - t)).clamp(0.0, 1.0),
                            t1 - t,
                            x,
                            x1,
                            &self.f,
                        );
                    }
                    None if now <= t + super::flight::SAME => self.x.copy_from_slice(x),
                    _ => continue,
                }
                self.put(at, covariance);
            }
        }
        // the copy's memory is used again
        let mut copy = after.map_or_else(|| vec![0.0; x.len()], |(_, copy)| copy);
        copy.copy_from_slice(x);
        self.after = Some((t, copy));
    }
}

/// The cubic through both ends with the rates `f` there; parameters, which have no rate, run
/// straight.
fn hermite(out: &mut [f64], s: f64, h: f64, x0: &[f64], x1: &[f64], f: &[Vec<f64>; 2]) {
    let (s2, s3) = (s * s, s * s * s);
    for i in 0..out.len() {
        out[i] = match (f[0].get(i), f[1].get(i)) {
            (Some(f0), Some(f1)) => {
                (2.0 * s3 - 3.0 * s2 + 1.0) * x0[i]
                    + h * (s3 - 2.0 * s2 + s) * f0
                    + (3.0 * s2 - 2.0 * s3) * x1[i]
                    + h * (s3 - s2) * f1
            }
            _ => between(x0[i], x1[i], s),
        };
    }
}
