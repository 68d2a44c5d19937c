//! Estimates of one parameter from repeated maneuvers in; whether they scatter as their standard
//! deviations say out.
//!
//! Where the parameter is one and the same in all maneuvers, the estimates are `y = 1 m + e` with the
//! claimed covariance `V = Cov(e)`. Then `m = 1'V^-1 y / 1'V^-1 1`, and `r'V^-1 r` with `r = y - 1 m` is
//! chi-square with `n - 1` degrees of freedom (Aitken 1936). Estimates that were made together (with
//! the friction of a flight) have errors in common, which do not scatter: the sample variance about the
//! plain mean is then expected to be `(tr V - 1'V 1/n)/(n - 1)`, which without common errors is the
//! mean of the squared standard deviations.

use super::weights::{Shared, Weights};
use crate::math::distribution::chi2_cdf;
use crate::math::products::dot;

/// Repeated estimates against what is claimed of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Repeats {
    pub n: usize,
    /// Plain mean.
    pub mean: f64,
    /// Standard deviation of the estimates about it.
    pub scatter: f64,
    /// The scatter that the claims let expect: the root mean square of the standard deviations, less
    /// what the estimates have in common.
    pub claimed: f64,
    /// `r'V^-1 r`: chi-square with n - 1 degrees of freedom where the claims hold and the parameter is
    /// one and the same in all maneuvers.
    pub chi2: f64,
    /// Probability of so large a value then.
    pub p: f64,
}

/// Compares at least two estimates with their standard deviations (all positive) and with what they
/// have in common; `None` for fewer.
pub fn repeats(values: &[f64], sds: &[f64], shared: &[Shared]) -> Option<Repeats> {
    let n = values.len();
    if n < 2 || sds.len() != n || !sds.iter().all(|sd| *sd > 0.0) {
        return None;
    }
    let nf = n as f64;
    let mean = values.iter().sum::<f64>() / nf;
    let scatter = (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (nf - 1.0)).sqrt();
    let weights = Weights::new(sds, shared, 1.0, 0.0);
    let by = weights.times(&vec![1.0; n]);
    let best = dot(&by, values) / by.iter().sum::<f64>();
    let r: Vec<f64> = values.iter().map(|v| v - best).collect();
    let chi2 = dot(&r, &weights.times(&r)).max(0.0);
    let claimed = expected(sds, shared).max(0.0).sqrt();
    Some(Repeats { n, mean, scatter, claimed, chi2, p: 1.0 - chi2_cdf(chi2, nf - 1.0) })
}

/// Expected sample variance about the plain mean, `(tr V - 1'V 1/n)/(n - 1)`.
fn expected(sds: &[f64], shared: &[Shared]) -> f64 {
    let n = sds.len() as f64;
    let trace: f64 = sds.iter().map(|s| s * s).sum();
    let mut total = trace;
    for group in shared {
        let mut sums = vec![0.0; group.sources];
        for (_, effects) in group.rows() {
            sums.iter_mut().zip(effects).for_each(|(sum, u)| *sum += u);
        }
        // 1'V 1 has the pairs besides the trace.
        total += dot(&sums, &sums) - dot(&group.effects, &group.effects);
    }
    (trace - total / n) / (n - 1.0)
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
            refused[0] += usize::from(repeats(&values, &sds, &[]).unwrap().p < 0.05);
            refused[1] += usize::from(repeats(&values, &halves, &[]).unwrap().p < 0.05);
        }
        assert!((8..=34).contains(&refused[0]) && refused[1] > 350, "{refused:?} of 400");
    }

    #[test]
    fn the_figures_are_the_plain_ones() {
        let r = repeats(&[1.0, 2.0, 3.0], &[0.5, 0.5, 0.5], &[]).unwrap();
        assert_eq!((r.n, r.mean, r.scatter, r.claimed, r.chi2), (3, 2.0, 1.0, 0.5, 8.0));
        assert!((r.p - libm::exp(-4.0)).abs() < 1e-12);
        assert_eq!(repeats(&[1.0], &[0.1], &[]), None);
        assert_eq!(repeats(&[1.0, 2.0], &[0.1, 0.0], &[]), None);
    }

    /// Two flights of six maneuvers each, whose common error is four times their own: what is drawn so is
    /// found honest, and claims too small by half are found out, although the plain ratio of scatter and
    /// claims is far below one within a flight.
    #[test]
    fn what_is_common_to_estimates_does_not_scatter() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(11);
        let (own, common) = (0.1, 0.4);
        let shared = |scale: f64, flights: &[usize]| -> Vec<Shared> {
            let of = |group: usize| Shared {
                group,
                sources: 1,
                points: (0..6).map(|k| 6 * group + k).collect(),
                effects: vec![scale * common; 6],
            };
            flights.iter().map(|&group| of(group)).collect()
        };
        let mut refused = [0, 0, 0];
        let mut ratio = 0.0;
        for _ in 0..400 {
            let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
            let flights = [draw(), draw()];
            let values: Vec<f64> =
                (0..12).map(|k| 3.0 + common * flights[k / 6] + own * draw()).collect();
            let sd = |scale: f64, n: usize| vec![scale * f64::hypot(own, common); n];
            let all = repeats(&values, &sd(1.0, 12), &shared(1.0, &[0, 1])).expect("twelve");
            let half = repeats(&values, &sd(0.5, 12), &shared(0.5, &[0, 1])).expect("twelve");
            let one = repeats(&values[..6], &sd(1.0, 6), &shared(1.0, &[0])).expect("six");
            ratio += (one.scatter / one.claimed).powi(2) / 400.0;
            for (count, found) in refused.iter_mut().zip([all, half, one]) {
                *count += usize::from(found.p < 0.05);
            }
        }
        assert!((8..=34).contains(&refused[0]) && (8..=34).contains(&refused[2]), "{refused:?}");
        assert!(refused[1] > 350 && (ratio - 1.0).abs() < 0.15, "{refused:?} of 400, {ratio}");
    }
}
