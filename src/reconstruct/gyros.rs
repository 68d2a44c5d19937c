//! Turns by the gyros and by the attitude, in; how far each gyro is behind the attitude, what it has of its
//! turns, and how its bias drifts, out.
//!
//! Of a gyro that is late by `tau` the turns since a time go as `a = k (g + tau w) + c0 + c1 t` (least squares,
//! a straight line in every part of 20 s; standard deviations allow for the colour of what is left). A bias
//! turns `g - a` in every part; what the parts' have of a straight line is its drift. Where all gyros are ahead
//! of the attitude by as much, it is the attitude that is late.

use super::consistency::{PART, Row};
use super::pairs::modelled;
use super::turns::{FEWEST, GYROS, Step};
use crate::math::distribution::{INTERVAL_95, t_quantile};
use crate::math::products::dot;

/// A delay is told from this size on, s.
pub const LATE: f64 = 0.01;
/// A scale is told from this deviation on.
const SCALE: f64 = 0.03;
/// A bias drifts from this change over the flight on, rad/s: from one that is constant for the filter that
/// makes an attitude wrong by a degree in 20 s.
const DRIFT: f64 = 2e-3;
/// Parts that tell a drift, at least.
const PARTS: usize = 4;

/// Parts of 20 s.
fn parts(runs: &[Vec<Step>]) -> impl Iterator<Item = &[Step]> {
    let same = |a: &Step, b: &Step| (a.t / PART).floor() == (b.t / PART).floor();
    runs.iter().flat_map(move |run| run.chunk_by(same)).filter(|part| part.len() >= FEWEST)
}

/// How far a gyro is behind the attitude, s, with its standard deviation; what the attitude turns per turn of
/// the gyro, likewise.
pub struct Skew {
    axis: usize,
    tau: f64,
    sd: f64,
    scale: f64,
    scale_sd: f64,
}

/// None where that is not known. What both have turned since the beginning of a part is compared, less a
/// straight line in each (a bias): `a = k g + k tau w`.
pub fn skew(axis: usize, runs: &[Vec<Step>]) -> Option<Skew> {
    let mut columns: [Vec<f64>; 3] = Default::default();
    let mut lengths = Vec::new();
    for part in parts(runs) {
        let t: Vec<f64> = part.iter().map(|step| step.t).collect();
        let rates: Vec<f64> = part.iter().map(|step| step.rates[axis]).collect();
        let of = [since(part, |s| s.attitude[axis]), since(part, |s| s.gyros[axis]), rates];
        columns.iter_mut().zip(of).for_each(|(all, y)| all.extend(straight(&t, &y).1));
        lengths.push(part.len());
    }
    let [a, g, w] = &columns;
    let (gg, gw, ww, ga, wa) = (dot(g, g), dot(g, w), dot(w, w), dot(g, a), dot(w, a));
    let determinant = gg * ww - gw * gw;
    let (k, slope) = ((ga * ww - wa * gw) / determinant, (wa * gg - ga * gw) / determinant);
    let left: Vec<f64> = (0..a.len()).map(|i| a[i] - k * g[i] - slope * w[i]).collect();
    let dof = left.len().checked_sub(2 + 2 * lengths.len()).filter(|dof| *dof > 0)? as f64;
    let colour = modelled(&left, &lengths).model.colour().max(1.0);
    let variance = dot(&left, &left) / dof * colour / determinant;
    let (sd, scale_sd) = ((gg * variance).sqrt() / k.abs(), (ww * variance).sqrt());
    let tau = slope / k;
    (sd < LATE && tau.is_finite()).then_some(Skew { axis, tau, sd, scale: k, scale_sd })
}

impl Skew {
    fn limit(&self) -> f64 {
        LATE.max(3.0 * self.sd)
    }

    pub fn row(&self) -> Row {
        let (tau, limit) = (self.tau, self.limit());
        // No sensor is ahead of what it measures: the attitude is behind then.
        let verdict = if tau > limit { "late" } else { "good" };
        let text = format!(
            "behind the attitude by {tau:.4} +- {:.4} s (95%){}",
            INTERVAL_95 * self.sd,
            if tau < -limit { ": the attitude is late" } else { "" }
        );
        let row = Row::of(GYROS[self.axis], "time skew", tau, "s", (verdict, text));
        Row { low: -limit, high: limit, ..row }
    }
}

