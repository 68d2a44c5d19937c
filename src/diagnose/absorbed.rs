//! A fit in; its residuals with what it absorbed of the noise beside them, as series whose products at every lag add up to the noise's, out.
//!
//! Residuals are smaller and less coloured than the noise, because the fit took a part of it: with `G` the sensitivities to all that was free
//! and `Sigma` the covariance of the noise by which it was weighted, `E[r r'] = Sigma - G P G'`, `P = (G' Sigma^-1 G)^-1`. So the columns of
//! `G P^(1/2)` stand beside the residuals, and sums over all of them, divided by the number of residuals, are those of the noise itself. Slow
//! noise is absorbed most: initial states and derivatives follow it through a short maneuver, and its level would otherwise be taken for a
//! fraction of what it is.

use super::gram::{Gram, factor};
use super::located::Answers;
use super::noise::Noise;
use crate::estimate::{Block, Case};
use rayon::prelude::*;

/// A fit as the noise sees it.
pub struct Fitted<'a> {
    pub case: &'a Case<'a>,
    /// Places among the segments of the case.
    pub segments: &'a [usize],
    /// Shared parameters that were free.
    pub free: &'a [usize],
    pub theta: &'a [f64],
    /// What is no noise in the residuals.
    pub answers: &'a Answers,
    /// Per segment of `segments`: `[directions][columns]`, the segment's rows of `P^(1/2)`; empty before `weighted`.
    roots: Vec<Vec<f64>>,
}

/// Residuals of one output in one segment, and columns that were absorbed; both nothing where a sample is masked.
pub struct Series {
    pub output: usize,
    pub masked: Vec<bool>,
    /// The residuals first.
    pub columns: Vec<Vec<f64>>,
}

impl<'a> Fitted<'a> {
    pub fn new(case: &'a Case<'a>, segments: &'a [usize], free: &'a [usize], theta: &'a [f64], answers: &'a Answers) -> Fitted<'a> {
        Fitted { case, segments, free, theta, answers, roots: Vec::new() }
    }

    /// With what a fit weighted by `noise` absorbs; `None` where the model is not finite.
    pub fn weighted(mut self, noise: &Noise) -> Option<Fitted<'a>> {
        let layout = &self.case.layout;
        let n = self.free.len();
        let parts: Vec<Part> = self.segments.par_iter().map(|&s| self.part(noise, s)).collect::<Option<_>>()?;
        let mut shared = vec![0.0; n * n];
        for (k, &i) in self.free.iter().enumerate() {
            shared[k * n + k] += layout.prior_weight(i);
        }
        for part in &parts {
            for (a, &i) in part.to.iter().enumerate() {
                for (b, &j) in part.to.iter().enumerate() {
                    shared[i * n + j] += part.information[a * part.to.len() + b];
                }
            }
        }
        let shared = inverse_root(&shared, n);
        self.roots = parts.iter().map(|part| part.root(&shared, n)).collect();
        Some(self)
    }

    fn blocks(&self, s: usize) -> Option<Vec<Block>> {
        self.case.evaluate(s, &self.case.layout.local(s, self.theta), true)
    }

    fn part(&self, noise: &Noise, s: usize) -> Option<Part> {
        let part = &self.case.layout.parts[s];
        let white = noise.whiten(s, &self.blocks(s)?);
        let own: Vec<usize> = (part.shared.len()..part.directions()).collect();
        let place = |i: &usize| part.shared.iter().position(|shared| shared == i);
        let (to, from): (Vec<usize>, Vec<usize>) = self.free.iter().enumerate().filter_map(|(k, i)| Some((k, place(i)?))).unzip();
        let order: Vec<usize> = own.iter().chain(&from).copied().collect();
        let columns: Vec<Vec<f64>> = order.iter().map(|&d| white.get(d).cloned().unwrap_or_default()).collect();
        let gram = Gram::of(&columns);
        gram.scale.iter().all(|v| v.is_finite()).then(|| Part::new(&gram, own.len(), part.directions(), order, to))
    }

    /// Residuals and absorbed columns of one segment.
    pub fn series(&self, at: usize) -> Vec<Series> {
        let s = self.segments[at];
        let directions = self.case.layout.parts[s].directions();
        let root = self.roots.get(at).map_or(&[][..], |root| root);
        let count = root.len() / directions.max(1);
        let one = |block: Block| {
            let masked: Vec<bool> = block.e.iter().map(|e| !e.is_finite()).collect();
            let mut columns = vec![vec![0.0; block.e.len()]; count];
            for (k, g) in block.g.chunks_exact(directions.max(1)).enumerate().filter(|(k, _)| !masked[*k]) {
                for (g, row) in g.iter().zip(root.chunks_exact(count.max(1))).filter(|(g, _)| **g != 0.0) {
                    columns.iter_mut().zip(row).for_each(|(column, r)| column[k] += g * r);
                }
            }
            let mut e = block.e;
            if let Some(Some(answer)) = self.answers.values.get(at).and_then(|of| of.get(block.output)) {
                e.iter_mut().zip(answer).for_each(|(e, answer)| *e -= answer);
            }
            columns.insert(0, e);
            Series { output: block.output, masked, columns }
        };
        self.blocks(s).unwrap_or_default().into_iter().map(one).collect()
    }
}

