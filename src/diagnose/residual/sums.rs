//! Residuals of one segment and sources in; sums of what the output, whitened by its own filter,
//! has of each source, and the response that gains most, out.

use super::columns::Columns;
use super::gain::gain;
use super::signals::signals;
use super::sources::{Source, Sources};
use super::whitening::Noise;
use crate::estimate::{Case, Trace};
use crate::math::all_finite;
use crate::math::products::Gram;
use crate::noise::Filter;
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

/// An output that is looked at.
struct Looked<'a> {
    output: usize,
    times: &'a [f64],
    filter: &'a Filter,
    masked: Vec<bool>,
    /// Its residuals, made white.
    e: Vec<f64>,
}

impl<'a> Looked<'a> {
    fn new(
        (case, noise): (&Case, &'a Noise),
        s: usize,
        trace: &'a Trace,
        less: &Less,
    ) -> Option<Looked<'a>> {
        let output = case.outputs.iter().position(|&o| o == trace.output)?;
        let (filter, less) = (noise.filter(s, output)?, less(output)?);
        let mut e: Vec<f64> =
            trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y).collect();
        if let Some(less) = less {
            e.iter_mut().zip(less).for_each(|(e, less)| *e -= less);
        }
        let masked: Vec<bool> = e.iter().map(|e| !e.is_finite()).collect();
        filter.whiten(&mut e, &masked);
        Some(Looked { output, times: &trace.t, filter, masked, e })
    }
}

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
    let looked: Vec<Looked> =
        traces.iter().filter_map(|trace| Looked::new((case, noise), s, trace, less)).collect();
    let mut all = Vec::new();
    let (mut columns, mut white): (Vec<Vec<f64>>, Vec<Vec<f64>>) = Default::default();
    // Outputs that are sampled together have the same columns, which stay in the cache for all of them.
    for together in looked.chunk_by(|a, b| a.times == b.times) {
        let mut made = Columns::new(&sources.all, &case.records[s], &signals, together[0].times);
        for (source, of) in sources.all.iter().enumerate() {
            made.of(of, &mut columns);
            for Looked { output, filter, masked, e, .. } in together {
                white.clone_from(&columns);
                filter.whiten_all(white.iter_mut().map(|x| &mut x[..]), masked);
                let unknown = |x: &&mut Vec<f64>| !all_finite(x);
                white.iter_mut().filter(unknown).for_each(|x| x.fill(0.0));
                all.push(Sums { output: *output, source, gram: size.products(&mut white, e) });
            }
        }
    }
    all
}
