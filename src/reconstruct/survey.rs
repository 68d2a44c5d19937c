//! What a first smoothing says of the sensor errors in; how late sensors are, and which errors the
//! data support, out.

use std::collections::BTreeMap;

use super::found::{Found, Held};
use super::settings::Settings;
use super::signals::Logged;
use super::smoother::flight::Flight;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use super::smoother::{Smoothed, Smoother};
use super::stretches::{guess, levels, stretches};
use crate::error::Errors;
use crate::model::Model;
use crate::model::extend::output_delay;

/// Share of the standard deviation at the start above which a state or a parameter counts as not
/// determined.
pub const UNKNOWN: f64 = 0.3;
/// Prior standard deviation of how late a sensor is, s, and what is as good as in time.
pub const LATE: f64 = 0.3;
const IN_TIME: f64 = 1e-3;
/// Smoothings at most before the path's own.
const SURVEYS: usize = 6;
/// Sensor errors have settled when none is further from where it was linearised than so many of its
/// standard deviations: what is left is its product with the filter's error of a state.
const SETTLED: f64 = 2.0;
/// Until stamps are where they belong, and for the level of an airspeed, so much of a long flight is enough, s.
pub const ENOUGH: f64 = 600.0;
/// An error is significant from so many standard deviations on.
pub const SIGNIFICANT: f64 = 2.0;

/// Runs about the one before: each squares the error that is left.
const PASSES: usize = 2;

/// Smooths the longest stretch until the late sensors' stamps are where they belong, then asks
/// which candidates the data support. The flight measures `measured`; it comes back with the stamps of the
/// last smoothing.
pub fn survey(
    model: &Model,
    mut flight: Flight,
    measured: &[Logged],
    settings: &Settings,
) -> std::result::Result<(Found, Flight), Errors> {
    let mut found = Found { passes: PASSES, ..Found::default() };
    let mut whole = false;
    for _ in 0..SURVEYS {
        let kinematics = Kinematics::new(model, found.free(model, settings))?;
        flight = found.flight(flight, measured);
        let smoother = Smoother::new(&kinematics, &flight, settings.gate);
        let stretches = stretches(&flight, settings);
        let length = |s: &&[f64; 2]| s[1] - s[0];
        let Some(&longest) = stretches.iter().max_by(|a, b| length(a).total_cmp(&length(b))) else {
            break;
        };
        whole |= length(&&longest) <= ENOUGH;
        let part = if whole { longest } else { [longest[0], longest[0] + ENOUGH] };
        let (guess, gusts) = guess(&kinematics, &flight, settings);
        let levels = levels(&smoother, &stretches, &guess, &gusts, &found, settings);
        let x = smoother.begin(&levels, part, None);
        let (mut about, mut settled) = smoother.about(&levels, part, &x, PASSES);
        let known = found.constants(&kinematics, &levels);
        if let Some(about) = &mut about {
            // the first time as the first seconds say
            let last = about.means.len().saturating_sub(kinematics.size());
            about.known = if known.is_empty() { about.means[last..].to_vec() } else { known };
        }
        let smoothed = smoother.parameters(about.as_ref(), &levels, part, &x);
        if !smoothed.finite {
            break;
        }
        let mut survey = Survey::of(&kinematics, &levels, &smoothed);
        let late = |i: usize| {
            settings.late.iter().any(|name| model.parameter(&output_delay(name)) == Some(i))
        };
        let known = about.map(|about| about.known).unwrap_or_default();
        settled |= survey.near(known.get(kinematics.states()..).unwrap_or_default(), late);
        found.levels = Some((kinematics.free.clone(), levels));
        found.values = survey.values();
        let mut moved = 0.0f64;
        for name in &settings.late {
            let parameter = model
                .parameter(&output_delay(name))
                .and_then(|p| survey.free.iter().position(|&i| i == p));
            if let (Some(output), Some(k)) = (model.output(name), parameter) {
                let step = survey.value[k].clamp(-LATE, LATE);
                found.values.insert(survey.free[k], [0.0, survey.sd(k)]);
                *found.late.entry(output).or_default() += step;
                moved = moved.max(step.abs());
            }
        }
        if moved < IN_TIME && !whole {
            whole = true;
        } else if moved < IN_TIME && settled {
            let candidates: Vec<usize> =
                settings.candidates.iter().filter_map(|name| model.parameter(name)).collect();
            found.held = survey.unsupported(&candidates);
            // what the others are without those; stamps are where they belong already
            found.values.extend(survey.values().into_iter().filter(|(i, _)| !late(*i)));
            break;
        }
    }
    Ok((found, flight))
}