/// Information of one segment.
struct Part {
    directions: usize,
    own: usize,
    /// Direction of each column: own ones, then shared ones.
    order: Vec<usize>,
    /// Place of each shared column in `free`.
    to: Vec<usize>,
    /// `[own][own]`: root of the inverse of the own parameters' information.
    own_root: Vec<f64>,
    /// `[own][to]`: own parameters that answer to shared ones.
    answer: Vec<f64>,
    /// `[to][to]`: information on shared ones with the own ones free.
    information: Vec<f64>,
}

impl Part {
    fn new(gram: &Gram, own: usize, directions: usize, order: Vec<usize>, to: Vec<usize>) -> Part {
        let m = to.len();
        let own_root = inverse_root(&gram.block(&(0..own).collect::<Vec<_>>()), own);
        // A^-1 B = R R' B
        let half: Vec<f64> =
            (0..own * m).map(|k| (0..own).map(|i| own_root[i * own + k / m] * gram.at(i, own + k % m)).sum()).collect();
        let answer = (0..own * m).map(|k| (0..own).map(|i| own_root[(k / m) * own + i] * half[i * m + k % m]).sum()).collect();
        let taken = |a: usize, b: usize| (0..own).map(|i| half[i * m + a] * half[i * m + b]).sum::<f64>();
        let information = (0..m * m).map(|k| gram.at(own + k / m, own + k % m) - taken(k / m, k % m)).collect();
        Part { directions, own, order, to, own_root, answer, information }
    }

    /// This segment's rows of `P^(1/2)`: columns of its own parameters, then those of the `n` shared ones.
    fn root(&self, shared: &[f64], n: usize) -> Vec<f64> {
        let (own, m, columns) = (self.own, self.to.len(), self.own + n);
        let mut root = vec![0.0; self.directions * columns];
        for (place, &direction) in self.order.iter().enumerate() {
            let row = &mut root[direction * columns..(direction + 1) * columns];
            for (k, value) in row[own..].iter_mut().enumerate() {
                *value = match place.checked_sub(own) {
                    Some(a) => shared[self.to[a] * n + k],
                    None => -(0..m).map(|a| self.answer[place * m + a] * shared[self.to[a] * n + k]).sum::<f64>(),
                };
            }
            if place < own {
                row[..own].copy_from_slice(&self.own_root[place * own..(place + 1) * own]);
            }
        }
        root
    }
}

/// `R` with `R R' = A^-1`, `[n][n]`; rows of what `A` does not determine are zero, as if it had been held.
fn inverse_root(a: &[f64], n: usize) -> Vec<f64> {
    let l = factor(a, n);
    let mut root = vec![0.0; n * n];
    for column in (0..n).filter(|&c| l[c * n + c] > 0.0) {
        // L' x = e
        for i in (0..=column).rev().filter(|&i| l[i * n + i] > 0.0) {
            let known: f64 = (i + 1..=column).map(|j| l[j * n + i] * root[j * n + column]).sum();
            root[i * n + column] = (if i == column { 1.0 } else { 0.0 } - known) / l[i * n + i];
        }
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_of_an_inverse_leaves_out_what_is_not_determined() {
        let a = [4.0, 2.0, 6.0, 2.0, 1.0, 3.0, 6.0, 3.0, 10.0];
        let r = inverse_root(&a, 3);
        let p: Vec<f64> = (0..9).map(|k| (0..3).map(|c| r[(k / 3) * 3 + c] * r[(k % 3) * 3 + c]).sum()).collect();
        // Without the second: the inverse of [4 6; 6 10].
        for (value, want) in p.iter().zip([2.5, 0.0, -1.5, 0.0, 0.0, 0.0, -1.5, 0.0, 1.0]) {
            assert!((value - want).abs() < 1e-9, "{p:?}");
        }
    }
}
