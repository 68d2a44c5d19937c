//! 95% intervals cover the truth about 95 times in 100, with white and with coloured noise.

use super::{Settings, TOY_TRUTH, Toy, sds};
use crate::estimate::Stop;
use rayon::prelude::*;

/// Share of intervals `value +- 1.96 sd` over the truth, pooled and per parameter, for `sd` and for `sd_crlb`.
fn coverage(trials: u64, rho: f64) -> ([f64; 2], Vec<[f64; 2]>) {
    let settings = Settings::default();
    let hits: Vec<Vec<[bool; 2]>> = (0..trials)
        .into_par_iter()
        .map(|seed| {
            let solution = Toy::simulate(seed, 3, 400, 0.1, rho).solve(&settings);
            assert_eq!(solution.fit.stop, Stop::Converged, "trial {seed}");
            let (sd, crlb) = (sds(solution.covariance.as_ref().unwrap()), sds(solution.crlb.as_ref().unwrap()));
            let truth = [TOY_TRUTH[0], TOY_TRUTH[1], 0.0, 0.1, 0.2];
            (0..5)
                .map(|i| {
                    let miss = (solution.fit.theta[i] - truth[i]).abs();
                    [miss <= 1.96 * sd[i], miss <= 1.96 * crlb[i]]
                })
                .collect()
        })
        .collect();
    let share = |i: usize, which: usize| hits.iter().filter(|h| h[i][which]).count() as f64 / trials as f64;
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
    assert!((0.92..=0.97).contains(&pooled[0]), "{pooled:?}");
    assert!(pooled[1] < 0.7, "{pooled:?}");
}
