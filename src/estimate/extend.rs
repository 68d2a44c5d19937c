//! A model, segments and settings in; the model with the shifts and the feedback that the settings
//! ask for, and segments that feed it, out.

use super::segment::Segment;
use super::{By, NoiseKind, Settings};
use crate::dynamics::{Interpolation, Record};
use crate::error::{Error, Errors};
use crate::math::interpolate::held;
use crate::math::median;
use crate::model::{Model, Scope, Scored, noise_of};
use crate::signal::robust::noise_sd;
use std::borrow::Cow;

/// The model that is estimated: with zero shifts and feedback as the settings say.
///
/// # Errors
/// Names that the model does not have: all at once.
pub fn extended<'a>(model: &'a Model, settings: &Settings) -> Result<Cow<'a, Model>, Errors> {
    extend(model, settings).map(|(model, _)| model)
}

/// The same, and the outputs whose measurements are further inputs.
fn extend<'a>(
    model: &'a Model,
    settings: &Settings,
) -> Result<(Cow<'a, Model>, Vec<usize>), Errors> {
    let mut model = Cow::Borrowed(model);
    let shifts = &settings.shifts;
    if !(shifts.outputs.is_empty() && shifts.inputs.is_empty()) {
        model = Cow::Owned(model.with_shifts(
            &shifts.outputs,
            &shifts.inputs,
            &Scope::parse(&shifts.per),
        )?);
    }
    if settings.stabilise.is_empty() {
        return Ok((model, Vec::new()));
    }
    let (stabilised, carried) = model.stabilised(&settings.stabilise)?;
    Ok((Cow::Owned(stabilised), carried))
}

/// Model and segments as they are estimated.
///
/// # Errors
/// As `extended`.
pub fn prepare<'a>(
    model: &'a Model,
    segments: &'a [Segment],
    settings: &Settings,
) -> Result<(Cow<'a, Model>, Cow<'a, [Segment]>), Errors> {
    let nu = model.inputs.len();
    let (mut model, carried) = extend(model, settings)?;
    // Equations are compared one by one: what drives the motion is in their residuals.
    if model.is_driven() && settings.by == By::Motion {
        model = Cow::Owned(filtered(&model, segments, settings)?);
    }
    if carried.is_empty() {
        return Ok((model, Cow::Borrowed(segments)));
    }
    let fed = |s: &Segment| Segment { record: fed(&s.record, nu, &carried), ..s.clone() };
    Ok((model, segments.iter().map(fed).collect()))
}

/// A setting that a filter does not know.
pub fn not_filtered(model: &Model, settings: &Settings) -> Option<Error> {
    let is_filtered = model.is_driven() && settings.by == By::Motion;
    (is_filtered && settings.noise == NoiseKind::Full).then(|| {
        Error::new("noise = \"full\" is not known to a filter, which takes the noise of outputs to be independent")
            .help("leave `noise` out: the model is driven by noise, so it is estimated by a filter")
    })
}

/// A model driven by noise with the covariance of its states, and the noise of what is measured as
/// parameters: they start at the fast part of the measurements, and are no less than `floor` says,
/// or than the resolution that the numbers show.
fn filtered(model: &Model, segments: &[Segment], settings: &Settings) -> Result<Model, Errors> {
    if let Some(error) = not_filtered(model, settings) {
        return Err(error.into());
    }
    let scored = (0..model.outputs.len()).filter_map(|output| {
        let of = |s: &'_ Segment| -> Vec<f64> {
            let channels = s.record.channels.iter().filter(|c| c.output == output);
            channels.flat_map(|c| &c.z).copied().filter(|z| z.is_finite()).collect()
        };
        let all: Vec<Vec<f64>> = segments.iter().map(of).filter(|z| !z.is_empty()).collect();
        let noise: Vec<f64> = all.iter().map(|z| noise_sd(z)).filter(|sd| *sd > 0.0).collect();
        let (name, own) = (&model.outputs[output].name, noise_of(&model.outputs[output].name));
        // What is held was found elsewhere, from numbers that may have been finer.
        let held = settings.starts.get(&own).filter(|_| settings.fixed.contains(&own));
        let given = settings.floor.get(name).copied().unwrap_or(0.0);
        let floor = given.max(resolution(&all) / 12f64.sqrt());
        let floor = held.map_or(floor, |held| held.min(floor));
        let start = if noise.is_empty() { floor } else { median(&noise) };
        (!all.is_empty()).then_some(Scored { output, start: start.max(floor), floor })
    });
    let scored: Vec<Scored> = scored.collect();
    let exact: Vec<usize> = settings.initial.iter().filter_map(|name| model.state(name)).collect();
    model.with_covariance(&scored, &exact, &Scope::parse(&settings.noise_per))
}

