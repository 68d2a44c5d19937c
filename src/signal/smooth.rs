//! Samples on a uniform grid in, smoothed samples and derivatives out.

use crate::error::{Error, Result};
use crate::math::dense;

/// A Savitzky-Golay filter: each sample is replaced by the value (or a derivative) of the
/// polynomial fitted to the window around it.
#[derive(Debug, Clone, PartialEq)]
pub struct SavitzkyGolay {
    window: usize,
    /// `[window][window]`: row i holds the weights for the value at point i of the window; the
    /// middle row is the usual filter, the others serve the ends.
    weights: Vec<f64>,
}

impl SavitzkyGolay {
    /// A filter of an odd `window` of samples spaced `dt` s, polynomial `order` below the window,
    /// and `derivative` 0, 1, 2 ... up to the order.
    pub fn new(window: usize, order: usize, derivative: usize, dt: f64) -> Result<Self> {
        if window.is_multiple_of(2)
            || order >= window
            || derivative > order
            || !(dt > 0.0 && dt.is_finite())
        {
            return Err(Error::new(format!(
                "a Savitzky-Golay filter of window {window}, order {order}, derivative {derivative}, spacing {dt} s"
            ))
            .help("the window is odd, the order below the window, the derivative at most the order, the spacing positive"));
        }
        Ok(SavitzkyGolay { window, weights: weights(window, order, derivative, dt) })
    }

    /// Number of samples that one value is made from.
    pub fn window(&self) -> usize {
        self.window
    }

    /// The filtered signal. The ends use the polynomials of the first and last whole window. NaN
    /// samples split the signal: each part is filtered by itself, and a part shorter than the
    /// window gives NaN.
    pub fn apply(&self, y: &[f64]) -> Vec<f64> {
        let mut out = vec![f64::NAN; y.len()];
        for part in parts(y) {
            if part.len() >= self.window {
                self.filter(&y[part.clone()], &mut out[part]);
            }
        }
        out
    }

    fn filter(&self, y: &[f64], out: &mut [f64]) {
        let (n, w, half) = (y.len(), self.window, self.window / 2);
        for i in 0..n {
            let start = i.saturating_sub(half).min(n - w);
            let row = &self.weights[(i - start) * w..(i - start + 1) * w];
            // Differences from a sample of the window: a constant passes exactly, its derivative is
            // exactly zero.
            let base = y[i];
            let sum: f64 = row.iter().zip(&y[start..start + w]).map(|(c, v)| c * (v - base)).sum();
            out[i] = sum + base * self.gain();
        }
    }

    /// The filter's answer to a constant: 1 for smoothing, 0 for a derivative.
    fn gain(&self) -> f64 {
        let middle = self.window / 2 * self.window;
        self.weights[middle..middle + self.window].iter().sum::<f64>().round()
    }
}

/// Smooths `y` (see [`SavitzkyGolay`]).
pub fn smooth(y: &[f64], window: usize, order: usize) -> Result<Vec<f64>> {
    Ok(SavitzkyGolay::new(window, order, 0, 1.0)?.apply(y))
}

/// The runs of samples that are not NaN.
pub fn parts(y: &[f64]) -> Vec<std::ops::Range<usize>> {
    let mut parts = vec![];
    let mut start = None;
    for i in 0..=y.len() {
        match (start, i < y.len() && !y[i].is_nan()) {
            (None, true) => start = Some(i),
            (Some(s), false) => {
                parts.push(s..i);
                start = None;
            }
            _ => {}
        }
    }
    parts
}

/// Weights `[window][window]` of the least-squares polynomial's derivative at each point of the
/// window.
fn weights(window: usize, order: usize, derivative: usize, dt: f64) -> Vec<f64> {
    let half = (window / 2) as f64;
    let scale = half.max(1.0);
    let points: Vec<f64> = (0..window).map(|i| (i as f64 - half) / scale).collect();
    let (values, derived) = orthonormal(&points, order, derivative);
    // value at point i: sum_k p_k^(d)(x_i) sum_j p_k(x_j) y_j
    let factor = libm::pow(scale * dt, -(derivative as f64));
    let at = dense::transpose(&derived, order + 1, window);
    dense::multiply(&at, &values, window, order + 1, window).iter().map(|v| v * factor).collect()
}

