//! Residuals and sensitivities at the estimate in; the covariance of the estimates under coloured residuals and the colour out.
//!
//! Morelli & Klein: `cov = M^-1 [sum G' R^-1 Sigma R^-1 G] M^-1`, summed over segments and outputs. `Sigma` is the Toeplitz matrix
//! of an autoregressive model per noise class, restarted at every segment. The residuals `r` are smaller and less coloured than
//! the noise, because the fit absorbed a part of it: `E[r r'] = (I-H) Sigma (I-H)'` with `H = G M^-1 G' R^-1`. So the sums of
//! products of residuals at each lag are raised by what was absorbed,
//! `sum_i [u_i' s_(i+k) + s_i' u_(i+k) - g_i' P g_(i+k)]` with `u = M^-1 g`, `s` the rows of `Sigma R^-1 G` and `P` the covariance
//! above, and the model is fitted to that; since `s` and `P` depend on the model, this is repeated.
//!
//! Samples count as equally spaced: with uneven time stamps, lag means number of samples. A masked sample keeps its place.
//!
//! Each output has a model of its own (in each group of segments with an `R` of its own). Where `R` is full, noise of different outputs
//! is taken to be correlated through innovations of the same instant only: with `A_i` the whitening filter of output `i`,
//! `Sigma_ij = A_i^-1 D_i^1/2 c_ij P_ij D_j^1/2 A_j^-T`, where `P_ij` marks pairs of the same instant. The numbers `c_ij` are such that
//! samples of the same instant have the correlation that `R` says (exactly so for outputs of the same rate): `R`'s correlation over the
//! likeness of both colours, made smaller together where the matrix `c` would not be positive definite. So correlation at the
//! same instant counts fully, and correlation between different instants as far as it follows from it and the colours; a delay between
//! the noise of two outputs is not modelled.

use super::arrow::{Arrow, Factor, Own};
use super::noise::Covariance;
use super::problem::{Block, Evaluate, Layout};
use super::sigma::Sigma;
use super::{OrderCriterion, Settings};
use crate::math::ar::{self, Ar, Order};
use rayon::prelude::*;

/// Blocks are kept while they need fewer numbers than this (256 MB); those of later segments are evaluated again when needed.
const KEPT: usize = 1 << 25;
/// Segments at a time, as in the pass over all segments.
const CHUNK: usize = 64;
/// How often the colour is fitted again after the absorbed part is known better.
const ROUNDS: usize = 6;

/// Covariance and colour.
#[derive(Debug, Clone)]
pub struct Colour {
    /// Blocks of `M^-1`, the Cramer-Rao covariance; like `covariance` without variance where a parameter is held.
    pub crlb: Arrow,
    /// Blocks of the covariance on the border and of every segment with itself and the border.
    pub covariance: Arrow,
    /// Per group of segments and output (`group * outputs + output`), in the unit of its residuals.
    pub models: Vec<Ar>,
}

/// The segments at one parameter vector.
pub struct Source<'a, F> {
    layout: &'a Layout,
    evaluate: &'a F,
    theta: &'a [f64],
    kept: Vec<Option<Vec<Block>>>,
}

impl<'a, F: Evaluate> Source<'a, F> {
    pub fn new(layout: &'a Layout, evaluate: &'a F, theta: &'a [f64]) -> Self {
        let mut source = Source { layout, evaluate, theta, kept: Vec::new() };
        let mut size = 0;
        for from in (0..layout.parts.len()).step_by(CHUNK) {
            if size > KEPT {
                break;
            }
            let to = (from + CHUNK).min(layout.parts.len());
            let chunk: Vec<_> = (from..to).into_par_iter().map(|s| source.fresh(s)).collect();
            size += chunk.iter().flatten().flatten().map(|b| b.e.len() + b.g.len()).sum::<usize>();
            source.kept.extend(chunk);
        }
        source
    }

