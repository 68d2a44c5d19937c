//! A screening in; what its best candidate gains in campaigns in which nothing is missing, out.
//!
//! A surrogate campaign has coloured noise from the base fit's autoregressive models and nothing
//! else. Whitened, that is white noise `w` of unit variance, and the slopes of the candidates'
//! projected columns are `u = H~'w`: a surrogate takes the very projections of the screening (their
//! sums of samples, `projected`), without a single simulation.

use super::screening::Screening;
use crate::diagnose::settings::Settings;
use crate::diagnose::thresholds::Thresholds;
use crate::math::distribution::chi2_quantile;
use crate::simulate::Stream;
use rayon::prelude::*;

/// Surrogates that are drawn at once.
const AT_ONCE: usize = 16;

/// What a candidate of `k` parameters gains by chance with this probability, if it is looked at
/// alone: half the quantile of chi-square. Candidates of different numbers of parameters compare
/// after it is taken off.
pub fn chance(k: usize, false_alarm: f64) -> f64 {
    if k == 0 { 0.0 } else { 0.5 * chi2_quantile(1.0 - false_alarm, k as f64) }
}

/// What a score (a gain less what chance gives it alone) must exceed so that the gain itself is
/// `factor` times that of the best by chance: noise stronger than it is taken for makes every gain
/// larger by its factor, and what chance gives with it. `limit`: the best score by chance.
pub fn times(factor: f64, limit: f64, k: usize, thresholds: &Thresholds) -> f64 {
    let chance = chance(k.max(1), thresholds.false_alarm);
    factor * (limit + chance) - chance
}

/// Best score of each surrogate, ascending; those that take no part (`round::takes_part`) are no
/// candidates here.
pub fn best_of_surrogates(
    screening: &Screening,
    takes_part: &[bool],
    settings: &Settings,
) -> Vec<f64> {
    let chances: Vec<f64> = screening
        .screened
        .iter()
        .map(|s| chance(s.taken, settings.thresholds.false_alarm))
        .collect();
    let sums = screening.sums();
    let noise = |i: usize| {
        let mut stream = Stream::new(settings.seed, &["diagnose", "surrogate", &i.to_string()]);
        (0..sums).map(|_| stream.normal()).collect::<Vec<f64>>()
    };
    let some = |from: usize| {
        let to = (from + AT_ONCE).min(settings.surrogates);
        let noise: Vec<Vec<f64>> = (from..to).map(noise).collect();
        let score = |gains: Vec<f64>| {
            let scores = gains.into_iter().zip(&chances).map(|(gain, chance)| gain - chance);
            scores.fold(0.0, f64::max)
        };
        screening.gains(&noise, takes_part).into_iter().map(score).collect::<Vec<f64>>()
    };
    let starts: Vec<usize> = (0..settings.surrogates).step_by(AT_ONCE).collect();
    let mut best: Vec<f64> = starts.into_par_iter().flat_map_iter(some).collect();
    best.sort_by(f64::total_cmp);
    best
}