impl Skew {
    /// The line about the scale: what the gyro turns per turn of the attitude; none where it turns the other
    /// way, which is told of its sign.
    pub fn scale_row(&self) -> Option<Row> {
        let k = 1.0 / self.scale;
        let sd = self.scale_sd * k * k;
        let limit = SCALE.max(3.0 * sd);
        let verdict = if (k - 1.0).abs() > limit { "scaled" } else { "good" };
        let text = format!(
            "turns by the gyro per turn of the attitude {k:.4} +- {:.4} (95%)",
            INTERVAL_95 * sd
        );
        let row = Row::of(GYROS[self.axis], "scale", k, "-", (verdict, text));
        (k > 0.0).then_some(Row { low: 1.0 - limit, high: 1.0 + limit, ..row })
    }
}

/// How late the attitude is, s, where all gyros of which it is known, and two at least, are ahead of it, by as
/// much.
pub fn late(skews: &[Skew]) -> Option<f64> {
    let ahead = skews.len() > 1 && skews.iter().all(|skew| skew.tau < -skew.limit());
    let weight = |skew: &Skew| 1.0 / skew.sd.powi(2).max(f64::MIN_POSITIVE);
    let sum: f64 = skews.iter().map(weight).sum();
    let tau = skews.iter().map(|skew| weight(skew) * skew.tau).sum::<f64>() / sum;
    let alike = skews.iter().all(|skew| (skew.tau - tau).abs() < skew.limit());
    (ahead && alike).then_some(-tau)
}

/// How far the bias of a gyro drifts over the flight: a straight line through the biases of the parts, against
/// what they scatter about it; none where too few parts tell. `may`: the model lets it.
pub fn drift(axis: usize, runs: &[Vec<Step>], may: bool) -> Option<Row> {
    let bias = |part: &[Step]| {
        let t: Vec<f64> = part.iter().map(|step| step.t).collect();
        let less = since(part, |s| s.gyros[axis] - s.attitude[axis]);
        (0.5 * (t[0] + t[t.len() - 1]), straight(&t, &less).0)
    };
    let (t, b): (Vec<f64>, Vec<f64>) = parts(runs).map(bias).unzip();
    if t.len() < PARTS {
        return None;
    }
    let (slope, left) = straight(&t, &b);
    let (n, mean) = (t.len() as f64, t.iter().sum::<f64>() / t.len() as f64);
    let square: f64 = t.iter().map(|t| (t - mean).powi(2)).sum();
    let length = t[t.len() - 1] - t[0];
    let half =
        t_quantile(0.995, n - 2.0) * (dot(&left, &left) / (n - 2.0) / square).sqrt() * length;
    let change = slope * length;
    let limit = DRIFT.max(half);
    let verdict = if change.abs() > limit && !may { "drifts" } else { "good" };
    let text = format!(
        "its bias changes by {change:.2e} +- {half:.1e} rad/s (99%) over the flight, by the attitude{}",
        if verdict == "good" {
            ""
        } else {
            ", and is taken for constant: see [reconstruct.method.walk]"
        }
    );
    let row = Row::of(GYROS[axis], "drift", change, "rad/s", (verdict, text));
    Some(Row { low: -limit, high: limit, ..row })
}

/// Sums of a quantity of every step, from the first one on.
fn since(part: &[Step], of: impl Fn(&Step) -> f64) -> Vec<f64> {
    let add = |sum: &mut f64, step: &Step| {
        *sum += of(step);
        Some(*sum)
    };
    part.iter().scan(0.0, add).collect()
}

/// The straight line of least squares: its slope, and what is left.
fn straight(t: &[f64], y: &[f64]) -> (f64, Vec<f64>) {
    let n = t.len() as f64;
    let (mt, my) = (t.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let square: f64 = t.iter().map(|t| (t - mt).powi(2)).sum();
    let slope = t.iter().zip(y).map(|(t, y)| (t - mt) * (y - my)).sum::<f64>() / square;
    (slope, t.iter().zip(y).map(|(t, y)| y - my - slope * (t - mt)).collect())
}
