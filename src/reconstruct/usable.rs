//! A flight's signals in; the same with what is dead or frozen masked, and notes of it, out.

use std::borrow::Cow;

use super::consistency::inertial;
use super::health;
use super::path::{FlightPath, Note};
use super::plausible;
use super::settings::Settings;
use super::signals::{Logged, Series};
use super::smoother::flight::Flight;
use super::stuck;
use super::verdicts;
use crate::error::Errors;
use crate::model::{Model, Quantity};

/// A sensor with fewer samples is not used: its noise cannot be told.
const FEW: usize = 20;

/// Signals that are fit to be used.
pub struct Usable<'s> {
    /// An input that ought to move is dead.
    pub unfit: bool,
    pub driving: Vec<Cow<'s, [f64]>>,
    pub measured: Vec<Logged<'s>>,
}

impl<'s> Usable<'s> {
    pub fn series<'a>(&'a self, driving: &[Series<'a>]) -> (Vec<Series<'a>>, Vec<Logged<'a>>) {
        let measured = self.measured.iter().map(|m| Logged {
            output: m.output,
            t: m.t,
            z: Cow::Borrowed(&m.z[..]),
        });
        (
            driving.iter().zip(&self.driving).map(|((t, _), y)| (*t, &y[..])).collect(),
            measured.collect(),
        )
    }

    /// The same without what is stuck while others say that it moves, and the flight that they drive.
    ///
    /// # Errors
    /// The model is none that the smoother can run.
    pub fn following(
        mut self,
        model: &Model,
        driving: &[Series],
        settings: &Settings,
        path: &mut FlightPath,
    ) -> Result<(Self, Flight), Errors> {
        let driving: Vec<Series> =
            driving.iter().zip(&self.driving).map(|((t, _), y)| (*t, &y[..])).collect();
        let flight = Flight::driven(model, &driving, settings.smooth_s);
        let flight = stuck::mask(model, (&driving, flight), &mut self.measured, settings, path)?;
        Ok((self, flight))
    }
}

/// The signals with what is dead or frozen masked; their health goes into the rows and notes of the
/// path.
pub fn usable<'s>(
    model: &Model,
    driving: &[Series<'s>],
    measured: &'s [Logged<'s>],
    path: &mut FlightPath,
) -> Usable<'s> {
    let (driving, inputs_well) =
        well(model.inputs.iter().map(|q| (q, inertial(&q.unit))), driving, path);
    let series: Vec<Series> = measured.iter().map(|m| (m.t, &m.z[..])).collect();
    let (outputs, _) =
        well(measured.iter().map(|m| (&model.outputs[m.output], true)), &series, path);
    if !inputs_well {
        path.notes.push(Note::lost(
            "no flight path: an input of the kinematic model is dead".to_string(),
        ));
    }
    let measured =
        measured.iter().zip(outputs).map(|(m, z)| Logged { output: m.output, t: m.t, z }).collect();
    Usable { unfit: !inputs_well, driving, measured }
}

/// Signals with what is dead or frozen masked where it ought to move, their health as rows; false
/// where one is dead.
fn well<'n, 's>(
    names: impl Iterator<Item = (&'n Quantity, bool)>,
    series: &[Series<'s>],
    path: &mut FlightPath,
) -> (Vec<Cow<'s, [f64]>>, bool) {
    let mut good = true;
    let mut out = Vec::new();
    for ((quantity, moves), (t, y)) in names.zip(series) {
        let (name, mut y) = (&quantity.name, Cow::Borrowed(*y));
        let health = health::health(t, &y);
        path.checks.extend(verdicts::health_rows(name, &health, moves));
        path.checks.extend(plausible::air_row(name, &quantity.unit, &y));
        if moves && health.dead {
            y.to_mut().fill(f64::NAN);
            good = false;
            path.notes.push(Note::of(
                name,
                health.samples,
                format!("{name} is dead: its value never changes"),
            ));
        } else if moves && health.samples < FEW {
            y.to_mut().fill(f64::NAN);
            let text = format!("{name} has only {} samples: not used", health.samples);
            path.notes.push(Note::of(name, health.samples, text));
        } else if moves && health.frozen_s > 0.0 {
            let y = y.to_mut();
            for run in &health.frozen {
                // the first sample of a run was still measured
                y[run.start + 1..run.end].fill(f64::NAN);
            }
            let text = format!(
                "{name} stands still for together {:.1} s: not used there",
                health.frozen_s
            );
            path.notes.push(Note::of(name, health.frozen.iter().map(|run| run.len()).sum(), text));
        }
        out.push(y);
    }
    (out, good)
}
