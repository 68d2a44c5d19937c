//! A fit and its noise in; what its residuals demonstrably respond to, out.
//!
//! What an output demonstrably responds to is no noise: it is taken out of the residuals before the
//! noise is made from them. Otherwise the noise's colour would imitate what is missing, and hide
//! it.

use super::absorbed::Fitted;
use super::columns::Columns;
use super::signals::signals;
use super::sources::Sources;
use super::sums::{Size, best, sums, together};
use super::whitening::Noise;
use crate::diagnose::settings::Settings;
use crate::math::products::Gram;

/// What the residuals of a fit demonstrably respond to, to be taken out of them before the noise is
/// made: `[segment of the fit][output]`.
#[derive(Debug, Clone, Default)]
pub struct Responses {
    pub values: Vec<Vec<Option<Vec<f64>>>>,
    /// How many were taken out of each output, and which have no more.
    taken: Vec<usize>,
    done: Vec<bool>,
}

impl Responses {
    /// One more for every output that responds above the limit of chance under this noise; false
    /// where none does.
    pub fn more(&mut self, fitted: &Fitted, noise: &Noise, settings: &Settings) -> bool {
        let (case, thresholds) = (fitted.at.case, &settings.thresholds);
        let sources =
            Sources::of(case, fitted.segments, 1.0 - settings.quantile, false, thresholds);
        self.values.resize(fitted.segments.len(), vec![None; case.outputs.len()]);
        self.taken.resize(case.outputs.len(), 0);
        self.done.resize(case.outputs.len(), false);
        let of = |s: usize| {
            let at = fitted.segments.iter().position(|&of| of == s).unwrap_or_default();
            let less = |output: usize| self.values[at].get(output).filter(|_| !self.done[output]);
            sums(case, noise, &sources, s, fitted.at.theta, &less, Size::Alike)
        };
        let grams = together(case, &sources, fitted.segments, &of);
        let n = sources.all.len();
        let mut chosen: Vec<(usize, usize, Vec<f64>)> = Vec::new();
        for (output, grams) in grams.chunks(n.max(1)).enumerate() {
            let above = |(i, gram): (usize, &Gram)| {
                let (gain, b) = best(gram, thresholds.ridge)?;
                (gain > sources.all[i].limit).then_some((gain - sources.all[i].limit, i, b))
            };
            let most =
                grams.iter().enumerate().filter_map(above).max_by(|a, b| a.0.total_cmp(&b.0));
            chosen.extend(most.map(|(_, source, b)| (output, source, b)));
        }
        for (at, &s) in fitted.segments.iter().enumerate() {
            let traces = case.traces(s, fitted.at.theta);
            let signals = signals(case, s, &traces);
            for (output, source, b) in &chosen {
                let Some(trace) = traces.iter().find(|t| t.output == case.outputs[*output]) else {
                    continue;
                };
                let one = &sources.all[*source];
                let all = std::slice::from_ref(one);
                let mut columns = Vec::new();
                Columns::new(all, &case.records[s], &signals, &trace.t).of(one, &mut columns);
                let sum = self.values[at][*output].get_or_insert_with(|| vec![0.0; trace.t.len()]);
                for (column, b) in columns.iter().zip(b) {
                    sum.iter_mut()
                        .zip(column)
                        .filter(|(_, x)| x.is_finite())
                        .for_each(|(sum, x)| *sum += b * x);
                }
            }
        }
        chosen.iter().for_each(|(output, ..)| self.taken[*output] += 1);
        for output in 0..case.outputs.len() {
            self.done[output] =
                self.taken[output] >= thresholds.responses || chosen.iter().all(|c| c.0 != output);
        }
        !chosen.is_empty()
    }
}
