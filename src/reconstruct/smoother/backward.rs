//! A tape of the filter in; smoothed states, their covariances and the sums that judge the noise
//! levels out, backwards in time.
//!
//! Modified Bryson-Frazier (Bierman 1973): an adjoint `a` and its covariance `A` run back through
//! the tape, with `x_s = x - P a`, `P_s = P - P A P` after the updates of a node; nothing is
//! inverted.
//!
//! ```text
//! measurement:  u = nu/s + K'a,   d = 1/s + K'A K,   a <- a - h u,   A <- A - (A K) h' - h (A K)' + d h h'
//! step:         a <- F'a,         A <- F'A F
//! ```
//!
//! `u` and `d` are de Jong's (1988) smoothed disturbance and its variance: the derivative of the
//! log-likelihood with respect to the measurement's variance is `sum (u^2 - d)/2`, with respect to
//! a process noise that enters by `g` it is `sum (g'a)^2 - g'A g` over two.

use super::filter::{Filter, Scalar, Tape};
use super::matrix::{VECTOR, adjoint_step, adjoint_update, multiply, smoothed};
use super::sums::Sums;
use crate::math::products::dot_by;

/// The backward pass of one run.
pub struct Backward {
    n: usize,
    m: usize,
    nx: usize,
    lanes: usize,
    inputs: usize,
    a: Vec<f64>,
    aa: Vec<f64>,
    b: Vec<f64>,
    w: Vec<f64>,
    pub sums: Sums,
    /// Smoothed mean and covariance of the node last visited.
    pub x: Vec<f64>,
    pub p: Vec<f64>,
    /// The node itself: `a`, `A` after its updates are undone belong to the step before it.
    w2: Vec<f64>,
}

/// What is done at the nodes, latest first.
pub trait Visit {
    /// The smoothed mean at node `k` of the tape; `covariance` computes `P_s` when asked. `noise`
    /// is the smoothed error of every input over the step that follows (zero at the end).
    fn node(
        &mut self,
        tape: &Tape,
        k: usize,
        x: &[f64],
        noise: &[f64],
        covariance: &mut dyn FnMut(&mut Vec<f64>),
    );
    /// The smoothed disturbance of a measurement: its residual is `r u`, with variance `r - r^2 d`.
    fn residual(&mut self, _t: f64, _scalar: &Scalar, _u: f64, _d: f64) {}
}

impl Backward {
    pub fn new(filter: &Filter) -> Backward {
        let (n, m, nx, lanes) = (filter.n, filter.m, filter.kinematics.states(), filter.lanes);
        let (channels, inputs) = (filter.flight.channels.len(), filter.flight.inputs.len());
        Backward {
            n,
            m,
            nx,
            lanes,
            inputs,
            a: vec![0.0; m],
            aa: vec![0.0; n * m],
            b: vec![0.0; m],
            w: vec![0.0; n * m],
            w2: vec![0.0; n * m],
            sums: Sums {
                channels: vec![[0.0; 2]; channels],
                inputs: vec![[0.0; 2]; inputs],
                walks: vec![[0.0; 2]; n],
            },
            x: vec![0.0; n],
            p: vec![0.0; n * m],
        }
    }

    /// Back through a whole tape.
    pub fn over(&mut self, tape: &Tape, visit: &mut impl Visit) {
        let (n, m) = (self.n, self.m);
        let nu = self.inputs;
        let mut noise = vec![0.0; nu];
        for k in (0..tape.t.len()).rev() {
            noise.fill(0.0);
            if tape.h[k] > 0.0 {
                self.step(
                    &tape.s[k * self.nx * self.lanes..(k + 1) * self.nx * self.lanes],
                    tape.h[k],
                    &tape.q[k * nu..],
                    &mut noise,
                );
            }
            let p = &tape.p[k * n * m..(k + 1) * n * m];
            multiply(p, m, &self.a, &mut self.b[..n]);
            for i in 0..n {
                self.x[i] = tape.x[k * n + i] - self.b[i];
            }
            let (aa, w) = (&self.aa, &mut self.w2);
            let mut covariance = |out: &mut Vec<f64>| {
                out.resize(n * m, 0.0);
                smoothed(p, aa, n, m, w, out);
            };
            visit.node(tape, k, &self.x, &noise, &mut covariance);
            if k == 0 {
                covariance(&mut self.p);
            }
            let last = tape.first.get(k + 1).copied().unwrap_or(tape.scalars.len());
            for j in (tape.first[k]..last).rev() {
                self.measurement(
                    tape.t[k],
                    &tape.scalars[j],
                    &tape.rows[j * m..(j + 1) * m],
                    &tape.gains[j * m..(j + 1) * m],
                    visit,
                );
            }
        }
    }

    fn measurement(
        &mut self,
        t: f64,
        scalar: &Scalar,
        h: &[f64],
        gain: &[f64],
        visit: &mut impl Visit,
    ) {
        let n = self.n;
        multiply(&self.aa, self.m, gain, &mut self.b[..n]);
        let u = scalar.nu / scalar.s + dot_by::<VECTOR>(gain, &self.a);
        let d = 1.0 / scalar.s + dot_by::<VECTOR>(gain, &self.b);
        let sum = &mut self.sums.channels[scalar.channel];
        sum[0] += u * u;
        sum[1] += d;
        visit.residual(t, scalar, u, d);
        for (a, h) in self.a.iter_mut().zip(h) {
            *a -= h * u;
        }
        adjoint_update(&mut self.aa, n, self.m, h, &self.b, d);
    }

    /// Back through a step `s = [Phi | Gamma]`.
    fn step(&mut self, s: &[f64], h: f64, q: &[f64], noise: &mut [f64]) {
        let (n, m, nx, lanes) = (self.n, self.m, self.nx, self.lanes);
        for (l, noise) in noise.iter_mut().enumerate() {
            let gamma = |i: usize| s[i * lanes + m + l];
            let (mut ga, mut gag) = (0.0, 0.0);
            for i in (0..nx).filter(|&i| gamma(i) != 0.0) {
                ga += gamma(i) * self.a[i];
                gag += gamma(i) * (0..nx).map(|j| self.aa[i * m + j] * gamma(j)).sum::<f64>();
            }
            self.sums.inputs[l][0] += ga * ga / h;
            self.sums.inputs[l][1] += gag / h;
            *noise = -q[l] * ga;
        }
        for i in 0..n {
            self.sums.walks[i][0] += self.a[i] * self.a[i] * h;
            self.sums.walks[i][1] += self.aa[i * m + i] * h;
        }
        // a <- F'a
        self.b[..m].copy_from_slice(&self.a);
        self.b[..nx].fill(0.0);
        for i in 0..nx {
            super::matrix::add(&mut self.b, self.a[i], &s[i * lanes..i * lanes + m]);
        }
        std::mem::swap(&mut self.a, &mut self.b);
        adjoint_step(&mut self.aa, n, m, nx, s, lanes, &mut self.w);
    }
}
