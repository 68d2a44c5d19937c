//! A series in; its Fourier sum at one of its own frequencies out.

/// `sum x_j exp(i 2 pi k j / n)` over the `n` samples: real and imaginary part. The turn goes on
/// from sample to sample, without a sine for each.
pub fn sum(x: &[f64], k: usize) -> (f64, f64) {
    let (step_sin, step_cos) = libm::sincos(2.0 * std::f64::consts::PI * k as f64 / x.len() as f64);
    let (mut cos, mut sin, mut a, mut b) = (1.0, 0.0, 0.0, 0.0);
    for x in x {
        a += x * cos;
        b += x * sin;
        (cos, sin) = (cos * step_cos - sin * step_sin, sin * step_cos + cos * step_sin);
    }
    (a, b)
}

/// The series under a Hann window over its whole length.
pub fn hann(x: &[f64]) -> Vec<f64> {
    let turn = 2.0 * std::f64::consts::PI / x.len() as f64;
    x.iter().enumerate().map(|(j, x)| x * 0.5 * (1.0 - libm::cos(turn * j as f64))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tone_is_at_its_own_frequency_alone() {
        let n = 200;
        let tone: Vec<f64> = (0..n)
            .map(|j| libm::cos(2.0 * std::f64::consts::PI * 7.0 * j as f64 / n as f64))
            .collect();
        let size = |x: &[f64], k: usize| libm::hypot(sum(x, k).0, sum(x, k).1) / n as f64;
        assert!((size(&tone, 7) - 0.5).abs() < 1e-12 && size(&tone, 9) < 1e-12);
        // Under the window half of it, and a quarter beside it.
        let windowed = hann(&tone);
        let sizes = [6, 7, 8, 9].map(|k| size(&windowed, k));
        assert!(
            sizes.iter().zip([0.125, 0.25, 0.125, 0.0]).all(|(a, b)| (a - b).abs() < 1e-12),
            "{sizes:?}"
        );
    }
}
