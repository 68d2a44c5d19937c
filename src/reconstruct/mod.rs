//! Measured motion of one flight in; the flight path that is consistent with the kinematics, and the sensor errors it needed, out.
//!
//! # Method
//!
//! The kinematic equations (a model file, by default the embedded fragment `kinematics`) are driven by the measured specific forces and
//! rates minus their biases; the other sensors are its outputs. The flight is cut into overlapping windows; in each one the biases and
//! the initial states are estimated by maximum-likelihood output error, the one estimator of this program, with every sensor scored at
//! its own time stamps. Kinematics hold in any maneuver, so windows need not know where maneuvers are. Neighbouring windows are blended
//! linearly over their overlap. `alphadot`-like quantities come from the model's own rates (`udot`, `wdot`), never from differencing a
//! vane.
//!
//! Inputs whose time derivative the model asks for (body rates, for the lever arms of the sensors) are smoothed first by a short local
//! cubic, which passes motions of a few hertz and makes the differentiated rate usable.
//!
//! What this version does not do: drifting biases, wind as a state, covariance along the path.

pub mod smoother;
mod windows;

use indexmap::IndexMap;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::dynamics::{Channel, Directions, Plan, Record};
use crate::error::{Error, Errors};
use crate::estimate::{self, Estimation, Stop};
use crate::model::Model;
use crate::model::graph::Leaf;
use crate::signal::resample::{self, Grid};
use crate::signal::smooth;

/// How a flight path is reconstructed.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Rate of the flight path's grid, Hz.
    #[schemars(range(min = 1.0))]
    pub rate_hz: f64,
    /// The sensor errors are estimated on a grid with every so many points of the flight path's.
    #[schemars(range(min = 1, max = 20))]
    pub estimate_every: usize,
    /// Length of a window, s: long enough to see a bias, short enough that it is constant.
    #[schemars(range(min = 1.0))]
    pub window_s: f64,
    /// Overlap of neighbouring windows, s, over which they are blended.
    #[schemars(range(min = 0.0))]
    pub overlap_s: f64,
    /// Length of the local cubic that smooths the rates before they are differentiated, s.
    #[schemars(range(min = 0.0))]
    pub smooth_s: f64,
    /// A gap of an input longer than this ends a window, s.
    #[schemars(range(min = 0.0))]
    pub max_gap_s: f64,
    /// Signals of the log for the inputs and outputs of the kinematic model, where the names differ.
    pub signals: IndexMap<String, String>,
    /// Further sensor errors to estimate, by name of the model's parameters (for example "b_alpha").
    pub free: Vec<String>,
    /// Sensor errors held at their start values.
    pub fixed: Vec<String>,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            rate_hz: 100.0,
            estimate_every: 2,
            window_s: 30.0,
            overlap_s: 6.0,
            smooth_s: 0.11,
            max_gap_s: 0.5,
            signals: IndexMap::new(),
            free: Vec::new(),
            fixed: Vec::new(),
        }
    }
}

/// A measured signal: ascending times in s, values in SI.
pub type Series<'a> = (&'a [f64], &'a [f64]);

/// One estimated sensor error of one window.
#[derive(Debug, Clone, PartialEq)]
pub struct Bias {
    pub window: usize,
    pub t_start_s: f64,
    pub t_end_s: f64,
    pub parameter: String,
    pub unit: String,
    pub value: f64,
    pub sd: Option<f64>,
}

/// A reconstructed flight: the model's outputs on a uniform grid, NaN where there is no path.
#[derive(Debug, Clone, Default)]
pub struct FlightPath {
    pub t: Vec<f64>,
    /// `[output of the model][time]`.
    pub outputs: Vec<Vec<f64>>,
    pub biases: Vec<Bias>,
    /// What a reader must know: windows without a path and why, sensors that were not there.
    pub notes: Vec<String>,
    /// Windows in all, and those that failed.
    pub windows: usize,
    pub failed: usize,
}

