//! A model, segments and which of them are held out, in; the model's best fit to the training
//! segments, with the noise that it leaves, out.

use super::training::{Task, Trained};
use crate::diagnose::residual::whitening::Noise;
use crate::diagnose::settings::Base as Kind;
use crate::diagnose::subject::{Places, Subject};
use crate::diagnose::thresholds::Thresholds;
use crate::error::Errors;
use crate::estimate::{self, Asked, Case, Estimation, Prepared, Segment, Unknown};
use crate::model::{Model, Scope};
use std::collections::BTreeMap;

/// A model with what was added to it so far, as it is estimated.
#[derive(Debug, Clone)]
pub struct Stand {
    pub model: Model,
    pub method: estimate::Settings,
    /// Names of the parameters that were added, in the order of their addition.
    pub added: Vec<String>,
    /// Where each of them leaves the model as it was; none for a shape.
    pub nulls: BTreeMap<String, Option<f64>>,
}

impl Stand {
    /// The base as the campaign has it.
    pub fn first(model: &Model, method: &estimate::Settings, base: Kind) -> Stand {
        let mut method = estimate::Settings { profile: Vec::new(), ..method.clone() };
        if base == Kind::Predicted {
            method.free = Some(free_of_predictions(model, &method));
        }
        if let Some(free) = &mut method.free {
            free.extend(model.estimated().iter().cloned());
        }
        Stand { model: model.clone(), method, added: Vec::new(), nulls: BTreeMap::new() }
    }

    /// With further parameters (name, value, whether it is held there, null), the others free from
    /// there on.
    pub fn with(&self, model: &Model, values: &[(String, f64, bool, Option<f64>)]) -> Stand {
        let mut stand = Stand { model: model.clone(), ..self.clone() };
        for (name, value, held, null) in values {
            stand.method.starts.insert(name.clone(), *value);
            if *held {
                stand.method.fixed.push(name.clone());
            } else if let Some(free) = &mut stand.method.free {
                free.push(name.clone());
            }
            stand.added.push(name.clone());
            stand.nulls.insert(name.clone(), *null);
        }
        stand
    }
}

/// Parameters that are free though the model's are predicted: those that belong to one maneuver.
pub fn free_of_predictions(model: &Model, method: &estimate::Settings) -> Vec<String> {
    let own = |p: &&crate::model::Parameter| {
        let per = method.per.get(&p.quantity.name).map(|per| Scope::parse(per));
        !p.fixed && per.unwrap_or(p.scope.clone()) == Scope::Segment
    };
    model.parameters.iter().filter(own).map(|p| p.quantity.name.clone()).collect()
}

/// Estimates a model from the training segments.
///
/// # Errors
/// As `estimate_segments`.
pub fn estimation(stand: &Stand, subject: &Subject) -> Result<Estimation, Errors> {
    let training: Vec<Segment> = subject
        .segments
        .iter()
        .zip(subject.held_out)
        .filter(|(_, held)| !**held)
        .map(|(s, _)| s.clone())
        .collect();
    let method = estimate::Settings { asked: Asked::Minimum, ..stand.method.clone() };
    estimate::estimate_segments(&stand.model, &training, &method)
}

/// The parameter vector of `case` with what an estimation over the training segments found.
pub fn placed(case: &Case, prepared: &Prepared, subject: &Subject, found: &Estimation) -> Vec<f64> {
    // Indices among all segments of those that were estimated from.
    let training: Vec<usize> =
        (0..subject.segments.len()).filter(|&s| !subject.held_out[s]).collect();
    let value = |i: usize| {
        let unknown = &case.unknowns[i];
        let segment = unknown.segment.map(|at| prepared.used[at]);
        let same = |row: &&estimate::Row| {
            row.name == unknown.name
                && row.group == unknown.group
                && row.segment.map(|s| training[s]) == segment
        };
        found
            .rows
            .iter()
            .find(same)
            .map(|row| row.value)
            .filter(|v| v.is_finite())
            .unwrap_or(case.layout.start[i])
    };
    (0..case.unknowns.len()).map(value).collect()
}

/// What a fit found, to be carried into another model's case over the same segments. Ordered, so
/// that it also prints the same every time.
#[derive(Debug, Clone, PartialEq)]
pub struct Known(BTreeMap<Unknown, f64>);

impl Known {
    pub fn of(case: &Case, prepared: &Prepared, theta: &[f64]) -> Known {
        let named = |(unknown, value): (&Unknown, &f64)| (among_all(unknown, prepared), *value);
        Known(case.unknowns.iter().zip(theta).map(named).collect())
    }

    /// The parameter vector of `case`; what is not known keeps its start.
    pub fn placed(&self, case: &Case, prepared: &Prepared) -> Vec<f64> {
        let value = |i: usize| {
            let unknown = among_all(&case.unknowns[i], prepared);
            let found = self.0.get(&unknown).copied().unwrap_or(case.layout.start[i]);
            found.clamp(case.layout.lower[i], case.layout.upper[i])
        };
        (0..case.unknowns.len()).map(value).collect()
    }
}

/// An unknown whose segment is counted among all segments, used or not.
fn among_all(unknown: &Unknown, prepared: &Prepared) -> Unknown {
    Unknown { segment: unknown.segment.map(|at| prepared.used[at]), ..unknown.clone() }
}

/// Takes the integration steps that the model asks for at `theta` where they are left to the
/// program, and at least those given.
pub fn settle_steps(case: &mut Case, theta: &[f64], least: &[usize]) {
    case.stiffen(theta);
    for s in 0..case.records.len() {
        if case.is_automatic(s) {
            let steps = &mut case.records[s].substeps;
            *steps = (*steps).max(least.get(s).copied().unwrap_or(1));
        }
    }
}

/// Shared parameters that move and that any of these segments sees, ascending.
pub fn seen(case: &Case, segments: &[usize]) -> Vec<usize> {
    let layout = &case.layout;
    let moves = |i: &usize| layout.lower[*i] < layout.upper[*i];
    let is_seen = |i: &usize| segments.iter().any(|&s| layout.parts[s].shared.contains(i));
    (0..layout.shared).filter(|i| moves(i) && is_seen(i)).collect()
}

/// The best fit of a case to its training segments under the given noise, from `theta`. The
/// parameters named stand last among the free ones returned.
pub fn fitted(
    case: &Case,
    noise: &Noise,
    places: &Places,
    theta: Vec<f64>,
    last: &[String],
    thresholds: &Thresholds,
) -> (Vec<usize>, Option<Trained>) {
    let mut free = seen(case, &places.training);
    free.sort_by_key(|&i| last.contains(&case.unknowns[i].name));
    let fit = Task { case, noise, segments: &places.training, free: &free, thresholds }.fit(theta);
    (free, fit)
}
