//! An autoregressive model in; products with its covariance matrix, in time linear in the number of samples, out.

use crate::math::ar::{self, Ar};

/// The factors `Sigma = A^-1 D A^-T` of an autoregressive process that starts stationary: row `i` of `A` is the predictor of the
/// order `min(i, p)`, `D` holds the prediction variances.
pub struct Filter {
    /// `predictors[q]`: coefficients of the predictor of order q, `0..=p`.
    predictors: Vec<Vec<f64>>,
    /// Prediction variance of each order.
    variances: Vec<f64>,
}

/// The filters of all noise classes; `None` when a model is not stationary.
pub fn filters(models: &[Ar]) -> Option<Vec<Filter>> {
    models.iter().map(Filter::new).collect()
}

impl Filter {
    /// `None` when the model is not stationary.
    pub fn new(model: &Ar) -> Option<Filter> {
        let mut predictors = vec![Vec::new()];
        predictors.extend(ar::step_down(&model.coefficients)?);
        let mut variances = vec![model.variance];
        for a in predictors.iter().skip(1).rev() {
            let last = a.last().copied().unwrap_or(0.0);
            let above = variances[variances.len() - 1];
            variances.push(above / (1.0 - last * last));
        }
        variances.reverse();
        Some(Filter { predictors, variances })
    }

    fn order(&self, i: usize) -> usize {
        i.min(self.predictors.len() - 1)
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

    /// `A^-1 v` in place for rows `[sample][nd]`.
    pub fn forward(&self, v: &mut [f64], nd: usize) {
        let n = v.len().checked_div(nd).unwrap_or(0);
        for i in 0..n {
            let (before, at) = v.split_at_mut(i * nd);
            for (j, a) in self.predictors[self.order(i)].iter().enumerate() {
                let from = &before[(i - 1 - j) * nd..(i - j) * nd];
                at[..nd].iter_mut().zip(from).for_each(|(at, from)| *at += a * from);
            }
        }
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
