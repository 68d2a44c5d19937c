//! Series of residuals in; the autoregressive model of the noise behind them, by Burg's recursion,
//! out.
//!
//! Burg's recursion chooses each partial autocorrelation `k_p` so that the forward and backward
//! prediction errors together are least,
//!
//! `k_p = 2 sum f_t b_(t-1) / sum (f_t^2 + b_(t-1)^2)`, `f' = f - k b`, `b' = b - k f` (Burg 1975;
//! Kay, Modern Spectral Estimation, 7.5.3),
//!
//! the sums taken over all series, each with errors of its own that never reach over its ends.
//! `|k_p| <= 1` by construction, so the model is stationary whatever the data; and it does not take
//! slow noise for faster than it is, as lagged products over the number of samples do.
//!
//! The errors need not be kept: with the coefficients `alpha` of the forward error (`alpha_0 = 1`)
//! and `beta` the same backwards, all sums are quadratic forms of
//! `R_p(i, j) = sum_t x_(t-i) x_(t-j)`, `t >= p` (Vos, A fast implementation of Burg's method,
//! 2013). So a series is reduced to its products once, products of many series are added, and the
//! recursion runs over the sums alone.
//!
//! A masked sample (NaN) ends a series, and the next valid one begins another.

use super::ar::{Ar, step_up};
use crate::math::distribution::chi2_cdf;
use crate::math::products::with_lags;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What is so unlikely in white noise is not modelled as white.
const NOT_WHITE: f64 = 1.0 - 1e-4;
/// A prediction error below this share of the series' own power is rounding: the recursion ends
/// there.
const ROUNDING: f64 = 1e-12;

/// Products of series, enough for models up to an order.
#[derive(Debug, Clone, PartialEq)]
pub struct Products {
    order: usize,
    /// Residuals that were measured.
    pub count: usize,
    /// How many of them have so many (`0..=order`) before them in their run: what a partial
    /// autocorrelation is found from.
    behind: Vec<usize>,
    /// Sum of their squares, and of what was absorbed of them.
    square: f64,
    /// For `t = 0..order` the products `x_(t-i) x_(t-j)`, `j <= i <= t`, of the sample `t` of each
    /// run, and last those of all `t >= order`: lower triangles, one behind the other.
    sums: Vec<f64>,
}

/// Where the triangle of sample `t` begins.
fn begins(t: usize) -> usize {
    t * (t + 1) * (t + 2) / 6
}

/// The stretches of a series without masked samples.
fn runs(x: &[f64]) -> impl Iterator<Item = &[f64]> {
    x.split(|v| v.is_nan()).filter(|run| !run.is_empty())
}

/// Sums of squares, each number by number; four go side by side, as each number waits for the sum before it.
fn squares(runs: &[&[f64]]) -> Vec<f64> {
    let mut sums = vec![0.0; runs.len()];
    for (runs, sums) in runs.chunks_exact(4).zip(sums.chunks_exact_mut(4)) {
        let n = runs.iter().map(|run| run.len()).min().unwrap_or(0);
        let [a, b, c, d] = std::array::from_fn(|k| runs[k][..n].iter());
        let mut now = [0.0; 4];
        for (((a, b), c), d) in a.zip(b).zip(c).zip(d) {
            now = [now[0] + a * a, now[1] + b * b, now[2] + c * c, now[3] + d * d];
        }
        sums.copy_from_slice(&now);
        let rest = runs.iter().map(|run| &run[n..]);
        sums.iter_mut().zip(rest).for_each(|(sum, rest)| rest.iter().for_each(|v| *sum += v * v));
    }
    let rest = runs.len() - runs.len() % 4;
    let one = |run: &&[f64]| run.iter().map(|v| v * v).sum();
    sums[rest..].iter_mut().zip(&runs[rest..]).for_each(|(sum, run)| *sum = one(run));
    sums
}

impl Products {
    pub fn new(order: usize) -> Products {
        Products {
            order,
            count: 0,
            behind: vec![0; order + 1],
            square: 0.0,
            sums: vec![0.0; begins(order + 1)],
        }
    }

    /// Counts the samples of a measured series and adds its products.
    pub fn take(&mut self, x: &[f64]) {
        self.take_all(&[x]);
    }

    /// The same of a measured series, and the products of all that a fit absorbed of it, which stand beside it
    /// and count no samples.
    pub fn take_all<S: AsRef<[f64]>>(&mut self, series: &[S]) {
        for run in series.iter().take(1).flat_map(|x| runs(x.as_ref())) {
            self.count += run.len();
            self.behind.iter_mut().enumerate().for_each(|(p, n)| *n += run.len().saturating_sub(p));
        }
        let all: Vec<&[f64]> = series.iter().flat_map(|x| runs(x.as_ref())).collect();
        squares(&all).iter().for_each(|square| self.square += square);
        all.iter().for_each(|run| self.run(run));
    }

