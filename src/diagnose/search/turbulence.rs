//! A base that leaves more than noise of the sensors in; whether noise that drives its rates
//! accounts for that, with the densities that it takes, out.
//!
//! The model's rates are driven by white noise, those that depend on its parameters (the rest is
//! kinematics, which holds in gusts too), and everything is estimated anew over all maneuvers by
//! filter error: parameters, densities, noise of the sensors. Turbulence accounts for what was left
//! if
//!
//! - what the filter takes for noise of each sensor is noise by the rule of `signal::adequacy`,
//! - its innovations are white: their own past foretells less than `innovation_share` of them, and
//!   turbulence in the model explains as much of what was left as an autoregressive model of it
//!   does, which may have anything in it that is missing,
//! - they go with no input, nor with its square or what its cube has besides (an effect that is not
//!   linear): no correlation at any lag is above chance and above the root of `innovation_input`, the
//!   share of their power,
//! - a density is known to be more than nothing.
//!
//! Whatever drives the motion in proportion to an input, or to the motion itself, does not look like
//! that.

use crate::diagnose::base::found::Found;
use crate::diagnose::base::stand::Stand;
use crate::diagnose::gap::left::{Left, of_traces};
use crate::diagnose::residual::timescale::characteristic_time;
use crate::diagnose::subject::Subject;
use crate::diagnose::thresholds::Thresholds;
use crate::dynamics::Record;
use crate::error::Errors;
use crate::estimate::{self, Estimation, Segment, Stop, Trace, estimate_segments};
use crate::math::distribution::normal_quantile;
use crate::model::{Model, density_of};

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
/// for what is left, from where the model starts.
pub fn turbulence(subject: &Subject, stand: &Stand, found: &Found, left: &[Left]) -> Turbulence {
    let whole = whole(subject.segments);
    let model = match driven(subject, stand, found, left) {
        Ok(model) => model,
        Err(why) => return refused(why),
    };
    let case = found.case();
    let here = case.unknowns.iter().zip(&found.fit.theta);
    let here = here.filter(|(u, _)| u.segment.is_none() && u.group.is_none());
    let here: Vec<(String, f64)> = here
        .filter(|(u, _)| model.parameter(&u.name).is_some())
        .map(|(u, value)| (u.name.clone(), *value))
        .collect();
    let mut last = refused("noise on its rates was not tried".into());
    for starts in [here, Vec::new()] {
        let mut method = estimate::Settings { profile: Vec::new(), ..stand.method.clone() };
        method.starts.extend(starts);
        if let Some(free) = &mut method.free {
            let states = model.states.iter().filter(|s| s.noise.is_some());
            free.extend(states.map(|s| density_of(&s.quantity.name)));
        }
        last = match estimate_segments(&model, &whole, &method) {
            Ok(estimation) => {
                judged(&model, &whole, &estimation, left, (stand, &subject.settings.thresholds))
            }
            Err(errors) => refused(first(&errors)),
        };
        if last.objection.is_none() {
            break;
        }
    }
    last
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

/// The model with noise on those rates whose states are measured: how large it may be is read from
/// what is left of them.
fn driven(subject: &Subject, stand: &Stand, found: &Found, left: &[Left]) -> Result<Model, String> {
    if stand.method.noise != estimate::NoiseKind::Diagonal {
        return Err("noise of outputs that is correlated is not known to a filter".into());
    }
    let case = found.case();
    let time = characteristic_time(case.records.iter(), &subject.settings.thresholds);
    let size = |i: usize| {
        let name = &stand.model.states[i].quantity.name;
        let of = left.iter().find(|l| l.output == *name)?;
        // White noise of density F moves a state that remembers for a time T by F sqrt(T).
        let start = of.adequacy.left() / time.sqrt();
        (start > 0.0 && start.is_finite()).then_some((i, start))
    };
    let states: Vec<(usize, f64)> =
        stand.model.uncertain_rates().into_iter().filter_map(size).collect();
    if states.is_empty() {
        return Err("no measured state has a rate that noise could drive".into());
    }
    stand.model.driven_by(&states).map_err(|errors| first(&errors))
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
    model: &Model,
    segments: &[Segment],
    estimation: &Estimation,
    left: &[Left],
    (stand, thresholds): (&Stand, &Thresholds),
) -> Turbulence {
    let density = |state: &crate::model::State| {
        state.noise?;
        let name = density_of(&state.quantity.name);
        let row = estimation.rows.iter().find(|row| row.name == name)?;
        Some(Density {
            state: state.quantity.name.clone(),
            unit: row.unit.clone(),
            value: row.value,
            sd: row.sd,
        })
    };
    let densities: Vec<Density> = model.states.iter().filter_map(density).collect();
    let traces: Vec<Trace> = estimation.responses.iter().flatten().cloned().collect();
    let innovations = of_traces(&traces, stand.method.colour());
    let mut outputs = Vec::new();
    let mut objections = Vec::new();
    if estimation.stop != Stop::Converged {
        objections.push(format!("its estimate ended with \"{}\"", estimation.stop));
    }
    // What goes with an input tells most.
    let with_input = with_inputs(model, segments, estimation, thresholds);
    objections.extend(with_input.clone());
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

/// Root of the mean variance of a sensor's noise, over the segments.
fn noise(estimation: &Estimation, output: &str) -> f64 {
    let of = estimation.outputs.iter().filter(|o| o.name == output && o.count > 0);
    let (sum, n) =
        of.fold((0.0, 0.0), |(sum, n), o| (sum + o.r * o.count as f64, n + o.count as f64));
    (sum / n).sqrt()
}

/// The output and input whose correlation is furthest above chance, where it is above what counts.
fn with_inputs(
    model: &Model,
    segments: &[Segment],
    estimation: &Estimation,
    thresholds: &Thresholds,
) -> Option<String> {
    let mut names: Vec<&str> = Vec::new();
    for trace in estimation.responses.iter().flatten() {
        if !names.contains(&trace.name.as_str()) {
            names.push(&trace.name);
        }
    }
    let flown: Vec<Flown> = segments.iter().zip(&estimation.responses).collect();
    let time = characteristic_time(segments.iter().map(|s| &s.record), thresholds);
    let nu = model.inputs.len();
    let looked = (nu * names.len() * thresholds.lags.len() * SHAPES) as f64;
    let quantile = normal_quantile(1.0 - 0.5 * thresholds.relation_p / looked.max(1.0));
    let mut most: Option<(f64, f64, &str, &str)> = None;
    for (i, input) in model.inputs.iter().enumerate() {
        let shapes = shapes(segments, i, nu);
        for (name, lag) in
            names.iter().flat_map(|name| thresholds.lags.iter().map(move |l| (name, l)))
        {
            for shape in &shapes {
                let pairs = pairs(&flown, name, (i, nu, lag * time), shape);
                let Some((r, n)) = correlation(&pairs) else { continue };
                // A series that is not random, and white noise: the variance of their correlation is 1/n.
                let white = quantile / n.sqrt();
                if r * r <= thresholds.innovation_input || r.abs() <= white {
                    continue;
                }
                let chance = white * inflation(&pairs).sqrt();
                if r.abs() > chance && most.is_none_or(|m| r.abs() / chance > m.0.abs() / m.1) {
                    most = Some((r, chance, name, &input.name));
                }
            }
        }
    }
    let (r, chance, output, input) = most?;
    Some(format!(
        "what is new in {output} goes with {input} (correlation {r:.2}, by chance {chance:.2} at most)"
    ))
}

/// A maneuver and what was modelled of it.
type Flown<'a> = (&'a Segment, &'a Vec<Trace>);

/// An input about its mean, its square about its mean, and its cube without what goes with the input.
fn shapes(segments: &[Segment], i: usize, nu: usize) -> [Box<dyn Fn(f64) -> f64>; SHAPES] {
    let (mut n, mut squares, mut fourth) = (0.0, 0.0, 0.0);
    for segment in segments {
        let (all, mean) = about_mean(&segment.record, i, nu);
        for x in all.iter().map(|x| x - mean).filter(|x| x.is_finite()) {
            (n, squares, fourth) = (n + 1.0, squares + x * x, fourth + x * x * x * x);
        }
    }
    let (mean, slope) =
        (squares / f64::max(n, 1.0), if squares > 0.0 { fourth / squares } else { 0.0 });
    [Box::new(|x| x), Box::new(move |x| x * x - mean), Box::new(move |x| x * x * x - slope * x)]
}

/// The values of an input, and their mean.
fn about_mean(record: &Record, i: usize, nu: usize) -> (Vec<f64>, f64) {
    let all: Vec<f64> = record.inputs.chunks_exact(nu).map(|row| row[i]).collect();
    let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
    (all, mean)
}

/// In each maneuver, a shape of input `i` of `nu`, so many seconds before, about the input's mean, and an
/// output's innovation.
type Pairs = Vec<Vec<[f64; 2]>>;

fn pairs(
    flown: &[Flown],
    name: &str,
    (i, nu, lag): (usize, usize, f64),
    shape: &dyn Fn(f64) -> f64,
) -> Pairs {
    let of = |(segment, traces): &Flown| {
        let record = &segment.record;
        let (all, mean) = about_mean(record, i, nu);
        let mut pairs = Vec::new();
        for trace in traces.iter().filter(|t| t.name == name) {
            for ((t, z), y) in trace.t.iter().zip(&trace.measured).zip(&trace.modelled) {
                let (k, e) = (((t - lag - record.t0) / record.dt).round(), z - y);
                let x = if k >= 0.0 { all.get(k as usize) } else { None };
                let x = x.map(|x| shape(x - mean)).filter(|x| x.is_finite() && e.is_finite());
                pairs.extend(x.map(|x| [x, e]));
            }
        }
        pairs
    };
    flown.iter().map(of).collect()
}

/// Correlation of both, and of how many samples. None where one of them is nothing.
fn correlation(pairs: &Pairs) -> Option<(f64, f64)> {
    let sum = |a: usize, b: usize| pairs.iter().flatten().map(|p| p[a] * p[b]).sum::<f64>();
    let (xx, ee, xe) = (sum(0, 0), sum(1, 1), sum(0, 1));
    let n = pairs.iter().map(Vec::len).sum::<usize>() as f64;
    (xx > 0.0 && ee > 0.0).then(|| (xe / (xx * ee).sqrt(), n))
}

/// How many times `1/n` the variance of the correlation of two independent series is:
/// `sum_k rho_x(k) rho_e(k)` (Bartlett 1946), at least 1. Innovations of gusts that last are not
/// white.
fn inflation(pairs: &Pairs) -> f64 {
    let at = |lag: usize, of: usize| {
        let one = |p: &Vec<[f64; 2]>| -> f64 {
            p.iter().zip(p.iter().skip(lag)).map(|(a, b)| a[of] * b[of]).sum()
        };
        pairs.iter().map(one).sum::<f64>()
    };
    let (xx, ee) = (at(0, 0), at(0, 1));
    let longest = pairs.iter().map(Vec::len).max().unwrap_or(0) / 4;
    let sum: f64 = (1..=longest.min(LONGEST)).map(|k| at(k, 0) * at(k, 1)).sum();
    (1.0 + 2.0 * sum / (xx * ee)).max(1.0)
}

/// Lags of an autocorrelation at most, samples.
const LONGEST: usize = 500;
/// Shapes of an input.
const SHAPES: usize = 3;
