//! A base that leaves more than noise of the sensors in; whether noise that drives its rates
//! accounts for that, with the densities that it takes, out.
//!
//! The model's rates are driven by white noise, those that depend on its parameters (the rest is
//! kinematics, which holds in gusts too), and everything is estimated anew over all maneuvers by
//! filter error: parameters, densities, noise of the sensors. Where innovations of states are not white
//! then, the noise on their rates may last, as gusts do; for how long is estimated, too. Turbulence accounts for what was left if
//!
//! - what the filter takes for noise of each sensor is noise by the rule of `signal::adequacy`,
//! - its innovations are white: their own past foretells less than `innovation_share` of them, and
//!   turbulence in the model explains as much of what was left as an autoregressive model of it
//!   does, which may have anything in it that is missing,
//! - they go with no input, nor with its square or what its cube has besides (an effect that is not
//!   linear): no correlation at any lag is above chance and above the root of `innovation_input`, the
//!   share of their power (of a record with noise the neighbours are asked, which do not share its noise:
//!   what is new answers to that as well),
//! - none lasts far longer than the records: that is a constant in each of them, and no turbulence,
//! - a density is known to be more than nothing.
//!
//! Whatever drives the motion in proportion to an input, or to the motion itself, does not look like
//! that.

use super::with_inputs::with_inputs;
use crate::diagnose::base::found::Found;
use crate::diagnose::base::stand::Stand;
use crate::diagnose::gap::left::{Left, of_traces};
use crate::diagnose::residual::timescale::characteristic_time;
use crate::diagnose::subject::Subject;
use crate::diagnose::thresholds::Thresholds;
use crate::error::Errors;
use crate::estimate::{self, Asked, Estimation, Segment, Stop, Trace, estimate_segments};
use crate::model::{Driven, Model, density_of, lasting_of};

/// The model driven by noise, as it was estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct Turbulence {
    pub densities: Vec<Density>,
    pub outputs: Vec<Accounted>,
    /// Why noise does not account for what is left; none where it does.
    pub objection: Option<String>,
    /// What is new in an output goes with an input: in words. No gust does that.
    pub with_input: Option<String>,
}

/// Root of the spectral density of the noise that drives a state.
#[derive(Debug, Clone, PartialEq)]
pub struct Density {
    pub state: String,
    pub unit: String,
    pub value: f64,
    /// None at zero.
    pub sd: Option<f64>,
    /// How long the noise lasts, s, and its standard deviation; none for white noise.
    pub lasts: Option<(f64, Option<f64>)>,
}

/// What a filter makes of an output.
#[derive(Debug, Clone, PartialEq)]
pub struct Accounted {
    pub output: String,
    /// Standard deviation of its sensor's noise.
    pub noise: f64,
    /// Share of the mean square of what was left that is in the innovations no more.
    pub explained: f64,
    /// Share of the innovations that their own past foretells.
    pub foretold: f64,
}

/// Estimates the base with noise on its rates, from where it stands and, where that does not account
/// for what is left, from where the model starts, and then with noise that lasts.
pub fn turbulence(subject: &Subject, stand: &Stand, found: &Found, left: &[Left]) -> Turbulence {
    let by = match driven(subject, stand, found, left) {
        Ok(by) => by,
        Err(why) => return refused(why),
    };
    let whole = whole(subject.segments);
    let case = found.case();
    let noisy = case.noisy();
    let noisy: Vec<String> = noisy.into_iter().map(|(name, _)| name).collect();
    let tried =
        |by: &[Driven], starts| tried((subject, stand), (by, starts), (&whole, &noisy), left);
    let here = case.unknowns.iter().zip(&found.fit.theta);
    let here = here.filter(|(u, _)| u.segment.is_none() && u.group.is_none());
    let here: Vec<(String, f64)> = here.map(|(u, value)| (u.name.clone(), *value)).collect();
    let mut last = (refused("noise on its rates was not tried".into()), Vec::new());
    for starts in [here, Vec::new()] {
        last = tried(&by, starts);
        if last.0.objection.is_none() {
            return last.0;
        }
    }
    let (white, solution) = last;
    match lasting(&by, &white, (subject, stand, found)) {
        Some(by) => Some(tried(&by, solution).0).filter(|t| t.objection.is_none()).unwrap_or(white),
        None => white,
    }
}

