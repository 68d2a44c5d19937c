//! A design in; its flight by the truth model, the true values of the parameters, and how far the
//! watched signals went, out.

use super::rows::Design;
use super::settings::Settings;
use super::study::Study;
use super::watch::{Limits, watched};
use crate::error::Result;
use crate::simulate::{Campaign, Truth};
use indexmap::IndexMap;

/// The largest departure of each watched signal from its value before the first step, SI: airspeed,
/// pitch, bank, load factor, angle of attack, current of the servo. NaN where nothing is watched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Excursions(pub [f64; 6]);

/// A design that was flown.
pub struct Flown {
    pub truth: Truth,
    pub facts: Facts,
}

/// What is true of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Facts {
    /// Duration of the signal, s.
    pub duration: f64,
    pub excursions: Excursions,
    /// True values of parameters before the first step.
    pub values: IndexMap<String, f64>,
}

/// Flies a design.
///
/// # Errors
/// There is no steady flight at the test point, or the motion diverges.
pub fn fly(study: &Study, campaign: &Campaign, design: &Design) -> Result<Flown> {
    let truth = campaign.truth(&design.name)?;
    let settings = &study.settings;
    let first = truth.maneuvers.first().map_or(0.0, |m| m.t_start_s);
    let before = truth.at(first - truth.dt);
    let value = |output: &String| before.get(output.as_str()).copied().unwrap_or(f64::NAN);
    let values =
        settings.true_values.iter().map(|(p, output)| (p.clone(), value(output))).collect();
    let facts = Facts {
        duration: truth.maneuvers.first().map_or(0.0, |m| m.t_end_s - m.t_start_s),
        excursions: excursions(settings, &truth),
        values,
    };
    Ok(Flown { truth, facts })
}

fn excursions(settings: &Settings, truth: &Truth) -> Excursions {
    Excursions(watched(&settings.watch, &Limits::default()).map(|(_, name, _)| {
        let Some(signal) = name.and_then(|name| truth.signals.get(name)) else { return f64::NAN };
        let index = |t: f64| (t / truth.dt).round().max(0.0) as usize;
        let of = |m: &crate::simulate::Placed| {
            let (from, to) = (index(m.t_start_s), index(m.t_end_s + settings.post_s));
            let (from, to) = (from.min(truth.n), (to + 1).min(truth.n));
            let before = signal.values.get(from.saturating_sub(1)).copied().unwrap_or(f64::NAN);
            signal.values[from..to].iter().fold(0.0f64, |most, v| most.max((v - before).abs()))
        };
        truth.maneuvers.iter().map(of).fold(0.0, f64::max)
    }))
}

impl Excursions {
    /// Whether none is above its limit.
    pub fn within(&self, settings: &Settings, limits: &Limits) -> bool {
        let all = watched(&settings.watch, limits);
        all.iter().zip(self.0).all(|((_, _, limit), x)| limit.is_none_or(|limit| x <= limit))
    }
}
