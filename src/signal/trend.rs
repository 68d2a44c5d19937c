//! A sampled signal that should only fall in; where it rises all the same, beyond its noise, out.
//!
//! Means over blocks are compared, each with the lowest one before it. The noise is that of
//! neighbouring samples, in which a slow change of the signal itself does not count.

/// Length of a block, s, and samples it needs at least.
const BLOCK_S: f64 = 10.0;
const FEWEST: usize = 5;
/// A rise counts beyond this many standard deviations of the difference of two means; among some
/// hundred blocks chance makes none of six.
const CERTAIN: f64 = 6.0;

/// A rise between the middles of two blocks, by so much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rise {
    pub from_s: f64,
    pub to_s: f64,
    pub by: f64,
}

/// The largest rise of the signal, in its unit, where it is more than noise. Times ascend, values
/// are finite.
pub fn rise(t: &[f64], y: &[f64]) -> Option<Rise> {
    let pairs = y.len().saturating_sub(1).max(1) as f64;
    let noise = y.windows(2).map(|p| (p[1] - p[0]) * (p[1] - p[0])).sum::<f64>() / (2.0 * pairs);
    let blocks = blocks(t, y);
    let (mut lowest, mut largest) = (*blocks.first()?, None::<Rise>);
    for block in blocks {
        let by = block.mean - lowest.mean;
        let sd = libm::sqrt(noise * (1.0 / block.n + 1.0 / lowest.n));
        if by > CERTAIN * sd && largest.is_none_or(|r| by > r.by) {
            largest = Some(Rise { from_s: lowest.middle_s, to_s: block.middle_s, by });
        }
        if by < 0.0 {
            lowest = block;
        }
    }
    largest
}

#[derive(Clone, Copy)]
struct Block {
    middle_s: f64,
    mean: f64,
    n: f64,
}

/// Means over stretches of `BLOCK_S`; a stretch with fewer samples than `FEWEST` is passed over.
fn blocks(t: &[f64], y: &[f64]) -> Vec<Block> {
    let Some(first) = t.first() else { return Vec::new() };
    let index = |t: f64| libm::floor((t - first) / BLOCK_S);
    let mut from = 0;
    let stretches = t.chunk_by(|a, b| index(*a) == index(*b)).map(|stretch| {
        from += stretch.len();
        from - stretch.len()..from
    });
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    stretches
        .filter(|range| range.len() >= FEWEST)
        .map(|range| Block {
            middle_s: mean(&t[range.clone()]),
            mean: mean(&y[range.clone()]),
            n: range.len() as f64,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// A gauge that falls by 0.4 a second, with noise, 5 times a second.
    fn gauge(seed: u64, noise: f64) -> (Vec<f64>, Vec<f64>) {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        let t: Vec<f64> = (0..2000).map(|k| 0.2 * k as f64).collect();
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let y = t.iter().map(|t| 3000.0 - 0.4 * t + noise * normal()).collect();
        (t, y)
    }

    #[test]
    fn noise_makes_no_rise() {
        for seed in 0..50 {
            for noise in [0.0, 1.0, 8.0, 100.0] {
                let (t, y) = gauge(seed, noise);
                assert_eq!(rise(&t, &y), None, "{seed} {noise}");
            }
        }
        assert_eq!(rise(&[], &[]), None);
        assert_eq!(rise(&[0.0], &[1.0]), None);
    }

    #[test]
    fn fault_a_rise_is_found_with_its_size_and_place() {
        let (t, mut y) = gauge(1, 8.0);
        t.iter().zip(&mut y).filter(|(t, _)| **t >= 200.0).for_each(|(_, y)| *y += 60.0);
        let rise = rise(&t, &y).expect("a rise");
        assert!((rise.by - 56.0).abs() < 6.0, "{rise:?}");
        assert!((rise.from_s - 195.0).abs() < 1.0 && (rise.to_s - 205.0).abs() < 1.0, "{rise:?}");
    }
}
