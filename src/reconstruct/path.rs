//! A reconstructed flight: its path, the sensor errors it needed, what its channels show, and what
//! a reader must know.

use std::collections::BTreeMap;

use super::consistency;
use super::smoother;

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
    /// A part of the path that was asked for is not there, and the data do not say why by
    /// themselves (as a gap does).
    pub missing: bool,
    /// A channel; `flightpath` where it is none.
    pub subject: String,
    /// How many samples, or one.
    pub count: u64,
    pub text: String,
}

/// The subject of notes about the path as a whole.
pub const FLIGHT_PATH: &str = "flightpath";

impl Note {
    pub fn of(subject: &str, count: usize, text: String) -> Note {
        Note { missing: false, subject: subject.to_string(), count: count as u64, text }
    }

    pub fn lost(text: String) -> Note {
        Note { missing: true, ..Note::from(text) }
    }
}

impl From<String> for Note {
    fn from(text: String) -> Note {
        Note::of(FLIGHT_PATH, 1, text)
    }
}
