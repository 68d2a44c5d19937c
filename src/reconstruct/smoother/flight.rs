//! Logged signals in; what drives and what measures a kinematic model, each at its own time stamps,
//! with its noise levels, out.
//!
//! Inputs run straight between their samples. An input whose time derivative the model asks for
//! (lever arms) is replaced by the local cubic through a short window at its own stamps, which
//! gives value and derivative together.
//!
//! Three steps, because a flight is smoothed again and again while its sensor errors are found: the inputs
//! hang on the model and on what drives it, the channels on what was measured, and only stamps on how late
//! sensors are. Every step takes the flight as it is and leaves what was made before it in place.

use super::local;
use crate::math::interpolate::between;
use crate::model::Model;
use crate::model::graph::{Leaf, Node};
use crate::reconstruct::signals::Series;
use crate::signal::robust::noise_sd;

/// Two stamps closer than this are one time, s.
pub const SAME: f64 = 1e-7;
/// A sample missing for more than this many usual spacings is a gap: its input is not known there.
const GAP: f64 = 5.0;

/// Stamps that several inputs share.
#[derive(Debug, Clone, Default)]
pub struct Clock {
    pub t: Vec<f64>,
    /// Median spacing, s.
    pub spacing: f64,
    /// Some input of it drives the model; of others only the start is read.
    pub drives: bool,
    /// Steps end at these stamps; the kinks of slower inputs may lie inside a step.
    pub steps: bool,
}

/// One driving signal.
#[derive(Debug, Clone, Default)]
pub struct Input {
    pub clock: usize,
    pub value: Vec<f64>,
    /// Time derivative at the stamps; empty where the model does not ask for it.
    pub slope: Vec<f64>,
    /// Standard deviation of one sample's noise.
    pub sd: f64,
    /// Variances of the noise that is left in value and slope.
    pub direct: [f64; 2],
    /// How far the signal strays within a gap: standard deviation of the signal itself.
    pub spread: f64,
}

/// One measured output.
#[derive(Debug, Clone, Default)]
pub struct Channel {
    /// Index into the model's outputs.
    pub output: usize,
    /// NaN where masked.
    pub z: Vec<f64>,
    /// Standard deviation of the fast noise, from the signal itself.
    pub sd: f64,
    /// The value is an angle: differences are taken to the nearest turn.
    pub angle: bool,
}

/// Channels with the same stamps.
#[derive(Debug, Clone, Default)]
pub struct Packet {
    pub t: Vec<f64>,
    pub channels: Vec<usize>,
}

/// Everything logged that the smoother reads.
#[derive(Debug, Clone, Default)]
pub struct Flight {
    pub clocks: Vec<Clock>,
    pub inputs: Vec<Input>,
    pub channels: Vec<Channel>,
    pub packets: Vec<Packet>,
}

impl Flight {
    /// A flight of which nothing is measured yet. `driving`: one series per input of the model, ascending
    /// times. `smooth_s`: length of the local cubic of the inputs that are differentiated.
    pub fn driven(model: &Model, driving: &[Series], smooth_s: f64) -> Flight {
        let nodes: Vec<Node> = model.rates.iter().chain(&model.output_nodes).copied().collect();
        let leaves = model.graph.leaves(&nodes);
        let mut flight = Flight::default();
        for (i, (t, value)) in driving.iter().enumerate() {
            let known: Vec<usize> =
                (0..t.len()).filter(|&k| t[k].is_finite() && value[k].is_finite()).collect();
            let t: Vec<f64> = known.iter().map(|&k| t[k]).collect();
            let value: Vec<f64> = known.iter().map(|&k| value[k]).collect();
            let sd = noise_sd(&value);
            let mut input = Input {
                sd,
                direct: [sd * sd, 0.0],
                spread: local::spread(&value).max(10.0 * sd),
                ..Default::default()
            };
            let is_differentiated = leaves.contains(&Leaf::InputRate(i));
            if is_differentiated {
                let half = smooth_s / spacing(&t).max(SAME) / 2.0;
                let smooth = local::cubic(&t, &value, (half as usize).max(2), GAP * spacing(&t));
                input.direct = [smooth.gain[0] * sd * sd, smooth.gain[1] * sd * sd];
                (input.value, input.slope) = (smooth.value, smooth.slope);
            } else {
                input.value = value;
            }
            input.clock = flight.clocks.iter().position(|c| c.t == t).unwrap_or_else(|| {
                flight.clocks.push(Clock { spacing: spacing(&t), t, ..Default::default() });
                flight.clocks.len() - 1
            });
            flight.clocks[input.clock].drives |=
                is_differentiated || leaves.contains(&Leaf::Input(i));
            flight.inputs.push(input);
        }
        let fastest = flight
            .clocks
            .iter()
            .filter(|c| c.drives)
            .map(|c| c.spacing)
            .fold(f64::INFINITY, f64::min);
        for clock in &mut flight.clocks {
            clock.steps = clock.drives && clock.spacing <= 1.5 * fastest;
        }
        flight
    }

