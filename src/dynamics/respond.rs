//! A propagator and a record in; start values, trajectories and predictions at the samples of the
//! record's channels out.

use super::propagate::{self, Columns};
use super::propagator::Propagator;
use super::record::Weights;
use super::starts::evaluate_starts;
use super::substeps;
use super::{Grid, Record, Response};
use crate::error::{Error, Result};
use crate::math::pool;
use crate::math::simd::{Eight, Width, by_width};
use crate::model::Model;
use std::cell::RefCell;

/// Samples of one clock for whose places a thread keeps the memory: 3.5 MiB.
const KEPT: usize = 1 << 16;

thread_local! {
    static PLACES: RefCell<Vec<Option<Weights>>> = const { RefCell::new(Vec::new()) };
}

impl Propagator {
    /// Start values for the `given` states of one record: the first measured value of the record
    /// `first`, or what the model says.
    ///
    /// # Errors
    /// A state starts "measured" and `first` has no finite sample of its output.
    pub fn first_values(
        &self,
        model: &Model,
        parameters: &[f64],
        record: &Record,
        first: &Record,
    ) -> Result<Vec<f64>> {
        let mut values = Vec::with_capacity(self.begin.len());
        let free: Vec<usize> = Vec::new();
        let natural = model.starts(&[], &free)?;
        let measured: Vec<f64> = natural
            .given
            .iter()
            .map(|&i| {
                let name = &model.states[i].quantity.name;
                model.output(name).and_then(|o| first.first_measured(o)).ok_or_else(|| {
                    Error::new(format!(
                        "state \"{name}\" starts at its first measured value, but there is no measured output \"{name}\""
                    ))
                    .help("map a measured signal to that output, or give the state a start value")
                })
            })
            .collect::<Result<_>>()?;
        let x = evaluate_starts(&natural, self.layout, &self.tables, parameters, &measured, record);
        for (&i, _) in self.starts.given.iter().zip(&self.begin) {
            values.push(x[i]);
        }
        Ok(values)
    }

    /// The states at the start of a record; arguments as of `run`.
    pub fn start(&self, parameters: &[f64], given: &[f64], record: &Record) -> Vec<f64> {
        evaluate_starts(&self.starts, self.layout, &self.tables, parameters, given, record)
    }

    /// Runs a record. `parameters`: all of the model's; `given`: start values of the `given()`
    /// states.
    pub fn run(
        &self,
        parameters: &[f64],
        given: &[f64],
        record: &Record,
        sensitivities: bool,
    ) -> Grid {
        let (mut grid, Columns { values, rows }) =
            propagate::run(self, parameters, given, record, sensitivities);
        let nd = self.directions.len();
        let point =
            |k: usize| rows.iter().flat_map(move |row| row[k * nd..(k + 1) * nd].iter().copied());
        if sensitivities {
            grid.dy = (0..grid.n).flat_map(point).collect();
        }
        grid.y = (0..grid.n).flat_map(|k| values.iter().map(move |values| values[k])).collect();
        values.into_iter().for_each(pool::give);
        grid
    }

    /// Integration steps per grid step that the model's Jacobian asks for at the start of a record
    /// (and at its inputs' extremes).
    pub fn substeps(&self, parameters: &[f64], given: &[f64], record: &Record) -> usize {
        substeps::substeps(self, parameters, given, record)
    }

    /// Runs a record and reads the predictions at the samples of its channels.
    pub fn respond(
        &self,
        parameters: &[f64],
        given: &[f64],
        record: &Record,
        sensitivities: bool,
    ) -> Response {
        let (grid, Columns { mut values, mut rows }) =
            propagate::run(self, parameters, given, record, sensitivities);
        let nd = self.directions.len();
        let mut out = Response { finite: grid.finite, ..Default::default() };
        // Channels of one topic have their times in common.
        let (mut places, mut off_grid) = (PLACES.take(), false);
        let mut of: Option<&[f64]> = None;
        for (i, channel) in record.channels.iter().enumerate() {
            let Some(column) = self.outputs.iter().position(|&k| k == channel.output) else {
                out.y.push(vec![f64::NAN; channel.t.len()]);
                out.dy.extend(sensitivities.then(|| vec![0.0; channel.t.len() * nd]));
                continue;
            };
            if of != Some(&*channel.t) {
                (off_grid, of) = (record.sampling(channel, &mut places), Some(&*channel.t));
            }
            let weights = off_grid.then_some(&places[..]);
            let again = record.channels[i + 1..].iter().any(|c| c.output == channel.output);
            out.y.push(match weights {
                None => whole(&mut values[column], again),
                Some(weights) => read(weights, &values[column]),
            });
            if sensitivities {
                out.dy.push(match weights {
                    None => whole(&mut rows[column], again),
                    Some(weights) => between(weights, &rows[column], nd),
                });
            }
        }
        if places.capacity() <= KEPT {
            PLACES.set(places);
        }
        values.into_iter().chain(rows).for_each(pool::give);
        out
    }
}

/// A column as it stands; a copy where it is asked for `again`.
fn whole(column: &mut Vec<f64>, again: bool) -> Vec<f64> {
    if again { column.clone() } else { std::mem::take(column) }
}

/// Values at the samples; not a number outside the grid.
fn read(weights: &[Option<Weights>], values: &[f64]) -> Vec<f64> {
    let mut out = pool::take(weights.len());
    let value = |w: &Option<Weights>| w.as_ref().map_or(f64::NAN, |w| w.value(|k| values[k]));
    out.iter_mut().zip(weights).for_each(|(out, w)| *out = value(w));
    out
}

/// Sensitivities at the samples, `[sample][direction]`; zero outside the grid.
fn between(weights: &[Option<Weights>], rows: &[f64], nd: usize) -> Vec<f64> {
    let mut out = pool::take(weights.len() * nd);
    for (out, w) in out.chunks_exact_mut(nd.max(1)).zip(weights) {
        match w {
            // SAFETY: the width is this machine's.
            Some(w) => unsafe { weigh(Width::detect(), w, &rows[w.first * nd..], out) },
            None => out.fill(0.0),
        }
    }
    out
}

by_width! {
    /// `out = sum_k w[k] rows[k]`, of rows of the length of `out`.
    fn weigh(w: &Weights, rows: &[f64], out: &mut [f64]) = weigh_body
}

/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn weigh_body<V: Eight>(w: &Weights, rows: &[f64], out: &mut [f64]) {
    let (nd, weights) = (out.len(), &w.w[..w.len]);
    assert!(rows.len() >= w.len * nd);
    let whole = nd - nd % 8;
    for at in (0..whole).step_by(8) {
        // SAFETY: eight numbers from `at` on lie in every row and in `out`.
        unsafe {
            let mut sum = V::splat(0.0);
            for (k, w) in weights.iter().enumerate() {
                sum = V::splat(*w).fma(V::load(rows.as_ptr().add(k * nd + at)), sum);
            }
            sum.store(out.as_mut_ptr().add(at));
        }
    }
    for at in whole..nd {
        let each = weights.iter().enumerate();
        out[at] = each.fold(0.0, |sum, (k, w)| w.mul_add(rows[k * nd + at], sum));
    }
}