/// Polynomials orthonormal on `points`: their values and their `derivative`-th derivatives, both
/// `[order + 1][points]`.
fn orthonormal(points: &[f64], order: usize, derivative: usize) -> (Vec<f64>, Vec<f64>) {
    let n = points.len();
    let (mut values, mut derived): (Vec<f64>, Vec<f64>) = (vec![], vec![]);
    for k in 0..=order {
        // Start from x^k and remove the lower ones, twice for orthogonality to rounding (modified
        // Gram-Schmidt).
        let mut p: Vec<f64> = points.iter().map(|x| monomial(*x, k, 0)).collect();
        let mut d: Vec<f64> = points.iter().map(|x| monomial(*x, k, derivative)).collect();
        for _ in 0..2 {
            for j in 0..k {
                let (pj, dj) = (&values[j * n..(j + 1) * n], &derived[j * n..(j + 1) * n]);
                let share: f64 = p.iter().zip(pj).map(|(a, b)| a * b).sum();
                p.iter_mut().zip(pj).for_each(|(a, b)| *a -= share * b);
                d.iter_mut().zip(dj).for_each(|(a, b)| *a -= share * b);
            }
        }
        let norm = p.iter().map(|v| v * v).sum::<f64>().sqrt();
        values.extend(p.iter().map(|v| v / norm));
        derived.extend(d.iter().map(|v| v / norm));
    }
    (values, derived)
}

/// The `derivative`-th derivative of `x^k`.
fn monomial(x: f64, k: usize, derivative: usize) -> f64 {
    if derivative > k {
        return 0.0;
    }
    let factor: f64 = (k - derivative + 1..=k).map(|i| i as f64).product();
    (0..k - derivative).fold(factor, |v, _| v * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cubic(n: usize, dt: f64) -> (Vec<f64>, Vec<f64>) {
        let t = (0..n).map(|i| i as f64 * dt - 0.3);
        t.map(|t| (1.0 + t * (2.0 + t * (-3.0 + t * 4.0)), 2.0 + t * (-6.0 + t * 12.0))).unzip()
    }

    fn derivative(y: &[f64], dt: f64, window: usize, order: usize) -> Vec<f64> {
        SavitzkyGolay::new(window, order, 1, dt).unwrap().apply(y)
    }

    fn differ(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn polynomials_of_the_order_pass_everywhere() {
        let (y, dy) = cubic(40, 0.02);
        for window in [5, 7, 15, 39] {
            for order in 3..window.min(7) {
                assert!(differ(&smooth(&y, window, order).unwrap(), &y) < 1e-12);
                assert!(
                    differ(&derivative(&y, 0.02, window, order), &dy) < 1e-9,
                    "{window} {order}"
                );
            }
        }
    }

    #[test]
    fn weights_are_the_published_ones() {
        // Savitzky & Golay 1964: 5-point quadratic smoothing and first derivative
        let sg = SavitzkyGolay::new(5, 2, 0, 1.0).unwrap();
        assert!(
            differ(&sg.weights[10..15], &[-3.0, 12.0, 17.0, 12.0, -3.0].map(|v| v / 35.0)) < 1e-14
        );
        let sg = SavitzkyGolay::new(5, 2, 1, 0.5).unwrap();
        assert!(differ(&sg.weights[10..15], &[-2.0, -1.0, 0.0, 1.0, 2.0].map(|v| v / 5.0)) < 1e-14);
    }

    #[test]
    fn a_sine_is_differentiated() {
        let (dt, n) = (0.01, 200);
        let y: Vec<f64> = (0..n).map(|i| (3.0 * i as f64 * dt).sin()).collect();
        let dy: Vec<f64> = (0..n).map(|i| 3.0 * (3.0 * i as f64 * dt).cos()).collect();
        assert!(differ(&derivative(&y, dt, 9, 4), &dy) < 1e-4);
    }

    #[test]
    fn gaps_split_the_signal() {
        let (mut y, _) = cubic(30, 0.02);
        y[20] = f64::NAN;
        let s = smooth(&y, 11, 3).unwrap();
        assert!((0..20).all(|i| (s[i] - y[i]).abs() < 1e-12) && (20..30).all(|i| s[i].is_nan()));
        assert!(smooth(&y[..4], 11, 3).unwrap().iter().all(|v| v.is_nan()));
        assert!(smooth(&[], 11, 3).unwrap().is_empty());
    }

    #[test]
    fn a_constant_is_exactly_constant() {
        let y = vec![0.1; 20];
        assert_eq!(smooth(&y, 7, 2).unwrap(), y);
        assert_eq!(derivative(&y, 0.1, 7, 2), vec![0.0; 20]);
    }

    #[test]
    fn impossible_filters_are_refused() {
        for (window, order, derivative, dt) in
            [(4, 2, 0, 1.0), (5, 5, 0, 1.0), (5, 2, 3, 1.0), (5, 2, 1, 0.0), (0, 0, 0, 1.0)]
        {
            assert!(SavitzkyGolay::new(window, order, derivative, dt).is_err());
        }
    }
}
