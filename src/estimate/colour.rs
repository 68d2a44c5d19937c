//! Residuals and sensitivities at the estimate in; the covariance of the estimates under coloured
//! residuals and the colour out.
//!
//! Morelli & Klein: `cov = M^-1 [sum G' R^-1 Sigma R^-1 G] M^-1`, summed over segments and outputs.
//! `Sigma` is the covariance of an autoregressive model per noise class, restarted at every
//! segment, with what the fit absorbed put back (`noise`).
//!
//! Samples count as equally spaced: with uneven time stamps, lag means number of samples. A masked
//! sample keeps its place.
//!
//! Each output has a model of its own (in each group of segments with an `R` of its own). Where `R`
//! is full, noise of different outputs is taken to be correlated through innovations of the same
//! instant only: with `A_i` the whitening filter of output `i`,
//! `Sigma_ij = A_i^-1 D_i^1/2 c_ij P_ij D_j^1/2 A_j^-T`, where `P_ij` marks pairs of the same
//! instant. The numbers `c_ij` are such that samples of the same instant have the correlation that
//! `R` says (exactly so for outputs of the same rate): `R`'s correlation over the likeness of both
//! colours, made smaller together where the matrix `c` would not be positive definite. So
//! correlation at the same instant counts fully, and correlation between different instants as far
//! as it follows from it and the colours; a delay between the noise of two outputs is not modelled.

use super::noise_covariance::Sigma;
use crate::least_squares::{Arrow, Block, Covariance, Evaluate, Factor, Layout, Own};
use crate::math::pool;
use crate::noise::{Absorbed, Direction, Modelled, Part, Prior, Products, Rule, burg};
use rayon::prelude::*;

/// Blocks are kept while they need fewer numbers than this (256 MB); those of later segments are
/// evaluated again when needed.
const KEPT: usize = 1 << 25;
/// Segments at a time, as in the pass over all segments.
const CHUNK: usize = 64;
/// How often the colour is fitted again after the absorbed part is known better, at most.
const ROUNDS: usize = 20;
/// Settled: what matters for slow noise, its level at frequency zero, moves by less than this
/// share.
const SETTLED: f64 = 1e-3;

/// Residuals are demonstrably coloured where white noise is so with less than this probability.
const DEMONSTRATED: f64 = 0.99;
/// A generalised least-squares step of more standard deviations than this is no chance.
const FAR: f64 = 4.0;

/// Covariance and colour.
#[derive(Debug, Clone)]
pub struct Colour {
    /// Blocks of `M^-1`, the Cramer-Rao covariance; like `covariance` without variance where a
    /// parameter is held.
    pub crlb: Arrow,
    /// Blocks of the covariance on the border and of every segment with itself and the border.
    pub covariance: Arrow,
    /// Per group of segments and output (`group * outputs + output`), in the unit of its residuals.
    pub models: Vec<Modelled>,
    /// Whether another round would have changed nothing.
    pub settled: bool,
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

    /// Whether there are sizes of innovations among the blocks.
    fn has_sizes(&self) -> bool {
        self.kept.iter().flatten().flatten().any(|block| block.instead.is_some())
    }

    /// Blocks whose masked samples have sensitivities of zero, which add nothing to any sum; their
    /// residuals stay NaN.
    fn fresh(&self, s: usize) -> Option<Vec<Block>> {
        let mut blocks = self.evaluate.blocks(s, &self.layout.local(s, self.theta), true)?;
        let nd = self.layout.parts[s].directions();
        for block in &mut blocks {
            empty_masked(&block.e, &mut block.g, nd);
        }
        Some(blocks)
    }

