//! Points with standard deviations in, a weighted straight line with covariance, between-point
//! scatter and bands out.
//!
//! Model: `y_i = intercept + slope x_i + b_i + e_i` with `Var(e_i) = s_i^2` (the claimed sd of the
//! point) and `Var(b_i) = tau^2` (scatter between maneuvers that the claims do not explain).
//! `tau^2` is the Paule-Mandel estimate, 0 when the claims explain the scatter; the covariance
//! `(X'WX)^-1` is then multiplied by `q = sum w r^2 / (n - 2)` (Birge; Knapp & Hartung), whatever
//! its size: claims that are all wrong by one factor do no harm, and t and F quantiles with n - 2
//! degrees of freedom hold.

use crate::math::distribution::{f_quantile, t_quantile};

/// How a line is fitted.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Estimate the scatter between the points (`tau`) beside their claimed standard deviations;
    /// without it `tau` is 0.
    pub between_scatter: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { between_scatter: true }
    }
}

/// Why there is no line: an outcome for a table, not an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unfit {
    /// Fewer than three points: a line through two has no residual to judge it by.
    TooFewPoints,
    /// All x are the same: any slope fits.
    IdenticalX,
    /// The x or y of this point (counted from 0) is not finite.
    BadValue(usize),
    /// The standard deviation of this point (counted from 0) is not positive and finite.
    BadSd(usize),
}

impl Unfit {
    /// The word for tables.
    pub fn name(self) -> &'static str {
        match self {
            Unfit::TooFewPoints => "too_few_points",
            Unfit::IdenticalX => "identical_x",
            Unfit::BadValue(_) => "bad_value",
            Unfit::BadSd(_) => "bad_sd",
        }
    }
}

impl std::fmt::Display for Unfit {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Unfit::TooFewPoints => write!(f, "fewer than three points"),
            Unfit::IdenticalX => write!(f, "all points have the same x"),
            Unfit::BadValue(i) => write!(f, "point {i} (from 0) has a value that is not finite"),
            Unfit::BadSd(i) => write!(
                f,
                "point {i} (from 0) has a standard deviation that is not positive and finite"
            ),
        }
    }
}

/// A fitted line. The covariances contain the factor `q`.
#[derive(Debug, Clone, PartialEq)]
pub struct LineFit {
    pub slope: f64,
    /// Value at x = 0.
    pub intercept: f64,
    pub slope_sd: f64,
    pub intercept_sd: f64,
    /// Covariance of slope and intercept.
    pub covariance: f64,
    /// Sd of the scatter between the points beyond their claimed sd, in units of y.
    pub tau: f64,
    /// `sum w r^2 / (n - 2)` with `w = 1 / (s_i^2 + tau^2)`: 1 where `tau > 0`, below 1 where the
    /// claims are too large.
    pub q: f64,
    /// The same with `tau = 0`: how far the claimed sd explain the scatter.
    pub reduced_chi_square: f64,
    /// Number of points.
    pub n: usize,
    /// Degrees of freedom, n - 2.
    pub dof: f64,
    /// Weighted mean of x, where slope and value of the line are uncorrelated.
    pub x_center: f64,
    /// Value of the line at `x_center`.
    pub y_center: f64,
    /// Sd of the value at `x_center`.
    pub y_center_sd: f64,
    /// Claimed variance of a typical point: the median of `s_i^2`.
    pub typical_variance: f64,
}

/// The straight line through `y` at `x` (equal lengths) with claimed standard deviations `sd`.
///
/// An [`Unfit`] says why there is none; slices of unequal length are a mistake of the caller and
/// panic.
pub fn line(x: &[f64], y: &[f64], sd: &[f64], settings: &Settings) -> Result<LineFit, Unfit> {
    assert!(x.len() == y.len() && x.len() == sd.len(), "x, y and sd of one length");
    check(x, y, sd)?;
    let n = x.len();
    let dof = (n - 2) as f64;
    // Work in units of the smallest sd and relative to the first point: squares neither overflow
    // nor vanish.
    let unit = sd.iter().fold(f64::INFINITY, |m, s| m.min(*s));
    let variance: Vec<f64> = sd.iter().map(|s| (s / unit) * (s / unit)).collect();
    let shifted: Vec<f64> = y.iter().map(|v| (v - y[0]) / unit).collect();
    let plain = Weighted::new(x, &shifted, &variance, 0.0);
    let tau2 =
        if settings.between_scatter { paule_mandel(x, &shifted, &variance, dof) } else { 0.0 };
    let w = Weighted::new(x, &shifted, &variance, tau2);
    let q = w.chi_square / dof;
    let slope = w.slope * unit;
    let y_center = y[0] + w.y_center * unit;
    let slope_variance = q / w.sxx;
    let center_variance = q / w.sum;
    Ok(LineFit {
        slope,
        intercept: y_center - slope * w.x_center,
        slope_sd: slope_variance.sqrt() * unit,
        intercept_sd: (center_variance + w.x_center * w.x_center * slope_variance).sqrt() * unit,
        covariance: -w.x_center * slope_variance * unit * unit,
        tau: tau2.sqrt() * unit,
        q,
        reduced_chi_square: plain.chi_square / dof,
        n,
        dof,
        x_center: w.x_center,
        y_center,
        y_center_sd: center_variance.sqrt() * unit,
        typical_variance: crate::math::median(&variance) * unit * unit,
    })
}

