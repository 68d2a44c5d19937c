//! A base as it stands in; its fit to the training maneuvers, the noise it leaves, and the held-out maneuvers with its derivatives, out.

use super::base::{Places, Stand, carried, estimation, fitted, placed, settle_steps};
use super::fit::Fit;
use super::noise::Noise;
use super::refit::{self, Frozen};
use super::{Subject, Trouble};
use crate::error::Errors;
use crate::estimate::{Case, Estimation, Prepared, Settings, Stop};
use crate::model::Model;

/// The base fitted as it stands.
pub struct Found {
    /// The model without shifts, and how it is estimated.
    pub model: Model,
    pub method: Settings,
    pub prepared: Prepared,
    pub places: Places,
    pub noise: Noise,
    pub fit: Fit,
    pub free: Vec<usize>,
    substeps: Vec<usize>,
    /// The held-out maneuvers at frozen derivatives.
    pub frozen: Vec<Option<Frozen>>,
}

impl Found {
    /// The parameters as segment place `s` has them.
    pub fn theta(&self, s: usize) -> Vec<f64> {
        let place = self.places.held_out.iter().position(|&h| h == s);
        place.and_then(|p| self.frozen[p].as_ref()).map_or_else(|| self.fit.theta.clone(), |f| f.theta.clone())
    }

    pub fn case(&self) -> Case<'_> {
        let mut case = self.prepared.case();
        case.records.iter_mut().zip(&self.substeps).for_each(|(record, steps)| record.substeps = *steps);
        case
    }
}

/// Estimates the base and fits it to the training maneuvers.
///
/// # Errors
/// As `estimate_segments`. What the data say is not an error.
pub fn at_first(stand: &Stand, subject: &Subject) -> Result<Result<Found, Trouble>, Errors> {
    let estimated = estimation(stand, subject)?;
    if estimated.stop == Stop::NotFinite {
        return Ok(Err(Trouble::Base("the base model is not finite at its start".into())));
    }
    let prepared = Prepared::new(&stand.model, subject.segments, &stand.method)?;
    let noise = |case: &Case| {
        let names: Vec<String> = case.outputs.iter().map(|&o| case.model.outputs[o].name.clone()).collect();
        Noise::of(&estimated, &names, groups(case, &prepared, subject, &estimated))
    };
    let found =
        fit(stand, subject, &prepared, &|case| (placed(case, &prepared, subject, &estimated), noise(case), Vec::new()), false);
    Ok(found.ok_or(Trouble::Base("the base model is not finite at its own estimate".into())))
}

/// Fits the base with what was added, from where it was fitted without; the noise is that of what is left now.
///
/// # Errors
/// Settings that do not fit the model.
pub fn at_next(stand: &Stand, subject: &Subject, from: &Found) -> Result<Option<Found>, Errors> {
    let prepared = Prepared::new(&stand.model, subject.segments, &stand.method)?;
    if prepared.used != from.prepared.used {
        return Ok(None);
    }
    let start = |case: &Case| {
        let before = from.case();
        let theta = carried(case, &prepared, &before, &from.prepared, &from.fit.theta);
        (theta, from.noise.clone(), from.substeps.clone())
    };
    Ok(fit(stand, subject, &prepared, &start, true))
}

/// Where a fit begins: parameters, noise, least integration steps.
type Start<'a> = dyn Fn(&Case) -> (Vec<f64>, Noise, Vec<usize>) + 'a;

/// `again`: once more with the noise that the first fit leaves.
fn fit(stand: &Stand, subject: &Subject, prepared: &Prepared, start: &Start, again: bool) -> Option<Found> {
    let places = Places::of(prepared, subject.held_out);
    let mut case = prepared.case();
    let (theta, mut noise, least) = start(&case);
    settle_steps(&mut case, &theta, &least);
    let (mut free, mut fit) = fitted(&case, &noise, &places, theta, &stand.added);
    if let (true, Some(first)) = (again, &fit) {
        noise = noise.of_residuals(&case, &places.training, &first.theta);
        (free, fit) = fitted(&case, &noise, &places, first.theta.clone(), &stand.added);
    }
    let fit = fit?;
    Some(Found {
        model: stand.model.clone(),
        method: stand.method.clone(),
        prepared: prepared.clone(),
        frozen: refit::frozen(&case, &noise, &places, &fit.theta),
        substeps: case.records.iter().map(|r| r.substeps).collect(),
        places,
        noise,
        fit,
        free,
    })
}

/// The group of every segment, as the estimation over the training segments numbers them.
fn groups(case: &Case, prepared: &Prepared, subject: &Subject, found: &Estimation) -> Vec<usize> {
    let training: Vec<usize> = (0..subject.segments.len()).filter(|&s| !subject.held_out[s]).collect();
    let of = |at: usize| {
        let place = training.iter().position(|&s| s == prepared.used[at])?;
        found.noise_groups.get(place).copied().flatten()
    };
    let known: Vec<Option<usize>> = (0..case.records.len()).map(of).collect();
    let like = |at: usize| {
        (0..case.records.len()).find(|&o| case.layout.parts[o].group == case.layout.parts[at].group && known[o].is_some())
    };
    (0..case.records.len()).map(|at| known[at].or(like(at).and_then(|o| known[o])).unwrap_or(0)).collect()
}

pub fn values(case: &Case, stand: &Stand, theta: &[f64]) -> Vec<(String, f64)> {
    let held = |name: &String| stand.method.starts.get(name).copied();
    let of = |name: &String| {
        let at = case.unknowns.iter().position(|u| u.name == *name && u.segment.is_none());
        Some((name.clone(), at.map(|i| theta[i]).or(held(name))?))
    };
    stand.added.iter().filter_map(of).collect()
}
