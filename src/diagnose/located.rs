//! A fit's residuals in; whether any output still answers to any input or to the motion, whatever the reason, out.
//!
//! The residual of one output, whitened, is regressed on what one source does: on the lagged values of an input of the model or of a modelled
//! output (both less their value at the start of the maneuver, or the square of that), or on what an input rings at one
//! frequency (a lightly damped oscillation that it excites; the start of the maneuver is such a source as well: what repeats itself in every
//! maneuver is no noise). The response is common to all maneuvers: no effect needs to be named for it. Regressors
//! are not projected on the base's sensitivities; since the residuals are orthogonal to those at the fit, that can
//! only make the gain smaller than it is. Held-out maneuvers must confirm it with the coefficients of the training.
//!
//! What an output demonstrably answers is not noise either: `Answers` takes it out of the residuals before the noise is made from them.
//! Otherwise the noise's colour would imitate what is missing, and hide it.

use super::absorbed::Fitted;
use super::base::Places;
use super::gram::Gram;
use super::noise::Noise;
use super::screen::gain;
use crate::estimate::{Case, Trace};
use crate::math::distribution::chi2_quantile;
use rayon::prelude::*;

/// Lags of the impulse response, s.
pub const LAGS: [f64; 8] = [0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2];
/// Damping of what rings, as a share of the critical one; of what repeats itself from the start of the maneuver there is none.
const DAMPING: f64 = 0.03;
/// Frequencies looked at, at most: multiples of one period per maneuver, up to half of what the record resolves.
const FREQUENCIES: usize = 60;
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

/// What an output may answer to.
struct Source {
    name: String,
    /// Those of one group are one row of the result: the best of them.
    group: usize,
    kind: Kind,
}

enum Kind {
    /// A signal, by its place among inputs and modelled outputs.
    Lagged { signal: usize, squared: bool },
    /// An input, or the start of the maneuver, and the angular frequency, rad/s.
    Ringing { input: Option<usize>, frequency: f64 },
}

impl Kind {
    fn columns(&self) -> usize {
        if matches!(self, Kind::Lagged { .. }) { LAGS.len() } else { 2 }
    }
}

/// Inputs, then modelled outputs of a segment: times and values.
type Signals = Vec<(Vec<f64>, Vec<f64>)>;

/// All sources of a case and how likely each may exceed its limit by luck.
struct Sources {
    all: Vec<Source>,
    groups: usize,
    /// `[lagged, ringing]`: limits of the gain.
    limits: [f64; 2],
}

impl Sources {
    fn of(case: &Case, segments: &[usize], quantile: f64) -> Sources {
        let inputs: Vec<String> = case.model.inputs.iter().map(|i| i.name.clone()).collect();
        let modelled = case.outputs.iter().map(|&o| format!("modelled {}", case.model.outputs[o].name));
        let linear: Vec<String> = inputs.iter().cloned().chain(modelled).collect();
        let mut all = Vec::new();
        for squared in [false, true] {
            for (signal, name) in linear.iter().enumerate() {
                let name = if squared { format!("the square of {name}") } else { name.clone() };
                all.push(Source { name, group: all.len(), kind: Kind::Lagged { signal, squared } });
            }
        }
        let lagged = all.len();
        let frequencies = frequencies(case, segments);
        for (k, input) in inputs.iter().map(Some).chain([None]).enumerate() {
            for &frequency in &frequencies {
                let what = input.map_or("the time since the start".to_string(), |name| format!("{name}, ringing"));
                let name = format!("{what} at {frequency:.2} rad/s");
                all.push(Source { name, group: lagged + k, kind: Kind::Ringing { input: input.map(|_| k), frequency } });
            }
        }
        // Half of what luck is allowed for each kind.
        let ringing = all.len() - lagged;
        let limit = |count: usize, columns: usize| {
            let share = 0.5 * (1.0 - quantile) / (count * case.outputs.len()).max(1) as f64;
            0.5 * chi2_quantile(1.0 - share, columns as f64)
        };
        Sources { groups: lagged + inputs.len() + 1, limits: [limit(lagged, LAGS.len()), limit(ringing, 2)], all }
    }

    fn limit(&self, source: usize) -> f64 {
        self.limits[usize::from(matches!(self.all[source].kind, Kind::Ringing { .. }))]
    }
}

/// Multiples of one period per maneuver of middle length.
fn frequencies(case: &Case, segments: &[usize]) -> Vec<f64> {
    let mut lengths: Vec<(f64, f64)> = segments
        .iter()
        .map(|&s| &case.records[s])
        .map(|r| (r.n.saturating_sub(r.start + 1) as f64 * r.dt, r.dt))
        .filter(|(length, dt)| *length > 0.0 && *dt > 0.0)
        .collect();
    lengths.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(length, dt)) = lengths.get(lengths.len() / 2) else { return Vec::new() };
    let lowest = 2.0 * std::f64::consts::PI / length;
    let count = ((0.5 * std::f64::consts::PI / dt / lowest) as usize).min(FREQUENCIES);
    (1..=count).map(|k| k as f64 * lowest).collect()
}

/// Regressors and residuals of one segment, output and source, as sums.
struct Sums {
    output: usize,
    source: usize,
    gram: Gram,
}

