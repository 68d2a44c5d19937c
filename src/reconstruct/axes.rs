//! Body rates and attitude as they were measured, in; whether each gyro turns about its own axis, and
//! how far it is behind the attitude, out.
//!
//! Between two samples of the attitude the aircraft turns about its axes by
//!
//! ```text
//! a_p = dphi - dpsi sin(theta)
//! a_q = dtheta cos(phi) + dpsi cos(theta) sin(phi)          angles in the middle of the two
//! a_r = dpsi cos(theta) cos(phi) - dtheta sin(phi)
//! ```
//!
//! and the gyros say `g = int w dt`. Each `a` must go with the gyro of its own axis, and with no other
//! one as well. Of one that is late by `tau` the turns since a time go as `a = k (g + tau w) + c0 + c1 t` (least
//! squares, a straight line in every part of 20 s; standard deviations allow for the colour of what is left).
//! It needs no other sensor and no model of the flight, so a gyro is told here where everything that is
//! integrated from it would contradict innocent sensors.

use super::consistency::{PART, Row, modelled};
use super::signals::{Logged, Series};
use crate::math::distribution::INTERVAL_95;
use crate::math::interpolate::{between, locate};
use crate::math::products::dot;
use crate::model::Model;

/// Time over which the aircraft turns, s.
const TURN: f64 = 0.4;
/// Turns that are compared, at least.
const FEWEST: usize = 30;
/// A gyro that goes so well with another axis, and so badly with its own, is exchanged.
const ANOTHER: f64 = 0.9;
const OWN: f64 = 0.7;
/// A delay is told from this size on, s.
const LATE: f64 = 0.01;
const GYROS: [&str; 3] = ["p_imu", "q_imu", "r_imu"];
const ANGLES: [&str; 3] = ["phi", "theta", "psi"];

/// What was found.
#[derive(Debug, Default)]
pub struct Axes {
    pub rows: Vec<Row>,
    /// Gyros that turn about each other's axes: their places among the inputs, and words.
    pub exchanged: Option<([usize; 2], String)>,
}

/// From one sample of the attitude to the next: its end and length, s, the turns about the three axes by
/// the attitude and by the gyros, rad, and what the gyros read in the end, rad/s.
struct Step {
    t: f64,
    length: f64,
    attitude: [f64; 3],
    gyros: [f64; 3],
    rates: [f64; 3],
}

/// Holds the gyros against the attitude; nothing where one of the six is not measured, or hardly moves.
pub fn axes(model: &Model, driving: &[Series], measured: &[Logged]) -> Axes {
    let gyro = |name: &str| {
        let at = model.inputs.iter().position(|input| input.name == name)?;
        driving.get(at).copied()
    };
    let angle = |name: &str| {
        let at = model.output(name)?;
        measured.iter().find(|m| m.output == at).map(|m| (m.t, &m.z[..]))
    };
    let (Some(gyros), Some(angles)) = (all(GYROS.map(gyro)), all(ANGLES.map(angle))) else {
        return Axes::default();
    };
    let runs = runs(gyros, angles);
    let turns = turns(&runs);
    if turns.len() < FEWEST {
        return Axes::default();
    }
    let goes = |i: usize, j: usize| goes(&turns, i, j);
    let is_exchanged = |i: usize, j: usize| {
        goes(i, j).abs() > ANOTHER
            && goes(j, i).abs() > ANOTHER
            && goes(i, i).abs() < OWN
            && goes(j, j).abs() < OWN
    };
    let pair = [(0, 1), (0, 2), (1, 2)].into_iter().find(|&(i, j)| is_exchanged(i, j));
    let mut found = Axes::default();
    for i in 0..3 {
        let other = pair.and_then(|(a, b)| [(a, b), (b, a)].into_iter().find(|one| one.0 == i));
        let own = goes(i, i);
        let verdict = if other.is_some() { "exchanged" } else { "good" };
        let text = format!(
            "correlation of its turns with those of the attitude about its axis {own:.3}; {}",
            (0..3)
                .filter(|j| *j != i)
                .map(|j| format!("about that of {} {:.3}", GYROS[j], goes(j, i)))
                .collect::<Vec<_>>()
                .join(", ")
        );
        found.rows.push(row(i, "axis", own, [f64::NAN; 2], "-", (verdict, text)));
        if other.is_none() {
            found.rows.extend(late(i, &runs));
        }
    }
    let place =
        |i: usize| model.inputs.iter().position(|input| input.name == GYROS[i]).unwrap_or(i);
    found.exchanged = pair.map(|(i, j)| {
        ([place(i), place(j)], format!("{} and {} are exchanged", GYROS[i], GYROS[j]))
    });
    found
}

