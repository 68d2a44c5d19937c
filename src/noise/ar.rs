//! An autoregressive model in; its autocovariance, its level at frequency zero and the predictors
//! of every order out.
//!
//! The model is `r[i] = a_1 r[i-1] + ... + a_p r[i-p] + e[i]`, with white `e`. It is kept as
//! partial autocorrelations `k_1 ... k_p` (reflection coefficients): it is stationary exactly where
//! all of them are within -1 and 1, however near, and all else follows by products: with
//! `A_p(z) = A_(p-1)(z) - k_p z^-p A_(p-1)(1/z)` (Levinson; Kay, Modern Spectral Estimation, 6.4)
//! `A_p(1) = prod (1 - k)`, and the variance of the process is that of `e` over `prod (1 - k^2)`.

/// An autoregressive model.
#[derive(Debug, Clone, PartialEq)]
pub struct Ar {
    /// Partial autocorrelations, each within -1 and 1; empty for white noise.
    pub partial: Vec<f64>,
    /// Variance of the driving white noise.
    pub variance: f64,
}

impl Ar {
    /// Share of the variance that the past foretells.
    pub fn foretold(&self) -> f64 {
        1.0 - self.partial.iter().map(|k| 1.0 - k * k).product::<f64>()
    }

    /// White noise.
    pub fn white(variance: f64) -> Ar {
        Ar { partial: Vec::new(), variance }
    }

    /// With coefficients `a_1 ... a_p`; `None` where the process is not stationary.
    #[cfg(test)]
    pub fn with_coefficients(coefficients: &[f64], variance: f64) -> Option<Ar> {
        let mut partial = vec![];
        let mut a = coefficients.to_vec();
        while let Some(k) = a.pop() {
            if !(k.abs() < 1.0) {
                return None;
            }
            partial.push(k);
            let lower: Vec<f64> =
                a.iter().zip(a.iter().rev()).map(|(x, y)| (x + k * y) / (1.0 - k * k)).collect();
            a = lower;
        }
        partial.reverse();
        Some(Ar { partial, variance })
    }

    /// The order p.
    pub fn order(&self) -> usize {
        self.partial.len()
    }

    /// Coefficients of the best predictor of each order `0..=p`.
    pub fn predictors(&self) -> Vec<Vec<f64>> {
        let mut all: Vec<Vec<f64>> = vec![vec![]];
        for k in &self.partial {
            all.push(step_up(&all[all.len() - 1], *k));
        }
        all
    }

    /// Variance of the error of each of these predictors; the first is that of the process itself.
    pub fn errors(&self) -> Vec<f64> {
        let mut all = vec![self.variance];
        for k in self.partial.iter().rev() {
            all.push(all[all.len() - 1] / (1.0 - k * k));
        }
        all.reverse();
        all
    }

    /// Power at frequency zero, per sample: the variance of the mean of `n` samples is this over
    /// `n`, for many of them.
    pub fn level(&self) -> f64 {
        self.partial.iter().fold(self.variance, |level, k| level / ((1.0 - k) * (1.0 - k)))
    }

    /// That level over the variance of the process: by how much the variance of a mean is larger
    /// than if the noise were white.
    pub fn colour(&self) -> f64 {
        self.partial.iter().fold(1.0, |colour, k| colour * (1.0 + k) / (1.0 - k))
    }

    /// The exact autocovariance of the process at lags `0..=lags`, from the Yule-Walker equations.
    #[cfg(test)]
    pub fn autocovariance(&self, lags: usize) -> Vec<f64> {
        let (predictors, errors) = (self.predictors(), self.errors());
        let last = self.order();
        let mut c = vec![errors[0]];
        for lag in 1..=lags {
            let lower = &predictors[(lag - 1).min(last)];
            let foretold: f64 = lower.iter().zip(c.iter().rev()).map(|(a, c)| a * c).sum();
            c.push(foretold + self.partial.get(lag - 1).map_or(0.0, |k| k * errors[lag - 1]));
        }
        c
    }
}

/// The predictor of order p from that of order p-1 and the partial autocorrelation.
pub fn step_up(a: &[f64], k: f64) -> Vec<f64> {
    a.iter().zip(a.iter().rev()).map(|(x, y)| x - k * y).chain([k]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn autocovariance_of_first_order_is_the_closed_form() {
        let model = Ar { partial: vec![0.9], variance: 2.0 };
        for (k, c) in model.autocovariance(30).iter().enumerate() {
            assert!((c - 2.0 * f64::powi(0.9, k as i32) / (1.0 - 0.81)).abs() < 1e-12);
        }
        assert!((model.level() - 200.0).abs() < 1e-9 && (model.colour() - 19.0).abs() < 1e-9);
    }

    #[test]
    fn autocovariance_solves_the_yule_walker_equations() {
        let a = [0.7, -0.4, 0.3, 0.1];
        let model = Ar::with_coefficients(&a, 1.7).expect("stationary");
        let c = model.autocovariance(12);
        for k in 0..=12usize {
            let sum: f64 = a.iter().enumerate().map(|(j, a)| a * c[k.abs_diff(j + 1)]).sum();
            let wanted = sum + if k == 0 { model.variance } else { 0.0 };
            assert!((c[k] - wanted).abs() < 1e-12, "lag {k}");
        }
        let back = model.predictors().pop().expect("an order");
        assert!(back.iter().zip(a).all(|(x, y)| (x - y).abs() < 1e-12), "{back:?}");
        // The level is the sum of the autocovariance over all lags.
        let c = model.autocovariance(400);
        let sum = c[0] + 2.0 * c[1..].iter().sum::<f64>();
        assert!(
            (model.level() / sum - 1.0).abs() < 1e-9
                && (model.colour() / (sum / c[0]) - 1.0).abs() < 1e-9
        );
    }

    #[test]
    fn white_noise_and_what_is_not_stationary() {
        assert_eq!(Ar::white(3.0).autocovariance(2), [3.0, 0.0, 0.0]);
        assert_eq!((Ar::white(3.0).level(), Ar::white(3.0).colour()), (3.0, 1.0));
        assert_eq!(Ar::with_coefficients(&[1.1], 1.0), None);
    }
}