/// Every pair of output and source. `theta`: parameters per segment place (held-out ones have own parameters of theirs).
pub fn locate(case: &Case, noise: &Noise, places: &Places, theta: &dyn Fn(usize) -> Vec<f64>, quantile: f64) -> Vec<Located> {
    let sources = Sources::of(case, &places.training, quantile);
    let at: Vec<Vec<f64>> = (0..case.records.len()).map(theta).collect();
    let sum =
        |segments: &[usize]| together(case, &sources, segments, &|s| sums(case, noise, &sources, s, &at[s], &|_| Some(&None)));
    let (training, held_out) = (sum(&places.training), sum(&places.held_out));
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
            source: source.name.clone(),
            gain,
            limit: sources.limit(i % n),
            held_out: if places.held_out.is_empty() { f64::NAN } else { realised },
        });
    }
    let mut found: Vec<Located> = found.into_iter().flatten().collect();
    found.sort_by(|a, b| (b.gain - b.limit).total_cmp(&(a.gain - a.limit)));
    found
}

/// Sums over segments, `[output][source]`.
fn together(case: &Case, sources: &Sources, segments: &[usize], of: &(dyn Fn(usize) -> Vec<Sums> + Sync)) -> Vec<Gram> {
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
fn best(gram: &Gram) -> Option<(f64, Vec<f64>)> {
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

/// Signals of one segment, less their value at its start.
fn signals(case: &Case, s: usize, traces: &[Trace]) -> Signals {
    let (record, nu) = (&case.records[s], case.model.inputs.len());
    let grid: Vec<f64> = (0..record.n).map(|k| record.t0 + k as f64 * record.dt).collect();
    let begin = record.t0 + record.start as f64 * record.dt;
    let inputs = (0..nu).map(|i| (grid.clone(), (0..record.n).map(|k| record.inputs[k * nu + i]).collect::<Vec<f64>>()));
    let modelled = case.outputs.iter().map(|&o| {
        let trace = traces.iter().find(|t| t.output == o);
        trace.map(|t| (t.t.clone(), t.modelled.clone())).unwrap_or_default()
    });
    let mut all: Signals = inputs.chain(modelled).collect();
    for (t, v) in &mut all {
        let first = at(t, v, begin);
        v.iter_mut().for_each(|v| *v -= first);
    }
    all
}

/// What a source does at these instants: one column per coefficient.
fn columns(kind: &Kind, case: &Case, s: usize, signals: &Signals, times: &[f64]) -> Vec<Vec<f64>> {
    let record = &case.records[s];
    let begin = record.t0 + record.start as f64 * record.dt;
    match *kind {
        Kind::Lagged { signal, squared } => {
            let (t, v) = &signals[signal];
            let of = |lag: f64| {
                let one = |time: &f64| at(t, v, time - lag);
                times.iter().map(one).map(|v| if squared { v * v } else { v }).collect()
            };
            LAGS.iter().map(|&lag| of(lag)).collect()
        }
        Kind::Ringing { input: None, frequency } => {
            let phase = |time: &f64| libm::sincos(frequency * (time - begin));
            vec![times.iter().map(|t| phase(t).1).collect(), times.iter().map(|t| phase(t).0).collect()]
        }
        Kind::Ringing { input: Some(input), frequency } => {
            let (t, v) = &signals[input];
            let (sin, cos) = libm::sincos(frequency * record.dt);
            let keep = libm::exp(-DAMPING * frequency * record.dt);
            let (mut x, mut y, mut last) = (0.0, 0.0, v.first().copied().unwrap_or(0.0));
            let (mut real, mut imaginary) = (Vec::with_capacity(v.len()), Vec::with_capacity(v.len()));
            for v in v {
                // what changes of the input starts an oscillation
                (x, y) = (keep * (cos * x - sin * y) + v - last, keep * (sin * x + cos * y));
                last = *v;
                real.push(x);
                imaginary.push(y);
            }
            [real, imaginary].iter().map(|v| times.iter().map(|time| at(t, v, *time)).collect()).collect()
        }
    }
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
            made = (&trace.t, sources.all.iter().map(|of| columns(&of.kind, case, s, &signals, &trace.t)).collect());
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
        let sources = Sources::of(case, fitted.segments, quantile);
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
                (gain > sources.limit(i)).then_some((gain - sources.limit(i), i, b))
            };
            let most = grams.iter().enumerate().filter_map(above).max_by(|a, b| a.0.total_cmp(&b.0));
            chosen.extend(most.map(|(_, source, b)| (output, source, b)));
        }
        for (at, &s) in fitted.segments.iter().enumerate() {
            let traces = case.traces(s, fitted.theta);
            let signals = signals(case, s, &traces);
            for (output, source, b) in &chosen {
                let Some(trace) = traces.iter().find(|t| t.output == case.outputs[*output]) else { continue };
                let columns = columns(&sources.all[*source].kind, case, s, &signals, &trace.t);
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

/// A sampled signal at `time`: straight lines between samples, held before the first and after the last; NaN for none.
fn at(t: &[f64], v: &[f64], time: f64) -> f64 {
    let after = t.partition_point(|t| *t <= time);
    match (after.checked_sub(1).and_then(|i| Some((t.get(i)?, v.get(i)?))), t.get(after).zip(v.get(after))) {
        (Some((a, x)), Some((b, y))) => x + (time - a) / (b - a) * (y - x),
        (Some((_, x)), None) => *x,
        (None, Some((_, y))) => *y,
        (None, None) => f64::NAN,
    }
}
