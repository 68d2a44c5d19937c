//! A sampled signal in; where it stops to flicker, as that of a live sensor does, and stands still,
//! out.
//!
//! Noise larger than the resolution moves every reading of a live sensor up and down. Commands,
//! switches and what a recorder holds do not flicker, so nothing is said of them.

use std::ops::Range;

/// A run of equal samples shorter than this is none, s.
const SHORTEST_S: f64 = 1.0;
/// Samples before a run that tell whether the signal flickers: at most, and at least.
const BEFORE: usize = 200;
const FEWEST: usize = 50;
/// A signal flickers where at least this share of neighbours differ,
const MOVES: f64 = 0.25;
/// and at least this share of the changes go against the one before: two in three do in white
/// noise, hardly any in a smooth motion.
const TURNS: f64 = 0.25;
/// The run is longer than any other by this factor.
const ALONE: usize = 10;
/// The signal stands still where so many equal samples in a row are less likely than this.
const UNLIKELY: f64 = 1e-9;

/// The time (indices of the samples) in which a signal stands still that flickered until then, and
/// never stood still for nearly as long: a sensor that is often at rest is judged by no rest. Times
/// ascend, values are finite.
pub fn longest(t: &[f64], y: &[f64]) -> Option<Range<usize>> {
    let mut runs = runs(y);
    runs.sort_by_key(|run| std::cmp::Reverse(run.len()));
    let run = runs.first()?.clone();
    let alone = runs.get(1).is_none_or(|other| ALONE * other.len() < run.len());
    (alone && t[run.end - 1] - t[run.start] >= SHORTEST_S && stops(y, &run)).then_some(run)
}

/// Whether `run`, samples of one value, begins where the signal flickered, and is longer than
/// chance makes it.
fn stops(y: &[f64], run: &Range<usize>) -> bool {
    let before = &y[run.start.saturating_sub(BEFORE)..=run.start];
    let changes: Vec<f64> =
        before.windows(2).map(|pair| pair[1] - pair[0]).filter(|change| *change != 0.0).collect();
    let (pairs, moves) = ((before.len() - 1) as f64, changes.len() as f64);
    let turns = changes.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count() as f64;
    let flickers = before.len() > FEWEST && moves >= MOVES * pairs && turns >= TURNS * moves;
    let equal = (pairs - moves + 1.0) / (pairs + 2.0);
    flickers && run.len() as f64 * libm::log(equal) < libm::log(UNLIKELY)
}

/// Runs of equal samples, in their order.
fn runs(y: &[f64]) -> Vec<Range<usize>> {
    let mut begin = 0;
    let range = |run: &[f64]| {
        begin += run.len();
        begin - run.len()..begin
    };
    y.chunk_by(|a, b| a == b).map(range).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Slow motion with noise, in steps of `resolution`, 50 times a second.
    fn sensor(noise: f64, resolution: f64) -> (Vec<f64>, Vec<f64>) {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        let t: Vec<f64> = (0..4000).map(|k| 0.02 * k as f64).collect();
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let y = t
            .iter()
            .map(|t| {
                ((2.0 * libm::sin(0.5 * t) + noise * normal()) / resolution).round() * resolution
            })
            .collect();
        (t, y)
    }

    #[test]
    fn fault_a_sensor_that_freezes_for_good_is_found_however_coarse() {
        for resolution in [1e-6, 0.005, 0.05, 0.1] {
            let (t, mut y) = sensor(0.05, resolution);
            assert_eq!(longest(&t, &y), None, "{resolution}");
            let held = y[2000];
            y[2000..].fill(held);
            let run = longest(&t, &y).expect("still");
            assert!((1990..=2000).contains(&run.start) && run.end == 4000, "{resolution}: {run:?}");
        }
    }

    #[test]
    fn what_does_not_flicker_is_not_judged() {
        // a command, a smooth signal that comes to rest, a slow one in steps
        let t: Vec<f64> = (0..4000).map(|k| 0.02 * k as f64).collect();
        let command: Vec<f64> =
            t.iter().map(|t| if (20.0..27.0).contains(t) { 2.5 } else { 0.0 }).collect();
        let rest: Vec<f64> =
            t.iter().map(|t| if *t < 40.0 { libm::sin(t - 40.0) } else { 0.0 }).collect();
        let steps: Vec<f64> = t.iter().map(|t| (2.0 * libm::sin(0.1 * t)).round() * 0.5).collect();
        // at rest, moved with noise that shows only then, at rest again
        let (_, noisy) = sensor(0.05, 0.2);
        let twice: Vec<f64> = t
            .iter()
            .zip(noisy)
            .map(|(t, y)| if (20.0..50.0).contains(t) { y } else { 0.0 })
            .collect();
        for y in [command, rest, steps, twice] {
            assert_eq!(longest(&t, &y), None);
        }
        assert_eq!(longest(&[], &[]), None);
    }
}
