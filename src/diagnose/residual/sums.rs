//! Residuals of one segment and sources in; sums of what the output, whitened by its own filter,
//! has of each source, and the response that gains most, out.

use super::gain::gain;
use super::sources::{Source, Sources, columns, signals};
use super::whitening::Noise;
use crate::estimate::Case;
use crate::math::products::Gram;
use rayon::prelude::*;

/// How the residuals' size is taken: alike at all instants, or as it is at each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Size {
    Alike,
    AsItIs,
}

impl Size {
    /// Products of regressors with each other and with the residuals, regressors multiplied by
    /// these, in place, where their size is as it is.
    pub fn products(self, columns: &mut [Vec<f64>], e: &[f64]) -> Gram {
        if self == Size::AsItIs {
            columns
                .iter_mut()
                .for_each(|column| column.iter_mut().zip(e).for_each(|(x, e)| *x *= e));
        }
        Gram::of(&columns.iter().map(Vec::as_slice).chain([e]).collect::<Vec<_>>())
    }
}

/// Regressors and residuals of one segment, output and source, as sums.
pub struct Sums {
    pub output: usize,
    pub source: usize,
    pub gram: Gram,
}

/// Sums over segments, `[output][source]`.
pub fn together(
    case: &Case,
    sources: &Sources,
    segments: &[usize],
    of: &(dyn Fn(usize) -> Vec<Sums> + Sync),
) -> Vec<Gram> {
    let parts: Vec<Vec<Sums>> = segments.par_iter().map(|&s| of(s)).collect();
    let zero = |source: &Source| Gram::zero(source.kind.columns() + 1);
    let mut all: Vec<Gram> =
        case.outputs.iter().flat_map(|_| sources.all.iter().map(zero)).collect();
    for part in parts.iter().flatten() {
        let places: Vec<usize> = (0..part.gram.n).collect();
        all[part.output * sources.all.len() + part.source].add(&part.gram, 0, &places);
    }
    all
}

/// Gain of the best response, and its coefficients; none where the source does nothing. `ridge`: a
/// little of the diagonal, as neighbouring lags of a slow source say nearly the same.
pub fn best(gram: &Gram, ridge: f64) -> Option<(f64, Vec<f64>)> {
    let e = gram.n - 1;
    let sound: Vec<usize> = (0..e).filter(|&k| gram.at(k, k) > 0.0).collect();
    if sound.is_empty() {
        return None;
    }
    let open = vec![(f64::NEG_INFINITY, f64::INFINITY); sound.len()];
    let mut f = gram.block(&sound);
    (0..sound.len()).for_each(|k| f[k * (sound.len() + 1)] *= 1.0 + ridge);
    let (gain, some) = gain(&f, &sound.iter().map(|&k| gram.at(k, e)).collect::<Vec<_>>(), &open);
    let mut b = vec![0.0; e];
    sound.iter().zip(some).for_each(|(&k, x)| b[k] = x);
    Some((gain, b))
}

/// What is taken from an output's residuals before they are looked at; none for an output that is
/// not looked at.
pub type Less<'a> = dyn Fn(usize) -> Option<&'a Option<Vec<f64>>> + 'a;

/// Sums of one segment.
pub fn sums(
    case: &Case,
    noise: &Noise,
    sources: &Sources,
    s: usize,
    theta: &[f64],
    less: &Less,
    size: Size,
) -> Vec<Sums> {
    let traces = case.traces(s, theta);
    let signals = signals(case, s, &traces);
    let mut all = Vec::new();
    // Outputs that are sampled together have the same columns.
    let mut made: (&[f64], Vec<Vec<Vec<f64>>>) = (&[], Vec::new());
    let mut white: Vec<Vec<f64>> = Vec::new();
    for trace in &traces {
        let Some(output) = case.outputs.iter().position(|&o| o == trace.output) else { continue };
        let (Some(filter), Some(less)) = (noise.filter(s, output), less(output)) else { continue };
        if made.0 != &*trace.t {
            made = (&trace.t, columns(&sources.all, &case.records[s], &signals, &trace.t));
        }
        let mut e: Vec<f64> =
            trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y).collect();
        if let Some(less) = less {
            e.iter_mut().zip(less).for_each(|(e, less)| *e -= less);
        }
        let masked: Vec<bool> = e.iter().map(|e| !e.is_finite()).collect();
        filter.whiten(&mut e, &masked);
        for (source, columns) in made.1.iter().enumerate() {
            white.clone_from(columns);
            filter.whiten_all(white.iter_mut().map(|x| &mut x[..]), &masked);
            let unknown = |x: &&mut Vec<f64>| !x.iter().all(|v| v.is_finite());
            white.iter_mut().filter(unknown).for_each(|x| x.fill(0.0));
            all.push(Sums { output, source, gram: size.products(&mut white, &e) });
        }
    }
    all
}
