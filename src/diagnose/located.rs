//! A fit's residuals in; whether any output still answers to any input or to the motion, whatever the reason, out.
//!
//! The residual of one output, whitened, is regressed on the lagged values of one source (an input of the model, or a modelled output; both
//! less their value at the start of the maneuver, or the square of that), lags common to all maneuvers: a short impulse response that no effect needs to be named
//! for. The regressors are not projected on the base's sensitivities; since the residuals are orthogonal to those at the fit, that can
//! only make the gain smaller than it is. Held-out maneuvers must confirm it with the coefficients of the training.

use super::base::Places;
use super::gram::Gram;
use super::noise::Noise;
use super::screen::gain;
use crate::estimate::Case;
use crate::math::distribution::chi2_quantile;
use rayon::prelude::*;

/// Lags of the impulse response, s.
pub const LAGS: [f64; 8] = [0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2];

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

/// Regressors and residuals of one segment and output, as sums.
struct Sums {
    output: usize,
    source: usize,
    gram: Gram,
}

/// Every pair of output and source. `theta`: parameters per segment place (held-out ones have own parameters of theirs).
pub fn locate(case: &Case, noise: &Noise, places: &Places, theta: &dyn Fn(usize) -> Vec<f64>, quantile: f64) -> Vec<Located> {
    let names = sources(case);
    let at: Vec<Vec<f64>> = (0..case.records.len()).map(theta).collect();
    let pairs = case.outputs.len() * names.len();
    let sum = |segments: &[usize]| {
        let parts: Vec<Vec<Sums>> = segments.par_iter().map(|&s| sums(case, noise, s, &at[s])).collect();
        let mut all: Vec<Gram> = vec![Gram::zero(LAGS.len() + 1); pairs];
        let places: Vec<usize> = (0..=LAGS.len()).collect();
        parts.iter().flatten().for_each(|p| all[p.output * names.len() + p.source].add(&p.gram, 0, &places));
        all
    };
    let (training, held_out) = (sum(&places.training), sum(&places.held_out));
    let mut found = Vec::new();
    for (i, (train, hold)) in training.iter().zip(&held_out).enumerate() {
        let lags: Vec<usize> = (0..LAGS.len()).filter(|&k| train.at(k, k) > 0.0).collect();
        if lags.is_empty() {
            continue;
        }
        let e = LAGS.len();
        let open = vec![(f64::NEG_INFINITY, f64::INFINITY); lags.len()];
        // A little of the diagonal: neighbouring lags of a slow source say nearly the same.
        let mut f = train.block(&lags);
        (0..lags.len()).for_each(|k| f[k * (lags.len() + 1)] *= 1.0 + 1e-6);
        let (gain, b) = gain(&f, &lags.iter().map(|&k| train.at(k, e)).collect::<Vec<_>>(), &open);
        let square: f64 =
            lags.iter().zip(&b).map(|(&i, x)| lags.iter().zip(&b).map(|(&j, y)| x * y * hold.at(i, j)).sum::<f64>()).sum();
        let realised = lags.iter().zip(&b).map(|(&k, b)| b * hold.at(k, e)).sum::<f64>() - 0.5 * square;
        found.push(Located {
            output: case.model.outputs[case.outputs[i / names.len()]].name.clone(),
            source: names[i % names.len()].clone(),
            gain,
            limit: 0.5 * chi2_quantile(1.0 - (1.0 - quantile) / pairs.max(1) as f64, lags.len() as f64),
            held_out: if places.held_out.is_empty() { f64::NAN } else { realised },
        });
    }
    found.sort_by(|a, b| (b.gain - b.limit).total_cmp(&(a.gain - a.limit)));
    found
}

fn sources(case: &Case) -> Vec<String> {
    let inputs = case.model.inputs.iter().map(|i| i.name.clone());
    let linear: Vec<String> =
        inputs.chain(case.outputs.iter().map(|&o| format!("modelled {}", case.model.outputs[o].name))).collect();
    linear.iter().cloned().chain(linear.iter().map(|name| format!("the square of {name}"))).collect()
}

fn sums(case: &Case, noise: &Noise, s: usize, theta: &[f64]) -> Vec<Sums> {
    let record = &case.records[s];
    let nu = case.model.inputs.len();
    let traces = case.traces(s, theta);
    let grid: Vec<f64> = (0..record.n).map(|k| record.t0 + k as f64 * record.dt).collect();
    let begin = record.t0 + record.start as f64 * record.dt;
    // (times, values) of every source
    let inputs = (0..nu).map(|i| (grid.clone(), (0..record.n).map(|k| record.inputs[k * nu + i]).collect::<Vec<f64>>()));
    let modelled = case.outputs.iter().map(|&o| {
        let trace = traces.iter().find(|t| t.output == o);
        trace.map(|t| (t.t.clone(), t.modelled.clone())).unwrap_or_default()
    });
    let sources: Vec<(Vec<f64>, Vec<f64>)> = inputs.chain(modelled).collect();
    let mut all = Vec::new();
    for trace in &traces {
        let Some(output) = case.outputs.iter().position(|&o| o == trace.output) else { continue };
        let Some(filter) = noise.filter(s, output) else { continue };
        let mut e: Vec<f64> = trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y).collect();
        let masked: Vec<bool> = e.iter().map(|e| !e.is_finite()).collect();
        filter.apply(&mut e, &masked);
        for (source, (t, v)) in sources.iter().chain(&sources).enumerate() {
            let (first, squared) = (at(t, v, begin), source >= sources.len());
            let mut columns: Vec<Vec<f64>> = Vec::new();
            for lag in LAGS {
                let moved = |time: &f64| at(t, v, time - lag) - first;
                let of = |time: &f64| if squared { moved(time) * moved(time) } else { moved(time) };
                let mut x: Vec<f64> = trace.t.iter().map(of).collect();
                filter.apply(&mut x, &masked);
                let sound = x.iter().all(|v| v.is_finite());
                columns.push(if sound { x } else { vec![0.0; e.len()] });
            }
            columns.push(e.clone());
            all.push(Sums { output, source, gram: Gram::of(&columns) });
        }
    }
    all
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
