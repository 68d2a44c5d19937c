//! A fit's residuals in; whether any output still responds to any input or to the motion, whatever
//! the reason, out.
//!
//! Two questions are asked of every output and every source (`sources`). Does the *output* answer:
//! is its residual, whitened by its own filter, a response to the source (whitened likewise)? That
//! finds errors of sensors, and what is fast. Does something *act*: is what is new at each instant,
//! given the past of all outputs, foretold by what the source does just then (`innovation`)? That
//! finds what is missing in forces and moments, in gusts as well.
//!
//! The response is common to all maneuvers: no effect needs to be named for it. Regressors are not
//! projected on the base's sensitivities; since the residuals are orthogonal to those at the fit,
//! that can only make the gain smaller than it is. Held-out maneuvers must confirm it with the
//! coefficients of the training.
//!
//! Noise whose size comes and goes (buffet, a burst of turbulence) makes the score `u = X'e` vary
//! more than `X'X` says where the source is large at the same instants. A pair is therefore only
//! real if its gain also exceeds chance with `u`'s variance as it is, `X' diag(e^2) X` (White,
//! Econometrica 48, 1980).

use super::gain::gain;
use super::innovation;
use super::sources::Sources;
use super::sums::{Size, Sums, best, sums, together};
use super::whitening::Noise;
use crate::diagnose::settings::Settings;
use crate::diagnose::subject::Places;
use crate::estimate::Case;
use crate::math::products::Gram;

/// An output that still responds to a source.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    pub output: String,
    pub source: String,
    /// Gain in log-likelihood of the impulse response over the training maneuvers, and what it must
    /// exceed.
    pub gain: f64,
    pub limit: f64,
    /// Realised with the same response over the held-out ones; NaN without any.
    pub held_out: f64,
}

impl Located {
    /// Whether it is more than noise.
    pub fn is_real(&self) -> bool {
        self.gain > self.limit && !(self.held_out < 0.0)
    }
}

/// Every pair of output and source. `theta`: parameters per segment place (held-out ones have own
/// parameters of theirs).
pub fn locate(
    case: &Case,
    noise: &Noise,
    places: &Places,
    theta: &dyn Fn(usize) -> Vec<f64>,
    settings: &Settings,
) -> Vec<Located> {
    let thresholds = &settings.thresholds;
    let at: Vec<Vec<f64>> = (0..case.records.len()).map(theta).collect();
    // Half of what chance is allowed for each of both questions.
    let chance = thresholds.question_share * (1.0 - settings.quantile);
    let sources = |motion: bool| Sources::of(case, &places.training, chance, motion, thresholds);
    let (responding, foretelling) = (sources(false), sources(true));
    let responses =
        |of: &Sources, s: usize, size| sums(case, noise, of, s, &at[s], &|_| Some(&None), size);
    let mut found = rows(case, &responding, places, "", &responses, thresholds.ridge);
    let foretold =
        |of: &Sources, s: usize, size| innovation::sums(case, noise, of, s, &at[s], size);
    found.extend(rows(case, &foretelling, places, innovation::HOW, &foretold, thresholds.ridge));
    found.sort_by(|a, b| (b.gain - b.limit).total_cmp(&(a.gain - a.limit)));
    found
}

/// Sums of a segment: sources, its place, how the residuals' size is taken.
type Of<'a> = dyn Fn(&Sources, usize, Size) -> Vec<Sums> + Sync + 'a;

