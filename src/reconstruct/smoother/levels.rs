//! What a flight's signals show of their own noise in; the noise levels a smoother runs with, and
//! their improvement by maximum likelihood, out.

use super::flight::Flight;
use super::kinematics::Kinematics;
use super::sums::Sums;
use indexmap::IndexMap;

/// Noise of everything, as the filter uses it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Levels {
    /// Variance of one sample per channel; infinite: the channel is not used.
    pub r: Vec<f64>,
    /// Spectral density per input, unit^2 s.
    pub density: Vec<f64>,
    /// Variance that a state or a parameter gains per second.
    pub walk: Vec<f64>,
    /// Standard deviations of states and parameters at the start.
    pub start_sd: Vec<f64>,
    /// Channels and inputs whose noise was given: it is not estimated.
    pub given: [Vec<bool>; 2],
}

/// Least share of the first guess that a measurement's standard deviation may fall to.
const LEAST: f64 = 0.3;
/// Walks need not be known as well as measurement noise: by this factor.
const WALKS: f64 = 5.0;
/// Most that one iteration changes a variance, as a factor: farther, and what is too large by a
/// poor start is not used any more, and stays too large because it is not used.
const STRIDE: f64 = 5.0;
/// A variance whose step promises less log-likelihood than this is where it may stay: the noise of an input that
/// no measurement sees grows without end, and gusts where there are none shrink without end.
const PROMISE: f64 = 1.0;

impl Levels {
    /// Levels from the signals themselves; `walks` gives densities (unit per square root of a
    /// second) by name of state or parameter, `sd` the noise of single samples by name of output or
    /// input.
    pub fn guess(
        kinematics: &Kinematics,
        flight: &Flight,
        walks: &IndexMap<String, f64>,
        sd: &IndexMap<String, f64>,
    ) -> Levels {
        let model = kinematics.model;
        let output = |c: &super::flight::Channel| sd.get(&model.outputs[c.output].name).copied();
        let input = |i: usize| sd.get(&model.inputs[i].name).copied();
        let names = model
            .states
            .iter()
            .map(|s| &s.quantity)
            .chain(kinematics.free.iter().map(|&i| &model.parameters[i].quantity));
        let walk = names.clone().map(|q| walks.get(&q.name).map_or(0.0, |w| w * w)).collect();
        let prior = |i: usize| {
            kinematics
                .free
                .get(i)
                .map(|&p| model.parameters[p].prior_sd)
                .filter(|sd| sd.is_finite())
        };
        let nx = kinematics.states();
        let start_sd = names
            .enumerate()
            .map(|(i, q)| {
                i.checked_sub(nx).and_then(prior).unwrap_or_else(|| unknown(&q.unit, i < nx))
            })
            .collect();
        let density = |i: usize| {
            let sd = input(i).unwrap_or(flight.inputs[i].sd);
            sd * sd * flight.clocks[flight.inputs[i].clock].spacing
        };
        let given = [
            flight.channels.iter().map(|c| output(c).is_some()).collect(),
            (0..flight.inputs.len()).map(|i| input(i).is_some()).collect(),
        ];
        let variance =
            |c: &super::flight::Channel| output(c).map_or((c.sd * c.sd).max(1e-24), |sd| sd * sd);
        Levels {
            given,
            r: flight.channels.iter().map(variance).collect(),
            density: (0..flight.inputs.len()).map(density).collect(),
            walk,
            start_sd,
        }
    }

    /// Begins with what other `levels` found for the free parameters `free`.
    pub fn begin(&mut self, kinematics: &Kinematics, levels: &Levels, free: &[usize]) {
        let nx = kinematics.states();
        self.r.clone_from(&levels.r);
        self.density.clone_from(&levels.density);
        let places =
            kinematics.free.iter().map(|p| free.iter().position(|f| f == p).map(|k| nx + k));
        for (i, place) in (0..nx).map(Some).chain(places).enumerate() {
            if let Some(walk) = place.and_then(|place| levels.walk.get(place)) {
                self.walk[i] = *walk;
            }
        }
    }

    /// One step of maximum likelihood: a variance times `sum u^2 / sum D`, the ratio of what its
    /// adjoints are to what they should be (score of de Jong's disturbance smoother: at the maximum
    /// each ratio is 1). `walks`: the states whose walk is estimated. Gives the largest relative
    /// change of a standard deviation that promises anything: with `g = v (sum u^2 - sum D)/2`, the derivative of
    /// the log-likelihood with respect to `ln v`, a step from `v` to `v'` promises `g ln(v'/v)/2`.
    pub fn improve(&mut self, first: &Levels, sums: &Sums, walks: &[usize]) -> f64 {
        let mut change = 0.0f64;
        let mut scale = |value: &mut f64, [actual, expected]: [f64; 2], least: f64, power: i32| {
            if value.is_finite() && *value > 0.0 && expected > 0.0 && actual.is_finite() {
                let ratio = (actual / expected).clamp(1.0 / STRIDE, STRIDE);
                let next = (*value * if power == 2 { ratio * ratio } else { ratio }).max(least);
                let tolerance = if power == 2 { WALKS } else { 1.0 };
                let promise = 0.25 * *value * (actual - expected) * libm::log(next / *value);
                if promise > PROMISE {
                    change = change.max(((next / *value).sqrt() - 1.0).abs() / tolerance);
                }
                *value = next;
            }
        };
        let free = |given: &[bool], i: usize| !given.get(i).copied().unwrap_or(false);
        for (j, r) in self.r.iter_mut().enumerate().filter(|(j, _)| free(&self.given[0], *j)) {
            scale(r, sums.channels[j], LEAST * LEAST * first.r[j], 1);
        }
        for (i, density) in
            self.density.iter_mut().enumerate().filter(|(i, _)| free(&self.given[1], *i))
        {
            // an input is at least as noisy as it looks; where the path needs more (vibration
            // averaged away before it was logged, a sensor that is not where it is said to be), it
            // gets more
            scale(density, sums.inputs[i], first.density[i], 1);
        }
        for &i in walks {
            // most of a walk's noise is not seen by the measurements, so its ratio moves it too
            // little: squared, it goes about twice as far. Below a hundredth of the first guess it
            // is no walk: it stops there.
            scale(&mut self.walk[i], sums.walks[i], 1e-4 * first.walk[i], 2);
        }
        change
    }
}

/// Standard deviation of something of which nothing is known.
fn unknown(unit: &str, state: bool) -> f64 {
    match (unit, state) {
        ("rad", true) => 1.0,
        ("m/s", true) => 30.0,
        ("m", true) => 5000.0,
        // a quaternion, which begins measured
        ("-", true) => 0.2,
        ("m/s^2", false) => 0.5,
        ("rad/s", false) => 0.02,
        ("rad", false) => 0.1,
        ("-", false) => 0.2,
        ("m/s", false) => 15.0,
        ("m", false) => 1.0,
        _ => 100.0,
    }
}
