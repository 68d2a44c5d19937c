//! A base at its fit in; what goes away when one of its loops is closed by the measurement, and
//! what each rate equation lacks, out.
//!
//! *Driven simulation*: the rate of one state gets `K (z - y)`, so that it follows its measurement
//! whatever its equation says. Outputs whose gap goes away then are wrong only through that state:
//! the fault is in its equation; those that keep it have one of their own.
//!
//! *Equation error*: with observer feedback on all measured states, `K (z - y)` is what each rate
//! equation lacks, smoothed over `1/K`. Noise of the sensor alone makes it `K` times as large.

use crate::diagnose::base::found::Found;
use crate::diagnose::base::stand::Known;
use crate::error::Errors;
use crate::estimate::{Prepared, Segment, Settings, Trace};
use crate::math::quantile;
use crate::signal::robust::noise_sd;

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

/// What an equation lacks.
#[derive(Debug, Clone, PartialEq)]
pub struct EquationError {
    /// Index of the segment; none for all together.
    pub segment: Option<usize>,
    /// The state whose rate it is, or the coefficient.
    pub name: String,
    pub is_rate: bool,
    pub unit: String,
    pub rms: f64,
    /// What noise of the sensors makes of it.
    pub noise: f64,
}

/// Driven simulation, and what the rate equations of these measured states lack, over all segments.
/// `gain`: how fast a state follows its measurement, 1/s.
///
/// # Errors
/// None that the base itself would not have.
pub fn driven(
    found: &Found,
    segments: &[Segment],
    states: &[String],
    gain: f64,
) -> Result<(Vec<Driven>, Vec<EquationError>), Errors> {
    let mut all = Vec::new();
    let traces = |states: &[String]| traces(found, segments, states, gain);
    let free = traces(&[])?;
    let noises = noises(found);
    let noise = |output: &str| noises.iter().find(|n| n.0 == output).map_or(f64::NAN, |n| n.1);
    let mut add = |state: Option<&String>, traces: &[Trace]| {
        for (output, unit) in outputs(traces) {
            let (rms, noise) = (rms(traces, &output, 1.0), noise(&output));
            all.push(Driven { state: state.cloned(), output, unit, rms, noise });
        }
    };
    add(None, &free);
    for state in states {
        add(Some(state), &traces(std::slice::from_ref(state))?);
    }
    let held = traces(states)?;
    let error = |name: &String| {
        let unit = outputs(&held).into_iter().find(|o| o.0 == *name)?.1;
        let unit = if unit == "-" { "1/s".to_string() } else { format!("{unit}/s") };
        let (rms, noise) = (rms(&held, name, gain), gain * noise(name));
        Some(EquationError { segment: None, name: name.clone(), is_rate: true, unit, rms, noise })
    };
    let errors = states.iter().filter_map(error).collect();
    Ok((all, errors))
}

/// States with a measured output of the same name, without feedback so far.
pub fn measured_states(found: &Found) -> Vec<String> {
    let case = found.case();
    let is_output = |name: &str| case.outputs.iter().any(|&o| case.model.outputs[o].name == name);
    let fed = |name: &String| found.method.stabilise.contains_key(name);
    let names = case.model.states.iter().filter(|s| !s.hidden).map(|s| s.quantity.name.clone());
    names.filter(|name| is_output(name) && !fed(name)).collect()
}

/// How a model is run with observer feedback on these states.
pub fn with_feedback(method: &Settings, states: &[String], gain: f64) -> Settings {
    let mut method = method.clone();
    method.stabilise.extend(states.iter().map(|name| (name.clone(), gain)));
    method
}

/// The measured noise of every output.
pub fn noises(found: &Found) -> Vec<(String, f64)> {
    let case = found.case();
    let of = |&o: &usize| {
        let channels =
            case.records.iter().flat_map(|r| r.channels.iter().filter(move |c| c.output == o));
        let all: Vec<f64> = channels.map(|c| noise_sd(&c.z)).filter(|n| *n > 0.0).collect();
        (case.model.outputs[o].name.clone(), quantile(&all, 0.5))
    };
    case.outputs.iter().map(of).collect()
}

/// The responses of all segments with observer feedback on these states.
fn traces(
    found: &Found,
    segments: &[Segment],
    states: &[String],
    gain: f64,
) -> Result<Vec<Trace>, Errors> {
    // A zero shift found for a sensor is the sensor's: the feedback is of what the sensor reads
    // less that.
    let prepared =
        Prepared::new(&found.model, segments, &with_feedback(&found.method, states, gain))?;
    if prepared.used != found.prepared.used {
        return Ok(Vec::new());
    }
    let base = found.case();
    let mut case = prepared.case();
    case.records
        .iter_mut()
        .zip(&base.records)
        .for_each(|(to, from)| to.substeps = from.substeps.max(2));
    let all = (0..case.records.len()).flat_map(|s| {
        let theta = Known::of(&base, &found.prepared, &found.theta(s)).placed(&case, &prepared);
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
        for (z, y) in trace
            .measured
            .iter()
            .zip(&trace.modelled)
            .filter(|(z, y)| z.is_finite() && y.is_finite())
        {
            square += factor * factor * (z - y) * (z - y);
            n += 1.0;
        }
    }
    (square / n).sqrt()
}
