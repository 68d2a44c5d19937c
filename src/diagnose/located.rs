//! A fit's residuals in; whether any output still answers to any input or to the motion, whatever the reason, out.
//!
//! Two questions are asked of every output and every source (`sources`). Does the *output* answer: is its residual, whitened by its own filter, a
//! response to the source (whitened likewise)? That finds errors of sensors, and what is fast. Does something *act*: is what is new at each instant, given the past
//! of all outputs, foretold by what the source does just then (`innovation`)? That finds what is missing in forces and moments, in gusts as well.
//!
//! The response is common to all maneuvers: no effect needs to be named for it. Regressors are not projected on the base's sensitivities; since the
//! residuals are orthogonal to those at the fit, that can only make the gain smaller than it is. Held-out maneuvers must confirm it with the
//! coefficients of the training.
//!
//! What an output demonstrably answers is not noise either: `Answers` takes it out of the residuals before the noise is made from them.
//! Otherwise the noise's colour would imitate what is missing, and hide it.

use super::absorbed::Fitted;
use super::base::Places;
use super::gram::Gram;
use super::innovation;
use super::noise::Noise;
use super::screen::gain;
use super::sources::{Source, Sources, columns, signals};
use crate::estimate::Case;
use rayon::prelude::*;

/// Answers taken out of one output's residuals before its noise is made, at most.
const ANSWERS: usize = 4;

/// An output that still answers to a source.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    pub output: String,
    pub source: String,
    /// Gain in log-likelihood of the impulse response over the training maneuvers, and what it must exceed.
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

/// Regressors and residuals of one segment, output and source, as sums.
pub struct Sums {
    pub output: usize,
    pub source: usize,
    pub gram: Gram,
}

/// Every pair of output and source. `theta`: parameters per segment place (held-out ones have own parameters of theirs).
pub fn locate(case: &Case, noise: &Noise, places: &Places, theta: &dyn Fn(usize) -> Vec<f64>, quantile: f64) -> Vec<Located> {
    let at: Vec<Vec<f64>> = (0..case.records.len()).map(theta).collect();
    // Half of what luck is allowed for each of both questions.
    let sources = |motion: bool| Sources::of(case, &places.training, 0.5 * (1.0 - quantile), motion);
    let (answering, foretelling) = (sources(false), sources(true));
    let mut found = rows(case, &answering, places, "", &|s| sums(case, noise, &answering, s, &at[s], &|_| Some(&None)));
    found.extend(rows(case, &foretelling, places, innovation::HOW, &|s| innovation::sums(case, noise, &foretelling, s, &at[s])));
    found.sort_by(|a, b| (b.gain - b.limit).total_cmp(&(a.gain - a.limit)));
    found
}

/// The best source of every group for every output.
fn rows(case: &Case, sources: &Sources, places: &Places, how: &str, of: &(dyn Fn(usize) -> Vec<Sums> + Sync)) -> Vec<Located> {
    let (training, held_out) = (together(case, sources, &places.training, of), together(case, sources, &places.held_out, of));
    let n = sources.all.len();
    let mut found: Vec<Option<Located>> = vec![None; case.outputs.len() * sources.groups];
    for (i, (train, hold)) in training.iter().zip(&held_out).enumerate() {
        let Some((gain, b)) = best(train) else { continue };
        let source = &sources.all[i % n];
        let row = &mut found[i / n * sources.groups + source.group];
        if row.as_ref().is_some_and(|row| row.gain >= gain) {
            continue;
        }
        let e = b.len();
        let square: f64 = (0..e).map(|i| (0..e).map(|j| b[i] * b[j] * hold.at(i, j)).sum::<f64>()).sum();
        let realised = (0..e).map(|k| b[k] * hold.at(k, e)).sum::<f64>() - 0.5 * square;
        *row = Some(Located {
            output: case.model.outputs[case.outputs[i / n]].name.clone(),
            source: format!("{}{how}", source.name),
            gain,
            limit: source.limit,
            held_out: if places.held_out.is_empty() { f64::NAN } else { realised },
        });
    }
    found.into_iter().flatten().collect()
}

/// Sums over segments, `[output][source]`.
pub fn together(case: &Case, sources: &Sources, segments: &[usize], of: &(dyn Fn(usize) -> Vec<Sums> + Sync)) -> Vec<Gram> {
    let parts: Vec<Vec<Sums>> = segments.par_iter().map(|&s| of(s)).collect();
    let zero = |source: &Source| Gram::zero(source.kind.columns() + 1);
    let mut all: Vec<Gram> = case.outputs.iter().flat_map(|_| sources.all.iter().map(zero)).collect();
    for part in parts.iter().flatten() {
        let places: Vec<usize> = (0..part.gram.n).collect();
        all[part.output * sources.all.len() + part.source].add(&part.gram, 0, &places);
    }
    all
}