/// The base driven by this noise, judged, and the shared values that were found. `noisy`: inputs whose
/// records have noise.
fn tried(
    (subject, stand): (&Subject, &Stand),
    (by, starts): (&[Driven], Vec<(String, f64)>),
    (segments, noisy): (&[Segment], &[String]),
    left: &[Left],
) -> (Turbulence, Vec<(String, f64)>) {
    let model = match stand.model.driven_by(by) {
        Ok(model) => model,
        Err(errors) => return (refused(first(&errors)), Vec::new()),
    };
    let (profile, asked) = (Vec::new(), Asked::Minimum);
    let mut method = estimate::Settings { profile, asked, ..stand.method.clone() };
    let has = |(name, _): &(String, f64)| model.parameter(name).is_some();
    method.starts.extend(starts.into_iter().filter(has));
    if let Some(free) = &mut method.free {
        for driven in by {
            let state = &stand.model.states[driven.state].quantity.name;
            free.push(density_of(state));
            free.extend(driven.lasts.map(|_| lasting_of(state)));
        }
    }
    let estimation = match estimate_segments(&model, segments, &method) {
        Ok(estimation) => estimation,
        Err(errors) => return (refused(first(&errors)), Vec::new()),
    };
    let thresholds = &subject.settings.thresholds;
    let flown = (segments, noisy);
    let judged = judged((&model, by), flown, &estimation, left, (stand, thresholds));
    let shared = estimation.rows.iter().filter(|r| r.segment.is_none() && r.group.is_none());
    (judged, shared.map(|r| (r.name.clone(), r.value)).collect())
}

/// The same where noise lasts in those states whose innovations are not white; none where they all are.
/// (Noise of a wrong colour moves the parameters, so that what is new may go with an input.)
fn lasting(
    by: &[Driven],
    white: &Turbulence,
    (subject, stand, found): (&Subject, &Stand, &Found),
) -> Option<Vec<Driven>> {
    let thresholds = &subject.settings.thresholds;
    let case = found.case();
    let time = characteristic_time(case.records.iter(), thresholds);
    let step = case.records.iter().map(|r| r.dt).fold(f64::INFINITY, f64::min);
    let is_white = |driven: &Driven| {
        let name = &stand.model.states[driven.state].quantity.name;
        let of = white.outputs.iter().find(|o| o.output == *name);
        of.is_none_or(|o| o.foretold <= thresholds.innovation_share)
    };
    let lasts = |driven: &Driven| {
        let lasts = (!is_white(driven)).then(|| [step, (0.5 * time).max(2.0 * step)]);
        Driven { lasts, ..*driven }
    };
    (!by.iter().all(is_white)).then(|| by.iter().map(lasts).collect())
}

fn refused(why: String) -> Turbulence {
    Turbulence {
        densities: Vec::new(),
        outputs: Vec::new(),
        objection: Some(why),
        with_input: None,
    }
}

fn first(errors: &Errors) -> String {
    errors.0.first().map(|e| e.what.clone()).unwrap_or_default()
}

/// Noise on those rates whose states are measured: how large it may be is read from what is left of
/// them.
fn driven(
    subject: &Subject,
    stand: &Stand,
    found: &Found,
    left: &[Left],
) -> Result<Vec<Driven>, String> {
    if stand.method.noise != estimate::NoiseKind::Diagonal {
        return Err("noise of outputs that is correlated is not known to a filter".into());
    }
    let case = found.case();
    let time = characteristic_time(case.records.iter(), &subject.settings.thresholds);
    let size = |i: usize| {
        let name = &stand.model.states[i].quantity.name;
        let of = left.iter().find(|l| l.output == *name)?;
        // White noise of density F moves a state that remembers for a time T by F sqrt(T).
        let density = of.adequacy.left() / time.sqrt();
        let driven = Driven { state: i, density, lasts: None };
        (density > 0.0 && density.is_finite()).then_some(driven)
    };
    let states: Vec<Driven> = stand.model.uncertain_rates().into_iter().filter_map(size).collect();
    if states.is_empty() {
        return Err("no measured state has a rate that noise could drive".into());
    }
    Ok(states)
}

/// Records that were cut into stretches, whole again: a filter forgets what it does not measure.
fn whole(segments: &[Segment]) -> Vec<Segment> {
    let mut all: Vec<(Option<String>, Segment)> = Vec::new();
    for segment in segments {
        let of = segment.stretch.as_ref().map(|s| s.of.clone());
        if of.is_none() || all.iter().all(|(known, _)| *known != of) {
            all.push((of, Segment { stretch: None, ..segment.clone() }));
        }
    }
    all.into_iter().map(|(_, segment)| segment).collect()
}

