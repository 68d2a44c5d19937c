//! Measured motion of one flight in; the flight path that is consistent with the kinematics, and the sensor errors it needed, out.
//!
//! # Method
//!
//! The kinematic equations (a model file, by default the embedded fragment `kinematics`) are driven by the measured specific forces and
//! rates minus their biases; the other sensors are its outputs, each at its own time stamps. One model file, two ways to use it:
//!
//! | | `by = "smoother"` | `by = "windows"` |
//! |---|---|---|
//! | what | a filter and smoother over the whole flight (`smoother`) | output error in overlapping windows, blended (`output_error`) |
//! | sensor errors | one value per flight, or drifting as random walks | one value per window |
//! | noise of the inputs | part of the model | not part of the model |
//! | turbulence | gusts as random walks of the velocities, their size estimated | not part of the model |
//! | standard deviations | of every signal along the path, and of the sensor errors | of the sensor errors |
//!
//! Either way every channel is first checked by itself and against all others (`consistency`, by the smoother).
//!
//! `alphadot`-like quantities come from the model's own rates (`udot`, `wdot`), never from differencing a vane. With gusts these are the
//! accelerations of the aircraft's motion, without the gusts' own.

pub mod consistency;
mod health;
mod output_error;
mod slow;
mod smoothed;
pub mod smoother;
mod survey;
pub mod taken;
#[cfg(test)]
mod tests;
mod verdicts;
mod windows;

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::error::{Error, Errors};
use crate::model::Model;
use crate::signal::resample::Grid;
use smoother::unwrap as unwrap_angle;

/// How the path is found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Filter and smoother over the whole flight.
    Smoother,
    /// Output error in overlapping windows.
    #[default]
    Windows,
}

/// How a flight path is reconstructed.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// How the path is found.
    pub by: Method,
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
    /// Signals of the log for the inputs and outputs of the kinematic model, where the names differ. A signal named here stands for that
    /// quantity alone: an output of the signal's own name is not compared with it.
    pub signals: IndexMap<String, String>,
    /// Outputs of the kinematic model that are not compared with the signals of their names.
    pub unscored: Vec<String>,
    /// Smoother: a gap of an input longer than this ends the path, s; shorter ones are coasted over.
    #[schemars(range(min = 0.0))]
    pub coast_s: f64,
    /// Smoother: measurements further than this many standard deviations from their prediction are rejected and counted.
    #[schemars(range(min = 3.0))]
    pub gate: f64,
    /// Smoother: random walks, in the unit of the state or parameter per square root of a second, by name; the others are constant.
    pub walk: IndexMap<String, f64>,
    /// Smoother: noise of single samples (standard deviation, SI) by name of the model's output or input, where it is known; that of the
    /// others is estimated. What a recorder has filtered or interpolated does not show its noise: give it.
    pub sd: IndexMap<String, f64>,
    /// Smoother: states and parameters that gusts disturb, as random walks whose size is estimated; names the model does not have are passed over.
    /// Altitude is among them because it follows the motion over ground, the model's the motion through the air.
    pub gusts: Vec<String>,
    /// Smoother: seconds of the flight, spread evenly over it, from which noise levels are estimated.
    #[schemars(range(min = 10.0))]
    pub noise_s: f64,
    /// Smoother: most iterations of that; 0 keeps the levels that the signals themselves show.
    pub noise_iterations: usize,
    /// Smoother: outputs of sensors that may be late (vanes with filters, slow recorders): how late is estimated, as the parameter `tau_<output>`.
    pub late: Vec<String>,
    /// Smoother: further sensor errors, by name of the model's parameters, that are estimated only where the data support them: those that
    /// are less than two standard deviations from their start are held there, the least significant first. Every decision is a row of the
    /// table `consistency`.
    pub candidates: Vec<String>,
    /// Smoother: outputs that depend on the flow of air; they mean nothing while the aircraft stands or rolls slowly.
    pub air_data: Vec<String>,
    /// Smoother: slow is a measured airspeed below this share of the flight's usual one (its 90% quantile).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub slow: f64,
    /// Further sensor errors to estimate, by name of the model's parameters (for example "b_alpha").
    pub free: Vec<String>,
    /// Sensor errors held at their start values.
    pub fixed: Vec<String>,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            by: Method::default(),
            rate_hz: 100.0,
            estimate_every: 2,
            window_s: 30.0,
            overlap_s: 6.0,
            smooth_s: 0.11,
            max_gap_s: 0.5,
            signals: IndexMap::new(),
            unscored: Vec::new(),
            coast_s: 3.0,
            gate: 5.0,
            walk: IndexMap::new(),
            sd: IndexMap::new(),
            gusts: ["u", "v", "w", "h", "wind_n", "wind_e", "wind_d"].map(String::from).to_vec(),
            noise_s: 480.0,
            noise_iterations: 12,
            late: Vec::new(),
            candidates: Vec::new(),
            air_data: ["V", "alpha_vane", "beta_vane"].map(String::from).to_vec(),
            slow: 0.3,
            free: Vec::new(),
            fixed: Vec::new(),
        }
    }
}

/// A measured signal: ascending times in s, values in SI.
pub type Series<'a> = (&'a [f64], &'a [f64]);

/// A measured output of the model: ascending times in s; values in SI, NaN where masked, angles without jumps of a whole turn.
#[derive(Debug, Clone)]
pub struct Logged<'a> {
    pub output: usize,
    pub t: &'a [f64],
    pub z: Cow<'a, [f64]>,
}

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

/// A measured output and what the path says of it, at the same times.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Compared {
    /// Of the model's outputs.
    pub output: usize,
    pub t: Vec<f64>,
    pub measured: Vec<f64>,
    /// NaN where there is no path.
    pub reconstructed: Vec<f64>,
}