    /// The same of which this is measured, and nothing else: outputs of the model with their values, whose
    /// stamps are still to come.
    pub fn measuring<'z>(
        mut self,
        model: &Model,
        measured: impl IntoIterator<Item = (usize, &'z [f64])>,
    ) -> Flight {
        (self.channels, self.packets) = (Vec::new(), Vec::new());
        for (output, z) in measured {
            let angle = model.outputs[output].unit == "rad";
            let sd = if angle { noise_sd(&local::unwrap(z)) } else { noise_sd(z) };
            self.channels.push(Channel { output, z: z.to_vec(), sd, angle });
        }
        self
    }

    /// The same with these stamps, ascending, of its channels, one after the other.
    pub fn stamped(mut self, stamps: impl IntoIterator<Item = Vec<f64>>) -> Flight {
        self.packets = Vec::new();
        for (number, t) in stamps.into_iter().enumerate() {
            match self.packets.iter_mut().find(|p| p.t == t) {
                Some(packet) => packet.channels.push(number),
                None => self.packets.push(Packet { t, channels: vec![number] }),
            }
        }
        self
    }

    /// The times at which all inputs are known, between gaps longer than `coast` s: `[begin, end]`
    /// each.
    pub fn stretches(&self, coast: f64) -> Vec<[f64; 2]> {
        let driving = || self.clocks.iter().filter(|c| c.drives);
        let first = driving()
            .map(|c| c.t.first().copied().unwrap_or(f64::INFINITY))
            .fold(f64::NEG_INFINITY, f64::max);
        let last = driving()
            .map(|c| c.t.last().copied().unwrap_or(f64::NEG_INFINITY))
            .fold(f64::INFINITY, f64::min);
        let gap = |c: &Clock, k: usize| c.t[k + 1] - c.t[k] > coast.max(GAP * c.spacing);
        let mut gaps: Vec<[f64; 2]> = Vec::new();
        for clock in driving() {
            let found = (0..clock.t.len().saturating_sub(1))
                .filter(|&k| gap(clock, k))
                .map(|k| [clock.t[k], clock.t[k + 1]]);
            gaps.extend(found);
        }
        gaps.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let (mut out, mut begin) = (Vec::new(), first);
        for [from, to] in gaps {
            if from > begin && from <= last {
                out.push([begin, from]);
            }
            begin = begin.max(to);
        }
        if last > begin {
            out.push([begin, last]);
        }
        out
    }

    /// Values and slopes of all inputs at time `t`; `near[clock]` is a sample at or before `t` to
    /// search from.
    #[inline]
    pub fn inputs_at(&self, t: f64, near: &[usize], value: &mut [f64], slope: &mut [f64]) {
        let (mut clock, mut k, mut w) = (usize::MAX, 0, 0.0);
        for (i, input) in self.inputs.iter().enumerate() {
            if input.clock != clock {
                clock = input.clock;
                let stamps = &self.clocks[clock].t;
                k = near[clock];
                while k + 1 < stamps.len() && stamps[k + 1] <= t {
                    k += 1;
                }
                w = if k + 1 < stamps.len() {
                    ((t - stamps[k]) / (stamps[k + 1] - stamps[k])).max(0.0)
                } else {
                    0.0
                };
            }
            let next = (k + 1).min(input.value.len() - 1);
            value[i] = between(input.value[k], input.value[next], w);
            if let (Some(a), Some(b)) = (input.slope.get(k), input.slope.get(next)) {
                slope[i] = between(*a, *b, w);
            }
        }
    }

    /// The last sample of every clock at or before `t`.
    pub fn locate(&self, t: f64) -> Vec<usize> {
        self.clocks
            .iter()
            .map(|c| c.t.partition_point(|&x| x <= t + SAME).saturating_sub(1))
            .collect()
    }

    /// Spectral density of the noise of input `i` after sample `k` of its clock, unit^2 s: white
    /// samples every `spacing` that stand for the time to the next one; in a gap the signal itself
    /// is unknown all along.
    #[inline]
    pub fn density(&self, i: usize, k: usize, given: f64) -> f64 {
        let input = &self.inputs[i];
        let clock = &self.clocks[input.clock];
        let step = if k + 1 < clock.t.len() { clock.t[k + 1] - clock.t[k] } else { clock.spacing };
        if step > GAP * clock.spacing {
            given.max(input.spread * input.spread * step)
        } else {
            given
        }
    }
}

/// Median spacing of ascending times, s; 0 for fewer than two.
pub fn spacing(t: &[f64]) -> f64 {
    let steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.is_empty() { 0.0 } else { crate::math::median(&steps) }
}
