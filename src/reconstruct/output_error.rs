//! Windows of output error: measured motion in; the path and the sensor errors of each window,
//! blended, out.
//!
//! The flight is cut into overlapping windows; in each one the sensor errors and the initial states
//! are estimated by maximum-likelihood output error, the one estimator of this program, with every
//! sensor scored at its own time stamps. Kinematics hold in any maneuver, so windows need not know
//! where maneuvers are. Neighbouring windows are blended linearly over their overlap.
//!
//! Inputs whose time derivative the model asks for (body rates, for the lever arms of the sensors)
//! are smoothed first by a short local cubic, which passes motions of a few hertz and makes the
//! differentiated rate usable.

use rayon::prelude::*;

use super::path::{Bias, FlightPath, Note};
use super::settings::Settings;
use super::signals::{Logged, Series};
use super::windows;
use crate::dynamics::{Channel, Directions, Propagator, Record};
use crate::estimate::{self, Estimation, Stop};
use crate::model::Model;
use crate::model::graph::Leaf;
use crate::signal::resample::{self, Grid};
use crate::signal::smooth;

/// The path on `grid` from the driving signals (one per input of the model) and the measured
/// outputs.
pub fn path(
    model: &Model,
    driving: &[Series],
    measured: &[Logged],
    grid: &Grid,
    settings: &Settings,
) -> FlightPath {
    let columns = input_columns(model, driving, grid, settings);
    let windows = windows::cut(&columns, grid, settings.window_s, settings.overlap_s);
    let solved: Vec<Result<Solved, String>> =
        windows.par_iter().map(|w| solve(model, &columns, measured, grid, w, settings)).collect();
    let none = "no flight path: nowhere are all inputs of the kinematic model known for a second"
        .to_string();
    let notes = if windows.is_empty() { vec![Note::lost(none)] } else { Vec::new() };
    assemble(model, grid, &windows, solved, notes, settings)
}

/// Inputs on the grid; those that are differentiated, smoothed.
fn input_columns(
    model: &Model,
    driving: &[Series],
    grid: &Grid,
    settings: &Settings,
) -> Vec<Vec<f64>> {
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
    measured: &[Logged],
    grid: &Grid,
    window: &windows::Window,
    settings: &Settings,
) -> Result<Solved, String> {
    model.without_noise("the flight path").map_err(|e| e.what)?;
    let fine = record(columns, measured, grid, window);
    let record = coarse(&fine, columns.len(), settings.estimate_every.max(1));
    let free: Vec<String> = model
        .parameters
        .iter()
        .filter(|p| {
            (!p.fixed || settings.free.contains(&p.quantity.name))
                && !settings.fixed.contains(&p.quantity.name)
        })
        .map(|p| p.quantity.name.clone())
        .collect();
    let initial: Vec<String> =
        model.states.iter().filter(|s| !s.hidden).map(|s| s.quantity.name.clone()).collect();
    // a tenth of a standard deviation is far below what a flight path needs
    let method = estimate::Settings {
        free: Some(free),
        initial,
        step_tolerance: 0.1,
        // A window that says nothing of a sensor has no path.
        without_effect: estimate::WithoutEffect::Refuse,
        asked: estimate::Asked::Minimum,
        ..Default::default()
    };
    let estimation = estimate::estimate(model, std::slice::from_ref(&record), &method)
        .map_err(|e| e.to_string())?;
    if estimation.stop != Stop::Converged {
        return Err(ended(&estimation));
    }
    let mut parameters = model.parameter_starts();
    let starts: Vec<usize> = (0..model.states.len()).filter(|&i| !model.states[i].hidden).collect();
    let mut given = vec![f64::NAN; starts.len()];
    for row in &estimation.rows {
        if let Some(i) = model.parameter(&row.name) {
            parameters[i] = row.value;
        } else if let Some(k) =
            starts.iter().position(|&i| row.name == format!("{}(0)", model.states[i].quantity.name))
        {
            given[k] = row.value;
        }
    }
    let propagator = Propagator::new(model, Directions { parameters: Vec::new(), starts })
        .map_err(|e| e.to_string())?;
    let run = propagator.run(&parameters, &given, &fine, false);
    if !run.finite {
        return Err("the path is not finite".to_string());
    }
    Ok(Solved { y: run.y, estimation })
}

