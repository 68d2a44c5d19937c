//! An estimation and the samples of what drives its model come in; a note on every delay that is
//! shorter than a sample of its input, with what the estimates owe to how the input is taken to run
//! between two samples, goes out.

use super::batch::Batch;
use super::config::Config;
use super::names::Driver;
use crate::dynamics::{Interpolation, Record};
use crate::error::{Errors, Result};
use crate::estimate::{Estimation, Row, Segment, Stop};
use crate::math::median;
use crate::model::graph::Leaf;
use crate::model::{Delayed, Model};
use crate::signal::resample::{Grid, cubic, hold, linear};
use crate::stage::{Inputs, Note, Severity, series};

/// How an input may run between two samples, in words.
const KINDS: [(Interpolation, &str); 3] = [
    (Interpolation::Linear, "along a straight line"),
    (Interpolation::Cubic, "along a cubic"),
    (Interpolation::Hold, "held"),
];
/// Points of the grid for one sample of the input, at least: what lies between two samples is seen.
const FINE: f64 = 8.0;
/// A hole of more than so many samples is no course between two.
const HOLE: f64 = 3.0;
/// A column of the grid is this signal where they differ by less than this share of its range.
const SAME: f64 = 1e-9;

/// A delay that is shorter than a sample of its input.
struct Short<'a> {
    input: usize,
    /// s.
    tau: f64,
    spacing: f64,
    /// The input's samples, segment by segment: times, s, and values.
    samples: Vec<(Vec<f64>, Vec<f64>)>,
    name: &'a str,
}

/// What there is to say; `again` estimates from other segments by the same settings.
///
/// # Errors
/// A table lacks a column, or an estimation is refused.
pub fn notes(
    config: &Config,
    inputs: &Inputs,
    (batch, estimation): (&Batch, &Estimation),
    again: &dyn Fn(&[Segment]) -> std::result::Result<Estimation, Errors>,
) -> std::result::Result<Vec<Note>, Errors> {
    if estimation.stop != Stop::Converged {
        return Ok(Vec::new());
    }
    let mut notes = held(config, batch);
    for short in shorts(config, inputs, batch, estimation)? {
        let mut others = Vec::new();
        for (kind, _) in KINDS {
            let Some(segments) = driven(&short, kind, &batch.labelled) else { continue };
            let other = again(&segments)?;
            if other.stop == Stop::Converged {
                others.push((kind, other));
            }
        }
        let (severity, text) = said(&short, &estimation.rows, &others);
        let text = format!("{}: {text}", batch.group);
        notes.push(config.note("", severity, short.name.to_string(), 1, text));
    }
    Ok(notes)
}

/// A delay of a held input looks back at a smooth curve through the grid: a step is where it stood to a
/// twentieth of a step of the grid (see `Record::behind`), whatever the delay's sd.
fn held(config: &Config, batch: &Batch) -> Vec<Note> {
    let Some(record) = batch.labelled.first().map(|segment| &segment.record) else {
        return Vec::new();
    };
    let is_held = |input: usize| record.interpolation.get(input) == Some(&Interpolation::Hold);
    let mut inputs: Vec<usize> = (config.model.delays.iter())
        .filter_map(|delay| match delay.of {
            Delayed::Input(input) if is_held(input) => Some(input),
            _ => None,
        })
        .collect();
    inputs.dedup();
    let note = |input: usize| {
        let name = config.model.inputs[input].name.clone();
        let text = format!(
            "{}: a delay() of {name}, which is held between samples, is known to {:.1e} s, a twentieth of a step of the grid, whatever its sd: a finer grid makes it smaller",
            batch.group,
            record.dt / 20.0
        );
        config.note("", Severity::Info, name, 1, text)
    };
    inputs.into_iter().map(note).collect()
}

/// The delays of inputs that are shorter than a sample, the shortest of each input.
fn shorts<'a>(
    config: &'a Config,
    inputs: &Inputs,
    batch: &Batch,
    estimation: &Estimation,
) -> Result<Vec<Short<'a>>> {
    let mut found: Vec<Short> = Vec::new();
    for (delay, input) in config.model.delays.iter().filter_map(|delay| match delay.of {
        Delayed::Input(input) => Some((delay, input)),
        _ => None,
    }) {
        let Some(Driver::Column(column)) = config.inputs.get(input) else { continue };
        let Some(tau) = value(&config.model, delay.tau, &batch.labelled, &estimation.rows) else {
            continue;
        };
        let samples: Vec<(Vec<f64>, Vec<f64>)> = batch
            .labelled
            .iter()
            .zip(&batch.flights)
            .map(|(segment, flight)| samples(inputs, flight, column, input, &segment.record))
            .collect::<Result<_>>()?;
        let steps = samples.iter().flat_map(|(t, _)| t.windows(2).map(|w| w[1] - w[0]));
        let spacing = median(&steps.collect::<Vec<f64>>());
        if !(tau > 0.0 && tau < spacing * (1.0 - SAME)) {
            continue;
        }
        let name = config.model.inputs[input].name.as_str();
        match found.iter_mut().find(|short| short.input == input) {
            Some(short) => short.tau = short.tau.min(tau),
            None => found.push(Short { input, tau, spacing, samples, name }),
        }
    }
    Ok(found)
}

/// A delay time: what depends on inputs (a distance over the airspeed) by their means; none where it
/// depends on more.
fn value(model: &Model, tau: u32, segments: &[Segment], rows: &[Row]) -> Option<f64> {
    let nu = model.inputs.len();
    let mean = |input: usize| {
        let all = || segments.iter().flat_map(|s| s.record.inputs.iter().skip(input).step_by(nu));
        all().sum::<f64>() / all().count() as f64
    };
    model.graph.value(tau, &|leaf| match leaf {
        Leaf::Parameter(p) => {
            let parameter = &model.parameters[p];
            let row = rows.iter().find(|row| row.name == parameter.quantity.name);
            Some(row.map_or(parameter.start, |row| row.value))
        }
        Leaf::Input(input) => Some(mean(input)),
        _ => None,
    })
}

