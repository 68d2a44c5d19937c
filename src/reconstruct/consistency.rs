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

use super::smoother::backward::Visit;
use super::smoother::grid::Outputs;
use super::smoother::levels::Levels;
use super::smoother::tape::Tape;
use super::smoother::{Innovation, Smoother};
use crate::math::dense;
use crate::math::interpolate::between;
use crate::noise::{Modelled, Products, Rule, burg};
use crate::signal::resample::Grid;
use rayon::prelude::*;

/// Length of the parts a channel is compared on, s.
pub const PART: f64 = 20.0;
/// Means over this time of an input and what the others say of it, s.
const BIN: f64 = 0.2;
/// Rate at which what the others say is read, Hz.
const RATE: f64 = 50.0;
/// Correlation and scale of a part from which its delay is believed.
const SOUND: f64 = 0.9;
/// A channel the wrong way round has a scale below the negative share of its motion that is told,
/// but for this factor, which allows for noise.
const WRONG_WAY: f64 = 0.8;
/// What the others say must vary by more than this many of its standard deviations to be worth a
/// comparison.
const SIGNAL: f64 = 4.0;

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

/// A channel: an input or a measured output, by its place in the smoother's flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Which {
    Input(usize),
    Output(usize),
}

/// What the others say of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    pub which: Which,
    /// Of what the trend leaves.
    pub correlation: f64,
    pub scale: [f64; 2],
    /// Delay and its standard deviation, s; NaN for inputs.
    pub delay: [f64; 2],
    /// By how much later the channel is in the later part than in the earlier one, and its standard
    /// deviation, s; NaN where they do not say.
    pub jump: [f64; 2],
    /// Root mean square of what is left, in the channel's unit, and samples.
    pub left: f64,
    pub samples: usize,
    /// The order at which the model of its noise was cut off.
    pub cut: Option<usize>,
}

/// Times, measured values, what the others say, and its slope; one per part.
type Pair = [Vec<f64>; 4];

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
    let mut levels = levels.clone();
    out.iter().for_each(|which| leave_out(smoother, &mut levels, *which));
    let mut watch = super::smoother::Innovations::new(smoother.flight.channels.len());
    let open = smoother.with_gate(f64::INFINITY);
    for part in parts(smoother, which, stretches) {
        let x = open.begin(&levels, part, None);
        open.run(&levels, part, &x, &mut watch, &mut super::smoother::Nothing);
    }
    let sum = |f: fn(&Innovation) -> f64| watch.channels.iter().map(f).sum::<f64>();
    sum(|c| c.square) / sum(|c| c.count as f64).max(1.0)
}

fn leave_out(smoother: &Smoother, levels: &mut Levels, which: Which) {
    match which {
        Which::Output(k) => levels.r[k] = f64::INFINITY,
        Which::Input(k) => {
            let spread = smoother.flight.inputs[k].spread;
            levels.density[k] = 10.0 * spread * spread;
        }
    }
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
    for &[from, to] in stretches {
        let count = ((to - from) / PART).floor().max(1.0) as usize;
        let each = (to - from) / count as f64;
        for i in 0..count {
            let part = [from + each * i as f64, from + each * (i + 1) as f64];
            let (a, b) =
                (t.partition_point(|&x| x < part[0]), t.partition_point(|&x| x <= part[1]));
            let z: Vec<f64> = y[a..b].iter().copied().filter(|z| z.is_finite()).collect();
            if z.len() > 20 {
                let steps: Vec<f64> = z.windows(11).map(|w| w[10] - w[0]).collect();
                let square = steps.iter().map(|s| s * s).sum::<f64>() / steps.len() as f64;
                found.push((square, part));
            }
        }
    }
    let halves: [fn(f64, f64) -> bool; 2] = [|t, middle| t < middle, |t, middle| t >= middle];
    let most = |half: fn(f64, f64) -> bool| {
        let within = found.iter().filter(|(_, part)| half(0.5 * (part[0] + part[1]), middle));
        within.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, part)| *part)
    };
    halves.into_iter().filter_map(most).collect()
}

/// Collects an input and its smoothed error, in means over `BIN`.
struct Bins {
    input: usize,
    from: f64,
    /// Per bin: time, weights, input, smoothed input.
    sums: Vec<[f64; 4]>,
    u: Vec<f64>,
}

