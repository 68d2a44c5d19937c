//! A base at its fit in; what goes away when one of its loops is closed by the measurement, and what each rate equation lacks, out.
//!
//! *Driven simulation*: the rate of one state gets `K (z - y)`, so that it follows its measurement whatever its equation says. Outputs
//! whose gap goes away then are wrong only through that state: the fault is in its equation; those that keep it have one of their own.
//!
//! *Equation error*: with all measured states led so, `K (z - y)` is what each rate equation lacks, smoothed over `1/K`. Noise of the
//! sensor alone makes it `K` times as large.

use super::found::Found;
use super::gaps::noise;
use crate::error::Errors;
use crate::estimate::{Prepared, Trace};
use crate::math::quantile;

/// How fast a state follows its measurement, 1/s.
const GAIN: f64 = 8.0;

/// The gap of one output with one state driven.
#[derive(Debug, Clone, PartialEq)]
pub struct Driven {
    /// The state that follows its measurement; none where nothing does.
    pub state: Option<String>,
    pub output: String,
    pub unit: String,
    pub rms: f64,
    /// Standard deviation of the measured noise.
    pub noise: f64,
}

/// What a rate equation lacks.
#[derive(Debug, Clone, PartialEq)]
pub struct EquationError {
    pub state: String,
    /// Unit of the state; the error is per second.
    pub unit: String,
    pub rms: f64,
    /// What noise of the sensor makes of it.
    pub noise: f64,
}

/// Both, over all segments.
///
/// # Errors
/// None that the base itself would not have.
pub fn driven(found: &Found) -> Result<(Vec<Driven>, Vec<EquationError>), Errors> {
    let states = measured_states(found);
    let mut all = Vec::new();
    let free = traces(found, &[])?;
    let noises: Vec<(String, f64)> = outputs(&free).into_iter().map(|(name, _)| (name.clone(), noise_of(&free, &name))).collect();
    let noise = |output: &str| noises.iter().find(|n| n.0 == output).map_or(f64::NAN, |n| n.1);
    let mut add = |state: Option<&String>, traces: &[Trace]| {
        for (output, unit) in outputs(traces) {
            let (rms, noise) = (rms(traces, &output, 1.0), noise(&output));
            all.push(Driven { state: state.cloned(), output, unit, rms, noise });
        }
    };
    add(None, &free);
    for state in &states {
        add(Some(state), &traces(found, std::slice::from_ref(state))?);
    }
    let held = traces(found, &states)?;
    let error = |state: &String| {
        let unit = outputs(&held).into_iter().find(|o| o.0 == *state)?.1;
        Some(EquationError { state: state.clone(), unit, rms: rms(&held, state, GAIN), noise: GAIN * noise(state) })
    };
    let errors = states.iter().filter_map(error).collect();
    Ok((all, errors))
}

/// States with a measured output of the same name, which are not led already.
fn measured_states(found: &Found) -> Vec<String> {
    let case = found.case();
    let is_output = |name: &str| case.outputs.iter().any(|&o| case.model.outputs[o].name == name);
    let led = |name: &String| found.method.stabilise.contains_key(name);
    let names = case.model.states.iter().filter(|s| !s.hidden).map(|s| s.quantity.name.clone());
    names.filter(|name| is_output(name) && !led(name)).collect()
}

/// The responses of all segments with these states led by their measurement.
fn traces(found: &Found, states: &[String]) -> Result<Vec<Trace>, Errors> {
    let mut method = found.method.clone();
    method.stabilise.extend(states.iter().map(|name| (name.clone(), GAIN)));
    // A zero shift found for a sensor is the sensor's: the state is led to what the sensor reads less that.
    let prepared = Prepared::new(&found.model, &found.prepared.segments, &method)?;
    if prepared.used != found.prepared.used {
        return Ok(Vec::new());
    }
    let base = found.case();
    let mut case = prepared.case();
    case.records.iter_mut().zip(&base.records).for_each(|(to, from)| to.substeps = from.substeps.max(2));
    let all = (0..case.records.len()).flat_map(|s| {
        let theta = super::base::carried(&case, &prepared, &base, &found.prepared, &found.theta(s));
        case.traces(s, &theta)
    });
    Ok(all.collect())
}

fn outputs(traces: &[Trace]) -> Vec<(String, String)> {
    let mut names: Vec<(String, String)> = Vec::new();
    for trace in traces {
        if names.iter().all(|(name, _)| *name != trace.name) {
            names.push((trace.name.clone(), trace.unit.clone()));
        }
    }
    names
}

fn rms(traces: &[Trace], output: &str, factor: f64) -> f64 {
    let (mut square, mut n) = (0.0, 0.0);
    for trace in traces.iter().filter(|t| t.name == output) {
        for (z, y) in trace.measured.iter().zip(&trace.modelled).filter(|(z, y)| z.is_finite() && y.is_finite()) {
            square += factor * factor * (z - y) * (z - y);
            n += 1.0;
        }
    }
    (square / n).sqrt()
}

fn noise_of(traces: &[Trace], output: &str) -> f64 {
    let all: Vec<f64> = traces.iter().filter(|t| t.name == output).map(|t| noise(&t.measured)).filter(|n| *n > 0.0).collect();
    quantile(&all, 0.5)
}
