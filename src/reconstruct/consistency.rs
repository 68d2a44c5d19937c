//! A flight and its smoother in; each channel against what all others say of it, as rows with
//! verdicts, out.
//!
//! Every channel in turn is left out (a measurement is not used; an input is driven with noise as
//! large as the signal), the flight is smoothed without it on the parts where it moves most, and
//! what the others say of it is compared with what was measured:
//!
//! ```text
//! z(t) = c0 + c1 t + k (y(t) - tau y'(t)) + e(t)          least squares per part, common k and tau
//! ```
//!
//! The trend takes up what the others cannot know (an attitude's start, a drift by a gyro's bias).
//! `k` is the scale and its sign, `tau` the delay, the correlation is of what the trend leaves. So
//! pressure altitude stands against integrated vertical motion, the vane against the inertial angle
//! of attack, attitude against integrated rates, one recorder's clock against the others'. Standard
//! deviations allow for the colour of `e`.

use super::pairs::{Comparison, Pair, Which, jump, pair, regress};
use super::smoother::levels::Levels;
use super::smoother::{Innovation, Smoother};
use rayon::prelude::*;

/// Length of the parts a channel is compared on, s.
pub const PART: f64 = 20.0;
/// One line of the consistency table.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    pub channel: String,
    /// What was looked at.
    pub check: &'static str,
    pub value: f64,
    /// Between these it is as it should be; NaN where there is no such limit.
    pub low: f64,
    pub high: f64,
    pub unit: String,
    /// One word or two; "good" where nothing is wrong.
    pub verdict: &'static str,
    pub text: String,
}

impl Row {
    /// A line without limits.
    pub fn of(
        channel: &str,
        check: &'static str,
        value: f64,
        unit: &str,
        (verdict, text): (&'static str, String),
    ) -> Row {
        let (channel, unit) = (channel.to_string(), unit.to_string());
        Row { channel, check, value, low: f64::NAN, high: f64::NAN, unit, verdict, text }
    }

    /// Whether it is of the same channel and check.
    pub fn is_of(&self, other: &Row) -> bool {
        (&self.channel, self.check) == (&other.channel, other.check)
    }
}

/// Compares every channel with the others; those in `out` are not used at all. `known` are sensor
/// errors found elsewhere (behind the states, which are not read): the parts begin with them.
pub fn compare(
    smoother: &Smoother,
    levels: &Levels,
    stretches: &[[f64; 2]],
    out: &[Which],
    known: Option<&[f64]>,
) -> Vec<Comparison> {
    let mut levels = levels.clone();
    out.iter().for_each(|which| leave_out(smoother, &mut levels, *which));
    let channels: Vec<(Which, Vec<[f64; 2]>)> = channels(smoother)
        .filter(|which| !out.contains(which))
        .map(|which| (which, parts(smoother, which, stretches)))
        .collect();
    // many channels move in the same parts: one start serves all
    let mut distinct: Vec<[f64; 2]> =
        channels.iter().flat_map(|(_, parts)| parts.iter().copied()).collect();
    distinct.sort_by(|a, b| a[0].total_cmp(&b[0]));
    distinct.dedup();
    let open = smoother.with_gate(f64::INFINITY);
    let starts: Vec<Vec<f64>> =
        distinct.par_iter().map(|&part| open.begin(&levels, part, known)).collect();
    channels
        .par_iter()
        .filter_map(|(which, parts)| {
            let mut without = levels.clone();
            leave_out(smoother, &mut without, *which);
            let one = |part: &[f64; 2]| {
                let start = distinct.iter().position(|d| d == part)?;
                pair(&open, &without, *which, *part, &starts[start])
            };
            let pairs: Vec<Pair> = parts.iter().filter_map(one).collect();
            Some(Comparison { jump: jump(*which, &pairs), ..regress(*which, &pairs)? })
        })
        .collect()
}

/// The channels that others may tell something of: a temperature has no axis that could be the
/// wrong way round, and nothing else tells it.
pub fn channels<'s>(smoother: &'s Smoother) -> impl Iterator<Item = Which> + 's {
    let flight = smoother.flight;
    let moving = |k: &usize| inertial(&smoother.kinematics.model.inputs[*k].unit);
    (0..flight.inputs.len())
        .filter(moving)
        .map(Which::Input)
        .chain((0..flight.channels.len()).map(Which::Output))
}