/// The signal that stands for a quantity of the model.
fn signal_of<'s>(settings: &'s Settings, name: &'s str) -> &'s str {
    settings.signals.get(name).map_or(name, String::as_str)
}

/// Names of the settings that the model does not have: an error each.
///
/// # Errors
/// As said.
pub fn check(model: &Model, settings: &Settings) -> Result<(), Errors> {
    let mut errors = Errors::default();
    for name in settings.free.iter().chain(&settings.fixed) {
        if model.parameter(name).is_none() {
            let known: Vec<&str> = model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
            errors.push(
                Error::new(format!("the kinematic model has no parameter \"{name}\"")).help(format!("it has {}", known.join(", "))),
            );
        }
    }
    for name in settings.signals.keys() {
        if model.input(name).is_none() && model.output(name).is_none() {
            errors.push(Error::new(format!("the kinematic model has no input or output \"{name}\"")));
        }
    }
    if settings.overlap_s * 2.0 > settings.window_s {
        errors
            .push(Error::new(format!("overlap_s = {} is more than half of window_s = {}", settings.overlap_s, settings.window_s)));
    }
    errors.or(())
}

/// Reconstructs a flight from its signals.
///
/// # Errors
/// An input of the kinematic model has no signal, or no output has one.
pub fn reconstruct<'a>(
    model: &Model,
    signals: impl Fn(&str) -> Option<Series<'a>>,
    settings: &Settings,
) -> Result<FlightPath, Errors> {
    check(model, settings)?;
    let mut errors = Errors::default();
    let mut driving: Vec<Series> = Vec::new();
    for input in &model.inputs {
        let name = signal_of(settings, &input.name);
        match signals(name).filter(|(t, _)| t.len() > 1) {
            Some(series) => driving.push(series),
            None => errors.push(
                Error::new(format!("the kinematic model needs the signal \"{name}\" ({}), and the flight has none", input.doc))
                    .help("map it in the channel map, or name another signal under [reconstruct.signals]"),
            ),
        }
    }
    let mut notes = Vec::new();
    let mut measured: Vec<(usize, Vec<f64>, Vec<f64>)> = Vec::new();
    for (k, output) in model.outputs.iter().enumerate() {
        if let Some((t, z)) = signals(signal_of(settings, &output.name)).filter(|(t, _)| t.len() > 1) {
            let z = if output.unit == "rad" { unwrap_angle(z) } else { z.to_vec() };
            measured.push((k, t.to_vec(), z));
        }
    }
    if measured.is_empty() {
        let known: Vec<&str> = model.outputs.iter().map(|o| o.name.as_str()).collect();
        errors.push(
            Error::new("no output of the kinematic model is measured")
                .help(format!("it can be compared with {}", known.join(", "))),
        );
    }
    errors.or(())?;
    let grid = common_grid(&driving, settings);
    if grid.n < 2 {
        notes.push("the inputs of the kinematic model have no common time".to_string());
        return Ok(FlightPath { notes, ..Default::default() });
    }
    let columns = input_columns(model, &driving, &grid, settings);
    let windows = windows::cut(&columns, &grid, settings.window_s, settings.overlap_s);
    let solved: Vec<Result<Solved, String>> =
        windows.par_iter().map(|w| solve(model, &columns, &measured, &grid, w, settings)).collect();
    Ok(assemble(model, &grid, &windows, solved, notes, settings))
}

/// The uniform grid on which all inputs have values: whole multiples of its spacing.
fn common_grid(driving: &[Series], settings: &Settings) -> Grid {
    let dt = 1.0 / settings.rate_hz;
    let first = driving.iter().filter_map(|(t, _)| t.first()).copied().fold(f64::NEG_INFINITY, f64::max);
    let last = driving.iter().filter_map(|(t, _)| t.last()).copied().fold(f64::INFINITY, f64::min);
    if !(last > first) {
        return Grid { t0: 0.0, dt, n: 0 };
    }
    Grid::covering((first / dt - 1e-6).ceil() * dt, last, dt)
}