/// Slope and intercept of the line that is added when the points of a fitted line all move by
/// `change`: the coefficients are linear in the points, with the weights of the fit. For errors
/// that all points share, such as those of assumed constants.
pub fn carried(fit: &LineFit, x: &[f64], sd: &[f64], change: &[f64]) -> (f64, f64) {
    let unit = sd.iter().fold(f64::INFINITY, |m, s| m.min(*s));
    let variance: Vec<f64> = sd.iter().map(|s| (s / unit) * (s / unit)).collect();
    let w = Weighted::new(x, change, &variance, (fit.tau / unit) * (fit.tau / unit));
    (w.slope, w.y_center - w.slope * w.x_center)
}

/// Correlations of slope and intercept of one line with those of another one through estimates of
/// the same maneuvers, `[slope, intercept][slope, intercept]`. `pairs`: place of a maneuver among
/// the points of each, and covariance of its two estimates. Scatter between maneuvers counts as
/// independent.
pub fn correlations(
    one: (&LineFit, &[f64], &[f64]),
    other: (&LineFit, &[f64], &[f64]),
    pairs: &[(usize, usize, f64)],
) -> [[f64; 2]; 2] {
    let weights = |(fit, x, sd): (&LineFit, &[f64], &[f64]), at: usize| {
        let mut unit = vec![0.0; x.len()];
        unit[at] = 1.0;
        let (slope, intercept) = carried(fit, x, sd, &unit);
        [slope, intercept]
    };
    let mut sums = [[0.0; 2]; 2];
    for &(i, j, covariance) in pairs {
        let (a, b) = (weights(one, i), weights(other, j));
        for (sums, a) in sums.iter_mut().zip(a) {
            sums.iter_mut().zip(b).for_each(|(sum, b)| *sum += a * b * covariance);
        }
    }
    let factor = (one.0.q * other.0.q).sqrt();
    let sd = |fit: &LineFit| [fit.slope_sd, fit.intercept_sd];
    let (a, b) = (sd(one.0), sd(other.0));
    for i in 0..2 {
        for j in 0..2 {
            sums[i][j] = (factor * sums[i][j] / (a[i] * b[j])).clamp(-1.0, 1.0);
        }
    }
    sums
}

/// A line through points whose errors are correlated (they were estimated together, with something
/// in common: the friction of a flight). `pairs`: places of two different points, and the covariance
/// of their estimates. The weights stay those of independent points; the covariance of slope and
/// intercept is that of these weights (a sandwich, White 1980).
pub fn correlated(fit: LineFit, x: &[f64], sd: &[f64], pairs: &[(usize, usize, f64)]) -> LineFit {
    let weights: Vec<(f64, f64)> = (0..if pairs.is_empty() { 0 } else { x.len() })
        .map(|at| {
            let mut unit = vec![0.0; x.len()];
            unit[at] = 1.0;
            carried(&fit, x, sd, &unit)
        })
        .collect();
    let mut variance =
        [fit.slope_sd * fit.slope_sd, fit.intercept_sd * fit.intercept_sd, fit.covariance];
    for &(i, j, covariance) in pairs {
        let (a, b, both) = (weights[i], weights[j], fit.q * covariance);
        variance[0] += 2.0 * both * a.0 * b.0;
        variance[1] += 2.0 * both * a.1 * b.1;
        variance[2] += both * (a.0 * b.1 + a.1 * b.0);
    }
    // Where slope and value are uncorrelated: Cov(slope, intercept + slope x) = 0.
    let [slope, intercept, covariance] = variance;
    let x_center = -covariance / slope;
    let center = intercept - covariance * covariance / slope;
    if pairs.is_empty() || !(slope > 0.0 && center > 0.0) {
        return fit;
    }
    LineFit {
        slope_sd: slope.sqrt(),
        intercept_sd: intercept.sqrt(),
        covariance,
        x_center,
        y_center: fit.intercept + fit.slope * x_center,
        y_center_sd: center.sqrt(),
        ..fit
    }
}

