//! A segment in; the signals that sources are made of, out.

use super::columns::{Signals, grid, sampled};
use crate::dynamics::Numbers;
use crate::estimate::{Case, Trace};

/// Signals of one segment, less their value at its start.
pub fn signals(case: &Case, s: usize, traces: &[Trace]) -> Signals {
    let (record, nu) = (&case.records[s], case.model.inputs.len());
    let grid = Numbers::from(grid(record));
    let begin = record.t0 + record.start as f64 * record.dt;
    let inputs = (0..nu).map(|i| {
        (grid.clone(), (0..record.n).map(|k| record.inputs[k * nu + i]).collect::<Vec<f64>>())
    });
    let modelled = case.outputs.iter().map(|&o| {
        let trace = traces.iter().find(|t| t.output == o);
        trace.map(|t| (t.t.clone(), t.modelled.clone())).unwrap_or_default()
    });
    let mut all: Signals = inputs.chain(modelled).collect();
    for (t, v) in &mut all {
        let first = sampled(t, v, &[begin], 0.0)[0];
        v.iter_mut().for_each(|v| *v -= first);
    }
    all
}
