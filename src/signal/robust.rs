//! A sampled signal in, its median-filtered version and an estimate of its noise out.

use crate::math::{mad_sd, median};

/// The running median over an odd `window` of samples; NaN samples are left out, the window shrinks
/// symmetrically at the ends. NaN where the window holds no value, and where the sample itself is
/// NaN. An even window is widened by one.
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

/// The sd of white noise on a moving signal, from the MAD of its third differences: they see no
/// quadratic, the median sees no steps and outliers. The resolution, as the least step between
/// samples, is the floor (uniform over one step). Samples that are no numbers are left out.
///
/// 0 for fewer than four neighbouring values.
pub fn noise_sd(y: &[f64]) -> f64 {
    let Some(fast) = fast_sd(y) else { return 0.0 };
    let step = least_step(y);
    fast.max(if step.is_finite() { step / 12f64.sqrt() } else { 0.0 })
}

/// The same of a signal that may be commanded, one of a few levels or of ramps: these are exact, and no
/// rounding.
pub fn commanded_sd(y: &[f64]) -> f64 {
    let known = || y.iter().filter(|v| v.is_finite());
    let range = known().fold(f64::NEG_INFINITY, |m, v| m.max(*v))
        - known().fold(f64::INFINITY, |m, v| m.min(*v));
    match least_step(y) > range / LEVELS || is_ramped(y) {
        true => fast_sd(y).unwrap_or(0.0),
        false => noise_sd(y),
    }
}

/// A signal that is rounded has so many steps of its resolution at least, one that is commanded fewer.
const LEVELS: f64 = 4.0;

/// Two steps are the same but for this share.
const SAME: f64 = 1e-6;

/// Whether a signal moves at a constant rate where it moves: most of its steps have one of the same size beside
/// them. One that is rounded steps now and then.
fn is_ramped(y: &[f64]) -> bool {
    let steps: Vec<f64> = y.windows(2).map(|w| w[1] - w[0]).collect();
    let same = |a: f64, b: f64| (a - b).abs() <= SAME * a.abs();
    let moves = |i: &usize| steps[*i].is_finite() && steps[*i] != 0.0;
    let beside = |i: &usize| {
        let before = i.checked_sub(1).is_some_and(|k| same(steps[*i], steps[k]));
        before || steps.get(i + 1).is_some_and(|next| same(steps[*i], *next))
    };
    let (all, alike) = (0..steps.len())
        .filter(moves)
        .fold((0, 0), |(all, alike), i| (all + 1, alike + usize::from(beside(&i))));
    2 * alike > all
}

/// By the third differences alone; none for fewer than four neighbouring values.
fn fast_sd(y: &[f64]) -> Option<f64> {
    let third =
        y.windows(4).map(|w| w[0] - 3.0 * w[1] + 3.0 * w[2] - w[3]).filter(|d| d.is_finite());
    let third: Vec<f64> = third.collect();
    // Var(e0 - 3 e1 + 3 e2 - e3) = 20 Var(e)
    (!third.is_empty()).then(|| mad_sd(&third) / 20f64.sqrt())
}

/// The least step between two samples; infinite where none differ.
fn least_step(y: &[f64]) -> f64 {
    let steps = y.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0);
    steps.fold(f64::INFINITY, f64::min)
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
        // On fast motion, with samples missing; and nothing but steps of the resolution.
        let wave = |i: usize| 3.0 * libm::sin(0.06 * i as f64);
        let moving: Vec<f64> = y
            .iter()
            .enumerate()
            .map(|(i, y)| if i % 50 == 7 { f64::NAN } else { y - 1e-3 * i as f64 + wave(i) })
            .collect();
        assert!((noise_sd(&moving) - 0.2).abs() < 0.015, "{}", noise_sd(&moving));
        let steps: Vec<f64> = (0..100).map(|i| [0.0, 0.04, -0.04][i / 10 % 3]).collect();
        assert!(commanded_sd(&steps) < 1e-15 && noise_sd(&steps) > 0.01);
        // Ramps of a surface with a constant rate are no rounding, slow motion that is rounded is.
        let ramps = |i: usize| (0.25 * (i % 40) as f64 - 2.0).clamp(-0.4, 1.1);
        let ramps: Vec<f64> = (0..200).map(ramps).collect();
        assert!(commanded_sd(&ramps) < 1e-12 && noise_sd(&ramps) > 0.01, "{}", noise_sd(&ramps));
        let coarse: Vec<f64> = (0..1000).map(|i| (0.01 * f64::from(i)).floor()).collect();
        assert!((noise_sd(&coarse) - 1.0 / 12f64.sqrt()).abs() < 1e-12);
        assert_eq!(commanded_sd(&coarse), noise_sd(&coarse));
    }
}
