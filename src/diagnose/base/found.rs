//! A base as it stands in; its fit to the training maneuvers, the noise it leaves, and the held-out
//! maneuvers with its derivatives, out.

use super::frozen::{Frozen, frozen, theta_at};
use super::stand::{Known, Stand, estimation, fitted, placed, seen, settle_steps};
use super::training::{Task, Trained};
use crate::diagnose::residual::absorbed::Fitted;
use crate::diagnose::residual::colour::noise_of;
use crate::diagnose::residual::evaluation::Evaluation;
use crate::diagnose::residual::responses::Responses;
use crate::diagnose::residual::whitening::Noise;
use crate::diagnose::subject::Places;
use crate::diagnose::subject::{Subject, Trouble};
use crate::diagnose::thresholds::Thresholds;
use crate::error::Errors;
use crate::estimate::{Case, Prepared, Settings, Stop};
use crate::model::Model;

/// The base fitted as it stands.
pub struct Found {
    /// The model without shifts, and how it is estimated.
    pub model: Model,
    pub method: Settings,
    pub prepared: Prepared,
    pub places: Places,
    pub noise: Noise,
    pub fit: Trained,
    pub free: Vec<usize>,
    substeps: Vec<usize>,
    /// The held-out maneuvers at frozen derivatives.
    pub frozen: Vec<Option<Frozen>>,
}

impl Found {
    /// The parameters as segment place `s` has them.
    pub fn theta(&self, s: usize) -> Vec<f64> {
        theta_at(&self.places, &self.frozen, &self.fit.theta, s)
    }

    /// What the fit to the training maneuvers found.
    pub fn known(&self) -> Known {
        Known::of(&self.prepared.case(), &self.prepared, &self.fit.theta)
    }

    /// Outputs whose noise is not modelled as far as it asks for, and to which order it is; none
    /// where there is nothing to model.
    pub fn unsure_noise(&self) -> Vec<(String, Option<usize>)> {
        let case = self.prepared.case();
        let name = |o: usize| case.model.outputs[case.outputs[o]].name.clone();
        let cut = self.noise.cut().into_iter().map(|(o, order)| (name(o), Some(order)));
        let unknown = self.noise.unknown().into_iter().map(|o| (name(o), None));
        cut.chain(unknown).collect()
    }

    pub fn case(&self) -> Case {
        let mut case = self.prepared.case();
        case.records
            .iter_mut()
            .zip(&self.substeps)
            .for_each(|(record, steps)| record.substeps = *steps);
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
    let prepared = Prepared::new(&stand.model, subject.segments, &stand.method)?.compiled();
    let start =
        |case: &Case| (vec![placed(case, &prepared, subject, &estimated)], None, Vec::new());
    let found = fit(stand, subject, &prepared, &start);
    Ok(found.ok_or(Trouble::Base("the base model is not finite at its own estimate".into())))
}

/// Fits the base with what was added, from where it was fitted without or from what is known
/// besides, whichever is better; the noise is that of what is left now.
///
/// # Errors
/// Settings that do not fit the model.
pub fn at_next(
    stand: &Stand,
    subject: &Subject,
    from: &Found,
    known: Option<&Known>,
) -> Result<Option<Found>, Errors> {
    let prepared = Prepared::new(&stand.model, subject.segments, &stand.method)?.compiled();
    if prepared.used != from.prepared.used {
        return Ok(None);
    }
    let before = from.known();
    let start = |case: &Case| {
        let starts = [Some(&before), known]
            .into_iter()
            .flatten()
            .map(|known| known.placed(case, &prepared))
            .collect();
        (starts, Some(from.noise.clone()), from.substeps.clone())
    };
    Ok(fit(stand, subject, &prepared, &start))
}

/// Where a fit begins: parameters (the best of these), noise if it is known, least integration
/// steps.
type Start<'a> = dyn Fn(&Case) -> (Vec<Vec<f64>>, Option<Noise>, Vec<usize>) + 'a;

/// Fits, and once more with the noise that the first fit leaves.
fn fit(stand: &Stand, subject: &Subject, prepared: &Prepared, start: &Start) -> Option<Found> {
    let (places, thresholds) =
        (Places::of(prepared, subject.held_out), &subject.settings.thresholds);
    let mut case = prepared.case();
    let (starts, known, least) = start(&case);
    starts.iter().for_each(|theta| settle_steps(&mut case, theta, &least));
    let theta = best(&case, known.as_ref(), (&places.training, thresholds), starts)?;
    let free = seen(&case, &places.training);
    let nothing = Responses::default();
    let rule = stand.method.colour();
    let again = |at: &Evaluation, noise: &Noise, responses: &Responses| {
        let fitted = Fitted::new(at, &places.training, &free, &responses.values, rule);
        Some(noise_of(&fitted.weighted(noise)?, thresholds))
    };
    // What demonstrably responds to something is taken out before, as long as anything does.
    let settled = |at: &Evaluation, mut noise: Noise| {
        let fitted = Fitted::new(at, &places.training, &free, &nothing.values, rule);
        let mut responses = Responses::default();
        while responses.more(&fitted, &noise, subject.settings) {
            noise = again(at, &noise, &responses)?;
        }
        Some(noise)
    };
    let noise = match known {
        Some(noise) => noise,
        None => {
            let at = Evaluation::new(&case, &theta, &places.training);
            let plain = noise_of(
                &Fitted::new(&at, &places.training, &free, &nothing.values, rule),
                thresholds,
            );
            // With what the estimation absorbed of it.
            (0..thresholds.noise_passes).try_fold(plain, |noise, _| again(&at, &noise, &nothing))?
        }
    };
    let (_, first) = fitted(&case, &noise, &places, theta, &stand.added, thresholds);
    let first = first?;
    let noise = {
        let at = Evaluation::new(&case, &first.theta, &places.training);
        settled(&at, again(&at, &noise, &nothing)?)?
    };
    let (free, fit) = fitted(&case, &noise, &places, first.theta, &stand.added, thresholds);
    let fit = fit?;
    Some(Found {
        model: stand.model.clone(),
        method: stand.method.clone(),
        prepared: prepared.clone(),
        frozen: frozen(&case, &noise, &places, &fit.theta, (&stand.nulls, thresholds)),
        substeps: case.records.iter().map(|r| r.substeps).collect(),
        places,
        noise,
        fit,
        free,
    })
}

/// The start at which the model is best; the first one where no noise is known to measure by.
fn best(
    case: &Case,
    noise: Option<&Noise>,
    (segments, thresholds): (&[usize], &Thresholds),
    starts: Vec<Vec<f64>>,
) -> Option<Vec<f64>> {
    let cost = |theta: &Vec<f64>| {
        let costs = noise
            .and_then(|noise| Task { case, noise, segments, free: &[], thresholds }.costs(theta));
        costs.map_or(f64::INFINITY, |costs| costs.iter().sum::<f64>())
    };
    starts
        .into_iter()
        .map(|theta| (cost(&theta), theta))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, theta)| theta)
}

pub fn values(case: &Case, stand: &Stand, theta: &[f64]) -> Vec<(String, f64)> {
    let held = |name: &String| stand.method.starts.get(name).copied();
    let of = |name: &String| {
        let at = case.unknowns.iter().position(|u| u.name == *name && u.segment.is_none());
        Some((name.clone(), at.map(|i| theta[i]).or(held(name))?))
    };
    stand.added.iter().filter_map(of).collect()
}
