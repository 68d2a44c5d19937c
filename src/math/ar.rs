//! A sampled autocovariance in, an autoregressive model of the noise behind it out, and back.
//!
//! The model is `r[i] = a_1 r[i-1] + ... + a_p r[i-p] + e[i]`, with white `e` of variance `variance`.

use super::distribution::chi2_cdf;

/// An autoregressive model.
#[derive(Debug, Clone, PartialEq)]
pub struct Ar {
    /// `a_1 ... a_p`; empty for white noise.
    pub coefficients: Vec<f64>,
    /// Variance of the driving white noise.
    pub variance: f64,
    /// The order p.
    pub order: usize,
}

/// The autocovariance at lags `0..=lags` of samples of zero mean (subtract the mean first where there is one).
///
/// NaN marks a masked sample: pairs with one are left out. The divisor is the number of valid samples at every lag (never the number
/// of pairs), so the sequence is positive semidefinite. All zeros when no sample is valid.
pub fn sample_autocovariance(r: &[f64], lags: usize) -> Vec<f64> {
    let valid = r.iter().filter(|v| !v.is_nan()).count();
    (0..=lags)
        .map(|lag| {
            let products = r.iter().zip(r.iter().skip(lag)).map(|(a, b)| a * b).filter(|v| !v.is_nan());
            if valid == 0 { 0.0 } else { products.sum::<f64>() / valid as f64 }
        })
        .collect()
}

/// The model of the order `0..=max_order` with the least BIC, `n ln(variance) + p ln n`, where `autocovariance` (lag 0 first) comes
/// from `n` samples; the highest order is also limited by the lags given and by `n - 2`.
///
/// A recursion that ceases to be stationary (an autocovariance that is not positive semidefinite) ends the search at the order
/// reached. A lag 0 that is not positive gives order 0 with that variance.
pub fn fit(autocovariance: &[f64], n: usize, max_order: usize) -> Ar {
    fit_by(autocovariance, n, max_order, Order::Penalty(libm::log(n as f64)))
}

/// How the order is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// Least `n ln(variance) + p penalty`: `ln n` is BIC, 2 is AIC.
    Penalty(f64),
    /// The order of BIC, raised until what is left looks white: the partial autocorrelations `phi_k` of all higher orders, of variance
    /// `1/n` each in white noise, have a sum of squares below its median (the portmanteau test of Monti, Biometrika 81, 1994,
    /// without its small-sample factor: `n sum phi_k^2` against chi-square).
    White,
}

/// As `fit`, with the order chosen by `order`.
pub fn fit_by(autocovariance: &[f64], n: usize, max_order: usize, order: Order) -> Ar {
    let Some(&c0) = autocovariance.first() else { return Ar { coefficients: vec![], variance: 0.0, order: 0 } };
    let mut all = vec![Ar { coefficients: vec![], variance: c0, order: 0 }];
    if !(c0 > 0.0 && c0.is_finite()) {
        return all.remove(0);
    }
    let mut a: Vec<f64> = vec![];
    let mut variance = c0;
    let mut reflections = vec![];
    // Levinson-Durbin recursion (Brockwell & Davis, Proposition 5.2.1)
    for p in 1..=max_order.min(autocovariance.len() - 1).min(n.saturating_sub(2)) {
        let predicted: f64 = a.iter().enumerate().map(|(j, aj)| aj * autocovariance[p - 1 - j]).sum();
        let reflection = (autocovariance[p] - predicted) / variance;
        if !(reflection.abs() < 1.0) {
            break;
        }
        reflections.push(reflection);
        a = step_up(&a, reflection);
        variance *= 1.0 - reflection * reflection;
        all.push(Ar { coefficients: a.clone(), variance, order: p });
    }
    let least = |criterion: &dyn Fn(&Ar) -> f64| {
        (0..all.len()).fold(0, |best, p| if criterion(&all[p]) < criterion(&all[best]) { p } else { best })
    };
    let nf = n as f64;
    let best = match order {
        Order::Penalty(penalty) => least(&|m| nf * libm::log(m.variance) + m.order as f64 * penalty),
        Order::White => {
            let bic = least(&|m| nf * libm::log(m.variance) + m.order as f64 * libm::log(nf));
            let passes = |p: usize| {
                let rest = reflections.get(p..).unwrap_or_default();
                let q: f64 = nf * rest.iter().map(|r| r * r).sum::<f64>();
                rest.is_empty() || chi2_cdf(q, rest.len() as f64) < 0.5
            };
            (bic..all.len()).find(|&p| passes(p)).unwrap_or(all.len() - 1)
        }
    };
    all.swap_remove(best)
}