fn check(x: &[f64], y: &[f64], sd: &[f64]) -> Result<(), Unfit> {
    for i in 0..x.len() {
        if !x[i].is_finite() || !y[i].is_finite() {
            return Err(Unfit::BadValue(i));
        }
        if !(sd[i] > 0.0 && sd[i].is_finite()) {
            return Err(Unfit::BadSd(i));
        }
    }
    if x.len() < 3 {
        return Err(Unfit::TooFewPoints);
    }
    let (low, high) =
        x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    // Differences of a few units in the last place are rounding, not a range of x.
    if high - low <= 1e-12 * low.abs().max(high.abs()) {
        return Err(Unfit::IdenticalX);
    }
    Ok(())
}

/// Weighted least squares about the weighted mean of x.
struct Weighted {
    sum: f64,
    x_center: f64,
    y_center: f64,
    sxx: f64,
    slope: f64,
    chi_square: f64,
}

impl Weighted {
    fn new(x: &[f64], y: &[f64], variance: &[f64], tau2: f64) -> Weighted {
        let w: Vec<f64> = variance.iter().map(|v| 1.0 / (v + tau2)).collect();
        let mean = |v: &[f64], sum: f64| v.iter().zip(&w).map(|(a, w)| a * w).sum::<f64>() / sum;
        let sum: f64 = w.iter().sum();
        let (x_center, y_center) = (mean(x, sum), mean(y, sum));
        let (mut sxx, mut sxy) = (0.0, 0.0);
        for i in 0..x.len() {
            sxx += w[i] * (x[i] - x_center) * (x[i] - x_center);
            sxy += w[i] * (x[i] - x_center) * (y[i] - y_center);
        }
        let slope = sxy / sxx;
        let residual = |i: usize| y[i] - y_center - slope * (x[i] - x_center);
        let chi_square = (0..x.len()).map(|i| w[i] * residual(i) * residual(i)).sum();
        Weighted { sum, x_center, y_center, sxx, slope, chi_square }
    }
}

/// `tau^2` such that the weighted sum of squared residuals equals its expectation, n - 2 (Paule &
/// Mandel 1982); the sum falls monotonically with `tau^2`, so bisection finds it.
fn paule_mandel(x: &[f64], y: &[f64], variance: &[f64], dof: f64) -> f64 {
    let excess = |tau2: f64| Weighted::new(x, y, variance, tau2).chi_square - dof;
    if !(excess(0.0) > 0.0) {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    while excess(high) > 0.0 && high < 1e250 {
        low = high;
        high *= 2.0;
    }
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if excess(middle) > 0.0 { low = middle } else { high = middle }
    }
}

impl LineFit {
    /// Value of the line at `x`.
    pub fn value(&self, x: f64) -> f64 {
        self.y_center + self.slope * (x - self.x_center)
    }

    /// Sd of the value of the line at `x`.
    pub fn value_sd(&self, x: f64) -> f64 {
        libm::hypot(self.y_center_sd, self.slope_sd * (x - self.x_center))
    }

    /// Sd of a further point of typical claimed sd about the line at `x`: line, scatter between
    /// points and the point's own error.
    ///
    /// The variance of a point is `q (tau^2 + s^2)`, with the median of the claimed `s_i^2` as
    /// `s^2`.
    pub fn point_sd(&self, x: f64) -> f64 {
        libm::hypot(
            self.value_sd(x),
            (self.q * (self.tau * self.tau + self.typical_variance)).sqrt(),
        )
    }

    /// Half width of the interval of `level` of one parameter, in units of its sd.
    pub fn interval_factor(&self, level: f64) -> f64 {
        t_quantile(0.5 * (1.0 + level), self.dof)
    }

    /// Half width of the simultaneous band (Working & Hotelling 1929) of `level`, in units of the
    /// sd of the line's value.
    pub fn simultaneous_factor(&self, level: f64) -> f64 {
        (2.0 * f_quantile(level, 2.0, self.dof)).sqrt()
    }
}

/// The line and its bands at one `x`, all in units of y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    pub x: f64,
    pub value: f64,
    /// Confidence interval of the line at this x alone.
    pub pointwise: (f64, f64),
    /// The whole line lies in this band, over all x at once.
    pub simultaneous: (f64, f64),
    /// A further point of typical claimed sd lies in here.
    pub prediction: (f64, f64),
}

/// The bands of `level` (0.95, say) at each of `xs`.
pub fn bands(fit: &LineFit, xs: &[f64], level: f64) -> Vec<Band> {
    let (single, joint) = (fit.interval_factor(level), fit.simultaneous_factor(level));
    xs.iter()
        .map(|&x| {
            let value = fit.value(x);
            let about = |half: f64| (value - half, value + half);
            let (sd, point) = (fit.value_sd(x), fit.point_sd(x));
            Band {
                x,
                value,
                pointwise: about(single * sd),
                simultaneous: about(joint * sd),
                prediction: about(single * point),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests;
