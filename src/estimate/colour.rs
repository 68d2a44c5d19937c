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

use super::arrow::{Arrow, Factor, Own};
use super::filter::{Filter, filters};
use super::problem::{Block, Layout};
use super::{OrderCriterion, Settings};
use crate::math::ar::{self, Ar};
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
    /// Per noise class, in the unit of its residuals.
    pub models: Vec<Ar>,
}

/// The segments at one parameter vector.
pub struct Source<'a, F> {
    layout: &'a Layout,
    evaluate: &'a F,
    theta: &'a [f64],
    kept: Vec<Option<Vec<Block>>>,
}

impl<'a, F> Source<'a, F>
where
    F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
{
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
        let mut blocks = (self.evaluate)(s, &self.layout.local(s, self.theta))?;
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
/// on a bound (`held`) pinned; `r` the variances it was weighted with; `count` the scored samples per class.
pub fn coloured<F>(
    source: &Source<F>,
    matrix: &Arrow,
    held: &[bool],
    r: &[f64],
    count: &[usize],
    settings: &Settings,
) -> Option<Colour>
where
    F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
{
    let factor = matrix.factor()?;
    let mut inverse = factor.sandwich(matrix);
    clear(&mut inverse, held);
    let lags = settings.max_ar_order;
    let raw = products(source, r.len(), lags)?;
    let mut models = fit(&raw.sums, &raw, count, settings);
    let mut covariance = spread(source, &factor, held, r, &models)?;
    for _ in 0..ROUNDS {
        let absorbed = absorbed(source, &inverse, &covariance, r, &models, lags)?;
        let total: Vec<Vec<f64>> = raw.sums.iter().zip(&absorbed).map(|(a, b)| add(a, b)).collect();
        let next = fit(&total, &raw, count, settings);
        if next.iter().zip(&models).all(|(a, b)| same(a, b)) {
            break;
        }
        models = next;
        covariance = spread(source, &factor, held, r, &models)?;
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

fn products<F>(source: &Source<F>, classes: usize, lags: usize) -> Option<Products>
where
    F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
{
    let mut all = Products { sums: vec![vec![0.0; lags + 1]; classes], pairs: vec![vec![0.0; lags + 1]; classes] };
    source.each(
        |_, blocks| {
            let one = |b: &Block| {
                let pairs = |k| b.e.iter().zip(b.e.iter().skip(k)).map(|(x, y)| x * y).filter(|v: &f64| !v.is_nan());
                (b.class, lagged(lags, |k| pairs(k).sum()), lagged(lags, |k| pairs(k).count() as f64))
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
            let penalty = match settings.ar_order {
                OrderCriterion::Aic => 2.0,
                OrderCriterion::Bic => libm::log(count[j] as f64),
            };
            ar::fit_penalised(&c, count[j], settings.max_ar_order, penalty)
        })
        .collect()
}

/// Covariance `M^-1 Q M^-1` with `Q = sum G' R^-1 Sigma R^-1 G`, plus the information of the priors.
fn spread<F>(source: &Source<F>, factor: &Factor, held: &[bool], r: &[f64], models: &[Ar]) -> Option<Arrow>
where
    F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
{
    let layout = source.layout;
    let nc = layout.shared;
    let filters = filters(models)?;
    let mut q = Arrow { shared: nc, cc: vec![0.0; nc * nc], own: Vec::with_capacity(layout.parts.len()) };
    source.each(
        |s, blocks| {
            let nd = layout.parts[s].directions();
            let mut q = vec![0.0; nd * nd];
            for block in blocks {
                let filter = &filters[block.class];
                let v = filter.backward(&block.g, nd);
                filter.add_spread(&v, nd, 1.0 / (r[block.class] * r[block.class]), &mut q);
            }
            q
        },
        |s, local| add_local(&mut q, layout, s, &local),
    )?;
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
    let mut own = Own { n, ss: vec![0.0; n * n], sc: vec![0.0; n * nc] };
    for (i, &gi) in part.shared.iter().enumerate() {
        for (j, &gj) in part.shared.iter().enumerate() {
            q.cc[gi * nc + gj] += at(i, j);
        }
        for k in 0..n {
            own.sc[k * nc + gi] += at(nl + k, i);
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
            out[(nl + k) * nd + i] = own.sc[k * nc + gi];
            out[i * nd + nl + k] = own.sc[k * nc + gi];
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
fn absorbed<F>(
    source: &Source<F>,
    inverse: &Arrow,
    covariance: &Arrow,
    r: &[f64],
    models: &[Ar],
    lags: usize,
) -> Option<Vec<Vec<f64>>>
where
    F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
{
    let filters = filters(models)?;
    let mut all = vec![vec![0.0; lags + 1]; r.len()];
    source.each(
        |s, blocks| {
            let nd = source.layout.parts[s].directions();
            let (m, p) = (local(inverse, source.layout, s), local(covariance, source.layout, s));
            blocks.iter().map(|b| (b.class, absorbed_block(b, nd, &m, &p, &filters[b.class], r[b.class], lags))).collect::<Vec<_>>()
        },
        |_, parts| {
            for (class, sums) in parts {
                all[class] = add(&all[class], &sums);
            }
        },
    )?;
    Some(all)
}

fn absorbed_block(block: &Block, nd: usize, m: &[f64], p: &[f64], filter: &Filter, r: f64, lags: usize) -> Vec<f64> {
    let n = block.e.len();
    let u = rows_times(&block.g, m, nd);
    let v = rows_times(&block.g, p, nd);
    let mut s = filter.backward(&block.g, nd);
    filter.forward(&mut s, nd);
    empty_masked(&block.e, &mut s, nd);
    let row = |a: &[f64], b: &[f64], i: usize, j: usize| -> f64 {
        a[i * nd..(i + 1) * nd].iter().zip(&b[j * nd..(j + 1) * nd]).map(|(x, y)| x * y).sum()
    };
    lagged(lags, |k| {
        (0..n.saturating_sub(k))
            .filter(|&i| i + k < n)
            .map(|i| (row(&u, &s, i, i + k) + row(&u, &s, i + k, i)) / r - row(&v, &block.g, i, i + k))
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

    pub fn spread_and_absorbed<F>(
        source: &Source<F>,
        matrix: &Arrow,
        r: &[f64],
        models: &[Ar],
        lags: usize,
    ) -> Option<(Arrow, Vec<Vec<f64>>)>
    where
        F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
    {
        let factor = matrix.factor()?;
        let covariance = spread(source, &factor, &[], r, models)?;
        let absorbed = absorbed(source, &factor.sandwich(matrix), &covariance, r, models, lags)?;
        Some((covariance, absorbed))
    }
}