/// The free parameters of a kinematic model as a smoothing found them: values and covariance
/// `[n][n]`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Survey {
    /// Indices of the model's parameters.
    pub free: Vec<usize>,
    pub value: Vec<f64>,
    pub covariance: Vec<f64>,
    pub start: Vec<f64>,
    pub start_sd: Vec<f64>,
}

impl Survey {
    pub fn of(kinematics: &Kinematics, levels: &Levels, smoothed: &Smoothed) -> Survey {
        let (nx, n) = (kinematics.states(), kinematics.size());
        let m = smoothed.p.len() / n.max(1);
        Survey {
            free: kinematics.free.clone(),
            value: smoothed.x[nx..].to_vec(),
            covariance: (nx..n).flat_map(|i| smoothed.p[i * m + nx..i * m + n].to_vec()).collect(),
            start: kinematics.free.iter().map(|&i| kinematics.model.parameters[i].start).collect(),
            start_sd: levels.start_sd[nx..].to_vec(),
        }
    }

    /// Value and standard deviation by parameter.
    pub fn values(&self) -> BTreeMap<usize, [f64; 2]> {
        (0..self.free.len()).map(|k| (self.free[k], [self.value[k], self.sd(k)])).collect()
    }

    /// Whether every parameter but those `apart` is where it was `known` to be, within a share of
    /// its standard deviation; NaN: it drifts.
    fn near(&self, known: &[f64], apart: impl Fn(usize) -> bool) -> bool {
        let near = |(k, known): (usize, &f64)| {
            known.is_nan()
                || apart(self.free[k])
                || (self.value[k] - known).abs() < SETTLED * self.sd(k)
        };
        known.iter().enumerate().all(near)
    }

    fn sd(&self, k: usize) -> f64 {
        self.covariance[k * self.free.len() + k].max(0.0).sqrt()
    }

    /// Holds the least significant of the `candidates` (indices of parameters) at its start, again
    /// and again until all others are significant. What the others then are follows from the joint
    /// Gaussian: `x | x_k = s` is `x - P_k/P_kk (x_k - s)`.
    pub fn unsupported(&mut self, candidates: &[usize]) -> Vec<Held> {
        let n = self.free.len();
        let mut out: Vec<Held> = Vec::new();
        loop {
            let open = (0..n).filter(|&k| {
                candidates.contains(&self.free[k])
                    && out.iter().all(|h| h.parameter != self.free[k])
            });
            let known = |k: usize| self.sd(k) < UNKNOWN * self.start_sd[k];
            let score = |k: usize| {
                if known(k) { (self.value[k] - self.start[k]).abs() / self.sd(k) } else { 0.0 }
            };
            let first = |k: usize| (score(k), self.free[k]);
            let Some(least) = open.min_by(|&a, &b| {
                let (a, b) = (first(a), first(b));
                a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
            }) else {
                return out;
            };
            if score(least) >= SIGNIFICANT {
                return out;
            }
            out.push(Held {
                parameter: self.free[least],
                value: self.value[least],
                sd: self.sd(least),
                known: known(least),
            });
            let variance = self.covariance[least * n + least];
            if !(variance > 0.0) {
                continue;
            }
            let row: Vec<f64> = self.covariance[least * n..(least + 1) * n].to_vec();
            let excess = self.value[least] - self.start[least];
            for i in 0..n {
                self.value[i] -= row[i] / variance * excess;
                for j in 0..n {
                    self.covariance[i * n + j] -= row[i] * row[j] / variance;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_data_do_not_support_is_held_and_the_others_follow() {
        // 0 and 1 are nearly the same to the data: only their sum is known, and either alone
        // explains it; 2 is nothing by itself
        let mut survey = Survey {
            free: vec![5, 6, 7],
            value: vec![0.6, 0.5, 0.1],
            covariance: vec![0.25, -0.2475, 0.0, -0.2475, 0.25, 0.0, 0.0, 0.0, 0.01],
            start: vec![0.0; 3],
            start_sd: vec![10.0; 3],
        };
        let held: Vec<usize> = survey.unsupported(&[5, 6, 7]).iter().map(|h| h.parameter).collect();
        // first one of the pair, then 2; the other one of the pair has become significant by it
        assert_eq!(held, vec![6, 7]);
    }

    #[test]
    fn what_the_data_do_not_know_is_not_called_significant() {
        let mut survey = Survey {
            free: vec![0],
            value: vec![30.0],
            covariance: vec![25.0],
            start: vec![0.0],
            start_sd: vec![6.0],
        };
        let held = survey.unsupported(&[0]);
        assert_eq!((held.len(), held[0].known), (1, false));
    }
}
