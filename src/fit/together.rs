//! Two lines through estimates of the same maneuvers in, correlations of their coefficients out.

use super::line::{LineFit, Points};
use std::collections::BTreeMap;

/// Correlations of slope and intercept of one line with those of another one,
/// `[slope, intercept][slope, intercept]`. `pairs`: places of two estimates, one of each line, and
/// the covariance that they have besides the shared sources. Scatter between maneuvers counts as
/// independent.
pub fn correlations(
    one: (&LineFit, Points),
    other: (&LineFit, Points),
    pairs: &[(usize, usize, f64)],
) -> [[f64; 2]; 2] {
    let (a, b) = (one.1.influence(one.0), other.1.influence(other.0));
    let mut sums = [[0.0; 2]; 2];
    let mut add = |a: [f64; 2], b: [f64; 2], covariance: f64| {
        for (sums, a) in sums.iter_mut().zip(a) {
            sums.iter_mut().zip(b).for_each(|(sum, b)| *sum += a * b * covariance);
        }
    };
    pairs.iter().for_each(|&(i, j, covariance)| add(a[i], b[j], covariance));
    let (from, to) = (by_source(&a, one.1), by_source(&b, other.1));
    for (source, a) in from {
        if let Some(b) = to.get(&source) {
            add(a, *b, 1.0);
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

/// How far an error of one sd of each source (group and number) moves slope and intercept.
fn by_source(influence: &[[f64; 2]], points: Points) -> BTreeMap<(usize, usize), [f64; 2]> {
    let mut sums: BTreeMap<(usize, usize), [f64; 2]> = BTreeMap::new();
    for group in points.shared {
        for (point, effects) in group.rows() {
            for (k, effect) in effects.iter().enumerate() {
                let of = sums.entry((group.group, k)).or_default();
                of.iter_mut().zip(influence[point]).for_each(|(sum, a)| *sum += a * effect);
            }
        }
    }
    sums
}
