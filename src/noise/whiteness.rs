//! Residuals in; how far they are from white noise, and how well two signals match, out.

use crate::math::distribution::chi2_cdf;

/// Answers to "is it white?"
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Whiteness {
    /// Probability of a Ljung-Box statistic as large as this one in white noise; NaN where there is
    /// nothing to tell.
    pub p: f64,
    /// Share of the autocorrelations outside +-1.96/sqrt(n), within which 95% of them lie in white
    /// noise.
    pub outside: f64,
    /// Lags looked at.
    pub lags: usize,
}

/// Judges residuals (NaN where masked) about their mean by their first autocorrelations: 20 of
/// them, or a fifth of the samples.
pub fn whiteness(e: &[f64]) -> Whiteness {
    let n = e.iter().filter(|v| !v.is_nan()).count();
    let lags = 20.min(n / 5);
    let mean = e.iter().filter(|v| !v.is_nan()).sum::<f64>() / n as f64;
    let centred: Vec<f64> = e.iter().map(|v| v - mean).collect();
    let c = autocovariances(&centred, lags);
    let scale = c.first().copied().unwrap_or(0.0);
    if lags == 0 || !(scale > 0.0) {
        return Whiteness { p: f64::NAN, outside: f64::NAN, lags };
    }
    let nf = n as f64;
    let rho: Vec<f64> = c.iter().skip(1).map(|c| c / scale).collect();
    // Ljung & Box, Biometrika 65 (1978)
    let q: f64 = rho.iter().enumerate().map(|(k, r)| r * r / (nf - 1.0 - k as f64)).sum::<f64>()
        * nf
        * (nf + 2.0);
    let outside = rho.iter().filter(|r| r.abs() > 1.96 / nf.sqrt()).count() as f64 / lags as f64;
    Whiteness { p: 1.0 - chi2_cdf(q, lags as f64), outside, lags }
}

/// Autocovariances at lags `0..=lags` over the number of valid samples, as the statistic is
/// defined; pairs with a masked sample are left out.
fn autocovariances(r: &[f64], lags: usize) -> Vec<f64> {
    let valid = r.iter().filter(|v| !v.is_nan()).count().max(1) as f64;
    let products = |lag: usize| {
        r.iter().zip(r.iter().skip(lag)).map(|(a, b)| a * b).filter(|v| !v.is_nan()).sum::<f64>()
    };
    (0..=lags).map(|lag| products(lag) / valid).collect()
}

/// How unequal two signals are, and in what.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Theil {
    /// Theil's inequality coefficient, `rms(a - b) / (rms(a) + rms(b))`: 0 where they are equal, 1
    /// where they have nothing in common.
    pub coefficient: f64,
    /// Shares of the mean square of `a - b` (they add up to 1; NaN where it is zero): its mean, the
    /// difference of the standard deviations, and the lack of correlation.
    pub bias: f64,
    pub variance: f64,
    pub covariance: f64,
}

/// Theil's inequality coefficient of two signals with its three parts (Economic Forecasts and
/// Policy, 1961). Samples without both values are left out.
pub fn theil(a: &[f64], b: &[f64]) -> Theil {
    let pairs: Vec<(f64, f64)> = a
        .iter()
        .zip(b)
        .filter(|(x, y)| x.is_finite() && y.is_finite())
        .map(|(x, y)| (*x, *y))
        .collect();
    let mean = |of: &dyn Fn(f64, f64) -> f64| {
        pairs.iter().map(|(x, y)| of(*x, *y)).sum::<f64>() / pairs.len() as f64
    };
    let (ma, mb) = (mean(&|x, _| x), mean(&|_, y| y));
    let square = mean(&|x, y| (x - y) * (x - y));
    let [va, vb] = [mean(&|x, _| (x - ma) * (x - ma)), mean(&|_, y| (y - mb) * (y - mb))];
    let (sa, sb) = (va.sqrt(), vb.sqrt());
    let together = mean(&|x, y| (x - ma) * (y - mb));
    Theil {
        coefficient: square.sqrt() / (mean(&|x, _| x * x).sqrt() + mean(&|_, y| y * y).sqrt()),
        bias: (ma - mb) * (ma - mb) / square,
        variance: (sa - sb) * (sa - sb) / square,
        covariance: 2.0 * (sa * sb - together) / square,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn series(seed: u64, n: usize, rho: f64) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        let mut x = 0.0;
        let mut next = || {
            let e: f64 = StandardNormal.sample(&mut rng);
            x = rho * x + e;
            5.0 + x
        };
        (0..n).map(|_| next()).collect()
    }

    #[test]
    fn white_noise_is_refused_one_time_in_twenty_and_coloured_noise_always() {
        let white: Vec<Whiteness> =
            (0..400).map(|seed| whiteness(&series(seed, 300, 0.0))).collect();
        let refused = white.iter().filter(|w| w.p < 0.05).count();
        assert!((8..=34).contains(&refused), "{refused} of 400");
        let outside = white.iter().map(|w| w.outside).sum::<f64>() / 400.0;
        assert!((outside - 0.05).abs() < 0.015, "{outside}");
        assert!((0..50).all(|seed| whiteness(&series(seed, 300, 0.5)).p < 1e-6));
    }

    #[test]
    fn too_few_samples_and_a_constant_tell_nothing() {
        assert!(whiteness(&[1.0, 2.0, f64::NAN]).p.is_nan() && whiteness(&[]).p.is_nan());
        assert!(whiteness(&[3.0; 50]).p.is_nan());
    }

    #[test]
    fn theil_is_nought_for_equal_and_one_for_opposite_signals() {
        let a = series(1, 100, 0.5);
        let opposite: Vec<f64> = a.iter().map(|v| -v).collect();
        let of = |a: &[f64], b: &[f64]| theil(a, b).coefficient;
        assert_eq!((of(&a, &a), of(&a, &opposite)), (0.0, 1.0));
    }

    #[test]
    fn the_parts_of_theil_say_in_what_signals_differ() {
        let a = series(1, 400, 0.5);
        let mean = a.iter().sum::<f64>() / a.len() as f64;
        let shifted: Vec<f64> = a.iter().map(|v| v + 0.3).collect();
        let larger: Vec<f64> = a.iter().map(|v| mean + 1.5 * (v - mean)).collect();
        let other = series(2, 400, 0.5);
        assert!((theil(&a, &shifted).bias - 1.0).abs() < 1e-9);
        assert!((theil(&a, &larger).variance - 1.0).abs() < 1e-9);
        let all = theil(&a, &other);
        assert!(
            all.covariance > 0.9 && (all.bias + all.variance + all.covariance - 1.0).abs() < 1e-9
        );
    }
}
