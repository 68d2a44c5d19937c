//! An autoregressive model in; series made white, and products with its covariance matrix, in time linear in the number of samples, out.
//!
//! `Sigma = A^-1 D A^-T` of a process that starts stationary: row `i` of `A` is the predictor of the order `min(i, p)`, so that the first
//! samples of a series count as what they are, and `D` holds the variances of the predictions' errors. `D^-1/2 A r` is white, of unit variance.

use super::ar::Ar;

/// The predictors of a process, of every order.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    /// `predictors[q]`: coefficients of the predictor of order q, `0..=p`.
    predictors: Vec<Vec<f64>>,
    /// Variance of the error of each.
    variances: Vec<f64>,
}

impl Filter {
    pub fn new(model: &Ar) -> Filter {
        Filter { predictors: model.predictors(), variances: model.errors() }
    }

    /// Whether there is noise to divide by.
    pub fn is_definite(&self) -> bool {
        self.variances.iter().all(|v| *v > 0.0 && v.is_finite())
    }

    fn order(&self, i: usize) -> usize {
        i.min(self.predictors.len() - 1)
    }

    /// A series made white, `D^-1/2 A x`; `masked[i]` tells which samples were not measured: one counts as its own prediction, so that it adds nothing,
    /// and those after it go on.
    pub fn whiten(&self, x: &mut Vec<f64>, masked: &[bool]) {
        let last = self.predictors.len() - 1;
        let innovation = |x: &[f64], i: usize| {
            let a = &self.predictors[i.min(last)];
            x[i] - a.iter().zip(x[..i].iter().rev()).map(|(a, x)| a * x).sum::<f64>()
        };
        // Masked samples first take the value of their prediction.
        for i in (0..x.len()).filter(|&i| masked.get(i).copied().unwrap_or(false)) {
            x[i] = 0.0;
            x[i] = -innovation(x, i);
        }
        let n = x.len();
        let mut white: Vec<f64> = (0..last.min(n)).map(|i| innovation(x, i) / self.variances[i].sqrt()).collect();
        // From order p on the predictor stays the same: lag by lag over the whole series.
        white.extend_from_slice(&x[last.min(n)..]);
        for (j, a) in self.predictors[last].iter().enumerate().filter(|_| n > last) {
            white[last..].iter_mut().zip(&x[last - 1 - j..]).for_each(|(w, x)| *w -= a * x);
        }
        let scale = 1.0 / self.variances[last].sqrt();
        white.iter_mut().skip(last).for_each(|w| *w *= scale);
        *x = white;
    }

    /// `A^-T g` for rows `[sample][nd]`.
    pub fn backward(&self, g: &[f64], nd: usize) -> Vec<f64> {
        let mut v = g.to_vec();
        let n = g.len().checked_div(nd).unwrap_or(0);
        for i in (0..n).rev() {
            // Sample i predicts nothing any more: hand its value to the samples it is predicted from.
            let (before, at) = v.split_at_mut(i * nd);
            for (j, a) in self.predictors[self.order(i)].iter().enumerate() {
                let to = &mut before[(i - 1 - j) * nd..(i - j) * nd];
                to.iter_mut().zip(&at[..nd]).for_each(|(to, v)| *to += a * v);
            }
        }
        v
    }

    /// Variance of the innovation of sample `i`: element `i` of `D`.
    pub fn variance(&self, i: usize) -> f64 {
        self.variances[self.order(i)]
    }

    /// Sum of products of the responses of two processes to an impulse, `sum_k psi(k) phi(k)`, over that of each with itself:
    /// 1 for processes of the same colour.
    pub fn likeness(&self, other: &Filter) -> f64 {
        let (a, b) = (self.impulse(), other.impulse());
        let sum = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
        sum(&a, &b) / (sum(&a, &a) * sum(&b, &b)).sqrt()
    }

    /// The stationary process's response to an impulse, until nothing is left of it.
    fn impulse(&self) -> Vec<f64> {
        let last = self.predictors.last().map(Vec::as_slice).unwrap_or_default();
        let mut psi = vec![1.0];
        let left = |psi: &[f64]| psi.iter().rev().take(last.len()).any(|v: &f64| v.abs() > LEFT);
        while psi.len() < LONGEST && left(&psi) {
            psi.push(last.iter().zip(psi.iter().rev()).map(|(a, v)| a * v).sum());
        }
        psi
    }
}

/// When an impulse is forgotten, and the number of samples after which it is given up.
const LEFT: f64 = 1e-9;
const LONGEST: usize = 1 << 14;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::dense::{cholesky, forward};

    #[test]
    fn whitening_is_the_inverse_of_the_covariances_factor() {
        let model = Ar::with_coefficients(&[1.2, -0.6, 0.2], 0.7).expect("stationary");
        let n = 12;
        let c = model.autocovariance(n);
        let sigma: Vec<f64> = (0..n * n).map(|k| c[(k / n).abs_diff(k % n)]).collect();
        let x: Vec<f64> = (0..n).map(|k| libm::sin(1.7 * k as f64)).collect();
        let (mut mine, mut want) = (x.clone(), x);
        Filter::new(&model).whiten(&mut mine, &[false; 12]);
        forward(&cholesky(&sigma, n).expect("definite"), n, &mut want);
        assert!(mine.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-9), "{mine:?} {want:?}");
    }

    #[test]
    fn a_masked_sample_says_nothing() {
        let filter = Filter::new(&Ar { partial: vec![0.8], variance: 1.0 });
        let (mut a, mut b) = (vec![1.0, 2.0, f64::NAN, 4.0, 5.0], vec![1.0, 2.0, 1e9, 4.0, 5.0]);
        let masked = [false, false, true, false, false];
        filter.whiten(&mut a, &masked);
        filter.whiten(&mut b, &masked);
        assert_eq!((&a, a[2]), (&b, 0.0));
        assert!((a[3] - (4.0 - 0.8 * 0.8 * 2.0)).abs() < 1e-12 && (a[4] - (5.0 - 0.8 * 4.0)).abs() < 1e-12);
    }
}