impl Visit for (&mut Bins, &Smoother<'_>) {
    fn node(
        &mut self,
        tape: &Tape,
        k: usize,
        _: &[f64],
        noise: &[f64],
        _: &mut dyn FnMut(&mut Vec<f64>),
    ) {
        let (bins, smoother) = (&mut *self.0, self.1);
        let (t, h) = (tape.t[k], tape.h[k]);
        let mut slope = bins.u.clone();
        smoother.flight.inputs_at(t + 0.5 * h, &smoother.flight.locate(t), &mut bins.u, &mut slope);
        let at = ((t - bins.from) / BIN).floor().max(0.0) as usize;
        if let Some(sum) = bins.sums.get_mut(at) {
            let u = bins.u[bins.input];
            sum[0] += t * h;
            sum[1] += h;
            sum[2] += u * h;
            sum[3] += (u + noise[bins.input]) * h;
        }
    }
}

/// What was measured and what the others say, over one part; none where the others do not know.
fn pair(
    smoother: &Smoother,
    levels: &Levels,
    which: Which,
    part: [f64; 2],
    x: &[f64],
) -> Option<Pair> {
    let flight = smoother.flight;
    match which {
        Which::Input(input) => {
            let count = ((part[1] - part[0]) / BIN) as usize;
            let mut bins = Bins {
                input,
                from: part[0],
                sums: vec![[0.0; 4]; count],
                u: vec![0.0; flight.inputs.len()],
            };
            let smoothed = smoother.run(levels, part, x, &mut (), &mut (&mut bins, smoother));
            // the first second still looks for the state
            let good: Vec<&[f64; 4]> =
                bins.sums.iter().skip(5).filter(|s| s[1] > 0.5 * BIN).collect();
            let mean = |k: usize| good.iter().map(|s| s[k] / s[1]).collect::<Vec<f64>>();
            (smoothed.finite && good.len() > 20).then(|| [mean(0), mean(2), mean(3), Vec::new()])
        }
        Which::Output(number) => {
            let dt = 1.0 / RATE;
            let grid = Grid::covering((part[0] / dt).ceil() * dt, part[1], dt);
            let outputs = smoother.kinematics.model.outputs.len();
            let mut out = Outputs::empty(outputs, smoother.kinematics.size(), grid.n);
            let smoothed = smoother.path(None, levels, part, x, (grid, 10), &mut (), &mut out);
            if !smoothed.finite {
                return None;
            }
            let k = flight.channels[number].output;
            let y = super::smoother::unwrap(&out.value[k]);
            let packet = flight.packets.iter().find(|p| p.channels.contains(&number))?;
            let z = super::smoother::unwrap(&flight.channels[number].z);
            let mut all: Pair = Default::default();
            for (&t, &z) in packet.t.iter().zip(&z) {
                let at = (t - grid.t0) / dt;
                if !(z.is_finite() && at >= 2.0 && at < grid.n as f64 - 3.0) {
                    continue;
                }
                let i = at as usize;
                let w = at - i as f64;
                let slope = |i: usize| (y[i + 2] - y[i - 2]) / (4.0 * dt);
                let values = [t, z, between(y[i], y[i + 1], w), between(slope(i), slope(i + 1), w)];
                all.iter_mut().zip(values).for_each(|(list, value)| list.push(value));
            }
            (all[0].len() > 20).then_some(all)
        }
    }
}

/// By how much later the channel is in the second part than in the first.
fn jump(which: Which, pairs: &[Pair]) -> [f64; 2] {
    // only where the part by itself tells the channel well
    let sound = |c: &Comparison| c.correlation > SOUND && (c.scale[0] - 1.0).abs() < 1.0 - SOUND;
    let delay =
        |pair: &Pair| regress(which, std::slice::from_ref(pair)).filter(sound).map(|c| c.delay);
    match pairs {
        [first, second] => match (delay(first), delay(second)) {
            (Some(a), Some(b)) => [b[0] - a[0], libm::hypot(a[1], b[1])],
            _ => [f64::NAN; 2],
        },
        _ => [f64::NAN; 2],
    }
}

