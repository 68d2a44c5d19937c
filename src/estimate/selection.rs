//! Parameters that may be left out in; the estimation in which all that are left are significant,
//! and what was decided of each, out.
//!
//! Backward elimination: everything is estimated; of the candidates that are not significant the
//! least significant is held at its start, and the others are estimated again, until all that are
//! left are. Two that the data cannot distinguish are not both left. (Standard deviations are those
//! that allow for coloured residuals: with the Cramer-Rao bound nearly everything looks
//! significant.)

use super::decision::{Decision, Support};
use super::rank::{NONE, Verdict};
use super::search::Searched;
use super::{Estimation, Search, Settings, Stop};
use crate::error::Errors;
use crate::math::distribution::chi2_cdf;

/// A candidate is significant from so many standard deviations on; one with several values (per
/// segment) where all of them together are as unlikely to be at their start.
const SIGNIFICANT: f64 = 2.0;

/// Estimates, without the candidates of the settings that the data do not support.
pub fn select(
    settings: &Settings,
    estimate: impl Fn(&Settings) -> Result<Estimation, Errors>,
    search: impl Fn(&Settings) -> Result<Searched, Errors>,
) -> Result<Estimation, Errors> {
    if settings.candidates.is_empty() {
        return estimate(settings);
    }
    if settings.search != Search::Backward {
        return with_taken(settings, estimate, search(settings)?);
    }
    // profiles are for the last one
    let mut trial = Settings { profile: Vec::new(), ..settings.clone() };
    let mut decisions: Vec<Decision> = Vec::new();
    let mut estimation = estimate(&trial)?;
    while let Some(decision) = weakest(&estimation, settings, &trial) {
        trial.fixed.push(decision.parameter.clone());
        decisions.push(decision);
        estimation = estimate(&trial)?;
    }
    if estimation.stop == Stop::Converged {
        let left = settings.candidates.iter().filter(|name| !trial.fixed.contains(name));
        decisions
            .extend(left.filter_map(|name| judge(&estimation, name)).map(|(decision, _)| decision));
    }
    if !settings.profile.is_empty() {
        trial.profile = settings
            .profile
            .iter()
            .filter(|name| decisions.iter().all(|d| !d.held() || d.parameter != **name))
            .cloned()
            .collect();
        estimation = estimate(&trial)?;
    }
    Ok(Estimation { decisions, ..estimation })
}

/// Estimates with the candidates that a search took.
fn with_taken(
    settings: &Settings,
    estimate: impl Fn(&Settings) -> Result<Estimation, Errors>,
    searched: Searched,
) -> Result<Estimation, Errors> {
    let mut trial = settings.clone();
    let left = settings.candidates.iter().filter(|name| !searched.taken.contains(name));
    trial.fixed.extend(left.cloned());
    trial.profile.retain(|name| !trial.fixed.contains(name));
    let mut estimation = estimate(&trial)?;
    // The search takes residuals for white; what does not stand out of slow ones goes again.
    let mut dropped: Vec<Decision> = Vec::new();
    while let Some(decision) = weakest(&estimation, settings, &trial) {
        trial.fixed.push(decision.parameter.clone());
        trial.profile.retain(|name| *name != decision.parameter);
        dropped.push(decision);
        estimation = estimate(&trial)?;
    }
    let decide = |name: &String| match searched.taken.contains(name) {
        true => match dropped.iter().find(|decision| decision.parameter == *name) {
            Some(decision) => Some(decision.clone()),
            None => judge(&estimation, name).map(|(decision, _)| decision),
        },
        false => Some(Decision {
            parameter: name.clone(),
            unit: searched.unit(name).to_string(),
            value: f64::NAN,
            sd: f64::NAN,
            start: searched.start(name),
            support: Support::NotTaken,
            like: Vec::new(),
        }),
    };
    let decisions = settings.candidates.iter().filter_map(decide).collect();
    Ok(Estimation { decisions, searched: searched.steps, ..estimation })
}

/// The candidate that is held next; none where all that are left are significant, or nothing can be
/// said.
fn weakest(estimation: &Estimation, settings: &Settings, trial: &Settings) -> Option<Decision> {
    let left = || settings.candidates.iter().filter(|name| !trial.fixed.contains(name));
    let idle = left().rev().find_map(|name| {
        estimation.rows.iter().find(|row| row.idle && row.name == *name).map(|row| Decision {
            parameter: row.name.clone(),
            unit: row.unit.clone(),
            value: f64::NAN,
            sd: f64::NAN,
            start: row.start,
            support: Support::NotObservable,
            like: Vec::new(),
        })
    });
    match estimation.stop {
        Stop::Converged if idle.is_some() => idle,
        Stop::Converged => {
            let judged = left().filter_map(|name| judge(estimation, name));
            let (decision, chance) = judged.max_by(|a, b| a.1.total_cmp(&b.1))?;
            let level = 1.0 - chi2_cdf(SIGNIFICANT * SIGNIFICANT, 1.0);
            (chance > level).then_some(Decision { support: Support::NotSignificant, ..decision })
        }
        Stop::Singular => {
            let undetermined =
                estimation.verdict.combinations.iter().filter(|c| c.information <= NONE);
            let terms = undetermined.flat_map(|c| &c.terms);
            let weak: Vec<&str> = terms.map(|term| term.name.as_str()).collect();
            // the last one named is the one that is missed least
            let name = left().rev().find(|name| weak.contains(&name.as_str()))?;
            let row = estimation.rows.iter().find(|row| row.name == *name)?;
            let (parameter, unit, start) = (row.name.clone(), row.unit.clone(), row.start);
            Some(Decision {
                parameter,
                unit,
                value: f64::NAN,
                sd: f64::NAN,
                start,
                support: Support::NotObservable,
                like: like(&estimation.verdict, name),
            })
        }
        _ => None,
    }
}

/// The other parameters of the combination without effect that a candidate is part of.
fn like(verdict: &Verdict, name: &str) -> Vec<String> {
    let without = verdict.combinations.iter().filter(|c| c.information <= NONE);
    let of = without.map(|c| &c.terms).find(|terms| terms.iter().any(|t| t.name == name));
    let mut names: Vec<String> = of.into_iter().flatten().map(|t| t.name.clone()).collect();
    names.retain(|other| other != name);
    names.dedup();
    names
}

/// A candidate's values against their start, and how likely they would be so far from it by chance.
/// One that sits on a bound is as far from it as it may be.
fn judge(estimation: &Estimation, name: &str) -> Option<(Decision, f64)> {
    let (mut square, mut count, mut farthest) = (0.0, 0.0, -1.0);
    let mut decision = None;
    for row in estimation.rows.iter().filter(|row| row.name == name) {
        let sd = row.sd.unwrap_or(f64::NAN);
        let z = if sd > 0.0 { (row.value - row.start) / sd } else { f64::INFINITY };
        square += z * z;
        count += 1.0;
        if z.abs() > farthest {
            farthest = z.abs();
            let (parameter, unit) = (row.name.clone(), row.unit.clone());
            decision = Some(Decision {
                parameter,
                unit,
                value: row.value,
                sd,
                start: row.start,
                support: Support::Significant,
                like: Vec::new(),
            });
        }
    }
    let chance = if square.is_finite() { 1.0 - chi2_cdf(square, count) } else { 0.0 };
    decision.map(|decision| (decision, chance))
}