/// The samples of an input that a record was made from: those of the signal where the column is one
/// that was put onto the grid, else the points of the grid.
fn samples(
    inputs: &Inputs,
    flight: &str,
    column: &str,
    input: usize,
    record: &Record,
) -> Result<(Vec<f64>, Vec<f64>)> {
    let grid = Grid { t0: record.t0, dt: record.dt, n: record.n };
    let values = of(record, input);
    let own = (grid.times(), values.clone());
    let Some(signals) = inputs.signals(flight, &[column.to_string()])? else { return Ok(own) };
    let signals = series(&signals)?;
    let Some((t, y)) = signals.get(column) else { return Ok(own) };
    let range = values.iter().fold(0.0f64, |most, v| most.max((v - values[0]).abs()));
    let same = |onto: Vec<f64>| {
        onto.iter().zip(&values).all(|(a, b)| (a - b).abs() <= SAME * range.max(b.abs()))
    };
    let is = KINDS.iter().any(|(kind, _)| same(onto(*kind, (t, y), &grid, f64::INFINITY)));
    if !is {
        return Ok(own);
    }
    let end = grid.time(record.n.saturating_sub(1));
    // two samples beyond each end, for the cubic
    let from = t.partition_point(|t| *t < record.t0).saturating_sub(2);
    let to = (t.partition_point(|t| *t <= end) + 2).min(t.len());
    Ok((t[from..to].to_vec(), y[from..to].to_vec()))
}

/// One column of a record's inputs.
fn of(record: &Record, input: usize) -> Vec<f64> {
    let nu = record.inputs.len() / record.n.max(1);
    record.inputs.iter().skip(input).step_by(nu.max(1)).copied().collect()
}

fn onto(kind: Interpolation, (t, y): (&[f64], &[f64]), grid: &Grid, most: f64) -> Vec<f64> {
    let onto = match kind {
        Interpolation::Linear | Interpolation::Ramps => linear,
        Interpolation::Cubic => cubic,
        Interpolation::Hold => hold,
    };
    onto(t, y, grid, most)
}

/// The segments on a grid that is fine against the input's samples, that input as `kind` says and the
/// others as they are; none where it has a hole.
fn driven(short: &Short, kind: Interpolation, segments: &[Segment]) -> Option<Vec<Segment>> {
    let one = |(segment, (t, y)): (&Segment, &(Vec<f64>, Vec<f64>))| {
        let record = &segment.record;
        let nu = record.inputs.len() / record.n.max(1);
        let times = ((FINE * record.dt / short.spacing).ceil() as usize).max(1);
        let coarse = Grid { t0: record.t0, dt: record.dt, n: record.n };
        let dt = record.dt / times as f64;
        let fine = Grid { t0: record.t0, dt, n: (record.n - 1) * times + 1 };
        let mut values = vec![0.0; fine.n * nu];
        for input in 0..nu {
            let column = if input == short.input {
                onto(kind, (t, y), &fine, HOLE * short.spacing)
            } else {
                let kind = record.interpolation.get(input).copied().unwrap_or_default();
                onto(kind, (&coarse.times(), &of(record, input)), &fine, f64::INFINITY)
            };
            if column.iter().any(|v| !v.is_finite()) {
                return None;
            }
            column.iter().enumerate().for_each(|(k, v)| values[k * nu + input] = *v);
        }
        let start = record.start * times;
        let record = Record { dt, n: fine.n, inputs: values.into(), start, ..record.clone() };
        // on the finer grid, what constants change of the columns has no place
        Some(Segment { record, made: Vec::new(), ..segment.clone() })
    };
    segments.iter().zip(&short.samples).map(one).collect()
}

/// How much it matters, and in words.
fn said(short: &Short, rows: &[Row], others: &[(Interpolation, Estimation)]) -> (Severity, String) {
    let Short { tau, spacing, name, .. } = short;
    let short = format!(
        "{name} is delayed by {tau:.3} s, less than a sample of it ({spacing:.3} s), and what it does between two samples is not known"
    );
    if others.len() < KINDS.len() {
        let text = format!(
            "{short}; the estimate did not converge with each of its courses: record {name} faster"
        );
        return (Severity::Warning, text);
    }
    let changed: Vec<String> = (rows.iter().enumerate())
        .filter(|(_, row)| !row.name.ends_with("(0)") && row.segment.is_none())
        .filter_map(|(i, row)| {
            let values: Vec<f64> = others.iter().map(|(_, other)| other.rows[i].value).collect();
            let half = 0.5
                * (values.iter().fold(f64::MIN, |a, b| a.max(*b))
                    - values.iter().fold(f64::MAX, |a, b| a.min(*b)));
            let sd = row.sd?;
            let each: Vec<String> = values.iter().map(|v| format!("{v:.4e}")).collect();
            let name = &row.name;
            (half > sd).then(|| {
                format!(
                    "{name} = {} ({:.1e} to be added to its sd of {sd:.1e})",
                    each.join(", "),
                    half
                )
            })
        })
        .collect();
    if changed.is_empty() {
        return (Severity::Info, format!("{short}; it changes no estimate by more than its sd"));
    }
    let courses: Vec<&str> = KINDS.iter().map(|(_, words)| *words).collect();
    let text =
        format!("{short}: {}: {}; record {name} faster", courses.join(", "), changed.join("; "));
    (Severity::Warning, text)
}