/// Gain of the best response, and its coefficients; none where the source does nothing.
pub fn best(gram: &Gram) -> Option<(f64, Vec<f64>)> {
    let e = gram.n - 1;
    let sound: Vec<usize> = (0..e).filter(|&k| gram.at(k, k) > 0.0).collect();
    if sound.is_empty() {
        return None;
    }
    let open = vec![(f64::NEG_INFINITY, f64::INFINITY); sound.len()];
    // A little of the diagonal: neighbouring lags of a slow source say nearly the same.
    let mut f = gram.block(&sound);
    (0..sound.len()).for_each(|k| f[k * (sound.len() + 1)] *= 1.0 + 1e-6);
    let (gain, some) = gain(&f, &sound.iter().map(|&k| gram.at(k, e)).collect::<Vec<_>>(), &open);
    let mut b = vec![0.0; e];
    sound.iter().zip(some).for_each(|(&k, x)| b[k] = x);
    Some((gain, b))
}

/// What is taken from an output's residuals before they are looked at; none for an output that is not looked at.
type Less<'a> = dyn Fn(usize) -> Option<&'a Option<Vec<f64>>> + 'a;

/// Sums of one segment.
fn sums(case: &Case, noise: &Noise, sources: &Sources, s: usize, theta: &[f64], less: &Less) -> Vec<Sums> {
    let traces = case.traces(s, theta);
    let signals = signals(case, s, &traces);
    let mut all = Vec::new();
    // Outputs that are sampled together have the same columns.
    let mut made: (&[f64], Vec<Vec<Vec<f64>>>) = (&[], Vec::new());
    for trace in &traces {
        let Some(output) = case.outputs.iter().position(|&o| o == trace.output) else { continue };
        let (Some(filter), Some(less)) = (noise.filter(s, output), less(output)) else { continue };
        if made.0 != trace.t {
            made = (&trace.t, columns(&sources.all, &case.records[s], &signals, &trace.t));
        }
        let mut e: Vec<f64> = trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y).collect();
        if let Some(less) = less {
            e.iter_mut().zip(less).for_each(|(e, less)| *e -= less);
        }
        let masked: Vec<bool> = e.iter().map(|e| !e.is_finite()).collect();
        filter.apply(&mut e, &masked);
        for (source, columns) in made.1.iter().enumerate() {
            let white = |x: &Vec<f64>| {
                let mut x = x.clone();
                filter.apply(&mut x, &masked);
                if x.iter().all(|v| v.is_finite()) { x } else { vec![0.0; e.len()] }
            };
            let columns: Vec<Vec<f64>> = columns.iter().map(white).chain([e.clone()]).collect();
            all.push(Sums { output, source, gram: Gram::of(&columns) });
        }
    }
    all
}

/// What the residuals of a fit demonstrably answer, to be taken out of them before the noise is made: `[segment of the fit][output]`.
#[derive(Debug, Clone, Default)]
pub struct Answers {
    pub values: Vec<Vec<Option<Vec<f64>>>>,
    /// How many were taken out of each output, and which have no more.
    taken: Vec<usize>,
    done: Vec<bool>,
}

impl Answers {
    /// One more for every output that answers above the limit of luck under this noise; false where none does.
    pub fn more(&mut self, fitted: &Fitted, noise: &Noise, quantile: f64) -> bool {
        let case = fitted.case;
        let sources = Sources::of(case, fitted.segments, 1.0 - quantile, false);
        self.values.resize(fitted.segments.len(), vec![None; case.outputs.len()]);
        self.taken.resize(case.outputs.len(), 0);
        self.done.resize(case.outputs.len(), false);
        let of = |s: usize| {
            let at = fitted.segments.iter().position(|&of| of == s).unwrap_or_default();
            let less = |output: usize| self.values[at].get(output).filter(|_| !self.done[output]);
            sums(case, noise, &sources, s, fitted.theta, &less)
        };
        let grams = together(case, &sources, fitted.segments, &of);
        let n = sources.all.len();
        let mut chosen: Vec<(usize, usize, Vec<f64>)> = Vec::new();
        for (output, grams) in grams.chunks(n.max(1)).enumerate() {
            let above = |(i, gram): (usize, &Gram)| {
                let (gain, b) = best(gram)?;
                (gain > sources.all[i].limit).then_some((gain - sources.all[i].limit, i, b))
            };
            let most = grams.iter().enumerate().filter_map(above).max_by(|a, b| a.0.total_cmp(&b.0));
            chosen.extend(most.map(|(_, source, b)| (output, source, b)));
        }
        for (at, &s) in fitted.segments.iter().enumerate() {
            let traces = case.traces(s, fitted.theta);
            let signals = signals(case, s, &traces);
            for (output, source, b) in &chosen {
                let Some(trace) = traces.iter().find(|t| t.output == case.outputs[*output]) else { continue };
                let one = std::slice::from_ref(&sources.all[*source]);
                let columns = columns(one, &case.records[s], &signals, &trace.t).concat();
                let sum = self.values[at][*output].get_or_insert_with(|| vec![0.0; trace.t.len()]);
                for (column, b) in columns.iter().zip(b) {
                    sum.iter_mut().zip(column).filter(|(_, x)| x.is_finite()).for_each(|(sum, x)| *sum += b * x);
                }
            }
        }
        chosen.iter().for_each(|(output, ..)| self.taken[*output] += 1);
        for output in 0..case.outputs.len() {
            self.done[output] = self.taken[output] >= ANSWERS || chosen.iter().all(|c| c.0 != output);
        }
        !chosen.is_empty()
    }
}
