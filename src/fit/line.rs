//! Points with standard deviations in, a weighted straight line with covariance and between-point
//! scatter out.
//!
//! Model: `y_i = intercept + slope x_i + b_i + e_i` with `Var(e_i) = s_i^2` (the claimed sd of the
//! point) and `Var(b_i) = tau^2` (scatter between maneuvers that the claims do not explain).
//! `tau^2` is the Paule-Mandel estimate, 0 when the claims explain the scatter; the covariance
//! `(X'WX)^-1` is then multiplied by `q = sum w r^2 / (n - 2)` (Birge; Knapp & Hartung), whatever
//! its size: claims that are all wrong by one factor do no harm, and t and F quantiles with n - 2
//! degrees of freedom hold.
//!
//! Points that were estimated together have errors in common (through the friction of a flight):
//! `e_i` contains `u_i . z` with standard normal `z`, one per source. Then `W = V^-1` with the full
//! covariance `V` (generalised least squares, Aitken 1936), and all of the above holds as it is.

use super::weights::{Shared, Weights};

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
    /// `sum w r^2` over its expectation, with `w = 1 / (s_i^2 + tau^2)`: 1 where `tau > 0`, below 1
    /// where the claims are too large.
    pub q: f64,
    /// `sum w r^2 / (n - 2)` with `tau = 0`: how far the claimed sd explain the scatter.
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

/// Where a line is fitted: slices of one length, a point each.
#[derive(Debug, Clone, Copy)]
pub struct Points<'a> {
    pub x: &'a [f64],
    /// Claimed standard deviations; what the points have in common is part of them.
    pub sd: &'a [f64],
    /// What the points have in common.
    pub shared: &'a [Shared],
}

/// The straight line through `y` at points.
///
/// An [`Unfit`] says why there is none; slices of unequal length are a mistake of the caller and
/// panic.
pub fn line(points: Points, y: &[f64], settings: &Settings) -> Result<LineFit, Unfit> {
    let Points { x, sd, .. } = points;
    assert!(x.len() == y.len() && x.len() == sd.len(), "x, y and sd of one length");
    check(x, y, sd)?;
    let n = x.len();
    let dof = (n - 2) as f64;
    // Work in units of the smallest sd and relative to the first point: squares neither overflow
    // nor vanish.
    let unit = points.unit();
    let shifted: Vec<f64> = y.iter().map(|v| (v - y[0]) / unit).collect();
    let plain = Weighted::new(points, &shifted, 0.0);
    let tau2 = if settings.between_scatter { paule_mandel(points, &shifted, dof) } else { 0.0 };
    let w = Weighted::new(points, &shifted, tau2);
    let q = w.chi_square / dof;
    let slope = w.slope * unit;
    let y_center = y[0] + w.y_center * unit;
    let slope_variance = q / w.sxx;
    let center_variance = q / w.sum;
    let variance: Vec<f64> = sd.iter().map(|s| s * s).collect();
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
        typical_variance: crate::math::median(&variance),
    })
}

impl Points<'_> {
    /// The smallest claimed sd.
    fn unit(&self) -> f64 {
        self.sd.iter().fold(f64::INFINITY, |m, s| m.min(*s))
    }

    /// By how much slope and intercept of a fitted line move with each of its points: both are
    /// linear in the points, with the weights of the fit.
    pub(super) fn influence(&self, fit: &LineFit) -> Vec<[f64; 2]> {
        let unit = self.unit();
        let tau = fit.tau / unit;
        let w = Weighted::new(*self, &vec![0.0; self.x.len()], tau * tau);
        let of = |(by_slope, by_sum): (&f64, &f64)| {
            let slope = by_slope / w.sxx;
            [slope, by_sum / w.sum - w.x_center * slope]
        };
        w.by_slope.iter().zip(&w.by_sum).map(of).collect()
    }
}

/// Slope and intercept of the line that is added when the points of a fitted line all move by
/// `change`. For errors that all points share, such as those of assumed constants.
pub fn carried(fit: &LineFit, points: Points, change: &[f64]) -> (f64, f64) {
    let moved = points.influence(fit);
    let sum = |k: usize| moved.iter().zip(change).map(|(of, change)| of[k] * change).sum();
    (sum(0), sum(1))
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

/// Weighted least squares about the weighted mean of x, in units of the smallest sd.
struct Weighted {
    /// Weights times 1 and times x - `x_center`.
    by_sum: Vec<f64>,
    by_slope: Vec<f64>,
    sum: f64,
    x_center: f64,
    y_center: f64,
    sxx: f64,
    slope: f64,
    chi_square: f64,
}

impl Weighted {
    fn new(points: Points, y: &[f64], tau2: f64) -> Weighted {
        let Points { x, sd, shared } = points;
        let w = Weights::new(sd, shared, points.unit(), tau2);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let by_sum = w.times(&vec![1.0; x.len()]);
        let sum: f64 = by_sum.iter().sum();
        // Relative to the first x: far from the origin nothing is lost.
        let away: Vec<f64> = x.iter().map(|v| v - x[0]).collect();
        let center = dot(&by_sum, &away) / sum;
        let dx: Vec<f64> = away.iter().map(|v| v - center).collect();
        let by_slope = w.times(&dx);
        let (sxx, y_center) = (dot(&by_slope, &dx), dot(&by_sum, y) / sum);
        let dy: Vec<f64> = y.iter().map(|v| v - y_center).collect();
        let slope = dot(&by_slope, &dy) / sxx;
        let residual: Vec<f64> = dy.iter().zip(&dx).map(|(dy, dx)| dy - slope * dx).collect();
        let chi_square = dot(&w.times(&residual), &residual);
        let x_center = x[0] + center;
        Weighted { by_sum, by_slope, sum, x_center, y_center, sxx, slope, chi_square }
    }
}

/// `tau^2` such that the weighted sum of squared residuals equals its expectation, n - 2 (Paule &
/// Mandel 1982); the sum falls monotonically with `tau^2`, so bisection finds it.
fn paule_mandel(points: Points, y: &[f64], dof: f64) -> f64 {
    let excess = |tau2: f64| Weighted::new(points, y, tau2).chi_square - dof;
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

#[cfg(test)]
mod tests;
