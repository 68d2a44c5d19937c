//! A solution in; what the noise of measured inputs moves, and what it alone determines, out.
//!
//! A model is driven by inputs as they were measured, `u + v`. What the noise `v` does to the outputs
//! it does to their sensitivities too, so that the gradient has a mean at the truth, and to second
//! order in `v`
//!
//! `E[theta - truth] = -M^-1 sum E[S_v' R^-1 y_v]`
//!
//! with `y_v` and `S_v` the parts of outputs and sensitivities that go with it (errors in variables:
//! Fuller 1987, sec. 1.1). Inputs with as much noise again move the estimates by as much once more
//! (Cook & Stefanski 1994). It is added with both signs, and half of the two steps of the iteration is
//! taken: what goes with the first power of the noise cancels.
//!
//! A parameter that only noise determines, as of a trim tab that stands still and is measured, is
//! determined the better the more noise there is: that is held against the information without more.

use super::case::Case;
use super::chords::Known;
use super::solution::Solution;
use super::{Settings, Stop};
use crate::dynamics::{Interpolation, Record, between_samples};
use crate::least_squares::{Arrow, Layout, stepped};
use crate::signal::robust::commanded_sd;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// Estimates that are moved by more than this share of their standard deviation are named: what many
/// maneuvers have in common does not become less in their mean.
const MOVES: f64 = 0.5;
/// As much noise again adds so much of the information on a parameter: more than half of it was noise.
const ALONE: f64 = 0.5;
/// Noise is that of samples where it grows by less than this factor at twice the stride, which is sought up
/// to so many points of the grid. *Convention*: on a line between two samples its power is two thirds.
const GROWS: f64 = 1.2;
const WIDEST: usize = 8;
/// Share of the power of samples' noise in third differences of a smooth curve through them, in the mean
/// of all places between two samples: the integral of the squared differences of its weights.
const SEEN: f64 = 0.6025;
/// Noise below this share of an input's range is not added.
const LEAST: f64 = 1e-9;

/// Noise of inputs.
struct Noise {
    /// Standard deviation by input, SI, the largest of any segment; 0 of one without.
    sds: Vec<f64>,
    /// By segment, `[point][input]`.
    drawn: Vec<Vec<f64>>,
}

/// What noise of the inputs does.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NoisyInputs {
    /// Inputs with the standard deviation of their noise, SI; the largest of any segment.
    pub inputs: Vec<(String, f64)>,
    /// Parameters with the standard deviations by which they are moved, those that are moved most first.
    pub moved: Vec<(String, f64)>,
    /// Parameters of which noise alone tells.
    pub alone: Vec<String>,
}

impl NoisyInputs {
    /// The inputs with their noise.
    pub fn words(&self) -> String {
        let each = |(name, sd): &(String, f64)| format!("{name} ({sd:.1e})");
        self.inputs.iter().map(each).collect::<Vec<_>>().join(", ")
    }
}

impl Case {
    /// What noise of the inputs moves or determines; none where it does neither.
    pub(super) fn noisy_inputs(
        &self,
        solution: &Solution,
        settings: &Settings,
    ) -> Option<NoisyInputs> {
        if self.is_filtered() || solution.fit.stop != Stop::Converged {
            return None;
        }
        let mut steps = self.noisier(1).map(|case| case.normal_step(solution, settings));
        let (more, less) = (steps.next()??, steps.next()??);
        let mut told = NoisyInputs::default();
        for (i, unknown) in self.unknowns.iter().enumerate() {
            let Some((sd, crlb)) = solution.deviation(i) else { continue };
            let by = 0.5 * (more.1[i] + less.1[i]) / sd;
            if by.abs() > MOVES {
                told.moved.push((unknown.name.clone(), by.abs()));
            }
            let gained =
                (0.5 * (information(&more.0, i)? + information(&less.0, i)?)) * crlb * crlb;
            if gained - 1.0 > ALONE && self.layout.prior_sd[i].is_infinite() {
                told.alone.push(unknown.name.clone());
            }
        }
        told.moved.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        told.inputs = self.noisy();
        (!told.moved.is_empty() || !told.alone.is_empty()).then_some(told)
    }

    /// The case with as much noise again in its inputs, in so many draws, each with both signs; none where they
    /// have none.
    pub fn noisier(&self, draws: u64) -> impl Iterator<Item = Case> {
        let drawn = (0..draws).filter_map(|draw| self.noise_of_inputs(draw));
        drawn.flat_map(|noise| [1.0, -1.0].map(|times| self.with(&noise, times)))
    }

    /// Names of the inputs that have noise, with its standard deviations, SI.
    pub fn noisy(&self) -> Vec<(String, f64)> {
        let Some(noise) = self.noise_of_inputs(0) else { return Vec::new() };
        let named = self.model.inputs.iter().zip(&noise.sds).filter(|(_, sd)| **sd > 0.0);
        named.map(|(input, sd)| (input.name.clone(), *sd)).collect()
    }

    /// Noise like that of the inputs, drawn by a number; none where they have none.
    fn noise_of_inputs(&self, draw: u64) -> Option<Noise> {
        let nu = self.model.inputs.len();
        let mut sds = vec![0.0f64; nu];
        let mut drawn = Vec::with_capacity(self.records.len());
        for (s, record) in self.records.iter().enumerate() {
            drawn.push(noise(record, nu, draw << 32 | s as u64, &mut sds));
        }
        sds.iter().any(|sd| *sd > 0.0).then_some(Noise { sds, drawn })
    }

