//! Signals, the flight path and a model without states come in; everything a model may ask for, on
//! one uniform grid, goes out.

mod config;

use super::{Campaign, Inputs, Note, Output, Read, Severity, Stage, Unit};
use crate::config::list;
use crate::dynamics::{Directions, Interpolation, Propagator, Record};
use crate::error::{Error, Errors, Result};
use crate::model::Model;
use crate::model::graph::Leaf;
use crate::signal::resample::{Grid, cubic, hold, linear, mean};
use crate::signal::smooth::smooth;
use crate::table::{Table, Want};
use indexmap::IndexMap;
use serde_json::Value;

pub use config::{Config, Settings};

pub const STAGE: Stage = Stage {
    name: "derive",
    about: "put signals on one grid",
    units: Unit::flights,
    writes: &["samples"],
    reads,
    slice,
    run,
    ..Stage::PLAIN
};

fn slice(campaign: &Campaign, _: &Unit) -> Value {
    let mut slice = campaign.derive.slice(&campaign.channels);
    if let (Some(entries), Some(reconstruct)) = (slice.as_object_mut(), &campaign.reconstruct) {
        entries.insert(
            "path".into(),
            reconstruct.model.outputs.iter().map(|o| o.name.as_str()).collect(),
        );
    }
    slice
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let tables: &[&'static str] =
        if campaign.reconstruct.is_some() { &["signals", "flightpath"] } else { &["signals"] };
    Read::flight(tables, &unit.name)
}

/// Columns of the flight path that are read at a time.
const AT_A_TIME: usize = 6;

/// Points of the grid that a model is run through at a time.
const PIECE: usize = 1 << 14;

/// A column of the samples table.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    pub unit: String,
    pub doc: String,
    /// SI, one per point of the grid; NaN where it is not known.
    pub values: Vec<f64>,
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let config = &campaign.derive;
    let own = ["signal", "t_s", "value"].map(String::from);
    let want = Want { own: Some(&own), ..Want::default() };
    let signals = inputs.wanted("signals", &unit.name, want)?;
    let signals = signals.map_or_else(|| inputs.of("signals", &unit.name), Ok)?;
    let series = super::series(&signals)?;
    let dt = 1.0 / config.settings.rate_hz;
    let ends = || series.iter().filter_map(|(name, (t, _))| Some((*name, *t.first()?, *t.last()?)));
    let earliest = ends().min_by(|a, b| a.1.total_cmp(&b.1));
    let latest = ends().max_by(|a, b| a.2.total_cmp(&b.2));
    let (from, first) = earliest.map_or(("", f64::INFINITY), |(name, first, _)| (name, first));
    let (to, last) = latest.map_or(("", f64::NEG_INFINITY), |(name, _, last)| (name, last));
    // Grid points are whole multiples of dt: the same times whatever the first sample's is.
    let grid = Grid::covering(libm::ceil(first / dt - 1e-6) * dt, last, dt);
    if grid.n > Grid::MOST {
        let what = format!(
            "the signals run from {first:.0} s ({from}) to {last:.0} s ({to}): {} points of the grid, and {} are the most",
            grid.n,
            Grid::MOST
        );
        return Err(Error::new(what)
            .help(
                "some clock has jumped, or is another one: the table `channels` says when each signal begins and ends",
            )
            .into());
    }
    let mut columns: IndexMap<String, Column> = IndexMap::new();
    let between = config.settings.interpolation.of(series.keys().copied());
    for ((name, (t, values)), between) in series.iter().zip(between) {
        let max_gap = config.settings.max_gap * spacing(t);
        let values = match (config.settings.averaged.get(*name), between) {
            (Some(width), _) => mean(t, values, &grid, max_gap, *width),
            (None, Interpolation::Linear | Interpolation::Ramps) => {
                linear(t, values, &grid, max_gap)
            }
            (None, Interpolation::Cubic) => cubic(t, values, &grid, max_gap),
            (None, Interpolation::Hold) => hold(t, values, &grid, max_gap),
        };
        columns.insert(
            name.to_string(),
            Column {
                unit: campaign.channels.unit(name),
                doc: campaign.channels.doc(name).to_string(),
                values,
            },
        );
    }
    // of a long flight the signals are large, and no longer needed; nor are the path's deviations
    drop(series);
    drop(signals);
    if let Some(reconstruct) = &campaign.reconstruct {
        let all = crate::table::schema("flightpath")?.columns.iter().map(|c| c.name.clone());
        let names: Vec<String> =
            all.filter(|name| reconstruct.model.output(name).is_some()).collect();
        // some columns at a time: all of them are as much again as what is made of them
        for some in names.chunks(AT_A_TIME) {
            let own = [some, &["t_s".to_string()]].concat();
            let want = Want { own: Some(&own), ..Want::default() };
            if let Some(path) = inputs.wanted("flightpath", &unit.name, want)? {
                let max_gap = config.settings.max_gap;
                add_flight_path(&path, &reconstruct.model, &grid, max_gap, &mut columns)?;
            }
        }
    }
    for (name, window) in &config.settings.smooth {
        if let Some(column) = columns.get_mut(name) {
            column.values = smooth(&column.values, points(*window, dt), 3)?;
        }
    }
    let mut notes = Vec::new();
    if let Some(model) = &config.model {
        notes.extend(lacking(&unit.name, &config.inputs, &columns));
        add_model(model, &config.inputs, &grid, &mut columns)?;
    }
    notes.extend(masked(&unit.name, &columns));
    let mut table = Table::build("samples").repeat("flight", &unit.name).f64("t_s", grid.times());
    for (name, column) in columns {
        table = table.dynamic(&name, &column.unit, &column.doc, column.values);
    }
    Ok(Output { tables: vec![("samples", table.finish()?)], files: Vec::new(), notes })
}

