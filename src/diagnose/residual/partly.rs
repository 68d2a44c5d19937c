//! A joint model and which outputs were measured at each instant in; instants at which some were
//! not, and those behind them, made white, out.
//!
//! At an instant at which only the outputs `S` were measured these are white as
//! `chol(C_SS)^-1 (w_S - mu_S)`, with `mu` the prediction from the past and `C = L L'` the
//! innovations' covariance. The others add nothing; the predictions behind them take their mean
//! under the model, `mu_M + C_MS C_SS^-1 (w_S - mu_S)`, for what they were. That this mean has an
//! error is left out: single filters have taken most of the past already.

use crate::math::dense::{cholesky, cholesky_solve, forward};
use crate::math::products::dot;
use std::ops::Range;

/// The best predictor of some order `q` of `m` outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Predictor {
    /// `[B_1 | ... ]` as `[m][q * m]`.
    pub b: Vec<f64>,
    /// The factor `L` of the innovations' covariance.
    pub l: Vec<f64>,
}

/// The instants that need more than the predictors.
pub struct Partly {
    /// Instant and pattern.
    steps: Vec<(usize, usize)>,
    patterns: Vec<Pattern>,
}

/// Which outputs were measured, at an instant with so many before it.
struct Pattern {
    order: usize,
    present: Vec<usize>,
    absent: Vec<usize>,
    /// Factor of `C_SS`.
    root: Vec<f64>,
    /// `C_MS C_SS^-1`, `[absent][present]`.
    guess: Vec<f64>,
}

impl Partly {
    /// `masked`: per output its samples that were not measured; none where it was not measured at
    /// all. `n`: instants.
    pub fn new(predictors: &[Predictor], masked: &[Option<&[bool]>], n: usize) -> Partly {
        let last = predictors.len() - 1;
        let (mut partly, mut until) = (Partly { steps: Vec::new(), patterns: Vec::new() }, 0);
        for t in 0..n {
            let is_absent = |i: &usize| masked[*i].is_none_or(|masked| masked[t]);
            let any = (0..masked.len()).any(|i| is_absent(&i));
            until = if any { t + last + 1 } else { until };
            if t >= until {
                continue;
            }
            let (absent, present): (Vec<usize>, Vec<usize>) =
                (0..masked.len()).partition(is_absent);
            let order = t.min(last);
            let known =
                partly.patterns.iter().position(|p| p.order == order && p.present == present);
            let pattern = known.unwrap_or_else(|| {
                partly.patterns.push(Pattern::new(&predictors[order].l, order, present, absent));
                partly.patterns.len() - 1
            });
            partly.steps.push((t, pattern));
        }
        partly
    }

    /// Makes these instants of the series `[output][instant]` white, and puts guesses in place of
    /// what was not measured.
    pub fn bridge(&self, predictors: &[Predictor], series: &mut [f64], white: &mut [f64]) {
        let Some(Pattern { present, absent, .. }) = self.patterns.first() else { return };
        let m = present.len() + absent.len();
        let n = series.len() / m;
        for &(t, pattern) in &self.steps {
            let Pattern { order, present, absent, root, guess } = &self.patterns[pattern];
            let (b, width) = (&predictors[*order].b, order * m);
            let foretold: Vec<f64> = (0..m)
                .map(|i| {
                    (0..width).map(|k| b[i * width + k] * series[k % m * n + t - 1 - k / m]).sum()
                })
                .collect();
            let new: Vec<f64> = present.iter().map(|&i| series[i * n + t] - foretold[i]).collect();
            for (&i, guess) in absent
                .iter()
                .zip(guess.chunks(present.len().max(1)).chain(std::iter::repeat(&[][..])))
            {
                series[i * n + t] = foretold[i] + dot(guess, &new);
                white[i * n + t] = 0.0;
            }
            let mut out = new;
            forward(root, present.len(), &mut out);
            present.iter().zip(out).for_each(|(&i, w)| white[i * n + t] = w);
        }
    }
}

impl Pattern {
    fn new(l: &[f64], order: usize, present: Vec<usize>, absent: Vec<usize>) -> Pattern {
        let (m, n) = (present.len() + absent.len(), present.len());
        let c =
            |i: usize, j: usize| (0..=i.min(j)).map(|k| l[i * m + k] * l[j * m + k]).sum::<f64>();
        let own: Vec<f64> =
            present.iter().flat_map(|&i| present.iter().map(move |&j| c(i, j))).collect();
        // Every block of a positive definite matrix is; where rounding says no, outputs count one
        // by one.
        let alone =
            || (0..n * n).map(|k| if k / n == k % n { own[k].sqrt() } else { 0.0 }).collect();
        let root = cholesky(&own, n).unwrap_or_else(|_| alone());
        let mut guess = Vec::with_capacity(absent.len() * n);
        for &i in &absent {
            let mut row: Vec<f64> = present.iter().map(|&j| c(i, j)).collect();
            cholesky_solve(&root, n, &mut row);
            guess.extend(row);
        }
        Pattern { order, present, absent, root, guess }
    }
}

/// Where these follow each other.
pub fn runs(there: &[bool]) -> Vec<Range<usize>> {
    let (mut runs, mut from) = (Vec::new(), 0);
    for run in there.split(|there| !there) {
        runs.push(from..from + run.len());
        from += run.len() + 1;
    }
    runs.retain(|run| !run.is_empty());
    runs
}
