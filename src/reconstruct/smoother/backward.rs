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

use super::filter::Filter;
use super::matrix::{Size, adjoint_step, adjoint_update, multiply, noises, padded, smoothed};
use super::sums::Sums;
use super::tape::{Scalar, Tape};
use crate::math::products::dot;
use crate::math::simd::Aligned;

/// The backward pass of one run.
pub struct Backward {
    size: Size,
    a: Aligned,
    aa: Aligned,
    b: Aligned,
    w: Aligned,
    /// Smoothed error of every input over the step that follows.
    noise: Vec<f64>,
    noises: Vec<[f64; 2]>,
    pub sums: Sums,
    /// Smoothed mean and covariance of the node last visited.
    pub x: Vec<f64>,
    pub p: Vec<f64>,
}

/// What is done at the nodes, latest first.
pub trait Visit {
    /// Whether nodes are visited at all; without, states need not be kept.
    const NODES: bool = true;
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
        let size = filter.size;
        Backward {
            size,
            a: Aligned::of_zeros(size.m),
            aa: Aligned::of_zeros(size.square()),
            b: Aligned::of_zeros(size.m),
            w: Aligned::of_zeros(size.square()),
            noise: vec![0.0; size.q],
            noises: vec![[0.0; 2]; size.q],
            sums: Sums {
                channels: vec![[0.0; 2]; filter.flight.channels.len()],
                inputs: vec![[0.0; 2]; size.q],
                walks: vec![[0.0; 2]; size.n],
            },
            x: vec![0.0; size.n],
            p: vec![0.0; size.square()],
        }
    }

    /// Back through a whole tape.
    pub fn over<V: Visit>(&mut self, tape: &Tape, visit: &mut V) {
        for k in (0..tape.t.len()).rev() {
            self.noise.fill(0.0);
            if tape.h[k] > 0.0 {
                self.step(tape, k);
            }
            if V::NODES || k == 0 {
                self.node(tape, k, visit);
            }
            let last = tape.first.get(k + 1).copied().unwrap_or(tape.scalars.len());
            for j in (tape.first[k]..last).rev() {
                self.measurement(tape, k, j, visit);
            }
        }
    }

    /// The smoothed state at node `k`.
    fn node(&mut self, tape: &Tape, k: usize, visit: &mut impl Visit) {
        let Size { n, m, .. } = self.size;
        let p = &tape.p[k * n * m..(k + 1) * n * m];
        multiply(p, n, m, &self.a, &mut self.b);
        let filtered = &tape.x[k * n..(k + 1) * n];
        for ((x, filtered), b) in self.x.iter_mut().zip(filtered).zip(self.b.iter()) {
            *x = filtered - b;
        }
        let (aa, w) = (&self.aa, &mut self.w);
        let mut covariance = |out: &mut Vec<f64>| {
            out.resize(n * m, 0.0);
            smoothed(p, aa, n, m, w, out);
        };
        visit.node(tape, k, &self.x, &self.noise, &mut covariance);
        if k == 0 {
            covariance(&mut self.p);
        }
    }

    /// Back through measurement `j`, at node `k`.
    fn measurement(&mut self, tape: &Tape, k: usize, j: usize, visit: &mut impl Visit) {
        let Size { n, m, .. } = self.size;
        let (scalar, row) = (&tape.scalars[j], j * m..(j + 1) * m);
        let (h, gain) = (&tape.rows[row.clone()], &tape.gains[row]);
        multiply(&self.aa, n, m, gain, &mut self.b);
        let u = scalar.nu / scalar.s + dot(gain, &self.a);
        let d = 1.0 / scalar.s + dot(gain, &self.b);
        let sum = &mut self.sums.channels[scalar.channel];
        sum[0] += u * u;
        sum[1] += d;
        visit.residual(tape.t[k], scalar, u, d);
        for (a, h) in self.a.iter_mut().zip(h) {
            *a -= h * u;
        }
        adjoint_update(&mut self.aa, n, m, h, &self.b, d);
    }

    /// Back through the step after node `k`.
    fn step(&mut self, tape: &Tape, k: usize) {
        let Size { m, x: nx, y, k: moving, q, .. } = self.size;
        let h = tape.h[k];
        let gamma = &tape.gamma[k * q * y..(k + 1) * q * y];
        noises(&self.aa, &self.a, self.size, gamma, &mut self.noises);
        for (l, &[ga, gag]) in self.noises.iter().enumerate() {
            self.sums.inputs[l][0] += ga * ga / h;
            self.sums.inputs[l][1] += gag / h;
            self.noise[l] = -tape.q[k * q + l] * ga;
        }
        for (i, sum) in self.sums.walks.iter_mut().enumerate() {
            sum[0] += self.a[i] * self.a[i] * h;
            sum[1] += self.aa[i * m + i] * h;
        }
        // a <- F'a = a + D'a
        let wide = padded(moving);
        let d = &tape.d[k * nx * wide..(k + 1) * nx * wide];
        self.b.copy_from_slice(&self.a);
        for (row, a) in d.chunks_exact(wide).zip(self.b.iter()) {
            self.a.iter_mut().zip(row).for_each(|(sum, d)| *sum += d * a);
        }
        adjoint_step(&mut self.aa, self.size, d, &mut self.w);
    }
}