    fn run(&mut self, x: &[f64]) {
        // The first samples backwards, so that products of one with those before it stand in a row.
        let back: Vec<f64> = x[..self.order.min(x.len())].iter().rev().copied().collect();
        for t in 0..back.len() {
            let (triangle, past) =
                (&mut self.sums[begins(t)..begins(t + 1)], &back[back.len() - 1 - t..]);
            let mut at = 0;
            for i in 0..=t {
                let row = &mut triangle[at..=at + i];
                row.iter_mut().zip(past).for_each(|(sum, x)| *sum += past[i] * x);
                at += i + 1;
            }
        }
        let (m, n) = (self.order, x.len());
        if n <= m {
            return;
        }
        let last: Vec<f64> = x[n - m..].iter().rev().copied().collect();
        self.rest(&back, &last, &with_lags(x, m));
    }

    /// Products of the samples from the order on, row by row: R(0, j) by its sum, `lags[j]`, R(i + 1, j + 1) =
    /// R(i, j) + what enters before the first of them - what leaves at the last. `first` samples of the run, as
    /// many as the order, and its `last` ones, both backwards.
    fn rest(&mut self, first: &[f64], last: &[f64], lags: &[f64]) {
        let triangle = &mut self.sums[begins(self.order)..];
        let (mut above, mut r) = (vec![0.0; lags.len()], vec![0.0; lags.len()]);
        let mut at = 0;
        for (j, lag) in lags.iter().enumerate() {
            r[0] = *lag;
            if let Some(k) = j.checked_sub(1) {
                let (enters, leaves) = (first[k], last[k]);
                let products = first.iter().zip(last).map(|(a, b)| a * enters - b * leaves);
                let next = r[1..=j].iter_mut().zip(&above).zip(products);
                next.for_each(|((r, above), more)| *r = above + more);
            }
            triangle[at..=at + j].iter_mut().zip(&r).for_each(|(sum, r)| *sum += r);
            at += j + 1;
            std::mem::swap(&mut above, &mut r);
        }
    }

    pub fn add(&mut self, other: &Products) {
        self.count += other.count;
        self.behind.iter_mut().zip(&other.behind).for_each(|(a, b)| *a += b);
        self.square += other.square;
        self.sums.iter_mut().zip(&other.sums).for_each(|(a, b)| *a += b);
    }

    /// Mean square.
    pub fn variance(&self) -> f64 {
        self.square / self.count.max(1) as f64
    }

    /// `R_0`: the products of all samples that have so many before them in their run.
    fn from_the_first(&self) -> Vec<f64> {
        let mut r = vec![0.0; (self.order + 1) * (self.order + 2) / 2];
        for t in 0..=self.order {
            r.iter_mut().zip(&self.sums[begins(t)..begins(t + 1)]).for_each(|(r, s)| *r += s);
        }
        r
    }
}

/// How the order of the residuals' autoregressive model is chosen. Slow noise of a small part of
/// the white noise's size widens intervals a lot and is easily missed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum OrderCriterion {
    /// The order of `bic`, raised until the residuals it leaves pass as white: the sum of squares
    /// of the partial autocorrelations of all higher orders is below its median for white noise.
    /// Covers 94 to 95%.
    White,
    /// Least `N ln(variance) + 2 p`. Covers 93 to 94%.
    Aic,
    /// Least `N ln(variance) + p ln N`. Covers 83 to 87%.
    Bic,
}

/// A model, and whether it could have been longer.
#[derive(Debug, Clone, PartialEq)]
pub struct Modelled {
    pub model: Ar,
    /// Probability of less in white noise, by the tests of Monti and of Ljung and Box: near one where
    /// the series are demonstrably not white.
    pub coloured: f64,
    /// The recursion ended at this order, below the highest asked for, and the criterion wanted no
    /// less: what is left is rounding, or no series is longer.
    pub cut: Option<usize>,
}

impl Modelled {
    /// What a cut order means.
    pub fn cut_words(order: usize) -> String {
        format!(
            "its noise is modelled to order {order} and no further: what is left is rounding, or no stretch without masked samples is longer"
        )
    }
}