    /// The case with so many times this noise in its inputs, in addition to what they have.
    fn with(&self, noise: &Noise, times: f64) -> Case {
        let mut noisy = self.clone();
        for (record, noise) in noisy.records.iter_mut().zip(&noise.drawn) {
            let inputs = record.inputs.iter().zip(noise);
            let inputs: Vec<f64> = inputs.map(|(u, v)| u + times * v).collect();
            record.inputs = inputs.into();
        }
        noisy
    }

    /// The normal matrix and the step from a solution.
    fn normal_step(&self, solution: &Solution, settings: &Settings) -> Option<(Arrow, Vec<f64>)> {
        let evaluate =
            |s: usize, local: &[f64], sensitivities: bool| self.evaluate(s, local, sensitivities);
        let layout = Layout { start: solution.fit.theta.clone(), ..self.layout.clone() };
        stepped(&layout, &evaluate, &solution.fit.theta, &settings.method())
    }
}

/// The information on a parameter that is left when all others are estimated with it.
fn information(matrix: &Arrow, i: usize) -> Option<f64> {
    let factor = matrix.factor().ok()?;
    let mut unit = vec![0.0; matrix.diagonal().len()];
    unit[i] = 1.0;
    Some(1.0 / factor.solve(&unit)[i])
}

/// Which points of a column are samples, and whether what lies between them is on a smooth curve.
struct Samples {
    every: usize,
    first: usize,
    smooth: bool,
}

impl Samples {
    /// Of a column that is made of others nobody knows the spacing. Between samples there is less noise
    /// than at them, so that noise grows with the stride as far as that.
    fn of(record: &Record, input: usize, column: &[f64]) -> Samples {
        if record.spacings.get(input).is_none_or(|spacing| spacing.is_finite()) {
            let Known { every, first, smooth, .. } = Known::of(record, input, column);
            return Samples { every, first, smooth };
        }
        let at = |first: usize, every: usize| {
            commanded_sd(&column.iter().skip(first).step_by(every).copied().collect::<Vec<f64>>())
        };
        let sd = |every: usize| (0..every).map(|first| at(first, every)).fold(0.0, f64::max);
        let every = (1..=WIDEST).find(|every| sd(2 * every) < GROWS * sd(*every)).unwrap_or(1);
        let first = (0..every)
            .fold(0, |best, first| if at(first, every) > at(best, every) { first } else { best });
        Samples { every, first, smooth: true }
    }

    /// The sd of the noise of the samples. They lie anywhere between the points of the grid, and are seen
    /// there through curves that take away what is fast; `SEEN` of their noise's power is left to third
    /// differences in the mean of all places between two samples, of which the points have every kind.
    fn sd(&self, column: &[f64]) -> f64 {
        let at = |phase: usize| {
            let phase: Vec<f64> = column.iter().skip(phase).step_by(self.every).copied().collect();
            commanded_sd(&phase)
        };
        if !self.smooth || self.every == 1 {
            return at(self.first);
        }
        let squares: f64 = (0..self.every).map(|phase| at(phase).powi(2)).sum();
        (squares / (SEEN * self.every as f64)).sqrt()
    }
}

/// Noise like that of the inputs of a record, `[point][input]`, drawn by the record's number; `sds`
/// become the largest seen.
fn noise(record: &Record, nu: usize, number: u64, sds: &mut [f64]) -> Vec<f64> {
    let mut all = vec![0.0; record.n * nu];
    for (i, most) in sds.iter_mut().enumerate() {
        let column: Vec<f64> =
            record.inputs.iter().skip(i).step_by(nu).take(record.n).copied().collect();
        let known = Samples::of(record, i, &column);
        let Samples { every, first, smooth } = known;
        let samples: Vec<f64> = column.iter().skip(first).step_by(every).copied().collect();
        let sd = known.sd(&column);
        let largest = samples.iter().fold(0.0f64, |m, u| m.max(u.abs()));
        if !(sd > LEAST * largest) {
            continue;
        }
        *most = most.max(sd);
        let mut random = Pcg64::seed_from_u64(number << 16 | i as u64);
        let drawn: Vec<f64> = samples
            .iter()
            .map(|_| sd * Distribution::<f64>::sample(&StandardNormal, &mut random))
            .collect();
        let held = record.interpolation.get(i) == Some(&Interpolation::Hold);
        let at = |j: isize| drawn[j.clamp(0, drawn.len() as isize - 1) as usize];
        for k in 0..record.n {
            let behind = k as isize - first as isize;
            let j = behind.div_euclid(every as isize);
            let share = behind.rem_euclid(every as isize) as f64 / every as f64;
            all[k * nu + i] = match (held, smooth) {
                (true, _) => at(j),
                (_, true) => between_samples([j - 1, j, j + 1, j + 2].map(at), share),
                (_, false) => (1.0 - share) * at(j) + share * at(j + 1),
            };
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples at every second point of the grid, and at shares of that between the points.
    #[test]
    fn noise_is_that_of_the_samples_wherever_they_lie() {
        let mut random = Pcg64::seed_from_u64(1);
        let sample = |random: &mut Pcg64| Distribution::<f64>::sample(&StandardNormal, random);
        let noise: Vec<f64> = (0..4000).map(|_| 0.3 * sample(&mut random)).collect();
        for beside in [0.0, 0.2, 0.5, 0.8] {
            let at = |k: usize| {
                let place = 1.0 + 0.5 * (k as f64 + beside);
                let j = place.floor() as usize;
                let samples = [noise[j - 1], noise[j], noise[j + 1], noise[j + 2]];
                between_samples(samples, place - j as f64)
            };
            let column: Vec<f64> = (0..7900).map(at).collect();
            let sd = Samples { every: 2, first: 0, smooth: true }.sd(&column);
            assert!((sd / 0.3 - 1.0).abs() < 0.05, "{beside}: {sd}");
        }
    }
}