/// The exact autocovariance of the process at lags `0..=lags`, from the Yule-Walker equations.
///
/// All NaN when the model is not stationary (it then has none).
pub fn autocovariance(model: &Ar, lags: usize) -> Vec<f64> {
    let Some(orders) = step_down(&model.coefficients) else { return vec![f64::NAN; lags + 1] };
    // Every lower-order predictor follows from the highest; the prediction variance rises from the driving noise to lag 0.
    let c0 = orders.iter().fold(model.variance, |v, a| v / (1.0 - square(a.last().copied().unwrap_or(0.0))));
    let mut c = vec![c0];
    let mut variance = c0;
    for k in 1..=lags {
        let lower: &[f64] = if k > orders.len() { &model.coefficients } else { orders.get(k.wrapping_sub(2)).map_or(&[], |a| a) };
        let mut next: f64 = lower.iter().enumerate().map(|(j, aj)| aj * c[k - 1 - j]).sum();
        if let Some(reflection) = orders.get(k - 1).and_then(|a| a.last()) {
            next += reflection * variance;
            variance *= 1.0 - square(*reflection);
        }
        c.push(next);
    }
    c
}

fn square(x: f64) -> f64 {
    x * x
}

/// The predictor of order p from that of order p-1 and the reflection coefficient.
fn step_up(a: &[f64], reflection: f64) -> Vec<f64> {
    let mut next: Vec<f64> = a.iter().zip(a.iter().rev()).map(|(x, y)| x - reflection * y).collect();
    next.push(reflection);
    next
}