/// Inputs on the grid; those that are differentiated, smoothed.
fn input_columns(model: &Model, driving: &[Series], grid: &Grid, settings: &Settings) -> Vec<Vec<f64>> {
    let nodes: Vec<_> = model.rates.iter().chain(&model.output_nodes).copied().collect();
    let leaves = model.graph.leaves(&nodes);
    let half = (settings.smooth_s / grid.dt / 2.0).floor() as usize;
    driving
        .iter()
        .enumerate()
        .map(|(i, (t, value))| {
            let column = resample::linear(t, value, grid, settings.max_gap_s);
            if half >= 2 && leaves.contains(&Leaf::InputRate(i)) {
                smooth::smooth(&column, 2 * half + 1, 3).unwrap_or(column)
            } else {
                column
            }
        })
        .collect()
}

/// Angles without jumps of a whole turn.
fn unwrap_angle(z: &[f64]) -> Vec<f64> {
    let turn = 2.0 * std::f64::consts::PI;
    let (mut shift, mut last) = (0.0, f64::NAN);
    z.iter()
        .map(|&x| {
            if !x.is_finite() {
                return x;
            }
            if last.is_finite() {
                shift -= turn * ((x + shift - last) / turn).round();
            }
            last = x + shift;
            last
        })
        .collect()
}

/// One window's result.
struct Solved {
    /// `[point][output]`.
    y: Vec<f64>,
    estimation: Estimation,
}

/// Estimates one window. The message says why there is no path.
fn solve(
    model: &Model,
    columns: &[Vec<f64>],
    measured: &[(usize, Vec<f64>, Vec<f64>)],
    grid: &Grid,
    window: &windows::Window,
    settings: &Settings,
) -> Result<Solved, String> {
    let fine = record(columns, measured, grid, window);
    let record = coarse(&fine, columns.len(), settings.estimate_every.max(1));
    let free: Vec<String> = model
        .parameters
        .iter()
        .filter(|p| (!p.fixed || settings.free.contains(&p.quantity.name)) && !settings.fixed.contains(&p.quantity.name))
        .map(|p| p.quantity.name.clone())
        .collect();
    let initial: Vec<String> = model.states.iter().filter(|s| !s.hidden).map(|s| s.quantity.name.clone()).collect();
    // a tenth of a standard deviation is far below what a flight path needs
    let method = estimate::Settings { free: Some(free), initial, step_tolerance: 0.1, max_ar_order: 8, ..Default::default() };
    let estimation = estimate::estimate(model, std::slice::from_ref(&record), &method).map_err(|e| e.to_string())?;
    if estimation.stop != Stop::Converged {
        return Err(format!("the estimation ended as \"{}\"", estimation.stop));
    }
    let mut parameters = model.parameter_starts();
    let starts: Vec<usize> = (0..model.states.len()).filter(|&i| !model.states[i].hidden).collect();
    let mut given = vec![f64::NAN; starts.len()];
    for row in &estimation.rows {
        if let Some(i) = model.parameter(&row.name) {
            parameters[i] = row.value;
        } else if let Some(k) = starts.iter().position(|&i| row.name == format!("{}(0)", model.states[i].quantity.name)) {
            given[k] = row.value;
        }
    }
    let plan = Plan::new(model, Directions { parameters: Vec::new(), starts }).map_err(|e| e.to_string())?;
    let run = plan.run(&parameters, &given, &fine, false);
    if !run.finite {
        return Err("the path is not finite".to_string());
    }
    Ok(Solved { y: run.y, estimation })
}

/// A window as a record: inputs on the grid, and the samples of every sensor in it at their own times.
fn record(columns: &[Vec<f64>], measured: &[(usize, Vec<f64>, Vec<f64>)], grid: &Grid, window: &windows::Window) -> Record {
    let n = window.end - window.begin;
    let inputs = (window.begin..window.end).flat_map(|k| columns.iter().map(move |c| c[k])).collect();
    let (t0, t1) = (grid.time(window.begin), grid.time(window.end - 1));
    let channels = measured
        .iter()
        .filter_map(|(output, t, z)| {
            let (a, b) = (t.partition_point(|&x| x < t0), t.partition_point(|&x| x <= t1));
            (b > a).then(|| Channel { output: *output, t: t[a..b].to_vec(), z: z[a..b].to_vec() })
        })
        .collect();
    Record { t0, dt: grid.dt, n, inputs, start: 0, channels, substeps: 1, ..Default::default() }
}

