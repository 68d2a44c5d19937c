//! The base fitted as it was and as it is with what was added, in; where the gap is and what became
//! of it, out.

use super::before_after::{At, Channel, Overlay, Shift, closure};
use super::coefficient::{Lack, coefficients, mean_square};
use super::driven::{Driven, EquationError, driven, measured_states};
use super::gaps::{Flown, Gap, gaps};
use super::looks::Looks;
use super::relation::{Relation, relations};
use crate::diagnose::base::found::Found;
use crate::diagnose::base::training::Task;
use crate::diagnose::residual::timescale::characteristic_time;
use crate::diagnose::residual::whitening::Noise;
use crate::diagnose::subject::Subject;
use crate::diagnose::thresholds::Thresholds;
use crate::error::Errors;
use crate::estimate::Case;
use rayon::join;

/// Where the gap is, and what the additions did to it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Comparison {
    pub gaps_before: Vec<Gap>,
    pub gaps_after: Vec<Gap>,
    pub channels: Vec<Channel>,
    pub overlays: Vec<Overlay>,
    pub shifts: Vec<Shift>,
    pub driven: Vec<Driven>,
    /// Of the base, before anything was added.
    pub lacking: Lacking,
    /// The same with everything that was added; none where nothing was.
    pub still_lacking: Option<Lacking>,
}

/// What the equations of a model lack, and what that goes with.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lacking {
    pub equations: Vec<EquationError>,
    pub relations: Vec<Relation>,
}

impl Comparison {
    /// What is lacking at the end of the search.
    pub fn lacking_at_last(&self) -> &Lacking {
        self.still_lacking.as_ref().unwrap_or(&self.lacking)
    }
}

/// What the additions did: the gap before and after, and the other parameters' shifts.
///
/// # Errors
/// None that the base itself would not have.
pub fn comparison(subject: &Subject, first: &Found, last: &Found) -> Result<Comparison, Errors> {
    let (before, after, thresholds) = (first.case(), last.case(), &subject.settings.thresholds);
    let looks = Looks::of(thresholds, characteristic_time(before.records.iter(), thresholds));
    let inputs: Vec<String> = before.model.inputs.iter().map(|i| i.name.clone()).collect();
    let (flown_before, flown_after) = join(|| flown(first, &before), || flown(last, &after));
    let is_amended = first.model.parameters.len() != last.model.parameters.len();
    let ((lacking, still), (gaps_before, gaps_after)) = join(
        || {
            join(
                || lacking(subject, first, &flown_before, &looks),
                || is_amended.then(|| lacking(subject, last, &flown_after, &looks)),
            )
        },
        || join(|| gaps(&flown_before, &inputs, &looks), || gaps(&flown_after, &inputs, &looks)),
    );
    let (driven, lacking) = lacking?;
    let mut comparison = Comparison {
        gaps_before,
        gaps_after,
        driven,
        lacking,
        still_lacking: still.transpose()?.map(|(_, lacking)| lacking),
        ..Comparison::default()
    };
    if first.prepared.used != last.prepared.used {
        return Ok(comparison);
    }
    let at = |s: usize| first.theta(s);
    let then = |s: usize| last.theta(s);
    (comparison.channels, comparison.overlays) = closure(
        &At { case: &before, theta: &at },
        &At { case: &after, theta: &then },
        &last.noise,
        &first.places.held_out,
        &first.places.training,
        &first.prepared.used,
    );
    comparison.shifts = shifts((first, &before), (last, &after), thresholds);
    Ok(comparison)
}

/// What goes away with one state driven, and what the equations of a model at its fit lack.
fn lacking(
    subject: &Subject,
    found: &Found,
    flown: &[Flown],
    looks: &Looks,
) -> Result<(Vec<Driven>, Lacking), Errors> {
    let states = measured_states(found);
    let lacks = coefficients(found, subject.segments, subject.context, &states, looks)?;
    let inputs: Vec<String> = found.model.inputs.iter().map(|i| i.name.clone()).collect();
    let (driven, mut equations) = driven(found, subject.segments, &states, looks.feedback)?;
    equations.extend(lacks.iter().flat_map(|lack| errors(lack, &found.prepared.used)));
    Ok((driven, Lacking { equations, relations: relations(flown, &inputs, &lacks, looks) }))
}

/// What a coefficient lacks, of all maneuvers together and of each.
fn errors(lack: &Lack, used: &[usize]) -> Vec<EquationError> {
    let counts: Vec<f64> =
        lack.values.iter().map(|v| v.iter().filter(|v| v.is_finite()).count() as f64).collect();
    let total: f64 = counts.iter().sum();
    let squares: Vec<[f64; 2]> = lack
        .values
        .iter()
        .zip(&lack.noise)
        .map(|(v, noise)| [mean_square(v), noise * noise])
        .collect();
    let mean = |i: usize| {
        (squares.iter().zip(&counts).filter(|(_, n)| **n > 0.0).map(|(s, n)| s[i] * n).sum::<f64>()
            / total)
            .sqrt()
    };
    let error = |segment, rms, noise| EquationError {
        segment,
        name: lack.name.clone(),
        is_rate: false,
        unit: lack.unit.clone(),
        rms,
        noise,
    };
    let each = squares
        .iter()
        .zip(used)
        .map(|(s, &segment)| error(Some(segment), s[0].sqrt(), s[1].sqrt()));
    std::iter::once(error(None, mean(0), mean(1))).chain(each).collect()
}

/// All maneuvers as a base models them.
fn flown<'a>(found: &Found, case: &'a Case) -> Vec<Flown<'a>> {
    let one = |s: usize| Flown {
        segment: found.prepared.used[s],
        record: &case.records[s],
        traces: case.traces(s, &found.theta(s)),
    };
    (0..case.records.len()).map(one).collect()
}

/// Shared parameters of the base, before and after.
fn shifts(
    (first, before): (&Found, &Case),
    (last, after): (&Found, &Case),
    thresholds: &Thresholds,
) -> Vec<Shift> {
    let sds = |found: &Found, case: &Case, noise: &Noise| {
        let task =
            Task { case, noise, segments: &found.places.training, free: &found.free, thresholds };
        task.spread(&found.fit.theta, found.free.len())
            .map(|s| s.sd)
            .unwrap_or_else(|| vec![None; found.free.len()])
    };
    let (sd_before, sd_after) = (sds(first, before, &first.noise), sds(last, after, &last.noise));
    let one = |(k, &i): (usize, &usize)| {
        let unknown = &before.unknowns[i];
        let same = |&(_, &j): &(usize, &usize)| {
            let other = &after.unknowns[j];
            other.name == unknown.name && other.group == unknown.group
        };
        let (l, &j) = last.free.iter().enumerate().find(same)?;
        let of = unknown.group.as_ref().map(|g| format!(" ({g})")).unwrap_or_default();
        Some(Shift {
            name: format!("{}{of}", unknown.name),
            unit: unknown.unit.clone(),
            before: first.fit.theta[i],
            after: last.fit.theta[j],
            before_sd: sd_before[k],
            after_sd: sd_after[l],
        })
    };
    first.free.iter().enumerate().filter_map(one).collect()
}