/// Adds the reconstructed columns that the kinematic model has; one with the name of a signal takes
/// its place, as the better knowledge of the same thing.
fn add_flight_path(
    path: &Table,
    kinematics: &Model,
    grid: &Grid,
    max_gap: f64,
    columns: &mut IndexMap<String, Column>,
) -> Result<()> {
    let t = path.f64("t_s")?;
    for column in path.columns().iter().filter(|c| kinematics.output(&c.name).is_some()) {
        let values = linear(t, path.f64(&column.name)?, grid, max_gap * spacing(t));
        columns.insert(
            column.name.clone(),
            Column { unit: column.unit.clone(), doc: column.doc.clone(), values },
        );
    }
    Ok(())
}

/// What to say where the model has no value anywhere, because something that it needs has none.
fn lacking(flight: &str, inputs: &[String], columns: &IndexMap<String, Column>) -> Option<Note> {
    let is_known = |name: &&String| {
        columns.get(*name).is_some_and(|c| c.values.iter().any(|value| value.is_finite()))
    };
    let lacking: Vec<&String> = inputs.iter().filter(|name| !is_known(name)).collect();
    (!lacking.is_empty()).then(|| Note {
        flight: flight.to_string(),
        stage: STAGE.name.to_string(),
        severity: Severity::Warning,
        subject: "model".to_string(),
        count: lacking.len() as u64,
        text: format!("nothing is derived in this flight: no value of {}", list(&lacking)),
    })
}

/// Adds the outputs of the model, wherever all its inputs have values.
///
/// # Errors
/// The model has states.
pub fn add_model(
    model: &Model,
    inputs: &[String],
    grid: &Grid,
    columns: &mut IndexMap<String, Column>,
) -> Result<()> {
    let driving: Vec<&[f64]> =
        inputs.iter().filter_map(|name| columns.get(name)).map(|c| c.values.as_slice()).collect();
    let outputs = outputs(model, &model.parameter_starts(), &driving, grid)?;
    for (quantity, values) in model.outputs.iter().zip(outputs) {
        columns.insert(
            quantity.name.clone(),
            Column { unit: quantity.unit.clone(), doc: quantity.doc.clone(), values },
        );
    }
    Ok(())
}

/// The outputs of a model without states at these parameters, wherever all that drives it has values.
///
/// # Errors
/// The model has states.
pub fn outputs(
    model: &Model,
    parameters: &[f64],
    driving: &[&[f64]],
    grid: &Grid,
) -> Result<Vec<Vec<f64>>> {
    let propagator = Propagator::new(model, Directions::default())?;
    let (n, nu, ny) = (grid.n, model.inputs.len(), model.outputs.len());
    let known = |k: usize| driving.iter().all(|column| column[k].is_finite());
    let piece = if looks_at_its_own_sample(model) { PIECE } else { n.max(1) };
    let mut outputs = vec![vec![f64::NAN; n]; ny];
    let mut begin = 0;
    while begin < n {
        let end = (begin..n).find(|k| known(*k) != known(begin)).unwrap_or(n);
        if known(begin) && driving.len() == nu {
            for from in (begin..end).step_by(piece) {
                let to = (from + piece).min(end);
                // an input's rate is that of the line to a neighbour
                let rows = from.saturating_sub(1).max(begin)..(to + 1).min(end);
                let values = rows.clone().flat_map(|k| driving.iter().map(move |c| c[k])).collect();
                let record = Record {
                    t0: grid.time(rows.start),
                    dt: grid.dt,
                    n: rows.len(),
                    inputs: values,
                    ..Default::default()
                };
                let run = propagator.run(parameters, &[], &record, false);
                let rows = rows.zip(run.y.chunks_exact(ny.max(1)));
                for (k, row) in rows.filter(|(k, _)| (from..to).contains(k)) {
                    row.iter().zip(&mut outputs).for_each(|(value, output)| output[k] = *value);
                }
            }
        }
        begin = end;
    }
    Ok(outputs)
}

