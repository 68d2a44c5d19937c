//! A base at its fit in; held-out maneuvers that it misses by more than it does those that it was
//! fitted to, out.
//!
//! What only a held-out maneuver shows (a stop that no other reaches) no candidate can gain on the
//! training maneuvers. But "nothing is missing" would be false. Maneuvers differ, in gusts above
//! all: the squares per sample, whitened, of the training ones are taken as draws of a lognormal,
//! and a held-out one is one more of them unless it lies above their prediction limit, Student's t
//! on the logarithms (no narrower than chi-square's own scatter). Flights differ, too: in rough air
//! the squares are larger and scatter more than those of calm flights say. So it has to lie above
//! the limit of its own flight as well, where enough maneuvers of that flight are known.

use crate::diagnose::base::found::Found;
use crate::diagnose::base::frozen::Frozen;
use crate::diagnose::settings::Settings;
use crate::estimate::Case;
use crate::math::distribution::t_quantile;

/// A held-out maneuver that is missed.
#[derive(Debug, Clone, PartialEq)]
pub struct Missed {
    /// Index among the segments.
    pub segment: usize,
    /// Squares of the whitened residuals per sample, infinite where the model does not run, and
    /// what they may be.
    pub per_sample: f64,
    pub limit: f64,
}

/// Held-out maneuvers above the limit; in one of `1/(1 - quantile)` campaigns with nothing missing
/// there is one.
pub fn missed(found: &Found, case: &Case, settings: &Settings) -> Vec<Missed> {
    let samples = |s: usize| -> usize {
        let channels = &case.records[s].channels;
        channels.iter().map(|channel| channel.z.iter().filter(|z| z.is_finite()).count()).sum()
    };
    let flight = |s: usize| {
        let labels = &found.prepared.segments[found.prepared.used[s]].labels;
        labels.get("flight").cloned()
    };
    let training: Vec<Trained> = found
        .places
        .training
        .iter()
        .zip(&found.fit.costs)
        .map(|(&s, &cost)| Trained { flight: flight(s), cost, samples: samples(s) })
        .filter(|t| t.samples > 0)
        .collect();
    let cost = |frozen: &Option<Frozen>| frozen.as_ref().map_or(f64::INFINITY, |f| f.squares);
    let held_out = found
        .places
        .held_out
        .iter()
        .zip(&found.frozen)
        .map(|(&s, frozen)| (s, cost(frozen), samples(s)));
    let held_out: Vec<(usize, f64, usize)> = held_out.filter(|h| h.2 > 0).collect();
    let share = (1.0 - settings.quantile) / held_out.len().max(1) as f64;
    let above = |(s, cost, n): (usize, f64, usize)| {
        // Where too few are known to tell what is too much, a model that does not run is.
        let fewest = settings.thresholds.fewest;
        let limit = limit_in(&training, flight(s), n, share, fewest).unwrap_or(f64::MAX);
        let per_sample = 2.0 * cost / n as f64;
        (per_sample > limit).then_some(Missed {
            segment: found.prepared.used[s],
            per_sample,
            limit,
        })
    };
    held_out.into_iter().filter_map(above).collect()
}

/// A maneuver of the training.
struct Trained {
    flight: Option<String>,
    cost: f64,
    samples: usize,
}

/// The higher one of the limits of all maneuvers, and of those of the same flight.
fn limit_in(
    training: &[Trained],
    flight: Option<String>,
    n: usize,
    share: f64,
    fewest: usize,
) -> Option<f64> {
    let of = |which: &dyn Fn(&Trained) -> bool| {
        let these = training.iter().filter(|t| which(t)).map(|t| (t.cost, t.samples));
        limit(&these.collect::<Vec<_>>(), n, share, fewest)
    };
    let same = |t: &Trained| flight.is_some() && t.flight == flight;
    let (all, own) = (of(&|_| true), of(&same));
    all.map(|all| own.map_or(all, |own| all.max(own)))
}

/// What another maneuver of `n` samples exceeds with this probability; none where too few are
/// known. `training`: cost and samples of each.
fn limit(training: &[(f64, usize)], n: usize, share: f64, fewest: usize) -> Option<f64> {
    let logs: Vec<f64> = training
        .iter()
        .map(|&(cost, n)| libm::log(2.0 * cost / n as f64))
        .filter(|v| v.is_finite())
        .collect();
    let count = logs.len() as f64;
    if logs.len() < fewest {
        return None;
    }
    let mean = logs.iter().sum::<f64>() / count;
    let variance = logs.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (count - 1.0);
    let sd = variance.max(2.0 / n as f64).sqrt();
    Some(libm::exp(mean + t_quantile(1.0 - share, count - 1.0) * sd * (1.0 + count.recip()).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn coverage_another_maneuver_of_the_same_kind_is_seldom_missed() {
        let mut random = rand_pcg::Pcg64::seed_from_u64(3);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        // Gusts whose size differs from maneuver to maneuver by a third.
        let mut one = |n: usize| {
            let size = libm::exp(0.3 * normal());
            let squares: f64 = (0..n).map(|_| size * normal()).map(|e| e * e).sum();
            (0.5 * squares, n)
        };
        let trials = 2000;
        let hits = (0..trials).filter(|_| {
            let training: Vec<(f64, usize)> = (0..8).map(|_| one(200)).collect();
            let (cost, n) = one(200);
            2.0 * cost / n as f64 > limit(&training, n, 0.05, 3).expect("enough")
        });
        let share = hits.count() as f64 / f64::from(trials);
        assert!(
            (share - 0.05).abs() < 3.0 * (0.05f64 * 0.95 / f64::from(trials)).sqrt(),
            "{share}"
        );
        assert_eq!(limit(&[(100.0, 200), (100.0, 200)], 200, 0.05, 3), None);
    }

    #[test]
    fn coverage_a_maneuver_in_rough_air_is_one_of_its_own_flight() {
        let mut random = rand_pcg::Pcg64::seed_from_u64(4);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        // Two calm flights, and a third in which gusts differ from maneuver to maneuver.
        let mut one = |flight: usize| {
            let size = if flight == 2 { libm::exp(0.1 + 0.2 * normal()) } else { 1.0 };
            let squares: f64 = (0..400).map(|_| size * normal()).map(|e| e * e).sum();
            Trained { flight: Some(flight.to_string()), cost: 0.5 * squares, samples: 400 }
        };
        let trials = 2000;
        let (mut by_all, mut by_both) = (0, 0);
        for _ in 0..trials {
            let training: Vec<Trained> = (0..21).map(|k| one(k % 3)).collect();
            let held_out = one(2);
            let per_sample = 2.0 * held_out.cost / 400.0;
            let flight = held_out.flight.clone();
            let all: Vec<(f64, usize)> = training.iter().map(|t| (t.cost, t.samples)).collect();
            by_all += usize::from(per_sample > limit(&all, 400, 0.01, 3).expect("enough"));
            let both = limit_in(&training, flight, 400, 0.01, 3).expect("enough");
            by_both += usize::from(per_sample > both);
        }
        // By all flights together one in eight, where one in a hundred is meant.
        let share = by_both as f64 / trials as f64;
        let scatter = (0.01 * 0.99 / trials as f64).sqrt();
        assert!(by_all > trials / 20 && share < 0.01 + 3.0 * scatter, "{by_all} {by_both}");
    }
}