/// The record with every `every`-th grid point; each input is the mean of its neighbourhood with triangular weights, so that noise is
/// averaged, not dropped. (Motion of 3 Hz keeps 99% at 50 Hz: enough for biases; the path itself is run on the fine grid.)
fn coarse(fine: &Record, inputs: usize, every: usize) -> Record {
    if every < 2 || fine.n < 2 * every {
        return fine.clone();
    }
    let n = (fine.n - 1) / every + 1;
    let mean = |k: usize, j: usize| {
        let (mut sum, mut weight) = (0.0, 0.0);
        // at the ends the neighbourhood shrinks evenly, so that the mean stays in place
        let reach = (every - 1).min(k * every).min(fine.n - 1 - k * every);
        for i in k * every - reach..=k * every + reach {
            let w = (every - i.abs_diff(k * every)) as f64;
            sum += w * fine.inputs[i * inputs + j];
            weight += w;
        }
        sum / weight
    };
    let rows = (0..n).flat_map(|k| (0..inputs).map(move |j| (k, j))).map(|(k, j)| mean(k, j)).collect();
    Record { dt: fine.dt * every as f64, n, inputs: rows, ..fine.clone() }
}

/// Blends the windows into one path.
fn assemble(
    model: &Model,
    grid: &Grid,
    windows: &[windows::Window],
    solved: Vec<Result<Solved, String>>,
    mut notes: Vec<String>,
    settings: &Settings,
) -> FlightPath {
    let ny = model.outputs.len();
    let mut outputs = vec![vec![0.0; grid.n]; ny];
    let mut weight = vec![0.0; grid.n];
    let (mut biases, mut failed) = (Vec::new(), 0);
    let overlap = settings.overlap_s / grid.dt;
    for (number, (window, result)) in windows.iter().zip(solved).enumerate() {
        let (t_start_s, t_end_s) = (grid.time(window.begin), grid.time(window.end - 1));
        let solved = match result {
            Ok(solved) => solved,
            Err(why) => {
                failed += 1;
                notes.push(format!("no flight path from {t_start_s:.1} s to {t_end_s:.1} s: {why}"));
                continue;
            }
        };
        for (k, row) in solved.y.chunks_exact(ny).enumerate() {
            // ramps up and down over the overlap; the epsilon keeps the outermost points of a flight
            let inside = (k.min(window.end - window.begin - 1 - k) as f64 + 0.5) / overlap.max(1.0);
            let w = inside.clamp(1e-6, 1.0);
            weight[window.begin + k] += w;
            for (column, y) in outputs.iter_mut().zip(row) {
                column[window.begin + k] += w * y;
            }
        }
        for row in solved.estimation.rows.iter().filter(|r| model.parameter(&r.name).is_some()) {
            let (parameter, unit) = (row.name.clone(), row.unit.clone());
            biases.push(Bias { window: number, t_start_s, t_end_s, parameter, unit, value: row.value, sd: row.sd });
        }
    }
    for column in &mut outputs {
        for (y, w) in column.iter_mut().zip(&weight) {
            *y = if *w > 0.0 { *y / w } else { f64::NAN };
        }
    }
    FlightPath { t: grid.times(), outputs, biases, notes, windows: windows.len(), failed }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_unwrapped() {
        let z = [3.0, 3.1, -3.1, -3.0, f64::NAN, 3.1];
        let u = unwrap_angle(&z);
        assert!(u.windows(2).all(|w| !(w[0].is_finite() && w[1].is_finite()) || (w[1] - w[0]).abs() < 0.3), "{u:?}");
        assert!((u[5] - 3.1).abs() < 1e-12);
    }
}
