//! Start values given from outside and a record in; the start values of all states out.

use super::Record;
use crate::model::linear::Starts;
use crate::model::{Layout, Tables};

/// Start values of all states.
pub fn evaluate_starts(
    starts: &Starts,
    layout: Layout,
    tables: &Tables,
    parameters: &[f64],
    given: &[f64],
    record: &Record,
) -> Vec<f64> {
    let file = start_file(starts, layout, tables, parameters, given, record);
    (0..layout.states).map(|i| starts.program.output(&file, i)[0]).collect()
}

/// The registers of the program that computes them, after its run.
pub fn start_file(
    starts: &Starts,
    layout: Layout,
    tables: &Tables,
    parameters: &[f64],
    given: &[f64],
    record: &Record,
) -> Vec<[f64; 1]> {
    let mut file = starts.program.registers::<1>();
    let row = &record.inputs[(record.start * layout.inputs).min(record.inputs.len())..];
    for (i, u) in row.iter().take(layout.inputs).enumerate() {
        file[layout.input() + i] = [*u];
    }
    for (i, p) in parameters.iter().enumerate().take(layout.parameters) {
        file[layout.parameter() + i] = [*p];
    }
    for (&i, &x) in starts.given.iter().zip(given) {
        file[layout.start_value() + i] = [x];
    }
    starts.program.prepare(&mut file, tables);
    starts.program.run(&mut file, tables);
    file
}