/// The smallest difference between two numbers that differ by more than rounding; of numbers that
/// do not differ, what rounding leaves of them.
fn resolution(all: &[Vec<f64>]) -> f64 {
    let mut sorted: Vec<f64> = all.concat();
    sorted.sort_by(f64::total_cmp);
    let largest = sorted.iter().fold(0.0f64, |most, z| most.max(z.abs()));
    let rounding = (1e-12 * largest).max(f64::MIN_POSITIVE);
    let steps = sorted.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > rounding);
    let least = steps.fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { rounding }
}

/// A record with `nu` inputs, and behind them what was measured of `outputs`, on its grid.
fn fed(record: &Record, nu: usize, outputs: &[usize]) -> Record {
    let columns: Vec<Vec<f64>> = outputs.iter().map(|&o| on_grid(record, o)).collect();
    let mut inputs = Vec::with_capacity(record.n * (nu + outputs.len()));
    for k in 0..record.n {
        inputs.extend((0..nu).map(|i| record.inputs.get(k * nu + i).copied().unwrap_or(f64::NAN)));
        inputs.extend(columns.iter().map(|column| column[k]));
    }
    // What is measured is smooth where all inputs count as smooth.
    let given = &record.interpolation;
    let cubic = given.len() >= nu && given.iter().all(|i| *i == Interpolation::Cubic);
    let mut interpolation = given.clone();
    if cubic && nu > 0 {
        interpolation.resize(nu + outputs.len(), Interpolation::Cubic);
    }
    Record { inputs: inputs.into(), interpolation, ..record.clone() }
}

/// What was measured of an output, at the points of the grid: straight lines between the samples
/// that are not masked, held before the first and after the last; NaN where there is none.
fn on_grid(record: &Record, output: usize) -> Vec<f64> {
    let channel = record.channels.iter().find(|c| c.output == output);
    let known = channel.iter().flat_map(|c| c.t.iter().zip(&c.z)).filter(|(_, z)| z.is_finite());
    let (t, z): (Vec<f64>, Vec<f64>) = known.map(|(t, z)| (*t, *z)).unzip();
    (0..record.n).map(|k| held(&t, &z, record.t0 + k as f64 * record.dt)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Channel;

    #[test]
    fn measurements_between_samples_are_straight_and_masked_ones_are_bridged() {
        let channel = Channel {
            output: 3,
            t: vec![10.1, 10.3, 10.4, 10.5].into(),
            z: vec![1.0, f64::NAN, 4.0, 4.5].into(),
        };
        let record = Record {
            t0: 10.0,
            dt: 0.1,
            n: 7,
            inputs: vec![7.0; 7].into(),
            channels: vec![channel],
            ..Record::default()
        };
        let fed = fed(&record, 1, &[3, 4]);
        let column = |i: usize| (0..7).map(|k| fed.inputs[3 * k + i]).collect::<Vec<f64>>();
        assert_eq!(column(0), [7.0; 7]);
        let want = [1.0, 1.0, 2.0, 3.0, 4.0, 4.5, 4.5];
        assert!(column(1).iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-9), "{:?}", column(1));
        assert!(column(2).iter().all(|v| v.is_nan()));
    }
}
