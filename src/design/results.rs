//! A checked study in; its designs flown, recorded, estimated and ranked, what a search found, and
//! what could not be flown, out.

use super::judged::{Judged, rank};
use super::search::{Found, search};
use super::study::Study;
use super::work::{Watch, fly_all, judge_all};
use crate::error::Errors;

/// What came of a study.
#[derive(Debug)]
pub struct Results {
    /// Per estimate, in the order of the file, the designs in theirs; one that a search found
    /// stands behind them.
    pub estimates: Vec<Vec<Judged>>,
    /// Designs that could not be flown, at their places in the study file.
    pub errors: Errors,
    pub found: Option<Found>,
}

/// Flies, records, estimates and ranks all designs.
///
/// # Errors
/// Settings of an estimate that do not fit its model, which the check of the study tells before.
pub fn run(study: &Study, watch: Watch) -> Result<Results, Errors> {
    let tried = fly_all(study, &study.designs, study.settings.seeds, watch)?;
    let mut errors = Errors::default();
    for (design, tried) in study.designs.iter().zip(&tried) {
        if let Err(e) = tried {
            errors.push(study.about(design, e.clone()));
        }
    }
    let mut estimates = judge_all(study, &study.designs, &tried);
    let mut found = None;
    if study.settings.optimise
        && let Some(settings) = &study.settings.search
    {
        let result = search(study, settings, &estimates, watch)?;
        if let Some((design, tried)) = &result.best {
            let more = judge_all(study, std::slice::from_ref(design), std::slice::from_ref(tried));
            estimates.iter_mut().zip(more).for_each(|(all, more)| all.extend(more));
        }
        found = Some(result);
    }
    estimates.iter_mut().for_each(|judged| rank(judged));
    Ok(Results { estimates, errors, found })
}