/// A reconstructed flight: the model's outputs on a uniform grid, NaN where there is no path.
#[derive(Debug, Clone, Default)]
pub struct FlightPath {
    pub t: Vec<f64>,
    /// `[output of the model][time]`.
    pub outputs: Vec<Vec<f64>>,
    /// Their standard deviations; empty where the method has none.
    pub sd: Vec<Vec<f64>>,
    pub biases: Vec<Bias>,
    /// What each channel shows of itself, and against the others.
    pub checks: Vec<consistency::Row>,
    /// Measured outputs against the path, a few times a second.
    pub compared: Vec<Compared>,
    /// How late sensors are, s, by output: they show the path of so much earlier (smoother).
    pub late: BTreeMap<usize, f64>,
    /// How far measurements were from their predictions, per measured output (smoother).
    pub innovations: smoother::Innovations,
    /// What a reader must know: windows without a path and why, sensors that were not there.
    pub notes: Vec<Note>,
    /// Windows in all, and those that failed.
    pub windows: usize,
    pub failed: usize,
}

/// Something that a reader of the path must know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// A part of the path that was asked for is not there, and the data do not say why by themselves (as a gap does).
    pub missing: bool,
    /// A channel; `flightpath` where it is none.
    pub subject: String,
    /// How many samples, or one.
    pub count: u64,
    pub text: String,
}

/// The subject of notes about the path as a whole.
const FLIGHT_PATH: &str = "flightpath";

impl Note {
    fn of(subject: &str, count: usize, text: String) -> Note {
        Note { missing: false, subject: subject.to_string(), count: count as u64, text }
    }

    fn lost(text: String) -> Note {
        Note { missing: true, ..Note::from(text) }
    }
}

impl From<String> for Note {
    fn from(text: String) -> Note {
        Note::of(FLIGHT_PATH, 1, text)
    }
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
    for name in settings.free.iter().chain(&settings.fixed).chain(&settings.candidates) {
        if model.parameter(name).is_none() {
            let known: Vec<&str> = model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
            errors.push(
                Error::new(format!("the kinematic model has no parameter \"{name}\"")).help(format!("it has {}", known.join(", "))),
            );
        }
    }
    for name in settings.walk.keys() {
        if model.state(name).is_none() && model.parameter(name).is_none() {
            errors.push(Error::new(format!("the kinematic model has no state or parameter \"{name}\"")));
        }
    }
    for name in settings.late.iter().filter(|name| model.output(name).is_none()) {
        errors.push(Error::new(format!("the kinematic model has no output \"{name}\" that could be late")));
    }
    for name in settings.unscored.iter().filter(|name| model.output(name).is_none()) {
        let known: Vec<&str> = model.outputs.iter().map(|o| o.name.as_str()).collect();
        errors
            .push(Error::new(format!("the kinematic model has no output \"{name}\"")).help(format!("it has {}", known.join(", "))));
    }
    for name in settings.signals.keys().chain(settings.sd.keys()) {
        if model.input(name).is_none() && model.output(name).is_none() {
            errors.push(Error::new(format!("the kinematic model has no input or output \"{name}\"")));
        }
    }
    for (name, sd) in settings.sd.iter().filter(|(_, sd)| !(**sd > 0.0 && sd.is_finite())) {
        errors.push(Error::new(format!("sd: the noise of \"{name}\" is a standard deviation above zero, not {sd}")));
    }
    for (name, walk) in settings.walk.iter().filter(|(_, walk)| !(**walk >= 0.0 && walk.is_finite())) {
        errors.push(Error::new(format!("walk: that of \"{name}\" is at least zero, not {walk}")));
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
            let z = if quantity.unit == "rad" { Cow::Owned(unwrap_angle(z)) } else { Cow::Borrowed(z) };
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
    let missing = |name: &&str| model.output(name).is_some_and(|k| measured.iter().all(|m| m.output != k));
    let missing: Vec<&str> = sensors.into_iter().filter(missing).collect();
    if !missing.is_empty() {
        notes.push(format!("not measured, so not checked: {}", missing.join(", ")).into());
    }
    let grid = common_grid(&driving, settings);
    if grid.n < 2 {
        notes.push(Note::lost("no flight path: the inputs of the kinematic model have no common time".to_string()));
        return Ok(FlightPath { notes, ..Default::default() });
    }
    if grid.n > Grid::MOST {
        let [from, to] = [0, grid.n - 1].map(|k| grid.time(k));
        let text = format!("no flight path: the inputs run from {from:.0} s to {to:.0} s, so some clock has jumped");
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

/// The path by windows of output error, with every channel checked against the others first: a sensor that is dead or reversed is not used.
fn checked(model: &Model, driving: &[Series], measured: &[Logged], grid: &Grid, settings: &Settings) -> Result<FlightPath, Errors> {
    let seen = smoothed::checks(model, driving, measured, grid, settings)?;
    if seen.unfit {
        let (t, nowhere) = (grid.times(), vec![vec![f64::NAN; grid.n]; model.outputs.len()]);
        return Ok(FlightPath { t, outputs: nowhere, checks: seen.checks, notes: seen.notes, ..Default::default() });
    }
    let driving: Vec<Series> = driving.iter().zip(&seen.driving).map(|((t, _), y)| (*t, &y[..])).collect();
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
    let y = if model.outputs[output].unit == "rad" { unwrap_angle(&path.outputs[output]) } else { path.outputs[output].clone() };
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
        let whole =
            if model.outputs[output].unit == "rad" && value.is_finite() { turn * ((z - value) / turn).round() } else { 0.0 };
        out.t.push(t);
        out.measured.push(z);
        out.reconstructed.push(value + whole);
    }
    out
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
