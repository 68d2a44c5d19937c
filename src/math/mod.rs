//! Small mathematics used on every floor: dense matrices in flat slices, quantiles of
//! distributions, interpolation, Fourier sums, vectors of the width the machine has.

pub mod combined;
pub mod complex;
pub mod dense;
mod digits;
pub mod distribution;
pub mod eigen;
pub mod fourier;
pub mod interpolate;
pub mod mixed;
pub mod pool;
pub mod products;
pub mod simd;
mod tiles;
pub mod turned;

pub use digits::digits;

/// Whether all numbers are finite; all are looked at, so that several are at once.
pub fn all_finite(numbers: &[f64]) -> bool {
    !numbers.iter().fold(false, |any, x| any | !x.is_finite())
}

/// The median of finite values (the mean of the middle two of an even number); NaN for none.
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// The quantile `p` (0..=1) of finite values, interpolated linearly between order statistics; NaN
/// for none.
pub fn quantile(values: &[f64], p: f64) -> f64 {
    let mut v = values.to_vec();
    let last = match v.len() {
        0 => return f64::NAN,
        n => n - 1,
    };
    let position = p.clamp(0.0, 1.0) * last as f64;
    let below = position.floor() as usize;
    let (_, &mut low, above) = v.select_nth_unstable_by(below, f64::total_cmp);
    let high = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    if position == below as f64 { low } else { low + (position - below as f64) * (high - low) }
}

/// The median absolute deviation from the median, times 1.4826: the sd where the values are normal,
/// deaf to outliers.
pub fn mad_sd(values: &[f64]) -> f64 {
    let middle = median(values);
    let deviations: Vec<f64> = values.iter().map(|v| (v - middle).abs()).collect();
    1.4826 * median(&deviations)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        let v = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(median(&v), 2.5);
        assert_eq!((quantile(&v, 0.0), quantile(&v, 1.0)), (1.0, 4.0));
        assert!((quantile(&v, 0.9) - 3.7).abs() < 1e-15);
        assert_eq!(median(&[7.0, 1.0, 2.0]), 2.0);
        assert!(median(&[]).is_nan() && mad_sd(&[]).is_nan());
    }

    #[test]
    fn one_number_that_is_not_finite_is_found() {
        let mut numbers = [1.0, -2.0, 0.0, f64::MAX, f64::MIN_POSITIVE, 3.0, 4.0];
        assert!(all_finite(&numbers) && all_finite(&[]));
        for k in 0..numbers.len() {
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let good = std::mem::replace(&mut numbers[k], bad);
                assert!(!all_finite(&numbers), "{k} {bad}");
                numbers[k] = good;
            }
        }
    }

    #[test]
    fn mad_ignores_outliers() {
        assert_eq!(mad_sd(&[1.0, 2.0, 3.0, 4.0, 1e9]), 1.4826);
    }
}
