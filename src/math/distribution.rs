//! A probability and degrees of freedom in, quantiles of the normal, t, F and chi-square
//! distributions out.
//!
//! Written on `libm` because quantiles reach tables and the platform's logarithm differs between
//! processors; `statrs` is the second source in the tests. Probabilities outside (0, 1) and degrees
//! of freedom that are not positive give NaN.

/// Half width of a 95% interval in standard deviations: what stands behind +- wherever the program
/// writes it.
pub const INTERVAL_95: f64 = 1.959_963_984_540_054;

/// Probability that a standard normal variable is below `x`.
pub fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x / std::f64::consts::SQRT_2)
}

/// Probability that a t variable with `dof` degrees of freedom is below `t`.
#[cfg(test)]
pub fn t_cdf(t: f64, dof: f64) -> f64 {
    // Abramowitz & Stegun 26.7.1
    let tail = 0.5 * beta_regularised(0.5 * dof, 0.5, dof / (dof + t * t));
    if t < 0.0 { tail } else { 1.0 - tail }
}

/// Probability that an F variable with `d1` (numerator) and `d2` degrees of freedom is below `f`.
pub fn f_cdf(f: f64, d1: f64, d2: f64) -> f64 {
    // Abramowitz & Stegun 26.6.2
    if f <= 0.0 { 0.0 } else { beta_regularised(0.5 * d1, 0.5 * d2, d1 * f / (d2 + d1 * f)) }
}

/// Probability that a chi-square variable with `dof` degrees of freedom is below `x`.
pub fn chi2_cdf(x: f64, dof: f64) -> f64 {
    // Abramowitz & Stegun 26.4.19
    if x <= 0.0 { 0.0 } else { gamma_regularised(0.5 * dof, 0.5 * x) }
}

/// The value below which a standard normal variable falls with probability `p`.
pub fn normal_quantile(p: f64) -> f64 {
    symmetric(p, |x| 0.5 * libm::erfc(x / std::f64::consts::SQRT_2))
}

/// The value below which a t variable with `dof` degrees of freedom falls with probability `p`.
pub fn t_quantile(p: f64, dof: f64) -> f64 {
    if !(dof > 0.0) {
        return f64::NAN;
    }
    symmetric(p, |x| 0.5 * beta_regularised(0.5 * dof, 0.5, dof / (dof + x * x)))
}

/// The value below which an F variable with `d1` (numerator) and `d2` degrees of freedom falls with
/// probability `p`.
pub fn f_quantile(p: f64, d1: f64, d2: f64) -> f64 {
    if !(p > 0.0 && p < 1.0 && d1 > 0.0 && d2 > 0.0) {
        return f64::NAN;
    }
    crossing(|f| {
        if p < 0.5 {
            f_cdf(f, d1, d2) - p
        } else {
            (1.0 - p) - beta_regularised(0.5 * d2, 0.5 * d1, d2 / (d2 + d1 * f))
        }
    })
}

/// The value below which a chi-square variable with `dof` degrees of freedom falls with probability
/// `p`.
pub fn chi2_quantile(p: f64, dof: f64) -> f64 {
    if !(p > 0.0 && p < 1.0 && dof > 0.0) {
        return f64::NAN;
    }
    crossing(|x| chi2_cdf(x, dof) - p)
}

/// The quantile of a distribution symmetric about 0 from its upper tail probability.
fn symmetric(p: f64, tail: impl Fn(f64) -> f64) -> f64 {
    if !(p > 0.0 && p < 1.0) {
        return f64::NAN;
    }
    if p == 0.5 {
        return 0.0;
    }
    let wanted = p.min(1.0 - p);
    crossing(|x| wanted - tail(x)) * if p < 0.5 { -1.0 } else { 1.0 }
}

/// The positive zero of an increasing function, by bracketing and bisection to the last bit: no
/// start value, no tail to fail in.
fn crossing(f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (1.0, 1.0);
    while f(high) < 0.0 && high < 1e300 {
        low = high;
        high *= 2.0;
    }
    while f(low) > 0.0 && low > 1e-300 {
        high = low;
        low *= 0.5;
    }
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if f(middle) < 0.0 { low = middle } else { high = middle }
    }
}

/// The regularised incomplete beta function `I_x(a, b)`.
fn beta_regularised(a: f64, b: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    let ln_front = libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b)
        + a * libm::log(x)
        + b * libm::log1p(-x);
    let front = libm::exp(ln_front);
    // The continued fraction converges fast below the mean; above it, use I_x(a, b) = 1 -
    // I_{1-x}(b, a).
    if x < (a + 1.0) / (a + b + 2.0) {
        front * beta_fraction(a, b, x) / a
    } else {
        1.0 - front * beta_fraction(b, a, 1.0 - x) / b
    }
}

/// Abramowitz & Stegun 26.5.8, evaluated by the modified Lentz method.
fn beta_fraction(a: f64, b: f64, x: f64) -> f64 {
    let tiny = 1e-300;
    let away = |v: f64| if v.abs() < tiny { tiny } else { v };
    let mut c = 1.0;
    let mut d = 1.0 / away(1.0 - (a + b) * x / (a + 1.0));
    let mut h = d;
    for m in 1..2000 {
        let m = m as f64;
        for term in [
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        ] {
            d = 1.0 / away(1.0 + term * d);
            c = away(1.0 + term / c);
            h *= d * c;
        }
        if (d * c - 1.0).abs() < 1e-16 {
            break;
        }
    }
    h
}