/// Least squares over the parts; none where there is nothing to compare.
fn regress(which: Which, pairs: &[Pair]) -> Option<Comparison> {
    let shared = if matches!(which, Which::Output(_)) { 2 } else { 1 };
    let size = shared + 2 * pairs.len();
    let mut rows: Vec<(Vec<f64>, f64)> = Vec::new();
    for (number, [t, z, y, slope]) in pairs.iter().enumerate() {
        let (t0, span) = (t[0], t[t.len() - 1] - t[0]);
        let (y0, z0) =
            (y.iter().sum::<f64>() / y.len() as f64, z.iter().sum::<f64>() / z.len() as f64);
        for k in 0..t.len() {
            let mut row = vec![0.0; size];
            row[0] = y[k] - y0;
            if shared == 2 {
                row[1] = -slope[k];
            }
            row[shared + 2 * number] = 1.0;
            row[shared + 2 * number + 1] = (t[k] - t0) / span;
            rows.push((row, z[k] - z0));
        }
    }
    let fit = |columns: &[usize]| -> Option<(Vec<f64>, Vec<f64>, Vec<f64>)> {
        let n = columns.len();
        let (mut gram, mut right) = (vec![0.0; n * n], vec![0.0; n]);
        for (row, z) in &rows {
            for (i, &a) in columns.iter().enumerate() {
                right[i] += row[a] * z;
                for (j, &b) in columns.iter().enumerate() {
                    gram[i * n + j] += row[a] * row[b];
                }
            }
        }
        let factor = dense::cholesky(&gram, n).ok()?;
        dense::cholesky_solve(&factor, n, &mut right);
        let residuals = rows
            .iter()
            .map(|(row, z)| z - columns.iter().zip(&right).map(|(&c, x)| row[c] * x).sum::<f64>())
            .collect();
        Some((right, dense::cholesky_inverse(&factor, n), residuals))
    };
    let trend: Vec<usize> = (shared..size).collect();
    let (_, _, without) = fit(&trend)?;
    let (x, inverse, left) = fit(&(0..size).collect::<Vec<_>>())?;
    let square = |list: &[f64]| list.iter().map(|e| e * e).sum::<f64>();
    let n = left.len();
    let r = square(&left) / (n.checked_sub(size)?.max(1)) as f64;
    let modelled = modelled(&left, &pairs.iter().map(|p| p[0].len()).collect::<Vec<_>>());
    let sd = |i: usize| (inverse[i * size + i] * r * modelled.model.colour().max(1.0)).sqrt();
    let (only, ..) = fit(&[&[0], &trend[..]].concat())?;
    let share = 1.0 - square(&left) / square(&without).max(1e-300);
    let scale = [x[0], sd(0)];
    // What is left of the trend may be explained by the delay alone; that says nothing of the sign.
    let told = x[0].abs() > SIGNAL * sd(0) || (share > 0.5 && x[0] > 0.0 && only[0] > 0.0);
    // Where the others say s + d of a channel that does -s, k = -s^2/(s^2 + d^2) and the square of
    // the correlation is at most -k. A negative k nearer to zero is the drift d alone.
    let worth = told && !(only[0] < 0.0 && x[0] > -WRONG_WAY * share);
    worth.then(|| Comparison {
        which,
        correlation: only[0].signum() * share.max(0.0).sqrt(),
        scale,
        delay: if shared == 2 { [x[1] / x[0], sd(1) / x[0].abs()] } else { [f64::NAN; 2] },
        jump: [f64::NAN; 2],
        left: (square(&left) / n as f64).sqrt(),
        samples: n,
        cut: modelled.cut,
    })
}

/// The noise of all `parts`. By its `colour`, power at frequency zero over that of white noise of the
/// same size, coloured errors widen the variance of what is slow.
pub fn modelled(errors: &[f64], parts: &[usize]) -> Modelled {
    let rule = Rule::default();
    let mut products = Products::new(rule.highest);
    let mut from = 0;
    for &n in parts {
        products.take(&errors[from..from + n]);
        from += n;
    }
    burg::fit(&products, rule.criterion)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A channel that does `z` while the others say `y`.
    fn told(z: impl Fn(f64) -> f64, y: impl Fn(f64) -> f64) -> Option<Comparison> {
        let t: Vec<f64> = (0..400).map(|k| 0.05 * f64::from(k)).collect();
        let noise = |t: f64| 0.05 * libm::sin(97.0 * t * t);
        let slope = |t: f64| (y(t + 0.01) - y(t - 0.01)) / 0.02;
        let of = |f: &dyn Fn(f64) -> f64| t.iter().map(|t| f(*t)).collect::<Vec<f64>>();
        let pair = [t.clone(), of(&|t| z(t) + noise(t)), of(&y), of(&slope)];
        regress(Which::Output(0), &[pair])
    }

    #[test]
    fn a_drift_of_what_the_others_say_is_no_reversed_sign() {
        let s = |t: f64| libm::sin(0.9 * t);
        assert!(told(|t| -s(t), s).expect("a comparison").reversed());
        assert!(!told(s, s).expect("a comparison").reversed());
        // What the others say drifts against the motion, by four times of it.
        assert_eq!(told(s, |t| -3.0 * s(t)), None);
    }
}