fn row(
    axis: usize,
    check: &'static str,
    value: f64,
    [low, high]: [f64; 2],
    unit: &str,
    (verdict, text): (&'static str, String),
) -> Row {
    let (channel, unit) = (GYROS[axis].to_string(), unit.to_string());
    Row { channel, check, value, low, high, unit, verdict, text }
}

/// Samples that are numbers, with straight lines between them, and what is below these.
struct Lines {
    t: Vec<f64>,
    y: Vec<f64>,
    sum: Vec<f64>,
}

impl Lines {
    fn new(t: &[f64], y: &[f64]) -> Lines {
        let good = || t.iter().zip(y).filter(|(_, y)| y.is_finite());
        let (t, y): (Vec<f64>, Vec<f64>) =
            (good().map(|s| *s.0).collect(), good().map(|s| *s.1).collect());
        let mut sum = vec![0.0; t.len()];
        for k in 1..t.len() {
            sum[k] = sum[k - 1] + 0.5 * (y[k - 1] + y[k]) * (t[k] - t[k - 1]);
        }
        Lines { t, y, sum }
    }

    /// The place of a time; none outside, or in a gap.
    fn place(&self, t: f64) -> Option<(usize, f64)> {
        let inside = self.t.len() > 1 && t >= self.t[0] && t <= self.t[self.t.len() - 1];
        let (k, share, _) = if inside { locate(&self.t, t) } else { return None };
        (self.t[k + 1] - self.t[k] < TURN).then_some((k, share))
    }

    fn at(&self, t: f64) -> Option<f64> {
        self.place(t).map(|(k, share)| between(self.y[k], self.y[k + 1], share))
    }

    fn integral(&self, from: f64, to: f64) -> Option<f64> {
        let (first, last) = (self.place(from)?, self.place(to)?);
        let whole = (first.0..last.0).all(|k| self.t[k + 1] - self.t[k] < TURN);
        let below = |(k, share): (usize, f64)| {
            let (h, end) = (self.t[k + 1] - self.t[k], between(self.y[k], self.y[k + 1], share));
            self.sum[k] + 0.5 * (self.y[k] + end) * share * h
        };
        whole.then(|| below(last) - below(first))
    }
}

fn all<T>(of: [Option<T>; 3]) -> Option<[T; 3]> {
    let [a, b, c] = of;
    Some([a?, b?, c?])
}

/// The steps from sample to sample of the roll angle, in runs without a gap.
fn runs(gyros: [Series; 3], angles: [Series; 3]) -> Vec<Vec<Step>> {
    let rates = gyros.map(|(t, y)| Lines::new(t, y));
    let angles = angles.map(|(t, y)| Lines::new(t, y));
    let mut out: Vec<Vec<Step>> = vec![Vec::new()];
    let mut last: Option<(f64, [f64; 3])> = None;
    for &t in &angles[0].t {
        let now = all(angles.each_ref().map(|angle| angle.at(t)));
        let step = last.zip(now).and_then(|((t0, before), now)| {
            let (length, attitude) = (t - t0, turned(before, now));
            let gyros = all(rates.each_ref().map(|rate| rate.integral(t0, t)))?;
            let rates = all(rates.each_ref().map(|rate| rate.at(t)))?;
            (length < TURN).then_some(Step { t, length, attitude, gyros, rates })
        });
        match (step, out.last_mut()) {
            (Some(step), Some(run)) => run.push(step),
            _ => out.push(Vec::new()),
        }
        last = now.map(|now| (t, now));
    }
    out
}

/// Mean rates of turns of at least `TURN`, one behind the other: by the attitude, and by the gyros.
fn turns(runs: &[Vec<Step>]) -> Vec<[[f64; 3]; 2]> {
    let mut out = Vec::new();
    for run in runs {
        let (mut length, mut sum) = (0.0, [[0.0; 3]; 2]);
        for step in run {
            length += step.length;
            for i in 0..3 {
                sum[0][i] += step.attitude[i];
                sum[1][i] += step.gyros[i];
            }
            if length > TURN - 1e-9 {
                out.push(sum.map(|turn| turn.map(|angle| angle / length)));
                (length, sum) = (0.0, [[0.0; 3]; 2]);
            }
        }
    }
    out
}

/// How well turns by the attitude about axis `i` go with those by gyro `j`.
fn goes(turns: &[[[f64; 3]; 2]], i: usize, j: usize) -> f64 {
    let of = |which: usize, axis: usize| turns.iter().map(|t| t[which][axis]).collect::<Vec<f64>>();
    correlation(&of(0, i), &of(1, j))
}

/// The turn about the body's axes between two attitudes (phi, theta, psi).
fn turned(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    let [phi, theta] = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let (sf, cf, st, ct) = (libm::sin(phi), libm::cos(phi), libm::sin(theta), libm::cos(theta));
    [d[0] - d[2] * st, d[1] * cf + d[2] * ct * sf, d[2] * ct * cf - d[1] * sf]
}

/// Sums of a quantity of every step, from the first one on.
fn since(part: &[Step], of: impl Fn(&Step) -> f64) -> Vec<f64> {
    let add = |sum: &mut f64, step: &Step| {
        *sum += of(step);
        Some(*sum)
    };
    part.iter().scan(0.0, add).collect()
}

/// Less the straight line of least squares.
fn detrended(t: &[f64], y: &[f64]) -> Vec<f64> {
    let n = t.len() as f64;
    let (mt, my) = (t.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let square: f64 = t.iter().map(|t| (t - mt).powi(2)).sum();
    let slope = t.iter().zip(y).map(|(t, y)| (t - mt) * (y - my)).sum::<f64>() / square;
    t.iter().zip(y).map(|(t, y)| y - my - slope * (t - mt)).collect()
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let mean = |x: &[f64]| x.iter().sum::<f64>() / n;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum()
    };
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt().max(f64::MIN_POSITIVE)
}

/// How far a gyro is behind the attitude; none where that is not known. What both have turned since the
/// beginning of a part is compared, less a straight line in each (a bias): `a = k g + k tau w`.
fn late(axis: usize, runs: &[Vec<Step>]) -> Option<Row> {
    let mut columns: [Vec<f64>; 3] = Default::default();
    let mut parts = Vec::new();
    let same = |a: &Step, b: &Step| (a.t / PART).floor() == (b.t / PART).floor();
    for part in runs.iter().flat_map(|run| run.chunk_by(same)).filter(|part| part.len() >= FEWEST) {
        let t: Vec<f64> = part.iter().map(|step| step.t).collect();
        let rates: Vec<f64> = part.iter().map(|step| step.rates[axis]).collect();
        let of = [since(part, |s| s.attitude[axis]), since(part, |s| s.gyros[axis]), rates];
        columns.iter_mut().zip(of).for_each(|(all, y)| all.extend(detrended(&t, &y)));
        parts.push(part.len());
    }
    let [a, g, w] = &columns;
    let (gg, gw, ww, ga, wa) = (dot(g, g), dot(g, w), dot(w, w), dot(g, a), dot(w, a));
    let determinant = gg * ww - gw * gw;
    let (k, slope) = ((ga * ww - wa * gw) / determinant, (wa * gg - ga * gw) / determinant);
    let left: Vec<f64> = (0..a.len()).map(|i| a[i] - k * g[i] - slope * w[i]).collect();
    let dof = left.len().checked_sub(2 + 2 * parts.len()).filter(|dof| *dof > 0)? as f64;
    let colour = modelled(&left, &parts).model.colour().max(1.0);
    let sd = (gg / determinant * dot(&left, &left) / dof * colour).sqrt() / k.abs();
    let tau = slope / k;
    if !(sd < LATE && tau.is_finite()) {
        return None;
    }
    let limit = LATE.max(3.0 * sd);
    // No sensor is ahead of what it measures: the attitude is behind then, and told so elsewhere.
    let verdict = if tau > limit { "late" } else { "good" };
    let text = format!(
        "behind the attitude by {tau:.4} +- {:.4} s (95%), scale {:.4}{}",
        INTERVAL_95 * sd,
        k,
        if tau < -limit { ": the attitude is late" } else { "" }
    );
    Some(row(axis, "time skew", tau, [-limit, limit], "s", (verdict, text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gyros and attitude of a flight that rolls, pitches and yaws, the gyros behind by `late`.
    fn flown(late: f64) -> Vec<Vec<Step>> {
        let attitude = |t: f64| {
            [
                0.3 * libm::sin(0.9 * t),
                0.05 + 0.1 * libm::sin(1.3 * t + 0.5),
                0.2 * libm::sin(0.4 * t) + 0.02 * t,
            ]
        };
        let rate = |t: f64| turned(attitude(t - 1e-4), attitude(t + 1e-4)).map(|a| a / 2e-4);
        let t: Vec<f64> = (0..6000).map(|k| 0.01 * f64::from(k)).collect();
        let slow: Vec<f64> = (0..1500).map(|k| 0.04 * f64::from(k)).collect();
        let gyro = |i: usize| t.iter().map(|t| rate(t - late)[i]).collect::<Vec<f64>>();
        let angle = |i: usize| slow.iter().map(|t| attitude(*t)[i]).collect::<Vec<f64>>();
        let (gyros, angles) = ([gyro(0), gyro(1), gyro(2)], [angle(0), angle(1), angle(2)]);
        runs(
            gyros.each_ref().map(|y| (&t[..], &y[..])),
            angles.each_ref().map(|y| (&slow[..], &y[..])),
        )
    }

    #[test]
    fn each_gyro_goes_with_its_own_axis() {
        let runs = flown(0.0);
        let turns = turns(&runs);
        for i in 0..3 {
            for j in 0..3 {
                let goes = goes(&turns, i, j);
                assert!(if i == j { goes > 0.999 } else { goes.abs() < 0.7 }, "{i} {j} {goes}");
            }
            let row = late(i, &runs).expect("it is known");
            assert!(row.verdict == "good" && row.value.abs() < 2e-3, "{row:?}");
        }
    }

    #[test]
    fn fault_a_late_gyro_is_late_and_no_gyro_is_early() {
        for i in 0..3 {
            let row = late(i, &flown(0.05)).expect("it is known");
            assert!(row.verdict == "late" && (row.value - 0.05).abs() < 3e-3, "{row:?}");
            let row = late(i, &flown(-0.05)).expect("it is known");
            assert!(row.verdict == "good" && row.text.ends_with("attitude is late"), "{row:?}");
        }
    }
}
