//! A candidate that passes in; whether noise of the inputs would make it itself, out.
//!
//! A model is driven by inputs as they were measured, `u + v`. Noise takes from the gain of what it is in,
//! and other records that go with the same motion make up for it: a delayed rate for a noisy angle of
//! attack, friction that holds what the noise would move. Such an effect gains on held-out maneuvers, too,
//! and in every choice of them, since the noise is in all. What tells is that it grows with the noise, where
//! one that is there does not: inputs with as much noise again (Cook & Stefanski 1994, as in
//! `estimate::noisy_inputs`), of both signs, are asked for one step from its fit.

use super::refit::{Attached, Ground, Refit, attached};
use crate::diagnose::base::stand::seen;
use crate::diagnose::base::training::Task;
use crate::diagnose::effect::Candidate;
use crate::error::Errors;

/// Draws of the noise, each with both signs.
const DRAWS: u64 = 2;

/// Why noise of the inputs may be all that a candidate is; none where it is not.
///
/// # Errors
/// Its model does not fit the settings of the base's estimation.
pub fn by_noise(
    ground: &Ground,
    candidate: &Candidate,
    refit: &Refit,
) -> Result<Option<String>, Errors> {
    if candidate.noise {
        return Ok(None);
    }
    let inputs = ground.case.noisy();
    if inputs.is_empty() {
        return Ok(None);
    }
    let at: Vec<f64> = refit.values.iter().map(|v| v.value).collect();
    let Some(Attached { case, theta, .. }) = attached(ground, (candidate, &at), &refit.known)?
    else {
        return Ok(None);
    };
    let free = seen(&case, &ground.places.training);
    let mut steps = vec![0.0; free.len()];
    for noisy in case.noisier(DRAWS) {
        let task = Task {
            case: &noisy,
            noise: ground.noise,
            segments: &ground.places.training,
            free: &free,
            thresholds: ground.thresholds,
        };
        let Some(step) = task.shared_step(&theta) else { return Ok(None) };
        let share = 0.5 / DRAWS as f64;
        steps.iter_mut().zip(step).for_each(|(sum, step)| *sum += share * step);
    }
    let mut most: Option<(f64, &str)> = None;
    for value in refit.values.iter().filter(|v| !v.held) {
        // An effect that is there or not is as large as its shape.
        let size = value.value - value.null.unwrap_or_default();
        let of = free.iter().zip(&steps).filter(|(i, _)| case.unknowns[**i].name == value.name);
        for (_, step) in of {
            let grows = step / size;
            if grows.is_finite() && most.is_none_or(|(most, _)| grows > most) {
                most = Some((grows, &value.name));
            }
        }
    }
    let Some((grows, name)) = most.filter(|(g, _)| *g > ground.thresholds.noise_grows) else {
        return Ok(None);
    };
    let names: Vec<&str> = inputs.iter().map(|(name, _)| name.as_str()).collect();
    Ok(Some(format!(
        "as much noise of the inputs again ({}) would make {name} {:.0}% larger: that noise may be all it is",
        names.join(", "),
        100.0 * grows
    )))
}
