//! 95% intervals cover the truth about 95 times in 100, with white and with coloured noise.

use super::{Settings, TOY_TRUTH, Toy, noise, normal, rng, sds, toy_response};
use crate::estimate::Stop;
use crate::noise::OrderCriterion;
use rayon::prelude::*;

/// Share of intervals `value +- 1.96 sd` over the truth, pooled and per parameter, for `sd` and for
/// `sd_crlb`.
fn coverage(trials: u64, rho: f64) -> ([f64; 2], Vec<[f64; 2]>) {
    let settings = Settings::default();
    let hits: Vec<Vec<[bool; 2]>> = (0..trials)
        .into_par_iter()
        .map(|seed| {
            let solution = Toy::simulate(seed, 3, 400, 0.1, rho).solve(&settings);
            assert_eq!(solution.fit.stop, Stop::Converged, "trial {seed}");
            let (sd, crlb) =
                (sds(solution.covariance.as_ref().unwrap()), sds(solution.crlb.as_ref().unwrap()));
            let truth = [TOY_TRUTH[0], TOY_TRUTH[1], 0.0, 0.1, 0.2];
            (0..5)
                .map(|i| {
                    let miss = (solution.fit.theta[i] - truth[i]).abs();
                    [miss <= 1.96 * sd[i], miss <= 1.96 * crlb[i]]
                })
                .collect()
        })
        .collect();
    let share =
        |i: usize, which: usize| hits.iter().filter(|h| h[i][which]).count() as f64 / trials as f64;
    let each: Vec<[f64; 2]> = (0..5).map(|i| [share(i, 0), share(i, 1)]).collect();
    let pooled = [0, 1].map(|w| each.iter().map(|e| e[w]).sum::<f64>() / 5.0);
    (pooled, each)
}

#[test]
fn white_noise() {
    let (pooled, each) = coverage(500, 0.0);
    println!("white: corrected {:.3}, Cramer-Rao {:.3}; each {each:.3?}", pooled[0], pooled[1]);
    assert!((0.93..=0.97).contains(&pooled[0]), "{pooled:?}");
    assert!((0.93..=0.97).contains(&pooled[1]), "{pooled:?}");
    assert!(each.iter().all(|e| (0.91..=0.98).contains(&e[0])), "{each:?}");
}

#[test]
fn coloured_noise() {
    let (pooled, each) = coverage(500, 0.9);
    println!("coloured: corrected {:.3}, Cramer-Rao {:.3}; each {each:.3?}", pooled[0], pooled[1]);
    assert!((0.93..=0.97).contains(&pooled[0]), "{pooled:?}");
    assert!(pooled[1] < 0.7, "{pooled:?}");
}

/// What noise one segment gets, from a seed.
type Noise = fn(u64, usize) -> Vec<f64>;

/// White noise and a third of its size of slow noise.
fn slow(seed: u64, n: usize, rho: f64) -> Vec<f64> {
    let mut rng = rng(seed);
    let (white, slow) = (noise(&mut rng, n, 0.1, 0.0), noise(&mut rng, n, 0.1 / 3.0, rho));
    white.iter().zip(&slow).map(|(w, s)| w + s).collect()
}

/// An oscillation of period 20 samples, hardly damped.
fn oscillation(seed: u64, n: usize) -> Vec<f64> {
    let mut rng = rng(seed);
    let mut v = vec![0.0, 0.0];
    for k in 2..n + 302 {
        v.push(1.8 * v[k - 1] - 0.9 * v[k - 2] + 0.02 * normal(&mut rng));
    }
    v.split_off(302)
}

const COLOURS: [(&str, Noise); 7] = [
    ("white", |seed, n| noise(&mut rng(seed), n, 0.1, 0.0)),
    ("AR(1) 0.9", |seed, n| noise(&mut rng(seed), n, 0.1, 0.9)),
    ("AR(1) 0.97", |seed, n| noise(&mut rng(seed), n, 0.1, 0.97)),
    ("AR(1) 0.99", |seed, n| noise(&mut rng(seed), n, 0.1, 0.99)),
    ("white + 1/3 slow 0.97", |seed, n| slow(seed, n, 0.97)),
    ("white + 1/3 slow 0.99", |seed, n| slow(seed, n, 0.99)),
    ("AR(2) oscillation", oscillation),
];

/// Pooled coverage of the two common parameters and of all five.
fn coverage_of(make: Noise, settings: &Settings, trials: u64) -> [f64; 2] {
    let truth = [TOY_TRUTH[0], TOY_TRUTH[1], 0.0, 0.1, 0.2];
    let hits: Vec<[bool; 5]> = (0..trials)
        .into_par_iter()
        .map(|trial| {
            let segment = |s: usize| -> Vec<f64> {
                let (y, _) = toy_response(400, &[truth[0], truth[1], truth[2 + s]]);
                y.iter().zip(make(10_000 + 3 * trial + s as u64, 400)).map(|(y, v)| y + v).collect()
            };
            let solution = Toy { z: (0..3).map(segment).collect() }.solve(settings);
            let sd = sds(solution.covariance.as_ref().unwrap());
            std::array::from_fn(|i| (solution.fit.theta[i] - truth[i]).abs() <= 1.96 * sd[i])
        })
        .collect();
    let share = |of: std::ops::Range<usize>| {
        let (n, count) =
            (of.len() as f64, hits.iter().flat_map(|h| &h[of.clone()]).filter(|hit| **hit).count());
        count as f64 / n / trials as f64
    };
    [share(0..2), share(0..5)]
}

/// Which criterion for the order does both jobs: short where the noise is simple, long enough for
/// slow noise hidden under white.
#[test]
fn recovery_coverage_by_order_criterion() {
    println!("coverage of 95% intervals (common parameters, all parameters)");
    for (name, make) in COLOURS {
        let decides = name == "white + 1/3 slow 0.97";
        let of = |ar_order| coverage_of(make, &Settings { ar_order, ..Settings::default() }, 500);
        let (white, bic) = (of(OrderCriterion::White), of(OrderCriterion::Bic));
        println!("{name:22} white {white:.3?}  bic {bic:.3?}");
        assert!(
            (0.92..=0.98).contains(&white[0]) && (0.93..=0.97).contains(&white[1]),
            "{name}: {white:?}"
        );
        assert!(!decides || bic[1] < 0.90, "the shorter models of BIC cover as much: {bic:?}");
    }
}
