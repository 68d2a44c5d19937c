//! Tests of the numerical core on problems with known answers.

mod candidates;
mod coverage;
mod equation_error;
mod friction;
mod groups;
mod hazards;
mod hfb320;
mod honest;
mod influential;
mod limits;
mod linear_algebra;
mod modes;
mod named;
mod noise;
mod noisy_inputs;
mod noisy_starts;
mod points;
mod shifts;
mod skewed;
mod starts;
mod together;

use super::{Settings, neighbours::Known, solution::Solution, solution::solve};
use crate::least_squares::{Block, Layout};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

fn rng(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

fn normal(rng: &mut Pcg64) -> f64 {
    StandardNormal.sample(rng)
}

/// First-order noise of standard deviation `sd` and correlation `rho` between neighbours.
fn noise(rng: &mut Pcg64, n: usize, sd: f64, rho: f64) -> Vec<f64> {
    let mut v = sd * normal(rng);
    (0..n)
        .map(|_| {
            let now = v;
            v = rho * v + sd * (1.0 - rho * rho).sqrt() * normal(rng);
            now
        })
        .collect()
}

/// `x[k+1] = a x[k] + b u[k]`, `y = x`, driven by a 3211; shared parameters a, b, own parameter
/// x[0].
struct Toy {
    /// Measurements per segment.
    z: Vec<Vec<f64>>,
}

fn input(k: usize) -> f64 {
    match k % 200 {
        20..65 => 1.0,
        65..95 => -1.0,
        95..110 => 1.0,
        110..125 => -1.0,
        _ => 0.0,
    }
}

/// Values and sensitivities with respect to a, b, x[0].
fn toy_response(n: usize, p: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (a, b) = (p[0], p[1]);
    let (mut x, mut s) = (p[2], [0.0, 0.0, 1.0]);
    let (mut y, mut g) = (Vec::with_capacity(n), Vec::with_capacity(3 * n));
    for k in 0..n {
        y.push(x);
        g.extend_from_slice(&s);
        s = [a * s[0] + x, a * s[1] + input(k), a * s[2]];
        x = a * x + b * input(k);
    }
    (y, g)
}

const TOY_TRUTH: [f64; 2] = [0.95, 0.1];

impl Toy {
    fn simulate(seed: u64, segments: usize, n: usize, sd: f64, rho: f64) -> Toy {
        let mut rng = rng(seed);
        let z = (0..segments)
            .map(|s| {
                let (y, _) = toy_response(n, &[TOY_TRUTH[0], TOY_TRUTH[1], s as f64 * 0.1]);
                y.iter().zip(noise(&mut rng, n, sd, rho)).map(|(y, v)| y + v).collect()
            })
            .collect();
        Toy { z }
    }

    fn layout(&self) -> Layout {
        let own = vec![1; self.z.len()];
        let mut start = vec![0.9, 0.15];
        start.extend(self.z.iter().map(|z| if z[0].is_nan() { 0.0 } else { z[0] }));
        Layout::plain(2, &own, 1, start)
    }

    fn evaluate(&self, s: usize, p: &[f64]) -> Option<Vec<Block>> {
        let (y, g) = toy_response(self.z[s].len(), p);
        if y.iter().any(|y| !y.is_finite()) {
            return None;
        }
        Some(vec![Block::new(0, self.z[s].iter().zip(&y).map(|(z, y)| z - y).collect(), g)])
    }

    fn solve(&self, settings: &Settings) -> Solution {
        solve(
            &self.layout(),
            &|s: usize, p: &[f64], _: bool| self.evaluate(s, p),
            settings,
            &Known::default(),
        )
    }
}

/// Standard deviations from the diagonal of an arrow covariance, whole vector.
fn sds(covariance: &crate::least_squares::Arrow) -> Vec<f64> {
    let nc = covariance.shared;
    let mut out: Vec<f64> = (0..nc).map(|i| covariance.cc[i * nc + i].sqrt()).collect();
    for own in &covariance.own {
        out.extend((0..own.n).map(|i| own.ss[i * own.n + i].sqrt()));
    }
    out
}
