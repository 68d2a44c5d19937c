//! How a flight path is reconstructed, and whether that fits a kinematic model.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Errors};
use crate::model::Model;

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
    #[schemars(range(min = 1.0, max = 10000.0))]
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
    /// Signals of the log for the inputs and outputs of the kinematic model, where the names
    /// differ. A signal named here stands for that quantity alone: an output of the signal's own
    /// name is not compared with it.
    pub signals: IndexMap<String, String>,
    /// Outputs of the kinematic model that are not compared with the signals of their names.
    pub unscored: Vec<String>,
    /// Smoother: a gap of an input longer than this ends the path, s; shorter ones are coasted
    /// over.
    #[schemars(range(min = 0.0))]
    pub coast_s: f64,
    /// Smoother: measurements further than this many standard deviations from their prediction are
    /// rejected and counted.
    #[schemars(range(min = 3.0))]
    pub gate: f64,
    /// Smoother: random walks, in the unit of the state or parameter per square root of a second,
    /// by name; the others are constant.
    pub walk: IndexMap<String, f64>,
    /// Smoother: noise of single samples (standard deviation, SI) by name of the model's output or
    /// input, where it is known; that of the others is estimated. What a recorder has filtered or
    /// interpolated does not show its noise: give it.
    pub sd: IndexMap<String, f64>,
    /// Smoother: states and parameters that gusts disturb, as random walks whose size is estimated;
    /// names the model does not have are passed over. Altitude is among them because it follows the
    /// motion over ground, the model's the motion through the air.
    pub gusts: Vec<String>,
    /// Smoother: seconds of the flight, spread evenly over it, from which noise levels are
    /// estimated.
    #[schemars(range(min = 10.0))]
    pub noise_s: f64,
    /// Smoother: most iterations of that, at most 1000; 0 keeps the levels that the signals themselves show.
    #[schemars(range(max = 1000))]
    pub noise_iterations: usize,
    /// Smoother: outputs of sensors that may be late (vanes with filters, slow recorders): how late
    /// is estimated, as the parameter `tau_<output>`.
    pub late: Vec<String>,
    /// Smoother: further sensor errors, by name of the model's parameters, that are estimated only
    /// where the data support them: those that are less than two standard deviations from their
    /// start are held there, the least significant first. Every decision is a row of the table
    /// `consistency`.
    pub candidates: Vec<String>,
    /// Smoother: outputs that depend on the flow of air; they mean nothing while the aircraft
    /// stands or rolls slowly.
    pub air_data: Vec<String>,
    /// Smoother: slow is a measured airspeed below this share of the flight's usual one (its 90%
    /// quantile).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub slow: f64,
    /// Further sensor errors to estimate, by name of the model's parameters (for example
    /// "b_alpha").
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

/// The signal that stands for a quantity of the model.
pub fn signal_of<'s>(settings: &'s Settings, name: &'s str) -> &'s str {
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
            let known: Vec<&str> =
                model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
            errors.push(
                Error::new(format!("the kinematic model has no parameter \"{name}\""))
                    .help(format!("it has {}", known.join(", "))),
            );
        }
    }
    for name in settings.walk.keys() {
        if model.state(name).is_none() && model.parameter(name).is_none() {
            errors.push(Error::new(format!(
                "the kinematic model has no state or parameter \"{name}\""
            )));
        }
    }
    for name in settings.late.iter().filter(|name| model.output(name).is_none()) {
        errors.push(Error::new(format!(
            "the kinematic model has no output \"{name}\" that could be late"
        )));
    }
    for name in settings.unscored.iter().filter(|name| model.output(name).is_none()) {
        let known: Vec<&str> = model.outputs.iter().map(|o| o.name.as_str()).collect();
        errors.push(
            Error::new(format!("the kinematic model has no output \"{name}\""))
                .help(format!("it has {}", known.join(", "))),
        );
    }
    for name in settings.signals.keys().chain(settings.sd.keys()) {
        if model.input(name).is_none() && model.output(name).is_none() {
            errors
                .push(Error::new(format!("the kinematic model has no input or output \"{name}\"")));
        }
    }
    for (name, sd) in settings.sd.iter().filter(|(_, sd)| !(**sd > 0.0 && sd.is_finite())) {
        errors.push(Error::new(format!(
            "sd: the noise of \"{name}\" is a standard deviation above zero, not {sd}"
        )));
    }
    for (name, walk) in
        settings.walk.iter().filter(|(_, walk)| !(**walk >= 0.0 && walk.is_finite()))
    {
        errors.push(Error::new(format!("walk: that of \"{name}\" is at least zero, not {walk}")));
    }
    if settings.overlap_s * 2.0 > settings.window_s {
        errors.push(Error::new(format!(
            "overlap_s = {} is more than half of window_s = {}",
            settings.overlap_s, settings.window_s
        )));
    }
    errors.or(())
}