/// The best source of every group for every output.
fn rows(
    case: &Case,
    sources: &Sources,
    places: &Places,
    how: &str,
    of: &Of,
    ridge: f64,
) -> Vec<Located> {
    let alike = |s: usize| of(sources, s, Size::Alike);
    let (training, held_out) = (
        together(case, sources, &places.training, &alike),
        together(case, sources, &places.held_out, &alike),
    );
    let n = sources.all.len();
    // Gain, coefficients and pair.
    let mut most: Vec<Option<(f64, Vec<f64>, usize)>> =
        vec![None; case.outputs.len() * sources.groups];
    for (i, gram) in training.iter().enumerate() {
        let Some((gain, b)) = best(gram, ridge) else { continue };
        let row = &mut most[i / n * sources.groups + sources.all[i % n].group];
        if row.as_ref().is_none_or(|row| row.0 < gain) {
            *row = Some((gain, b, i));
        }
    }
    let mut most: Vec<(f64, Vec<f64>, usize)> = most.into_iter().flatten().collect();
    let clear = |m: &(f64, Vec<f64>, usize)| m.0 > sources.all[m.2 % n].limit;
    let asked =
        sources.only(&most.iter().filter(|m| clear(m)).map(|m| m.2 % n).collect::<Vec<_>>());
    // Nothing is asked of the flights again where nothing is clear.
    let again: &[usize] = if asked.1.is_empty() { &[] } else { &places.training };
    let varied = together(case, &asked.0, again, &|s| of(&asked.0, s, Size::AsItIs));
    for (gain, _, i) in most.iter_mut().filter(|m| clear(m)) {
        let at = asked.1.iter().position(|&source| source == *i % n).unwrap_or_default();
        *gain = gain.min(by_size(&training[*i], &varied[*i / n * asked.1.len() + at], ridge));
    }
    let row = |(gain, b, i): (f64, Vec<f64>, usize)| {
        let (source, hold, e) = (&sources.all[i % n], &held_out[i], b.len());
        let square: f64 =
            (0..e).map(|i| (0..e).map(|j| b[i] * b[j] * hold.at(i, j)).sum::<f64>()).sum();
        let realised = (0..e).map(|k| b[k] * hold.at(k, e)).sum::<f64>() - 0.5 * square;
        Located {
            output: case.model.outputs[case.outputs[i / n]].name.clone(),
            source: format!("{}{how}", source.name),
            gain,
            limit: source.limit,
            held_out: if places.held_out.is_empty() { f64::NAN } else { realised },
        }
    };
    most.into_iter().map(row).collect()
}

/// Gain of the best response, the residuals' size taken as it is.
fn by_size(alike: &Gram, varied: &Gram, ridge: f64) -> f64 {
    let e = alike.n - 1;
    let sound: Vec<usize> = (0..e).filter(|&k| varied.at(k, k) > 0.0).collect();
    let mut f = varied.block(&sound);
    (0..sound.len()).for_each(|k| f[k * (sound.len() + 1)] *= 1.0 + ridge);
    let u: Vec<f64> = sound.iter().map(|&k| alike.at(k, e)).collect();
    gain(&f, &u, &vec![(f64::NEG_INFINITY, f64::INFINITY); sound.len()]).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::distribution::chi2_quantile;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    /// One pulse of a source; noise of unit size whose sd grows with it `bursts` times, and what
    /// responds to it.
    fn gains(seed: u64, bursts: f64, answer: f64) -> [f64; 2] {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let source = |lag: usize| -> Vec<f64> {
            (0..400usize)
                .map(|k| {
                    if (100 + lag..140 + lag).contains(&k) {
                        1.0 + 0.1 * (k % 7) as f64
                    } else {
                        0.0
                    }
                })
                .collect()
        };
        let mut columns = vec![source(0), source(9)];
        let noise =
            |x: &f64| (1.0 + bursts * x) * random.sample::<f64, _>(StandardNormal) + answer * x;
        let e: Vec<f64> = columns[0].iter().map(noise).collect();
        let alike = Size::Alike.products(&mut columns.clone(), &e);
        let ridge = Settings::default().thresholds.ridge;
        [
            best(&alike, ridge).expect("a source").0,
            by_size(&alike, &Size::AsItIs.products(&mut columns, &e), ridge),
        ]
    }

    #[test]
    fn coverage_noise_that_comes_and_goes_with_a_source_is_no_answer_to_it() {
        let limit = 0.5 * chi2_quantile(0.95, 2.0);
        let share = |bursts: f64, answer: f64, which: usize| {
            (0..1000).filter(|&seed| gains(seed, bursts, answer)[which] > limit).count() as f64
                / 1000.0
        };
        // 5% of steady noise for both, within 3 sd of 1000 trials; of bursts only where the size is
        // taken as it is.
        let slack = 3.0 * (0.05f64 * 0.95 / 1000.0).sqrt();
        assert!(
            (share(0.0, 0.0, 0) - 0.05).abs() < slack && (share(0.0, 0.0, 1) - 0.05).abs() < slack
        );
        assert!(share(2.0, 0.0, 0) > 0.3 && (share(2.0, 0.0, 1) - 0.05).abs() < slack);
        // What does answer is still seen.
        assert!(share(0.0, 0.8, 1) > 0.9 && share(0.5, 0.8, 1) > 0.9);
    }
}