    /// Blocks whose masked samples have sensitivities of zero, which add nothing to any sum; their residuals stay NaN.
    fn fresh(&self, s: usize) -> Option<Vec<Block>> {
        let mut blocks = (self.evaluate)(s, &self.layout.local(s, self.theta), true)?;
        let nd = self.layout.parts[s].directions();
        for block in &mut blocks {
            empty_masked(&block.e, &mut block.g, nd);
        }
        Some(blocks)
    }

    /// `f(segment, blocks)` for every segment, handed to `take` in segment order; `None` where one is not finite.
    fn each<T: Send>(&self, f: impl Fn(usize, &[Block]) -> T + Sync, mut take: impl FnMut(usize, T)) -> Option<()> {
        for from in (0..self.layout.parts.len()).step_by(CHUNK) {
            let to = (from + CHUNK).min(self.layout.parts.len());
            let chunk: Vec<Option<T>> = (from..to)
                .into_par_iter()
                .map(|s| match self.kept.get(s) {
                    Some(kept) => kept.as_ref().map(|blocks| f(s, blocks)),
                    None => self.fresh(s).map(|blocks| f(s, &blocks)),
                })
                .collect();
            for (s, value) in (from..to).zip(chunk) {
                take(s, value?);
            }
        }
        Some(())
    }
}

/// Covariance of the estimates when the residuals have the colour they show. `matrix` is the normal matrix with priors, parameters
/// on a bound (`held`) pinned; `noise` the `R` of every group it was weighted with.
pub fn coloured<F: Evaluate>(
    source: &Source<F>,
    matrix: &Arrow,
    held: &[bool],
    noise: &[Covariance],
    settings: &Settings,
) -> Option<Colour> {
    let factor = matrix.factor()?;
    let mut inverse = factor.sandwich(matrix);
    clear(&mut inverse, held);
    let lags = settings.max_ar_order;
    let count: Vec<usize> = noise.iter().flat_map(|r| r.count.iter().copied()).collect();
    let raw = products(source, count.len(), lags)?;
    let mut models = fit(&raw.sums, &raw, &count, settings);
    let mut sigma = Sigma::new(source.layout, noise, &models)?;
    let mut covariance = spread(source, &factor, held, &sigma)?;
    for _ in 0..ROUNDS {
        let absorbed = absorbed(source, &inverse, &covariance, &sigma, lags)?;
        let total: Vec<Vec<f64>> = raw.sums.iter().zip(&absorbed).map(|(a, b)| add(a, b)).collect();
        let next = fit(&total, &raw, &count, settings);
        if next.iter().zip(&models).all(|(a, b)| same(a, b)) {
            break;
        }
        models = next;
        sigma = Sigma::new(source.layout, noise, &models)?;
        covariance = spread(source, &factor, held, &sigma)?;
    }
    Some(Colour { crlb: inverse, covariance, models })
}

fn empty_masked(e: &[f64], rows: &mut [f64], nd: usize) {
    for (k, e) in e.iter().enumerate() {
        if e.is_nan() {
            rows[k * nd..(k + 1) * nd].fill(0.0);
        }
    }
}

/// Settled: the same order, and what matters for slow noise, its level at frequency zero, moves by less than 0.1%.
fn same(a: &Ar, b: &Ar) -> bool {
    let level = |m: &Ar| m.variance.sqrt() / (1.0 - m.coefficients.iter().sum::<f64>());
    a.order == b.order && (level(a) - level(b)).abs() <= 1e-3 * level(a).abs()
}

/// Sums of products of residuals per class and lag, and the number of pairs in each.
struct Products {
    sums: Vec<Vec<f64>>,
    pairs: Vec<Vec<f64>>,
}

