//! What was decided about the sensor errors in; the flight with its stamps moved, and what the
//! filter starts from, out.

use std::collections::BTreeMap;

use super::settings::Settings;
use super::signals::Logged;
use super::smoother::flight::Flight;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use crate::model::extend::output_delay;
use crate::model::{Model, Parameter};

/// What was decided about the sensor errors before the path is smoothed.
#[derive(Debug, Default)]
pub struct Found {
    /// How late sensors are, s, by output.
    pub late: BTreeMap<usize, f64>,
    /// Errors that the data do not support.
    pub held: Vec<Held>,
    /// Runs that are linearised about the one before: scales and delays make products of states and
    /// parameters.
    pub passes: usize,
    /// Value and standard deviation of the sensor errors over the whole flight, by parameter.
    pub values: BTreeMap<usize, [f64; 2]>,
    /// Noise levels, and the parameters that were free with them.
    pub levels: Option<(Vec<usize>, Levels)>,
}

/// A parameter that the data do not support.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held {
    /// Index of the model's parameter.
    pub parameter: usize,
    /// What it would have been.
    pub value: f64,
    pub sd: f64,
    /// The data know it, and it is not significant.
    pub known: bool,
}

/// Parts of a flight know the sensor errors as the whole one does, give or take so many standard
/// deviations.
const WIDER: f64 = 3.0;

impl Found {
    /// The parameters that are smoothed.
    pub fn free(&self, model: &Model, settings: &Settings) -> Vec<usize> {
        let named = |list: &[String], p: &Parameter| list.contains(&p.quantity.name);
        let free =
            |p: &Parameter| !p.fixed || named(&settings.free, p) || named(&settings.candidates, p);
        let held = |i: usize| {
            self.held.iter().any(|h| h.parameter == i)
                || named(&settings.fixed, &model.parameters[i])
        };
        (0..model.parameters.len()).filter(|&i| free(&model.parameters[i]) && !held(i)).collect()
    }

    /// A flight that measures `measured`, with late sensors at the times they stand for.
    pub fn flight(&self, flight: Flight, measured: &[Logged]) -> Flight {
        flight.stamped(measured.iter().map(|m| {
            let late = self.late.get(&m.output).copied().unwrap_or(0.0);
            m.t.iter().map(|t| t - late).collect()
        }))
    }

    /// Narrows the start of the sensor errors to what the whole flight says of them; what it was,
    /// where that is known.
    pub fn narrow(&self, kinematics: &Kinematics, levels: &mut Levels) -> Option<Vec<f64>> {
        if self.values.is_empty() {
            return None;
        }
        let before = levels.start_sd.clone();
        for (sd, i) in levels.start_sd[kinematics.states()..].iter_mut().zip(&kinematics.free) {
            if let Some([_, known]) = self.values.get(i) {
                *sd = sd.min(WIDER * known);
            }
        }
        Some(before)
    }

    /// States (not read) and sensor errors as the whole flight says.
    pub fn known(&self, kinematics: &Kinematics) -> Vec<f64> {
        let start =
            |i: &usize| self.values.get(i).map_or(kinematics.model.parameters[*i].start, |v| v[0]);
        vec![0.0; kinematics.states()]
            .into_iter()
            .chain(kinematics.free.iter().map(start))
            .collect()
    }

    /// The same where they are constant, NaN where they drift: what the filter is linearised about.
    pub fn constants(&self, kinematics: &Kinematics, levels: &Levels) -> Vec<f64> {
        if self.values.is_empty() {
            return Vec::new();
        }
        self.known(kinematics)
            .iter()
            .zip(&levels.walk)
            .map(|(x, walk)| if *walk > 0.0 { f64::NAN } else { *x })
            .collect()
    }

    /// What a parameter has beyond what was smoothed: stamps that were moved already.
    pub fn offset(&self, model: &Model, parameter: usize) -> f64 {
        let of = |(output, late): (&usize, &f64)| {
            (output_delay(&model.outputs[*output].name)
                == model.parameters[parameter].quantity.name)
                .then_some(*late)
        };
        self.late.iter().find_map(of).unwrap_or(0.0)
    }
}