/// Partial autocorrelations of the orders from 1 up.
pub(super) fn partial(products: &Products) -> Vec<f64> {
    let m = products.order;
    let mut partial = Vec::new();
    // `r` is R_p, `p` ascending: what is summed from the first sample on is taken off sample by
    // sample.
    let mut r = products.from_the_first();
    let mut predictor: Vec<f64> = Vec::new();
    // An order of more than half a run's length is found from its ends alone (Ulrych & Bishop, Rev.
    // Geophys. 13, 1975).
    for p in (1..=m).take_while(|p| 2 * products.behind[*p] >= products.count) {
        r.iter_mut().zip(&products.sums[begins(p - 1)..begins(p)]).for_each(|(r, s)| *r -= s);
        let at = |i: usize, j: usize| r[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)];
        let alpha: Vec<f64> = std::iter::once(1.0).chain(predictor.iter().map(|a| -a)).collect();
        let (mut cross, mut power) = (0.0, 0.0);
        for i in 0..p {
            for j in 0..p {
                let product = alpha[i] * alpha[j];
                cross += product * at(i, p - j);
                power += product * (at(i, j) + at(p - i, p - j));
            }
        }
        let k = 2.0 * cross / power;
        if !(power > ROUNDING * (at(0, 0) + at(p, p)) && k.abs() < 1.0) {
            break;
        }
        predictor = step_up(&predictor, k);
        partial.push(k);
    }
    partial
}

/// Probability of a smaller sum of squares of the autocorrelations up to a lag in white noise, each
/// over its variance there (Ljung & Box, Biometrika 65, 1978).
fn coloured(products: &Products, lags: usize) -> f64 {
    let r = products.from_the_first();
    let term =
        |p: usize| (r[p * (p + 1) / 2] / products.variance()).powi(2) / products.behind[p] as f64;
    let q: f64 = (1..=lags).map(term).sum();
    if lags == 0 { 0.0 } else { chi2_cdf(q, lags as f64) }
}

/// The model of these series' noise; white noise of variance 0 where there is nothing.
pub fn fit(products: &Products, criterion: OrderCriterion) -> Modelled {
    let c0 = products.variance();
    if !(c0 > 0.0 && c0.is_finite()) {
        return Modelled { model: Ar::white(0.0), coloured: 0.0, cut: None };
    }
    let partial = partial(products);
    // Each is found from so many samples, and has a variance of one over that in white noise.
    let weight = |p: usize| products.behind.get(p).map_or(0.0, |n| *n as f64);
    // n ln(variance) of every order, but for a constant.
    let mut costs = vec![0.0];
    for (p, k) in (1..).zip(&partial) {
        costs.push(costs[p - 1] + weight(p) * libm::log1p(-k * k));
    }
    // Portmanteau test of what an order leaves (Monti): probability of less in white noise.
    let unlikely = |p: usize| {
        let rest = &partial[p..];
        let q: f64 = (p + 1..).zip(rest).map(|(p, k)| weight(p) * k * k).sum();
        if rest.is_empty() { 0.0 } else { chi2_cdf(q, rest.len() as f64) }
    };
    // Many small correlations that no single order is worth are not white noise either, nor are
    // those of one sign that weak slow noise leaves: its partial autocorrelations die out sooner.
    let coloured = unlikely(0).max(coloured(products, partial.len()));
    let first = usize::from(coloured > NOT_WHITE);
    let least = |penalty: f64| {
        let cost = |p: usize| costs[p] + p as f64 * penalty;
        (first..costs.len()).fold(first, |best, p| if cost(p) < cost(best) { p } else { best })
    };
    let order = match criterion {
        OrderCriterion::Aic => least(2.0),
        OrderCriterion::Bic => least(libm::log(products.count as f64)),
        OrderCriterion::White => (least(libm::log(products.count as f64))..=partial.len())
            .find(|&p| unlikely(p) < 0.5)
            .unwrap_or(partial.len()),
    };
    let cut = (order == partial.len() && order < products.order).then_some(order);
    let variance = partial[..order].iter().fold(c0, |variance, k| variance * (1.0 - k * k));
    Modelled { model: Ar { partial: partial[..order].to_vec(), variance }, coloured, cut }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_side_by_side_are_those_of_one_after_the_other() {
        let of = |k: usize| -> Vec<f64> {
            (0..40 + 7 * (k % 5)).map(|i| libm::sin(0.7 * (i + 3 * k) as f64)).collect()
        };
        let all: Vec<Vec<f64>> = (0..11).map(of).collect();
        for n in 0..=all.len() {
            let some: Vec<&[f64]> = all[..n].iter().map(Vec::as_slice).collect();
            let want: Vec<f64> = some.iter().map(|x| x.iter().map(|v| v * v).sum()).collect();
            assert_eq!(squares(&some), want);
        }
    }

    #[test]
    fn products_are_those_of_every_pair_of_samples() {
        let x: Vec<f64> = (0..60).map(|k| libm::sin(1.3 * k as f64) + 0.01 * k as f64).collect();
        for order in [1, 2, 7, 24] {
            let mut products = Products::new(order);
            products.take(&x);
            let last = &products.sums[begins(order)..];
            for i in 0..=order {
                for j in 0..=i {
                    let want: f64 = (order..x.len()).map(|t| x[t - i] * x[t - j]).sum();
                    assert!((last[i * (i + 1) / 2 + j] - want).abs() < 1e-12, "{order} {i} {j}");
                }
            }
        }
    }
}