fn judged(
    (model, by): (&Model, &[Driven]),
    flown: (&[Segment], &[String]),
    estimation: &Estimation,
    left: &[Left],
    (stand, thresholds): (&Stand, &Thresholds),
) -> Turbulence {
    let row = |name: String| estimation.rows.iter().find(|row| row.name == name);
    let density = |driven: &Driven| {
        let state = model.states[driven.state].quantity.name.clone();
        let (found, lasts) = (row(density_of(&state))?, row(lasting_of(&state)));
        Some(Density {
            unit: found.unit.clone(),
            value: found.value,
            sd: found.sd,
            lasts: lasts.map(|row| (row.value, row.sd)),
            state,
        })
    };
    let densities: Vec<Density> = by.iter().filter_map(density).collect();
    let traces: Vec<Trace> = estimation.responses.iter().flatten().cloned().collect();
    let innovations = of_traces(&traces, stand.method.colour());
    let mut outputs = Vec::new();
    let mut objections = Vec::new();
    if estimation.stop != Stop::Converged {
        objections.push(format!("its estimate ended with \"{}\"", estimation.stop));
    }
    // What goes with an input tells most.
    let with_input = with_inputs(model, flown, estimation, thresholds);
    objections.extend(with_input.clone());
    objections.extend(constant(&densities, flown.0, thresholds));
    for before in left {
        let Some(after) = innovations.iter().find(|l| l.output == before.output) else { continue };
        let noise = noise(estimation, &before.output);
        let (was, is) = (before.adequacy.left(), after.adequacy.left());
        let explained = 1.0 - is * is / (was * was);
        outputs.push(Accounted {
            output: before.output.clone(),
            noise,
            explained,
            foretold: after.foretold,
        });
        // What is left beside next to nothing of the noise is rounding.
        if is < thresholds.innovation_share * before.adequacy.noise() {
            continue;
        }
        let name = &before.output;
        if after.adequacy.with_noise(noise).is_poor() {
            objections
                .push(format!("{name} is left with more than noise of its sensor all the same"));
        } else if before.adequacy.is_poor() && after.foretold > thresholds.innovation_share {
            let share = 100.0 * after.foretold;
            objections.push(format!(
                "what is new in {name} is not white: its past foretells {share:.0}% of it"
            ));
        } else if before.adequacy.is_poor()
            && before.foretold > explained + thresholds.innovation_share
        {
            objections.push(format!(
                "it explains {:.0}% of what is left of {name}, of which its own past foretells {:.0}%",
                100.0 * explained,
                100.0 * before.foretold
            ));
        }
    }
    let known = |d: &Density| d.sd.is_some_and(|sd| d.value > 2.0 * sd);
    if !densities.iter().any(known) {
        objections.push("none of its densities is more than nothing".into());
    }
    Turbulence { densities, outputs, objection: objections.into_iter().next(), with_input }
}

/// Noise that lasts far longer than the records is a constant in each of them: an error of the model that
/// differs from maneuver to maneuver, or from flight to flight.
fn constant(
    densities: &[Density],
    segments: &[Segment],
    thresholds: &Thresholds,
) -> Option<String> {
    let length = |s: &Segment| s.record.dt * s.record.n as f64;
    let longest = segments.iter().map(length).fold(0.0, f64::max);
    let lasts = |d: &&Density| {
        d.value > 0.0 && d.lasts.is_some_and(|(lasts, _)| lasts > thresholds.lasting * longest)
    };
    let found = densities.iter().find(lasts)?;
    Some(format!(
        "what drives the rate of {} lasts {:.0} s, far longer than the maneuvers ({longest:.0} s at most): it is a constant in each of them, no turbulence",
        found.state, found.lasts?.0
    ))
}

/// Root of the mean variance of a sensor's noise, over the segments.
fn noise(estimation: &Estimation, output: &str) -> f64 {
    let of = estimation.outputs.iter().filter(|o| o.name == output && o.count > 0);
    let (sum, n) =
        of.fold((0.0, 0.0), |(sum, n), o| (sum + o.r * o.count as f64, n + o.count as f64));
    (sum / n).sqrt()
}