/// The regularised lower incomplete gamma function `P(a, x)`.
fn gamma_regularised(a: f64, x: f64) -> f64 {
    let front = libm::exp(a * libm::log(x) - x - libm::lgamma(a));
    if x < a + 1.0 {
        // Abramowitz & Stegun 6.5.29
        let (mut term, mut sum, mut k) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-17 {
            k += 1.0;
            term *= x / k;
            sum += term;
        }
        return front * sum;
    }
    // Abramowitz & Stegun 6.5.31 in its even form, by the modified Lentz method
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1e300, 1.0 / b);
    let mut h = d;
    for i in 1..5000 {
        let an = -(i as f64) * (i as f64 - a);
        b += 2.0;
        d = 1.0 / (an * d + b);
        c = b + an / c;
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-16 {
            break;
        }
    }
    1.0 - front * h
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor, Normal, StudentsT};

    fn close(got: f64, wanted: f64) {
        assert!((got / wanted - 1.0).abs() < 1e-6, "got {got}, the table has {wanted}");
    }

    #[test]
    fn quantiles_agree_with_tables() {
        close(normal_quantile(0.975), 1.959964);
        close(normal_quantile(0.995), 2.575829);
        close(normal_quantile(0.0001), -3.719016);
        close(t_quantile(0.975, 1.0), 12.706205);
        close(t_quantile(0.975, 2.0), 4.302653);
        close(t_quantile(0.975, 10.0), 2.228139);
        close(t_quantile(0.975, 30.0), 2.042272);
        close(t_quantile(0.9995, 3.0), 12.923979);
        close(t_quantile(0.95, 5.0), 2.015048);
        close(t_quantile(0.05, 5.0), -2.015048);
        close(f_quantile(0.95, 2.0, 10.0), 4.102821);
        close(f_quantile(0.95, 2.0, 1.0), 199.5);
        close(f_quantile(0.99, 3.0, 20.0), 4.938193);
        close(f_quantile(0.95, 5.0, 4.0), 6.256057);
        close(chi2_quantile(0.95, 1.0), 3.841459);
        close(chi2_quantile(0.95, 10.0), 18.307038);
        close(chi2_quantile(0.05, 10.0), 3.940299);
        close(chi2_quantile(0.999, 2.0), 13.815511);
    }

    #[test]
    fn quantiles_have_closed_forms_where_the_distribution_has() {
        // F(2, d): p = 1 - (1 + 2 f / d)^(-d/2); t(2): t = (2p - 1) / sqrt(2 p (1 - p)); chi2(2):
        // -2 ln(1 - p)
        for p in [1e-6, 0.01, 0.3, 0.7, 0.95, 0.9875, 0.999999] {
            for d in [1.0, 2.0, 7.0, 40.0, 1000.0] {
                let wanted = (-2.0 / d * f64::ln_1p(-p)).exp_m1() * d / 2.0;
                assert!(
                    (f_quantile(p, 2.0, d) / wanted - 1.0).abs() < 1e-8,
                    "{p} {d} {}",
                    f_quantile(p, 2.0, d) / wanted - 1.0
                );
            }
            let wanted = (2.0 * p - 1.0) / (2.0 * p * (1.0 - p)).sqrt();
            assert!((t_quantile(p, 2.0) / wanted - 1.0).abs() < 1e-8);
            assert!((chi2_quantile(p, 2.0) / (-2.0 * f64::ln_1p(-p)) - 1.0).abs() < 1e-8);
        }
    }

    #[test]
    fn distributions_agree_with_a_second_source() {
        for dof in [1.0, 2.0, 3.5, 9.0, 30.0, 200.0] {
            for x in [0.05, 0.5, 1.0, 2.5, 6.0, 30.0] {
                assert!(
                    (t_cdf(x, dof) - StudentsT::new(0.0, 1.0, dof).unwrap().cdf(x)).abs() < 1e-10
                );
                assert!(
                    (t_cdf(-x, dof) - StudentsT::new(0.0, 1.0, dof).unwrap().cdf(-x)).abs() < 1e-10
                );
                assert!((chi2_cdf(x, dof) - ChiSquared::new(dof).unwrap().cdf(x)).abs() < 1e-10);
                assert!(
                    (f_cdf(x, 2.0, dof) - FisherSnedecor::new(2.0, dof).unwrap().cdf(x)).abs()
                        < 1e-10
                );
                assert!(
                    (f_cdf(x, dof, 5.0) - FisherSnedecor::new(dof, 5.0).unwrap().cdf(x)).abs()
                        < 1e-10
                );
            }
        }
        for x in [-5.0, -1.0, 0.0, 0.3, 4.0] {
            assert!((normal_cdf(x) - Normal::new(0.0, 1.0).unwrap().cdf(x)).abs() < 1e-10);
        }
    }

    #[test]
    fn a_quantile_is_the_inverse_of_its_distribution() {
        for p in [1e-9, 1e-4, 0.2, 0.5, 0.8, 0.9999] {
            for d in [1.0, 4.0, 33.0] {
                assert!((t_cdf(t_quantile(p, d), d) / p - 1.0).abs() < 1e-9);
                assert!((f_cdf(f_quantile(p, 3.0, d), 3.0, d) / p - 1.0).abs() < 1e-6);
                assert!((chi2_cdf(chi2_quantile(p, d), d) / p - 1.0).abs() < 1e-9);
            }
            assert!((normal_cdf(normal_quantile(p)) / p - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn nonsense_gives_nan() {
        for p in [0.0, 1.0, -0.1, 1.1, f64::NAN] {
            assert!(normal_quantile(p).is_nan() && t_quantile(p, 3.0).is_nan());
            assert!(f_quantile(p, 2.0, 3.0).is_nan() && chi2_quantile(p, 3.0).is_nan());
        }
        assert!(
            t_quantile(0.9, 0.0).is_nan()
                && f_quantile(0.9, 2.0, -1.0).is_nan()
                && chi2_quantile(0.9, f64::NAN).is_nan()
        );
    }
}
