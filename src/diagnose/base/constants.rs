//! A base at its fit in; the base with those constants estimated that the flights can tell better
//! than what is known of them, out.
//!
//! A model assumes constants (the place of a sensor, a vane's bias from another estimate), each with
//! an sd. Taken as exact, an error of one sd stands in the residuals like a missing effect, wherever
//! the flights are long enough to see it. So a constant `c` that they see is free, with its value and
//! sd for a prior: with `G_c` the whitened sensitivity to it and `G_c~` what the base's own free
//! parameters do not imitate, it is seen where the information of the flights, `G_c~'G_c~`, is a
//! share of what is known already, `1/sd^2`. The others stay as they are: an error of theirs is not
//! seen either.

use super::found::Found;
use super::stand::{Stand, seen};
use super::training::Task;
use crate::diagnose::subject::Subject;
use crate::error::Errors;
use crate::estimate::Prepared;
use crate::model::Model;

/// The model with those constants as parameters; none where the flights tell of none.
///
/// # Errors
/// Settings that do not fit the model.
pub fn with_constants(base: &Found, subject: &Subject) -> Result<Option<Model>, Errors> {
    let uncertain = |c: &&crate::model::Assumed| c.sd > 0.0 && c.value.is_finite();
    let constants = subject.model.constants.iter().filter(uncertain);
    let names: Vec<String> = constants.map(|c| c.quantity.name.clone()).collect();
    if names.is_empty() || !subject.method.priors {
        return Ok(None);
    }
    let model = subject.model.with_estimated(&names)?;
    let stand = Stand::first(&model, subject.method, subject.settings.base);
    let prepared = Prepared::new(&model, subject.segments, &stand.method)?;
    if prepared.used != base.prepared.used {
        return Ok(None);
    }
    let case = prepared.case();
    let theta = base.known().placed(&case, &prepared);
    let index = |name: &String| case.unknowns.iter().position(|u| u.name == *name);
    let wanted: Vec<(usize, &String)> =
        names.iter().filter_map(|name| Some((index(name)?, name))).collect();
    let others = seen(&case, &base.places.training);
    let others = others.into_iter().filter(|i| wanted.iter().all(|(w, _)| w != i));
    let mut order: Vec<usize> = others.collect();
    let n = order.len();
    order.extend(wanted.iter().map(|(i, _)| i));
    let (noise, thresholds) = (&base.noise, &subject.settings.thresholds);
    let segments = &base.places.training[..];
    let task = Task { case: &case, noise, segments, free: &order, thresholds };
    let Some(parts) = task.parts(&theta) else { return Ok(None) };
    let mut all = task.together(&parts, &theta);
    all.eliminate(0, n);
    let is_told = |(k, (i, _)): &(usize, (usize, &String))| {
        // Of the sum of both, what is known already.
        let (both, known) = (all.at(n + k, n + k), case.layout.prior_weight(*i));
        both - known > thresholds.constant_share * known
    };
    let told = wanted.into_iter().enumerate().filter(is_told);
    let told: Vec<String> = told.map(|(_, (_, name))| name.clone()).collect();
    if told.is_empty() { Ok(None) } else { subject.model.with_estimated(&told).map(Some) }
}