/// Whether an input is a rate or a specific force: those are never still. A temperature may be one
/// number for a whole flight.
pub fn inertial(unit: &str) -> bool {
    matches!(unit, "m/s^2" | "rad/s" | "rad/s^2")
}

/// How well the measurements fit together over the parts where `which` moves, without the channels
/// `out`: mean normalised innovation squared.
pub fn misfit(
    smoother: &Smoother,
    levels: &Levels,
    stretches: &[[f64; 2]],
    which: Which,
    out: &[Which],
) -> f64 {
    misfit_over(smoother, levels, &parts(smoother, which, stretches), out)
}

/// The same over these parts.
pub fn misfit_over(smoother: &Smoother, levels: &Levels, parts: &[[f64; 2]], out: &[Which]) -> f64 {
    let mut levels = levels.clone();
    out.iter().for_each(|which| leave_out(smoother, &mut levels, *which));
    let mut watch = super::smoother::Innovations::new(smoother.flight.channels.len());
    let open = smoother.with_gate(f64::INFINITY);
    for &part in parts {
        let x = open.begin(&levels, part, None);
        open.run(&levels, part, &x, &mut watch, &mut super::smoother::Nothing);
    }
    let sum = |f: fn(&Innovation) -> f64| watch.channels.iter().map(f).sum::<f64>();
    sum(|c| c.square) / sum(|c| c.count as f64).max(1.0)
}

/// Noise levels with which a channel says nothing.
pub fn leave_out(smoother: &Smoother, levels: &mut Levels, which: Which) {
    match which {
        Which::Output(k) => levels.r[k] = f64::INFINITY,
        Which::Input(k) => {
            let spread = smoother.flight.inputs[k].spread;
            levels.density[k] = 10.0 * spread * spread;
        }
    }
}

/// The stretches in parts of about `PART`.
pub fn slices(stretches: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let of = |&[from, to]: &[f64; 2]| {
        let count = ((to - from) / PART).floor().max(1.0) as usize;
        let each = (to - from) / count as f64;
        (0..count).map(move |i| [from + each * i as f64, from + each * (i + 1) as f64])
    };
    stretches.iter().flat_map(of).collect()
}

/// The parts of the flight where a channel moves most, one in each half so that a clock that jumps
/// shows, in the order of time.
fn parts(smoother: &Smoother, which: Which, stretches: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let flight = smoother.flight;
    let (t, y): (&[f64], &[f64]) = match which {
        Which::Input(k) => (&flight.clocks[flight.inputs[k].clock].t, &flight.inputs[k].value),
        Which::Output(k) => {
            let Some(packet) = flight.packets.iter().find(|p| p.channels.contains(&k)) else {
                return Vec::new();
            };
            (&packet.t, &flight.channels[k].z)
        }
    };
    let (Some(first), Some(last)) = (stretches.first(), stretches.last()) else {
        return Vec::new();
    };
    let middle = 0.5 * (first[0] + last[1]);
    let mut found: Vec<(f64, [f64; 2])> = Vec::new();
    for part in slices(stretches) {
        let (a, b) = (t.partition_point(|&x| x < part[0]), t.partition_point(|&x| x <= part[1]));
        let z = &y[a..b];
        let known = z.iter().filter(|z| z.is_finite()).count();
        // What is masked for the most part says little.
        if known > 20 && 2 * known >= z.len() {
            let steps = z.windows(11).map(|w| w[10] - w[0]);
            let steps: Vec<f64> = steps.filter(|step| step.is_finite()).collect();
            let square = steps.iter().map(|s| s * s).sum::<f64>() / steps.len().max(1) as f64;
            found.push((square, part));
        }
    }
    let halves: [fn(f64, f64) -> bool; 2] = [|t, middle| t < middle, |t, middle| t >= middle];
    let most = |half: fn(f64, f64) -> bool| {
        let within = found.iter().filter(|(_, part)| half(0.5 * (part[0] + part[1]), middle));
        within.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, part)| *part)
    };
    halves.into_iter().filter_map(most).collect()
}