/// Whether a point of the outputs depends on the inputs there alone, and on their rates: what looks back, or
/// at the clock, sees all that went before.
pub fn looks_at_its_own_sample(model: &Model) -> bool {
    model.delays.is_empty() && !model.graph.leaves(&model.output_nodes).contains(&Leaf::Time)
}

/// Points of the grid in a window of so many seconds: an odd number, enough for a cubic.
pub fn points(window: f64, dt: f64) -> usize {
    (2 * libm::round(window / dt / 2.0) as usize + 1).max(5)
}

/// The usual spacing of ascending times, s: the median.
pub fn spacing(t: &[f64]) -> f64 {
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(0.0)
}

/// One note per column that has gaps between its first and its last value, and one on the points where no
/// column has a value.
fn masked(flight: &str, columns: &IndexMap<String, Column>) -> Vec<Note> {
    let note = |severity: Severity, subject: &str, count: usize, text: String| Note {
        flight: flight.to_string(),
        stage: STAGE.name.to_string(),
        severity,
        subject: subject.to_string(),
        count: count as u64,
        text,
    };
    let points = columns.values().map(|c| c.values.len()).max().unwrap_or(0);
    let mut silent = vec![columns.len() > 1; points];
    for column in columns.values().filter(|c| c.values.iter().any(|v| v.is_finite())) {
        silent.iter_mut().zip(&column.values).for_each(|(silent, v)| *silent &= !v.is_finite());
    }
    let mut notes = Vec::new();
    let mut paused = 0;
    for (name, column) in columns {
        let first = column.values.iter().position(|v| v.is_finite()).unwrap_or(0);
        let last = column.values.iter().rposition(|v| v.is_finite()).map_or(0, |i| i + 1);
        let gaps: Vec<usize> = (first..last).filter(|&k| !column.values[k].is_finite()).collect();
        let count = gaps.iter().filter(|&&k| !silent[k]).count();
        paused = paused.max(gaps.len() - count);
        if count > 0 {
            let of = last - first;
            let text = format!("{name}: {count} of {of} grid points lie in gaps and are masked");
            notes.push(note(Severity::Warning, name, count, text));
        }
    }
    if paused > 0 {
        let text = format!(
            "{paused} of {points} grid points lie where nothing was recorded, and are masked"
        );
        notes.push(note(Severity::Info, "", paused, text));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Constants;

    /// A flight longer than a piece, with what looks at its own sample alone and with what looks back or at
    /// the clock: no seam.
    #[test]
    fn a_model_that_is_run_in_pieces_has_no_seams() {
        let n = PIECE + 300;
        let grid = Grid { t0: 5.0, dt: 0.01, n };
        let value = |k: usize| libm::sin(0.003 * k as f64);
        let outputs = [
            ("own", "rad", "2*u"),
            ("rate", "rad/s", "rate(u)"),
            ("late", "rad", "delay(u, 0.5)"),
            ("clock", "s", "t"),
        ];
        for some in [&outputs[..2], &outputs[..]] {
            let lines: String = some
                .iter()
                .map(|(name, unit, text)| {
                    format!("{name} = {{ unit = \"{unit}\", value = \"{text}\" }}\n")
                })
                .collect();
            let text = format!("title = \"derived\"\n[inputs]\nu = \"rad\"\n[outputs]\n{lines}")
                .replace("0.5", "tau");
            let text = text.replace(
                "[outputs]",
                "[constants]\ntau = { unit = \"s\", value = 0.5 }\n[outputs]",
            );
            let model = Model::parse("derived", &text, &Constants::default())
                .unwrap_or_else(|e| panic!("{e}"));
            let u = Column {
                unit: "rad".into(),
                doc: String::new(),
                values: (0..n).map(value).collect(),
            };
            let mut columns = IndexMap::from([("u".to_string(), u)]);
            add_model(&model, &["u".to_string()], &grid, &mut columns).expect("run");
            let at = |name: &str, k: usize| columns[name].values[k];
            for k in [100, PIECE - 1, PIECE, PIECE + 1, PIECE + 200] {
                assert!((at("own", k) - 2.0 * value(k)).abs() < 1e-12);
                let rate = (value(k + 1) - value(k - 1)) / 0.02;
                assert!((at("rate", k) - rate).abs() < 1e-2 * 0.3, "{k}: {} {rate}", at("rate", k));
                if some.len() > 2 {
                    assert!((at("late", k) - value(k.saturating_sub(50))).abs() < 1e-9, "{k}");
                    assert!((at("clock", k) - 0.01 * k as f64).abs() < 1e-9, "{k}");
                }
            }
        }
    }

    #[test]
    fn windows_have_a_middle_and_room_for_a_cubic() {
        assert_eq!([points(2.0, 0.01), points(0.6, 0.02), points(1e-3, 0.02)], [201, 31, 5]);
    }
}
