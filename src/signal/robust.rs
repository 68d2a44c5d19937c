//! A sampled signal in, its median-filtered version and estimates of its level and noise out.

use crate::math::{mad_sd, median};

/// The running median over an odd `window` of samples; NaN samples are left out, the window shrinks symmetrically at the ends.
/// NaN where the window holds no value, and where the sample itself is NaN. An even window is widened by one.
pub fn median_filter(y: &[f64], window: usize) -> Vec<f64> {
    let half = window / 2;
    let mut values = Vec::with_capacity(2 * half + 1);
    (0..y.len())
        .map(|i| {
            if y[i].is_nan() {
                return f64::NAN;
            }
            let reach = half.min(i).min(y.len() - 1 - i);
            values.clear();
            values.extend(y[i - reach..=i + reach].iter().filter(|v| !v.is_nan()));
            median(&values)
        })
        .collect()
}

/// Median and MAD standard deviation of the values that are not NaN; both NaN when there are none.
pub fn level(y: &[f64]) -> (f64, f64) {
    let values: Vec<f64> = y.iter().copied().filter(|v| !v.is_nan()).collect();
    (median(&values), mad_sd(&values))
}

/// The sd of white noise on a slowly varying signal, from the MAD of its second differences; steps and outliers hardly count.
///
/// 0 for fewer than three neighbouring values. Quantisation coarser than the noise may hide the noise (0 as well).
pub fn noise_sd(y: &[f64]) -> f64 {
    let second: Vec<f64> = y.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).filter(|d| !d.is_nan()).collect();
    // Var(e0 - 2 e1 + e2) = 6 Var(e)
    if second.is_empty() { 0.0 } else { mad_sd(&second) / 6f64.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn median_filter_removes_spikes_and_keeps_edges() {
        let y = [0.0, 0.0, 9.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0];
        assert_eq!(median_filter(&y, 3), [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
        let gap = median_filter(&[1.0, f64::NAN, 3.0], 3);
        assert!(gap[0] == 1.0 && gap[1].is_nan() && gap[2] == 3.0);
        assert!(median_filter(&[], 5).is_empty());
    }

    #[test]
    fn noise_is_found_under_drift_and_steps() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        let y: Vec<f64> = (0..5000)
            .map(|i| {
                let e: f64 = StandardNormal.sample(&mut rng);
                0.2 * e + 1e-3 * i as f64 + if i / 500 % 2 == 0 { 3.0 } else { 0.0 }
            })
            .collect();
        assert!((noise_sd(&y) - 0.2).abs() < 0.01);
        assert_eq!(noise_sd(&[1.0, 2.0]), 0.0);
        assert_eq!(level(&[1.0, f64::NAN, 3.0, 2.0]), (2.0, 1.4826));
    }
}
