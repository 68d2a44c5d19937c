//! White series of several outputs in; sums of their products at some lags, and the predictor that these
//! ask for, out.

use super::partly::Predictor;
use crate::math::dense::{cholesky, cholesky_solve};
use crate::math::products::add_dots;
use std::ops::Range;

/// Sums of products `w_t w_(t-lag)'` of series of several outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Lagged {
    /// Instants at which all of them were measured.
    pub count: usize,
    /// `[lag][outputs][outputs]`, lags up to the highest order.
    pub(super) lags: Vec<Vec<f64>>,
}

impl Lagged {
    pub fn zero(outputs: usize, order: usize) -> Lagged {
        Lagged { count: 0, lags: vec![vec![0.0; outputs * outputs]; order + 1] }
    }

    /// Adds the products of one segment's series `[output][sample]`, all of one length, within runs
    /// of samples at which all were measured. Products are those of the residuals and of what was
    /// absorbed beside them: `count` is told apart.
    pub fn take(&mut self, w: &[&[f64]], runs: &[Range<usize>]) {
        for run in runs {
            let w: Vec<&[f64]> = w.iter().map(|w| &w[run.clone()]).collect();
            let mut late = w.clone();
            for sums in &mut self.lags {
                add_dots(&late, &w, sums);
                late.iter_mut().for_each(|w| *w = w.get(1..).unwrap_or_default());
            }
        }
    }

    pub fn add(&mut self, other: &Lagged) {
        self.count += other.count;
        for (lag, more) in self.lags.iter_mut().zip(&other.lags) {
            lag.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        }
    }
}

/// The best linear predictor of order `q` (multivariate Yule-Walker equations; Brockwell and Davis,
/// section 11.4) and the factor of its innovations' covariance; `None` where that is not definite.
pub(super) fn predictor(lags: &[Vec<f64>], m: usize, q: usize) -> Option<Predictor> {
    let n = q * m;
    // E[w_(t-1-a) w_(t-1-b)'] of the stacked past
    let of = |a: usize, b: usize, i: usize, j: usize| {
        if b >= a { lags[b - a][i * m + j] } else { lags[a - b][j * m + i] }
    };
    let past: Vec<f64> =
        (0..n * n).map(|k| of(k / n / m, k % n / m, k / n % m, k % n % m)).collect();
    let mut b = vec![0.0; m * n];
    if q > 0 {
        let l = cholesky(&past, n).ok()?;
        for i in 0..m {
            let row = &mut b[i * n..(i + 1) * n];
            (0..n).for_each(|k| row[k] = lags[1 + k / m][i * m + k % m]);
            cholesky_solve(&l, n, row);
        }
    }
    let mut left = lags[0].clone();
    for i in 0..m {
        for j in 0..m {
            left[i * m + j] -=
                (0..n).map(|k| b[i * n + k] * lags[1 + k / m][j * m + k % m]).sum::<f64>();
        }
    }
    let l = cholesky(&left, m).ok()?;
    Some(Predictor { b, l })
}
