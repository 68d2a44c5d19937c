//! Estimates of one parameter from repeated maneuvers in; whether they scatter as their standard
//! deviations say out.

use crate::math::distribution::chi2_cdf;

/// Repeated estimates against what is claimed of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Repeats {
    pub n: usize,
    /// Plain mean.
    pub mean: f64,
    /// Standard deviation of the estimates about it.
    pub scatter: f64,
    /// Root mean square of their claimed standard deviations.
    pub claimed: f64,
    /// `sum ((value - weighted mean) / sd)^2`: chi-square with n - 1 degrees of freedom where the
    /// claims hold and the parameter is one and the same in all maneuvers.
    pub chi2: f64,
    /// Probability of so large a value then.
    pub p: f64,
}

/// Compares at least two estimates with their standard deviations (all positive); `None` for fewer.
pub fn compare(values: &[f64], sds: &[f64]) -> Option<Repeats> {
    let n = values.len();
    if n < 2 || sds.len() != n || !sds.iter().all(|sd| *sd > 0.0) {
        return None;
    }
    let nf = n as f64;
    let mean = values.iter().sum::<f64>() / nf;
    let scatter = (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (nf - 1.0)).sqrt();
    let claimed = (sds.iter().map(|s| s * s).sum::<f64>() / nf).sqrt();
    let weights: Vec<f64> = sds.iter().map(|s| 1.0 / (s * s)).collect();
    let weighted =
        values.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>() / weights.iter().sum::<f64>();
    let chi2 = values.iter().zip(&weights).map(|(v, w)| w * (v - weighted) * (v - weighted)).sum();
    Some(Repeats { n, mean, scatter, claimed, chi2, p: 1.0 - chi2_cdf(chi2, nf - 1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn honest_claims_pass_and_claims_too_small_by_half_do_not() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(7);
        let mut refused = [0, 0];
        for _ in 0..400 {
            let sds: Vec<f64> = (0..12).map(|i| 0.1 + 0.02 * f64::from(i)).collect();
            let draw = |sd: &f64| {
                let e: f64 = StandardNormal.sample(&mut rng);
                3.0 + sd * e
            };
            let values: Vec<f64> = sds.iter().map(draw).collect();
            let halves: Vec<f64> = sds.iter().map(|s| 0.5 * s).collect();
            refused[0] += usize::from(compare(&values, &sds).unwrap().p < 0.05);
            refused[1] += usize::from(compare(&values, &halves).unwrap().p < 0.05);
        }
        assert!((8..=34).contains(&refused[0]) && refused[1] > 350, "{refused:?} of 400");
    }

    #[test]
    fn the_figures_are_the_plain_ones() {
        let r = compare(&[1.0, 2.0, 3.0], &[0.5, 0.5, 0.5]).unwrap();
        assert_eq!((r.n, r.mean, r.scatter, r.claimed, r.chi2), (3, 2.0, 1.0, 0.5, 8.0));
        assert!((r.p - libm::exp(-4.0)).abs() < 1e-12);
        assert_eq!(compare(&[1.0], &[0.1]), None);
        assert_eq!(compare(&[1.0, 2.0], &[0.1, 0.0]), None);
    }
}
