//! Residuals of one segment in; sums of what is new in them at each instant with what sources do at
//! that instant, out.
//!
//! A force or moment that the model lacks moves all outputs together, in the way in which a gust
//! moves them: looked at as a response of one output, it is hidden by gusts of its own size, and a
//! noise model takes it for a colour of theirs. But `Noise::whiten` predicts every output from the
//! past of all of them, as a Kalman filter does, and past outputs tell what the gusts before did.
//! What is left, `w_t`, is what acted since the last sample, and what sensors add. Where nothing is
//! missing that is white, of unit covariance, and nothing foretells it (causality in the sense of
//! Granger, Econometrica 37, 1969). A missing term acts in proportion to itself there and then:
//! `w_t = C x_t + noise`, with `x_t` what the source does at `t`, not whitened, and few
//! coefficients suffice, because the aircraft's own response to the term belongs to the past that
//! is known already.
//!
//! Sources are modelled signals and inputs, never measured outputs: those have the noise itself in
//! them. What the fit absorbed makes `w` smaller than white (`1 - W G P G' W'`), so that gains are
//! at most those of chance.

use super::columns::Columns;
use super::signals::signals;
use super::sources::Sources;
use super::sums::{Size, Sums};
use super::whitening::Noise;
use crate::estimate::{Block, Case, Trace};
use crate::math::all_finite;
use crate::math::products::{Gram, add_dots};

/// How a source does what it does here, in words after its name.
pub const HOW: &str = ", acting at once";

/// Sums of one segment.
pub fn sums(
    case: &Case,
    noise: &Noise,
    sources: &Sources,
    s: usize,
    theta: &[f64],
    size: Size,
) -> Vec<Sums> {
    let traces = case.traces(s, theta);
    let signals = signals(case, s, &traces);
    let place = |output: usize| case.outputs.iter().position(|&o| o == output);
    let residuals =
        |z: &[f64], y: &[f64]| -> Vec<f64> { z.iter().zip(y).map(|(z, y)| z - y).collect() };
    let known = |t: &&Trace| place(t.output).is_some_and(|o| noise.filter(s, o).is_some());
    let block = |t: &Trace| {
        Some(Block::new(place(t.output)?, residuals(&t.measured, &t.modelled), Vec::new()))
    };
    let (times, blocks): (Vec<&[f64]>, Vec<Block>) =
        traces.iter().filter(known).filter_map(|t| Some((&t.t[..], block(t)?))).unzip();
    let white = noise.whiten(s, &blocks, &[]).pop().unwrap_or_default();
    let mut looked = Vec::with_capacity(blocks.len());
    let mut from = 0;
    for (times, block) in times.into_iter().zip(&blocks) {
        let known: Vec<bool> = block.e.iter().map(|e| e.is_finite()).collect();
        looked.push((times, known, block.output, &white[from..from + block.e.len()]));
        from += block.e.len();
    }
    let mut all = Vec::new();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    // Outputs that are sampled together have the same columns, and the same products of these.
    for together in looked.chunk_by(|a, b| (a.0, &a.1) == (b.0, &b.1)) {
        let (times, known) = (together[0].0, &together[0].1);
        let mut made = Columns::new(&sources.all, &case.records[s], &signals, times);
        for (source, of) in sources.all.iter().enumerate() {
            made.of(of, &mut columns);
            silence(&mut columns, known);
            let products = (size == Size::Alike).then(|| Gram::of(&columns));
            for (_, _, output, new) in together {
                let gram = match &products {
                    Some(products) => joined(products, &columns, new),
                    None => size.products(&mut columns.clone(), new),
                };
                all.push(Sums { output: *output, source, gram });
            }
        }
    }
    all
}

/// Nothing where a sample is not known, and nothing anywhere in a column that is not finite.
fn silence(columns: &mut [Vec<f64>], known: &[bool]) {
    let all = known.iter().all(|known| *known);
    for column in columns {
        let finite = all_finite(column);
        if finite && all {
            continue;
        }
        column
            .iter_mut()
            .zip(known)
            .filter(|(_, known)| !finite || !**known)
            .for_each(|(v, _)| *v = 0.0);
    }
}

/// Products of columns with those of one more behind them.
fn joined(products: &Gram, columns: &[Vec<f64>], e: &[f64]) -> Gram {
    let n = products.n;
    let mut all = Gram::zero(n + 1);
    all.add(products, 0, &(0..n).collect::<Vec<_>>());
    let columns: Vec<&[f64]> = columns.iter().map(|column| &column[..]).chain([e]).collect();
    let mut with = vec![0.0; n + 1];
    add_dots(&columns, &[e], &mut with);
    with.iter().enumerate().for_each(|(k, with)| all.sums[k * (n + 1) + n] = *with);
    all.scale[n] = all.sums[n * (n + 1) + n];
    all
}