/// Why an estimation has no result: how it ended, and the parameters to blame.
fn ended(estimation: &Estimation) -> String {
    let mut text = format!("the estimation ended as \"{}\"", estimation.stop);
    let words = estimation.verdict.undetermined();
    if !words.is_empty() {
        text += &format!(
            ": {}; hold a sensor error in `fixed`, or log what determines it",
            words.join("; ")
        );
    }
    text
}

/// A window as a record: inputs on the grid, and the samples of every sensor in it at their own
/// times.
fn record(
    columns: &[Vec<f64>],
    measured: &[Logged],
    grid: &Grid,
    window: &windows::Window,
) -> Record {
    let n = window.end - window.begin;
    let inputs =
        (window.begin..window.end).flat_map(|k| columns.iter().map(move |c| c[k])).collect();
    let (t0, t1) = (grid.time(window.begin), grid.time(window.end - 1));
    let channels = measured
        .iter()
        .filter_map(|Logged { output, t, z }| {
            let (a, b) = (t.partition_point(|&x| x < t0), t.partition_point(|&x| x <= t1));
            (b > a).then(|| Channel {
                output: *output,
                t: t[a..b].to_vec().into(),
                z: z[a..b].to_vec().into(),
            })
        })
        .collect();
    Record { t0, dt: grid.dt, n, inputs, start: 0, channels, substeps: 1, ..Default::default() }
}

/// The record with every `every`-th grid point; each input is the mean of its neighbourhood with
/// triangular weights, so that noise is averaged, not dropped. (Motion of 3 Hz keeps 99% at 50 Hz:
/// enough for biases; the path itself is run on the fine grid.)
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
    let rows =
        (0..n).flat_map(|k| (0..inputs).map(move |j| (k, j))).map(|(k, j)| mean(k, j)).collect();
    Record { dt: fine.dt * every as f64, n, inputs: rows, ..fine.clone() }
}

/// Blends the windows into one path.
fn assemble(
    model: &Model,
    grid: &Grid,
    windows: &[windows::Window],
    solved: Vec<Result<Solved, String>>,
    mut notes: Vec<Note>,
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
                notes.push(Note::lost(format!(
                    "no flight path from {t_start_s:.1} s to {t_end_s:.1} s: {why}"
                )));
                continue;
            }
        };
        for (k, row) in solved.y.chunks_exact(ny).enumerate() {
            // ramps up and down over the overlap; the epsilon keeps the outermost points of a
            // flight
            let inside = (k.min(window.end - window.begin - 1 - k) as f64 + 0.5) / overlap.max(1.0);
            let w = inside.clamp(1e-6, 1.0);
            weight[window.begin + k] += w;
            for (column, y) in outputs.iter_mut().zip(row) {
                column[window.begin + k] += w * y;
            }
        }
        for row in solved.estimation.rows.iter().filter(|r| model.parameter(&r.name).is_some()) {
            let (parameter, unit) = (row.name.clone(), row.unit.clone());
            biases.push(Bias {
                window: number,
                t_start_s,
                t_end_s,
                parameter,
                unit,
                value: row.value,
                sd: row.sd,
            });
        }
    }
    for column in &mut outputs {
        for (y, w) in column.iter_mut().zip(&weight) {
            *y = if *w > 0.0 { *y / w } else { f64::NAN };
        }
    }
    FlightPath {
        t: grid.times(),
        outputs,
        biases,
        notes,
        windows: windows.len(),
        failed,
        ..Default::default()
    }
}