/// The predictors of order 1..=p that belong to one of order p; `None` when it is not stationary.
pub fn step_down(coefficients: &[f64]) -> Option<Vec<Vec<f64>>> {
    let mut orders = vec![];
    let mut a = coefficients.to_vec();
    while let Some(&reflection) = a.last() {
        if !(reflection.abs() < 1.0) {
            return None;
        }
        let m = a.len() - 1;
        let lower = (0..m).map(|j| (a[j] + reflection * a[m - 1 - j]) / (1.0 - reflection * reflection)).collect();
        orders.push(std::mem::replace(&mut a, lower));
    }
    orders.reverse();
    Some(orders)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn simulate(coefficients: &[f64], n: usize, seed: u64) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        let mut r: Vec<f64> = vec![];
        for i in 0..n + 500 {
            let e: f64 = StandardNormal.sample(&mut rng);
            r.push(e + coefficients.iter().enumerate().filter(|(j, _)| *j < i).map(|(j, a)| a * r[i - 1 - j]).sum::<f64>());
        }
        r.split_off(500)
    }

    #[test]
    fn first_order_is_recovered() {
        let r = simulate(&[0.9], 20_000, 1);
        let model = fit(&sample_autocovariance(&r, 20), r.len(), 20);
        assert_eq!(model.order, 1);
        assert!((model.coefficients[0] - 0.9).abs() < 0.01, "{model:?}");
        assert!((model.variance - 1.0).abs() < 0.03);
    }

    #[test]
    fn second_order_is_recovered_and_white_stays_white() {
        let r = simulate(&[1.2, -0.6], 20_000, 2);
        let model = fit(&sample_autocovariance(&r, 20), r.len(), 20);
        assert_eq!(model.order, 2);
        assert!((model.coefficients[0] - 1.2).abs() < 0.02 && (model.coefficients[1] + 0.6).abs() < 0.02);
        assert_eq!(fit(&sample_autocovariance(&simulate(&[], 5_000, 3), 20), 5_000, 20).order, 0);
    }

    #[test]
    fn the_order_is_raised_until_the_rest_is_white() {
        // A third of slow noise under white noise: BIC stops early, and the level at frequency zero is far too low.
        let (white, slow) = (simulate(&[], 1_000, 5), simulate(&[0.97], 1_000, 6));
        let r: Vec<f64> = white.iter().zip(&slow).map(|(w, s)| w + s * 0.081).collect();
        let c = sample_autocovariance(&r, 24);
        let level = |m: &Ar| m.variance / square(1.0 - m.coefficients.iter().sum::<f64>());
        let (bic, raised) = (fit(&c, r.len(), 24), fit_by(&c, r.len(), 24, Order::White));
        assert!(raised.order > bic.order && level(&raised) > 1.5 * level(&bic), "{bic:?} {raised:?}");
        // A process of known order is not made longer than it needs.
        let ar2 = sample_autocovariance(&simulate(&[1.2, -0.6], 20_000, 2), 24);
        let model = fit_by(&ar2, 20_000, 24, Order::White);
        assert!((model.coefficients[0] - 1.2).abs() < 0.03 && (model.coefficients[1] + 0.6).abs() < 0.03, "{model:?}");
    }

    #[test]
    fn autocovariance_of_first_order_is_the_closed_form() {
        let c = autocovariance(&Ar { coefficients: vec![0.9], variance: 2.0, order: 1 }, 30);
        for (k, c) in c.iter().enumerate() {
            assert!((c - 2.0 * f64::powi(0.9, k as i32) / (1.0 - 0.81)).abs() < 1e-12);
        }
    }

    #[test]
    fn autocovariance_solves_the_yule_walker_equations() {
        let model = Ar { coefficients: vec![0.7, -0.4, 0.3, 0.1], variance: 1.7, order: 4 };
        let c = autocovariance(&model, 12);
        for k in 0..=12usize {
            let sum: f64 = model.coefficients.iter().enumerate().map(|(j, a)| a * c[k.abs_diff(j + 1)]).sum();
            let wanted = sum + if k == 0 { model.variance } else { 0.0 };
            assert!((c[k] - wanted).abs() < 1e-12, "lag {k}");
        }
        // and the fit of an exact autocovariance is the model again
        let again = fit(&c, 1_000_000, 4);
        assert!(again.coefficients.iter().zip(&model.coefficients).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn short_lags_and_white_noise() {
        assert_eq!(autocovariance(&Ar { coefficients: vec![], variance: 3.0, order: 0 }, 2), [3.0, 0.0, 0.0]);
        assert_eq!(autocovariance(&Ar { coefficients: vec![0.5, 0.2], variance: 3.0, order: 2 }, 0).len(), 1);
        assert!(autocovariance(&Ar { coefficients: vec![1.1], variance: 1.0, order: 1 }, 1)[0].is_nan());
        assert_eq!(fit(&[], 10, 3).order, 0);
        assert_eq!(fit(&[0.0, 0.0], 10, 3), Ar { coefficients: vec![], variance: 0.0, order: 0 });
    }

    #[test]
    fn masked_samples_are_left_out() {
        let c = sample_autocovariance(&[1.0, f64::NAN, 2.0, 3.0], 2);
        assert_eq!(c, [14.0 / 3.0, 6.0 / 3.0, 2.0 / 3.0]);
        assert_eq!(sample_autocovariance(&[f64::NAN], 1), [0.0, 0.0]);
        let mut r = simulate(&[0.9], 20_000, 4);
        (5_000..9_000).for_each(|i| r[i] = f64::NAN);
        let model = fit(&sample_autocovariance(&r, 20), 16_000, 20);
        assert!((model.coefficients[0] - 0.9).abs() < 0.01, "{model:?}");
    }
}
