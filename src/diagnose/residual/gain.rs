//! Slopes and curvatures of a log-likelihood in; the most it gains within bounds, and where, out.

use crate::math::dense;
use crate::math::products::dot;

/// Largest `b'u - b'Fb/2` within bounds, and where; where zero is within them, it is never less
/// than nothing.
pub fn gain(f: &[f64], u: &[f64], bounds: &[(f64, f64)]) -> (f64, Vec<f64>) {
    let k = u.len();
    let inside = |b: &[f64]| b.iter().zip(bounds).all(|(b, (low, high))| b >= low && b <= high);
    let free = dense::cholesky(f, k).ok().map(|l| {
        let mut b = u.to_vec();
        dense::cholesky_solve(&l, k, &mut b);
        b
    });
    let b = match free {
        Some(b) if inside(&b) => b,
        _ => by_coordinates(f, u, bounds),
    };
    let quadratic: f64 = (0..k).map(|i| b[i] * dot(&f[i * k..(i + 1) * k], &b)).sum();
    let value: f64 = dot(&b, u) - 0.5 * quadratic;
    match inside(&vec![0.0; k]) {
        true if value > 0.0 => (value, b),
        true => (0.0, vec![0.0; k]),
        false if value.is_finite() => (value, b),
        false => (f64::NEG_INFINITY, b),
    }
}

/// One coefficient after the other at its best within its bounds, until none moves.
fn by_coordinates(f: &[f64], u: &[f64], bounds: &[(f64, f64)]) -> Vec<f64> {
    let k = u.len();
    let mut b: Vec<f64> = bounds.iter().map(|(low, high)| 0.0f64.clamp(*low, *high)).collect();
    for _ in 0..200 {
        let mut moved = 0.0f64;
        for i in 0..k {
            let others: f64 = (0..k).filter(|&j| j != i).map(|j| f[i * k + j] * b[j]).sum();
            if f[i * k + i] > 0.0 {
                let next = ((u[i] - others) / f[i * k + i]).clamp(bounds[i].0, bounds[i].1);
                moved = moved.max((next - b[i]).abs() * f[i * k + i].sqrt());
                b[i] = next;
            }
        }
        if moved < 1e-6 {
            break;
        }
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_those_of_the_best_coefficient_within_bounds() {
        let open = [(f64::NEG_INFINITY, f64::INFINITY)];
        let (g, b) = gain(&[4.0], &[2.0], &open);
        assert!((g - 0.5).abs() < 1e-12 && (b[0] - 0.5).abs() < 1e-12);
        let (g, b) = gain(&[4.0], &[2.0], &[(0.0, 0.25)]);
        assert!((g - (0.25 * 2.0 - 0.125)).abs() < 1e-12 && b[0] == 0.25);
        assert_eq!(gain(&[4.0], &[-2.0], &[(0.0, 1.0)]).0, 0.0);
        // Two correlated ones, the second at its bound: the first is found again.
        let (f, u) = ([2.0, 1.0, 1.0, 2.0], [3.0, 3.0]);
        let (_, b) = gain(&f, &u, &[open[0], (0.0, 0.5)]);
        assert!((b[1] - 0.5).abs() < 1e-9 && (b[0] - 1.25).abs() < 1e-6, "{b:?}");
    }
}
