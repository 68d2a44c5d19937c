//! Seeds and names in, independent reproducible streams of random numbers out.

use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng;

/// A stream of random numbers that depends on a seed and on names, and on nothing else: adding or
/// changing one sensor leaves the streams of all others as they are.
pub struct Stream {
    generator: Pcg64,
    spare: Option<f64>,
}

impl Stream {
    /// The stream of `names` (for example flight, topic, field, purpose) under `seed`.
    pub fn new(seed: u64, names: &[&str]) -> Self {
        let mut hash = blake3::Hasher::new();
        hash.update(&seed.to_le_bytes());
        for name in names {
            hash.update(&(name.len() as u64).to_le_bytes());
            hash.update(name.as_bytes());
        }
        let digest = hash.finalize();
        let half = |first: usize| {
            u128::from_le_bytes(std::array::from_fn(|i| digest.as_bytes()[first + i]))
        };
        Stream { generator: Pcg64::new(half(0), half(16)), spare: None }
    }

    /// Uniform in [0, 1), 53 bits.
    pub fn uniform(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Standard normal (polar method, Knuth, The Art of Computer Programming 2, 3.4.1, algorithm
    /// P).
    pub fn normal(&mut self) -> f64 {
        if let Some(x) = self.spare.take() {
            return x;
        }
        loop {
            let (u, v) = (2.0 * self.uniform() - 1.0, 2.0 * self.uniform() - 1.0);
            let s = u * u + v * v;
            if s > 0.0 && s < 1.0 {
                let f = (-2.0 * libm::log(s) / s).sqrt();
                self.spare = Some(v * f);
                return u * f;
            }
        }
    }

    /// Exponentially distributed with mean 1.
    pub fn exponential(&mut self) -> f64 {
        -libm::log(1.0 - self.uniform())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(values: &[f64]) -> [f64; 3] {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let moment = |k: i32| values.iter().map(|x| (x - mean).powi(k)).sum::<f64>() / n;
        [mean, moment(2), moment(4)]
    }

    #[test]
    fn normal_numbers_have_the_moments_of_the_normal_distribution() {
        let mut stream = Stream::new(1, &["a"]);
        let values: Vec<f64> = (0..200_000).map(|_| stream.normal()).collect();
        let [mean, second, fourth] = moments(&values);
        // Standard errors 1/sqrt(n), sqrt(2/n), sqrt(96/n): 0.0022, 0.0032, 0.022; four of each.
        assert!(
            mean.abs() < 0.009 && (second - 1.0).abs() < 0.013 && (fourth - 3.0).abs() < 0.09,
            "{mean} {second} {fourth}"
        );
        let pairs: f64 = values.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / values.len() as f64;
        assert!(pairs.abs() < 0.009, "{pairs}");
    }

    #[test]
    fn exponential_numbers_have_mean_and_deviation_one() {
        let mut stream = Stream::new(1, &["a"]);
        let values: Vec<f64> = (0..100_000).map(|_| stream.exponential()).collect();
        let [mean, second, _] = moments(&values);
        assert!((mean - 1.0).abs() < 0.013 && (second - 1.0).abs() < 0.04, "{mean} {second}");
    }

    #[test]
    fn streams_differ_by_seed_and_by_name_and_repeat() {
        let first = |seed, names: &[&str]| Stream::new(seed, names).uniform();
        assert_eq!(first(1, &["a", "b"]), first(1, &["a", "b"]));
        assert_ne!(first(1, &["a", "b"]), first(2, &["a", "b"]));
        assert_ne!(first(1, &["a", "b"]), first(1, &["ab"]));
        assert_ne!(first(1, &["a", "b"]), first(1, &["b", "a"]));
    }

    #[test]
    fn the_generator_is_a_named_one_whose_numbers_stay() {
        let mut stream = Stream::new(1, &["flight-01"]);
        let numbers = [stream.uniform(), stream.uniform()];
        let digest = blake3::hash(
            &[&1u64.to_le_bytes()[..], &9u64.to_le_bytes()[..], b"flight-01"].concat(),
        );
        let half = |i: usize| {
            u128::from_le_bytes(digest.as_bytes()[16 * i..16 * i + 16].try_into().unwrap())
        };
        let mut generator = Pcg64::new(half(0), half(1));
        let expected: Vec<f64> =
            (0..2).map(|_| (generator.next_u64() >> 11) as f64 / 9_007_199_254_740_992.0).collect();
        assert_eq!(numbers.to_vec(), expected);
    }
}