fn products<F: Evaluate>(source: &Source<F>, classes: usize, lags: usize) -> Option<Products> {
    let mut all = Products { sums: vec![vec![0.0; lags + 1]; classes], pairs: vec![vec![0.0; lags + 1]; classes] };
    source.each(
        |s, blocks| {
            let one = |b: &Block| {
                let pairs = |k| b.e.iter().zip(b.e.iter().skip(k)).map(|(x, y)| x * y).filter(|v: &f64| !v.is_nan());
                (Sigma::class(source.layout, s, b), lagged(lags, |k| pairs(k).sum()), lagged(lags, |k| pairs(k).count() as f64))
            };
            blocks.iter().map(one).collect::<Vec<_>>()
        },
        |_, parts| {
            for (class, sums, pairs) in parts {
                all.sums[class] = add(&all.sums[class], &sums);
                all.pairs[class] = add(&all.pairs[class], &pairs);
            }
        },
    )?;
    Some(all)
}

fn lagged(lags: usize, f: impl Fn(usize) -> f64) -> Vec<f64> {
    (0..=lags).map(f).collect()
}

fn add(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// One model per class. The autocovariance is the sum of products per pair: dividing by the number of samples, as usual, would
/// make slow noise look faster than it is.
fn fit(sums: &[Vec<f64>], raw: &Products, count: &[usize], settings: &Settings) -> Vec<Ar> {
    (0..sums.len())
        .map(|j| {
            let lags = sums[j].iter().zip(&raw.pairs[j]).take_while(|(_, pairs)| **pairs > 0.0);
            let c: Vec<f64> = lags.map(|(sum, pairs)| sum / pairs).collect();
            let by = match settings.ar_order {
                OrderCriterion::White => Order::White,
                OrderCriterion::Aic => Order::Penalty(2.0),
                OrderCriterion::Bic => Order::Penalty(libm::log(count[j] as f64)),
            };
            ar::fit_by(&c, count[j], settings.max_ar_order, by)
        })
        .collect()
}

/// Covariance `M^-1 Q M^-1` with `Q = sum G' R^-1 Sigma R^-1 G`, plus the information of the priors.
fn spread<F: Evaluate>(source: &Source<F>, factor: &Factor, held: &[bool], sigma: &Sigma) -> Option<Arrow> {
    let layout = source.layout;
    let nc = layout.shared;
    let mut q = Arrow { shared: nc, cc: vec![0.0; nc * nc], own: Vec::with_capacity(layout.parts.len()) };
    let mut known = true;
    source.each(
        |s, blocks| sigma.spread(s, blocks),
        |s, local| match local {
            Some(local) => add_local(&mut q, layout, s, &local),
            None => known = false,
        },
    )?;
    if !known {
        return None;
    }
    for i in 0..layout.start.len() {
        q.add_diagonal(i, layout.prior_weight(i));
    }
    clear(&mut q, held);
    Some(factor.sandwich(&q))
}

/// Adds a matrix over a segment's directions (lower triangle) to an arrow whose blocks of earlier segments are complete.
fn add_local(q: &mut Arrow, layout: &Layout, s: usize, local: &[f64]) {
    let (part, nc) = (&layout.parts[s], layout.shared);
    let (nl, nd, n) = (part.shared.len(), part.directions(), part.own);
    let at = |i: usize, j: usize| local[i.max(j) * nd + i.min(j)];
    let mut own = Own::empty(n, &part.shared);
    for (i, &gi) in part.shared.iter().enumerate() {
        for (j, &gj) in part.shared.iter().enumerate() {
            q.cc[gi * nc + gj] += at(i, j);
        }
        for k in 0..n {
            own.sc[k * nl + i] += at(nl + k, i);
        }
    }
    for i in 0..n {
        for j in 0..n {
            own.ss[i * n + j] = at(nl + i, nl + j);
        }
    }
    q.own.push(own);
}

/// Rows and columns of a segment's directions out of an arrow.
fn local(matrix: &Arrow, layout: &Layout, s: usize) -> Vec<f64> {
    let (part, nc) = (&layout.parts[s], layout.shared);
    let (nl, nd) = (part.shared.len(), part.directions());
    let own = &matrix.own[s];
    let mut out = vec![0.0; nd * nd];
    for (i, &gi) in part.shared.iter().enumerate() {
        for (j, &gj) in part.shared.iter().enumerate() {
            out[i * nd + j] = matrix.cc[gi * nc + gj];
        }
        for k in 0..own.n {
            out[(nl + k) * nd + i] = own.sc[k * nl + i];
            out[i * nd + nl + k] = own.sc[k * nl + i];
        }
    }
    for i in 0..own.n {
        for j in 0..own.n {
            out[(nl + i) * nd + nl + j] = own.ss[i * own.n + j];
        }
    }
    out
}

/// What the fit absorbed of the sums of products, per class and lag.
fn absorbed<F: Evaluate>(
    source: &Source<F>,
    inverse: &Arrow,
    covariance: &Arrow,
    sigma: &Sigma,
    lags: usize,
) -> Option<Vec<Vec<f64>>> {
    let layout = source.layout;
    let mut all = vec![vec![0.0; lags + 1]; layout.noise.groups * layout.noise.outputs];
    let mut known = true;
    source.each(
        |s, blocks| {
            let (m, p) = (local(inverse, layout, s), local(covariance, layout, s));
            let rows = sigma.rows(s, blocks)?;
            let one = |(b, rows)| (Sigma::class(layout, s, b), absorbed_block(b, layout.parts[s].directions(), &m, &p, rows, lags));
            Some(blocks.iter().zip(rows).map(one).collect::<Vec<_>>())
        },
        |_, parts| {
            known &= parts.is_some();
            for (class, sums) in parts.into_iter().flatten() {
                all[class] = add(&all[class], &sums);
            }
        },
    )?;
    known.then_some(all)
}

/// `s` are the block's rows of `Sigma R^-1 G`.
fn absorbed_block(block: &Block, nd: usize, m: &[f64], p: &[f64], mut s: Vec<f64>, lags: usize) -> Vec<f64> {
    let n = block.e.len();
    let u = rows_times(&block.g, m, nd);
    let v = rows_times(&block.g, p, nd);
    empty_masked(&block.e, &mut s, nd);
    let row = |a: &[f64], b: &[f64], i: usize, j: usize| -> f64 {
        a[i * nd..(i + 1) * nd].iter().zip(&b[j * nd..(j + 1) * nd]).map(|(x, y)| x * y).sum()
    };
    lagged(lags, |k| {
        (0..n.saturating_sub(k))
            .filter(|&i| i + k < n)
            .map(|i| row(&u, &s, i, i + k) + row(&u, &s, i + k, i) - row(&v, &block.g, i, i + k))
            .sum()
    })
}

/// Every row of `g` times the symmetric matrix `m`.
fn rows_times(g: &[f64], m: &[f64], nd: usize) -> Vec<f64> {
    let mut out = vec![0.0; g.len()];
    if nd > 0 {
        for (o, g) in out.chunks_exact_mut(nd).zip(g.chunks_exact(nd)) {
            for (gi, row) in g.iter().zip(m.chunks_exact(nd)) {
                o.iter_mut().zip(row).for_each(|(o, m)| *o += gi * m);
            }
        }
    }
    out
}

fn clear(matrix: &mut Arrow, held: &[bool]) {
    for (i, &held) in held.iter().enumerate() {
        if held {
            matrix.clear(i);
        }
    }
}

#[cfg(test)]
pub mod tests_only {
    //! What the tests compare with full matrices.
    use super::*;

    pub fn spread_and_absorbed<F: Evaluate>(
        source: &Source<F>,
        matrix: &Arrow,
        noise: &[Covariance],
        models: &[Ar],
        lags: usize,
    ) -> Option<(Arrow, Vec<Vec<f64>>)> {
        let factor = matrix.factor()?;
        let sigma = Sigma::new(source.layout, noise, models)?;
        let covariance = spread(source, &factor, &[], &sigma)?;
        let absorbed = absorbed(source, &factor.sandwich(matrix), &covariance, &sigma, lags)?;
        Some((covariance, absorbed))
    }
}
