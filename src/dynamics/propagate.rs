//! A propagator and a record in; values, then Jacobians over lanes, then sensitivities, chunk by chunk
//! (see the module's page), out.

use super::evaluate::{Many, Programs};
use super::modes::Lost;
use super::propagator::Propagator;
use super::starts::start_file;
use super::stiffness::Stiffness;
use super::tableau::MOST_SUBSTEPS;
use super::tangent::Tangent;
use super::values::{Chunk, Run};
use super::{Grid, Record};
use crate::math::pool;

/// Grid steps per chunk.
const CHUNK: usize = 32;
/// Grid steps between two looks at the Jacobian where sub-steps are chosen along the way.
const LOOK: usize = 64;

/// What a run gives of every output.
pub struct Columns {
    /// `[output][point]`
    pub values: Vec<Vec<f64>>,
    /// `[output][point][direction]`; empty unless asked for.
    pub rows: Vec<Vec<f64>>,
}

/// Runs `record` from its start point to its end. Values and sensitivities stand apart, output by output.
pub fn run(
    propagator: &Propagator,
    parameters: &[f64],
    given: &[f64],
    record: &Record,
    sensitivities: bool,
) -> (Grid, Columns) {
    let (nx, nu, ny) =
        (propagator.layout.states, propagator.layout.inputs, propagator.outputs.len());
    let n = record.n.saturating_sub(record.start);
    let nd = propagator.directions.len();
    let mut grid = Grid { n, finite: true, ..Default::default() };
    let mut values: Vec<Vec<f64>> = (0..ny).map(|_| pool::take(n)).collect();
    if n == 0 || record.inputs.len() < record.n * nu {
        values.iter_mut().for_each(|values| values.fill(f64::NAN));
        grid.finite = n == 0;
        return (
            grid,
            Columns { values, rows: vec![Vec::new(); if sensitivities { ny } else { 0 }] },
        );
    }
    let file = start_file(
        &propagator.starts,
        propagator.layout,
        &propagator.tables,
        parameters,
        given,
        record,
    );
    let mut x: Vec<f64> = (0..nx).map(|i| propagator.starts.program.output(&file, i)[0]).collect();
    let mut programs = Programs::new(propagator, parameters);
    let mut outputs = Many::new(&propagator.output_values, propagator, parameters)
        .by(propagator.native.values.as_ref());
    let mut run = Run::new(propagator, record, &mut programs.taus);
    let mut look = vec![0.0; propagator.layout.time() + 1];
    run.limit(&x, &mut programs);
    let mut lost = run.begin(&x, &mut programs).err().map(|why| (0, why));
    let mut tangent = sensitivities.then(|| Tangent::new(propagator, parameters, &file, n));
    if let Some(tangent) = &mut tangent {
        run.held().for_each(|state| tangent.hold(state));
    }
    let mut stiffness: Option<Stiffness> = None;
    let mut chunk = Chunk::default();
    let mut substeps = record.substeps.max(1);
    for first in (0..n).step_by(CHUNK) {
        if propagator.plain() {
            chunk.clear_plain()
        } else {
            chunk.clear()
        }
        let end = (first + CHUNK).min(n);
        if record.substeps == 0 && first % LOOK == 0 {
            run.arguments(first, 0.0, &x, &mut look);
            substeps = stiffness
                .get_or_insert_with(|| Stiffness::new(propagator, parameters))
                .substeps(&look, record.dt);
        }
        lost = if lost.is_some() {
            lost
        } else if substeps > MOST_SUBSTEPS {
            let fastest = stiffness.as_mut().map(|stiffness| stiffness.fastest(&look));
            let (state, time_constant) = fastest.unwrap_or((0, 0.0));
            Some((first, Lost::Stiff { state, time_constant }))
        } else if propagator.plain() {
            let lost = run.march(first..end, substeps, &mut x, &mut programs.rates, &mut chunk);
            lost.map(|k| (k, Lost::Diverges))
        } else {
            run.walk(first..end, substeps, &mut x, &mut programs, &mut chunk)
        };
        let good = lost.map_or(end, |(k, _)| k);
        let width = propagator.layout.time() + 1;
        outputs.over(&chunk.points[..(good - first) * width], &mut values, first);
        let bad = match values.iter().all(|values| finite(&values[first..good])) {
            true => None,
            false => (first..good).find(|&k| values.iter().any(|values| !values[k].is_finite())),
        };
        if let Some((k, why)) = bad.map(|k| (k, Lost::Diverges)).or(lost) {
            (grid.finite, grid.lost) = (false, Some(why));
            values.iter_mut().for_each(|values| values[k..].fill(f64::NAN));
            let rows = vec![vec![f64::NAN; n * nd]; if sensitivities { ny } else { 0 }];
            return (grid, Columns { values, rows });
        }
        if let Some(tangent) = &mut tangent {
            tangent.advance(&run, &chunk);
        }
    }
    grid.x_end = x;
    grid.stuck = run.stuck();
    let Some(tangent) = tangent else { return (grid, Columns { values, rows: Vec::new() }) };
    grid.finite &= tangent.is_finite();
    (grid, Columns { values, rows: tangent.rows })
}

/// Whether all numbers are finite: zero times each of them is zero then. Sixteen sums side by side,
/// so that none waits for the other.
fn finite(numbers: &[f64]) -> bool {
    let (blocks, rest) = numbers.as_chunks::<16>();
    let mut zeros = [0.0; 16];
    for block in blocks {
        zeros.iter_mut().zip(block).for_each(|(zero, x)| *zero += 0.0 * x);
    }
    zeros.iter().all(|zero| *zero == 0.0) && rest.iter().all(|x| x.is_finite())
}
