//! Measured motion of one flight in; the flight path that is consistent with the kinematics, and
//! the sensor errors it needed, out.
//!
//! # Method
//!
//! The kinematic equations (a model file, by default the embedded fragment `kinematics`) are driven
//! by the measured specific forces and rates minus their biases; the other sensors are its outputs,
//! each at its own time stamps. One model file, two ways to use it:
//!
//! | | `by = "smoother"` | `by = "windows"` |
//! |---|---|---|
//! | what | a filter and smoother over the whole flight (`smoother`) | output error in overlapping windows, blended (`output_error`) |
//! | sensor errors | one value per flight, or drifting as random walks | one value per window |
//! | noise of the inputs | part of the model | not part of the model |
//! | turbulence | gusts as random walks of the velocities, their size estimated | not part of the model |
//! | standard deviations | of every signal along the path, and of the sensor errors | of the sensor errors |
//!
//! Either way every channel is first checked by itself, outputs for where they stand still while the others move (`stuck`), gyros against the attitude (`axes`), and each
//! against all others (`consistency`, by the smoother).
//!
//! `alphadot`-like quantities come from the model's own rates (`udot`, `wdot`), never from
//! differencing a vane. With gusts these are the accelerations of the aircraft's motion, without
//! the gusts' own.

mod airspeed;
mod axes;
mod checked;
pub mod consistency;
mod following;
mod found;
mod gyros;
mod health;
mod output_error;
mod pairs;
mod path;
mod plausible;
mod pulled;
mod sensor_errors;
mod settings;
mod signals;
mod slow;
mod smoothed;
pub mod smoother;
mod stretches;
mod stuck;
mod survey;
pub mod taken;
#[cfg(test)]
mod tests;
mod turns;
mod usable;
mod verdicts;
mod wide;
mod windows;

use std::borrow::Cow;

use crate::error::{Error, Errors};
use crate::model::Model;
use crate::signal::resample::Grid;
use settings::signal_of;
use smoother::unwrap as unwrap_angle;

pub use path::{Bias, Compared, FlightPath, Note};
pub use settings::{Method, Settings, check};
pub use signals::{Logged, Series};

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
        match signals(name).filter(several) {
            Some(series) => driving.push(series),
            None => errors.push(
                Error::new(format!("the kinematic model needs the signal \"{name}\" ({}), and the flight has none", input.doc))
                    .help("map it in the channel map, or name another signal under [reconstruct.method.signals]"),
            ),
        }
    }
    let mut notes: Vec<Note> = Vec::new();
    let mut measured: Vec<Logged> = Vec::new();
    let apart = taken::apart(model, settings, |a, b| a == b);
    for (output, quantity) in model.outputs.iter().enumerate() {
        if settings.unscored.contains(&quantity.name) || apart.iter().any(|a| a.output == output) {
            continue;
        }
        if let Some((t, z)) = signals(signal_of(settings, &quantity.name)).filter(several) {
            let z =
                if quantity.unit == "rad" { Cow::Owned(unwrap_angle(z)) } else { Cow::Borrowed(z) };
            measured.push(Logged { output, t, z });
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
    let sensors = ["V", "alpha_vane", "beta_vane", "phi", "theta", "psi"];
    let missing =
        |name: &&str| model.output(name).is_some_and(|k| measured.iter().all(|m| m.output != k));
    let missing: Vec<&str> = sensors.into_iter().filter(missing).collect();
    if !missing.is_empty() {
        notes.push(format!("not measured, so not checked: {}", missing.join(", ")).into());
    }
    let grid = common_grid(&driving, settings);
    if grid.n < 2 {
        notes.push(Note::lost(
            "no flight path: the inputs of the kinematic model have no common time".to_string(),
        ));
        return Ok(FlightPath { notes, ..Default::default() });
    }
    if grid.n > Grid::MOST {
        let [from, to] = [0, grid.n - 1].map(|k| grid.time(k));
        let text = format!(
            "no flight path: the inputs run from {from:.0} s to {to:.0} s, so some clock has jumped"
        );
        notes.push(Note::lost(text));
        return Ok(FlightPath { notes, ..Default::default() });
    }
    let mut path = match settings.by {
        Method::Windows => checked(model, &driving, &measured, &grid, settings)?,
        Method::Smoother => smoothed::path(model, &driving, &measured, &grid, settings)?,
    };
    path.notes.splice(0..0, notes);
    path.compared = measured.iter().map(|m| compared(model, &path, &grid, m)).collect();
    Ok(path)
}

/// The path by windows of output error, with every channel checked against the others first: a
/// sensor that is dead or reversed is not used.
fn checked(
    model: &Model,
    driving: &[Series],
    measured: &[Logged],
    grid: &Grid,
    settings: &Settings,
) -> Result<FlightPath, Errors> {
    let seen = checked::checks(model, driving, measured, grid, settings)?;
    if seen.unfit {
        let (t, nowhere) = (grid.times(), vec![vec![f64::NAN; grid.n]; model.outputs.len()]);
        return Ok(FlightPath {
            t,
            outputs: nowhere,
            checks: seen.checks,
            notes: seen.notes,
            ..Default::default()
        });
    }
    let driving: Vec<Series> =
        driving.iter().zip(&seen.driving).map(|((t, _), y)| (*t, &y[..])).collect();
    let mut path = output_error::path(model, &driving, &seen.measured, grid, settings);
    path.checks = seen.checks;
    path.notes.splice(0..0, seen.notes);
    Ok(path)
}

/// Whether a signal has at least two values.
fn several((_, values): &Series) -> bool {
    values.iter().filter(|v| v.is_finite()).nth(1).is_some()
}

/// Time between two compared samples at least, s.
const COMPARED: f64 = 0.2;

/// Samples of one measured output beside the path, which runs straight between grid points.
fn compared(model: &Model, path: &FlightPath, grid: &Grid, logged: &Logged) -> Compared {
    let Logged { output, t, ref z } = *logged;
    let mut out = Compared { output, ..Default::default() };
    let y = if model.outputs[output].unit == "rad" {
        unwrap_angle(&path.outputs[output])
    } else {
        path.outputs[output].clone()
    };
    let late = path.late.get(&output).copied().unwrap_or(0.0);
    let mut next = f64::NEG_INFINITY;
    let turn = 2.0 * std::f64::consts::PI;
    for (&t, &z) in t.iter().zip(z.iter()).filter(|(_, z)| z.is_finite()) {
        let at = (t - late - grid.t0) / grid.dt;
        if t < next || !(at >= 0.0 && at < grid.n as f64 - 1.0) {
            continue;
        }
        next = t + COMPARED - 1e-6;
        let k = at as usize;
        let value = y[k] + (at - k as f64) * (y[k + 1] - y[k]);
        let whole = if model.outputs[output].unit == "rad" && value.is_finite() {
            turn * ((z - value) / turn).round()
        } else {
            0.0
        };
        out.t.push(t);
        out.measured.push(z);
        out.reconstructed.push(value + whole);
    }
    out
}

/// The uniform grid on which all inputs have values: whole multiples of its spacing.
fn common_grid(driving: &[Series], settings: &Settings) -> Grid {
    let dt = 1.0 / settings.rate_hz;
    let first =
        driving.iter().filter_map(|(t, _)| t.first()).copied().fold(f64::NEG_INFINITY, f64::max);
    let last = driving.iter().filter_map(|(t, _)| t.last()).copied().fold(f64::INFINITY, f64::min);
    if !(last > first) {
        return Grid { t0: 0.0, dt, n: 0 };
    }
    Grid::covering((first / dt - 1e-6).ceil() * dt, last, dt)
}
