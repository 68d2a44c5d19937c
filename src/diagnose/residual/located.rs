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
//!
//! A model that is driven by noisy records moves where the aircraft did not, and its residuals answer to
//! just that. Inputs with as much noise again add as much to `u` as theirs did (Cook & Stefanski 1994),
//! which is taken from it.

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

/// A case and the parameters of each of its segments (held-out ones have own parameters of theirs).
pub struct At {
    pub case: Case,
    pub theta: Vec<Vec<f64>>,
}

/// The same flights where inputs have as much noise again, drawn several times; none where they have no
/// noise. Asked for only where something is clear.
pub type Noisier<'a> = dyn Fn() -> &'a [At] + 'a;

/// Every pair of output and source.
pub fn locate(
    at: &At,
    noise: &Noise,
    places: &Places,
    noisier: &Noisier,
    settings: &Settings,
) -> Vec<Located> {
    let thresholds = &settings.thresholds;
    // Half of what chance is allowed for each of both questions.
    let chance = thresholds.question_share * (1.0 - settings.quantile);
    let sources =
        |motion: bool| Sources::of(&at.case, &places.training, chance, motion, thresholds);
    let (responding, foretelling) = (sources(false), sources(true));
    let responses = |at: &At, of: &Sources, s: usize, size| {
        sums(&at.case, noise, of, s, &at.theta[s], &|_| Some(&None), size)
    };
    let foretold = |at: &At, of: &Sources, s: usize, size| {
        innovation::sums(&at.case, noise, of, s, &at.theta[s], size)
    };
    let flights = (at, noisier, places);
    let mut found = rows(flights, &responding, "", &responses, thresholds.ridge);
    found.extend(rows(flights, &foretelling, innovation::HOW, &foretold, thresholds.ridge));
    found.sort_by(|a, b| (b.gain - b.limit).total_cmp(&(a.gain - a.limit)));
    found
}

/// Sums of a segment: sources, its place, how the residuals' size is taken.
type Of<'a> = dyn Fn(&At, &Sources, usize, Size) -> Vec<Sums> + Sync + 'a;

/// The best source of every group for every output.
fn rows(
    (at, noisier, places): (&At, &Noisier, &Places),
    sources: &Sources,
    how: &str,
    of: &Of,
    ridge: f64,
) -> Vec<Located> {
    let case = &at.case;
    let sums = |at: &At, sources: &Sources, segments: &[usize], size: Size| {
        together(&at.case, sources, segments, &|s| of(at, sources, s, size))
    };
    let (training, mut held_out) = (
        sums(at, sources, &places.training, Size::Alike),
        sums(at, sources, &places.held_out, Size::Alike),
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
    let varied = sums(at, &asked.0, again, Size::AsItIs);
    let place = |i: usize| {
        let source = asked.1.iter().position(|&source| source == i % n);
        i / n * asked.1.len() + source.unwrap_or_default()
    };
    for (gain, _, i) in most.iter_mut().filter(|m| clear(m)) {
        *gain = gain.min(by_size(&training[*i], &varied[place(*i)], ridge));
    }
    let clear: Vec<usize> = (0..most.len()).filter(|&m| clear(&most[m])).collect();
    let noisier = if clear.is_empty() { &[] } else { noisier() };
    if !noisier.is_empty() {
        let more = |segments: &[usize]| -> Vec<Vec<Gram>> {
            noisier.iter().map(|at| sums(at, &asked.0, segments, Size::Alike)).collect()
        };
        let (more_training, more_held_out) = (more(&places.training), more(&places.held_out));
        for m in clear {
            let (gain, b, i) = &mut most[m];
            let rest = less(&training[*i], &more_training, place(*i));
            held_out[*i] = less(&held_out[*i], &more_held_out, place(*i));
            let Some((left, response)) = best(&rest, ridge) else { continue };
            *gain = gain.min(left).min(by_size(&rest, &varied[place(*i)], ridge));
            *b = response;
        }
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

/// Products without what noise of the inputs makes of those with the residuals: as much noise again,
/// `more[draw][place]`, adds as much once more.
fn less(gram: &Gram, more: &[Vec<Gram>], place: usize) -> Gram {
    let (mut less, e) = (gram.clone(), gram.n - 1);
    for k in 0..e {
        let with: f64 = more.iter().map(|all| all[place].at(k, e)).sum();
        less.sums[k * gram.n + e] -= with / more.len() as f64 - gram.at(k, e);
    }
    less
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
