//! A measured signal in; the size of the noise that is on it, out.
//!
//! It is read from the measurements alone: the median of the absolute second differences, which signals that are
//! smooth on the scale of two samples do not reach (white noise of variance 1 has second differences of variance 6).

use crate::math::mad_sd;

/// Standard deviation of the noise of a smooth signal.
pub fn noise(z: &[f64]) -> f64 {
    let second: Vec<f64> = z.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).filter(|v| v.is_finite()).collect();
    mad_sd(&second) / 6f64.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Stream;

    #[test]
    fn noise_is_read_below_a_smooth_signal() {
        let mut stream = Stream::new(1, &["gaps"]);
        let z: Vec<f64> = (0..4000).map(|k| 5.0 * libm::sin(0.05 * f64::from(k)) + 0.1 * stream.normal()).collect();
        assert!((noise(&z) / 0.1 - 1.0).abs() < 0.08, "{}", noise(&z));
    }
}