    /// `f(segment, blocks)` for every segment, handed to `take` in segment order; `None` where one
    /// is not finite.
    fn each<T: Send>(
        &self,
        f: impl Fn(usize, &[Block]) -> T + Sync,
        mut take: impl FnMut(usize, T),
    ) -> Option<()> {
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

/// Covariance of the estimates when the residuals have the colour they show. `matrix` is the normal
/// matrix with priors, parameters on a bound (`held`) pinned; `noise` the `R` of every group it was
/// weighted with. `exact` says that regressors have no noise of their own, as what a model integrates has none.
pub fn coloured<F: Evaluate>(
    source: &Source<F>,
    matrix: &Arrow,
    held: &[bool],
    noise: &[Covariance],
    (rule, exact): (Rule, bool),
) -> Option<Colour> {
    let factor = matrix.factor().ok()?;
    let mut inverse = factor.sandwich(matrix);
    clear(&mut inverse, held);
    let outputs: usize = noise.iter().map(|r| r.count.len()).sum();
    let classes = if source.has_sizes() { 2 * outputs } else { outputs };
    let mut models = fit(source, classes, rule, None)?;
    let white = models.iter().all(|model| model.coloured < DEMONSTRATED);
    let mut settled = false;
    for _ in 0..ROUNDS {
        let sigma = Sigma::new(source.layout, noise, &plain(&models));
        if !sigma.is_definite() {
            break;
        }
        let mut taken = absorbed(source, &sigma, held)?;
        if (white || !exact) && is_too_far(source, &taken, &inverse, &factor, held, &sigma)? {
            taken.all = taken.all.at_rest();
        }
        let next = fit(source, classes, rule, Some(&taken))?;
        settled = next.iter().zip(&models).all(|(a, b)| same(a, b));
        models = next;
        if settled {
            break;
        }
    }
    let mut covariance =
        spread(source, &factor, held, &Sigma::new(source.layout, noise, &plain(&models)))?;
    // In short records of white noise some colour is always seen, and the slow part of it may come
    // out many times too small: what is not demonstrably coloured widens intervals, and narrows none.
    if white {
        let of = |(white, found): (f64, f64)| match found > 0.0 {
            true => (white / found).max(1.0).sqrt(),
            false => 1.0,
        };
        let widened: Vec<f64> =
            inverse.diagonal().into_iter().zip(covariance.diagonal()).map(of).collect();
        covariance.scale(&widened);
    }
    models.truncate(outputs);
    Some(Colour { crlb: inverse, covariance, models, settled })
}

/// Whether least squares with this noise would go further than its own errors explain, although the
/// residuals may be white, or regressors have noise. Where the equations are right both estimates have one mean, and the step
/// is smaller than the estimate's sd (Hausman, Econometrica 46, 1978). Noise in regressors draws them apart: what the step leaves is no
/// noise then, and a colour made of it feeds itself.
fn is_too_far<F: Evaluate>(
    source: &Source<F>,
    taken: &Taken,
    white: &Arrow,
    factor: &Factor,
    held: &[bool],
    sigma: &Sigma,
) -> Option<bool> {
    let beyond = |covariance: &Arrow| {
        let sd = covariance.diagonal().into_iter().map(f64::sqrt);
        taken.all.step().iter().zip(sd).any(|(step, sd)| step.abs() > FAR * sd)
    };
    if !beyond(white) {
        return Some(false);
    }
    Some(beyond(&spread(source, factor, held, sigma)?))
}

fn plain(models: &[Modelled]) -> Vec<crate::noise::Ar> {
    models.iter().map(|m| m.model.clone()).collect()
}

fn same(a: &Modelled, b: &Modelled) -> bool {
    let (a, b) = (a.model.level(), b.model.level());
    (a - b).abs() <= SETTLED * b.abs()
}

/// What each segment's part of the fit absorbed under this noise, with the step that the noise asks
/// for.
struct Taken {
    parts: Vec<Part>,
    all: Absorbed,
}

fn absorbed<F: Evaluate>(source: &Source<F>, sigma: &Sigma, held: &[bool]) -> Option<Taken> {
    let layout = source.layout;
    let is_held = |i: usize| held.get(i).copied().unwrap_or(false);
    let prior = |i: usize| {
        let (weight, pull) = layout.prior(i, source.theta[i]);
        Prior { weight, pull }
    };
    let part = |s: usize, blocks: &[Block]| {
        let of = &layout.parts[s];
        let own = of.offset..of.offset + of.own;
        let shared = of
            .shared
            .iter()
            .map(|&i| if is_held(i) { Direction::Held } else { Direction::Shared(i) });
        let directions: Vec<Direction> = shared
            .chain(own.clone().map(|i| if is_held(i) { Direction::Held } else { Direction::Own }))
            .collect();
        let priors: Vec<Prior> = of.shared.iter().copied().chain(own).map(prior).collect();
        let white = sigma.whiten(s, blocks);
        let part = Part::new(&directions, &white, &priors);
        white.into_iter().for_each(pool::give);
        part
    };
    let mut parts = Vec::with_capacity(layout.parts.len());
    source.each(part, |_, part| parts.extend(part))?;
    let shared: Vec<Prior> =
        (0..layout.shared).map(|i| if is_held(i) { Prior::default() } else { prior(i) }).collect();
    (parts.len() == layout.parts.len())
        .then(|| Taken { all: Absorbed::new(&parts, &shared), parts })
}

/// One model per class, of the residuals and of what was absorbed beside them.
fn fit<F: Evaluate>(
    source: &Source<F>,
    classes: usize,
    rule: Rule,
    taken: Option<&Taken>,
) -> Option<Vec<Modelled>> {
    let mut all = vec![Products::new(rule.highest); classes];
    let of = |s: usize, blocks: &[Block]| {
        let taken = taken.map(|taken| taken.all.of(&taken.parts[s]));
        let one = |block: &Block| {
            let mut products = Products::new(rule.highest);
            match &taken {
                None => products.take(&block.e),
                Some(taken) => products.take_all(&taken.series(&block.e, &block.g)),
            }
            (Sigma::class(source.layout, s, block), products)
        };
        blocks.iter().map(one).collect::<Vec<_>>()
    };
    source.each(of, |_, parts| {
        parts.iter().for_each(|(class, products)| all[*class].add(products))
    })?;
    Some(all.iter().map(|products| burg::fit(products, rule.criterion)).collect())
}

fn empty_masked(e: &[f64], rows: &mut [f64], nd: usize) {
    for (k, e) in e.iter().enumerate() {
        if e.is_nan() {
            rows[k * nd..(k + 1) * nd].fill(0.0);
        }
    }
}

/// Covariance `M^-1 Q M^-1` with `Q = sum G' R^-1 Sigma R^-1 G`, plus the information of the
/// priors.
fn spread<F: Evaluate>(
    source: &Source<F>,
    factor: &Factor,
    held: &[bool],
    sigma: &Sigma,
) -> Option<Arrow> {
    let layout = source.layout;
    let nc = layout.shared;
    let mut q =
        Arrow { shared: nc, cc: vec![0.0; nc * nc], own: Vec::with_capacity(layout.parts.len()) };
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

/// Adds a matrix over a segment's directions (lower triangle) to an arrow whose blocks of earlier
/// segments are complete.
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
    use crate::noise::Ar;

    /// `[segment][block][series][sample]`.
    pub type Series = Vec<Vec<Vec<Vec<f64>>>>;

    /// The covariance under these models of the noise, and the series that stand in for the noise.
    pub fn spread_and_series<F: Evaluate>(
        source: &Source<F>,
        matrix: &Arrow,
        noise: &[Covariance],
        models: &[Ar],
    ) -> Option<(Arrow, Series)> {
        let sigma = Sigma::new(source.layout, noise, models);
        let covariance = spread(source, &matrix.factor().ok()?, &[], &sigma)?;
        let taken = absorbed(source, &sigma, &[])?;
        let mut series = Vec::new();
        let of = |s: usize, blocks: &[Block]| {
            let one = taken.all.of(&taken.parts[s]);
            blocks.iter().map(|b| one.series(&b.e, &b.g)).collect::<Vec<_>>()
        };
        source.each(of, |_, one| series.push(one))?;
        Some((covariance, series))
    }
}
