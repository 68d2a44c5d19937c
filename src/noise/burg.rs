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
        for run in x.split(|v| v.is_nan()).filter(|run| !run.is_empty()) {
            self.count += run.len();
            self.behind.iter_mut().enumerate().for_each(|(p, n)| *n += run.len().saturating_sub(p));
        }
        self.beside(x);
    }

    /// Adds the products of a series that stands beside measured ones: what a fit absorbed of them.
    /// It counts no samples.
    pub fn beside(&mut self, x: &[f64]) {
        for run in x.split(|v| v.is_nan()).filter(|run| !run.is_empty()) {
            self.run(run);
        }
    }

    /// A measured series and all that was absorbed of it.
    pub fn take_all(&mut self, series: &[Vec<f64>]) {
        let mut series = series.iter();
        series.next().iter().for_each(|x| self.take(x));
        series.for_each(|x| self.beside(x));
    }

    fn run(&mut self, x: &[f64]) {
        self.square += x.iter().map(|v| v * v).sum::<f64>();
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
        // R(0, j) by its sum, R(i + 1, j + 1) = R(i, j) + what enters before the first sample -
        // what leaves at the last.
        let triangle = &mut self.sums[begins(m)..];
        for (j, mut r) in with_lags(x, m).into_iter().enumerate() {
            triangle[j * (j + 1) / 2] += r;
            for i in 1..=m - j {
                r += x[m - i] * x[m - i - j] - x[n - i] * x[n - i - j];
                let row = i + j;
                triangle[row * (row + 1) / 2 + i] += r;
            }
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
