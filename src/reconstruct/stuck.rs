//! The signals of a flight in; the same without the stretches in which an output stands still but for its
//! noise, while all other sensors say that it moves, and what to say of them, out.
//!
//! `health` finds a value that repeats. A vane that jams or ices goes on with its noise; the smoother then
//! believes it, and lets accelerometers be noisy instead. `consistency` looks where a channel moves most, so
//! never where it is stuck. Here every output is asked where it moves least beside the sensor that it else
//! moves with (the vane beside the vertical acceleration, say): what all others say of it there, changes over
//! a second of both,
//!
//! ```text
//! dz(t) = k dy(t) + e(t),    dz(t) = z(t + 1 s) - z(t)
//! ```
//!
//! both without mean and trend, because what the others say drifts, and a drift is slow. It is stuck where `k` is
//! nearly nothing beyond chance, the same sensors tell it well where it moves most, and `dy` is several times what is left there.
//! What is stuck stays where it is, too: in gusts the others can be wrong about what moves (an airspeed that went from
//! 77 to 161 m/s was called stuck).
//! Then the whole flight is gone through to find where.

use super::consistency::{PART, Row, leave_out, misfit_over, slices};
use super::following::{Following, lagged};
use super::found::Found;
use super::pairs::{Pair, Which, pair};
use super::path::{FlightPath, Note};
use super::settings::Settings;
use super::signals::{Logged, Series};
use super::slow::slow;
use super::smoother::Smoother;
use super::smoother::flight::Flight;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use super::stretches::{guess, stretches};
use crate::error::Errors;
use crate::math::median;
use crate::model::Model;
use rayon::prelude::*;

/// Fewest parts of a flight among which one can stand out.
const FEW: usize = 4;
/// Parts that are looked at, until in one the others say that the channel moves.
const ASKED: usize = 3;
/// A sensor that a channel moves with, by the correlation of how much both move, part by part.
const TOGETHER: f64 = 0.5;
/// A channel follows from this share of what the others say on, and stands still below this one, beyond chance.
/// *Convention.*
const FOLLOWS: f64 = 0.5;
const STANDS: f64 = 0.3;
/// The others tell a channel well whose scale, where it moves most, is one within this.
const TOLD: f64 = 0.3;
/// They say that it moves where what they say is so many times what they leave of it there.
const MOVES: f64 = 6.0;
/// A channel stays where it is if the means over `SHORT` seconds lie within its fast noise about their median, in this
/// share of all. *Convention*: of what moves few do, and where it is let go is known to a window.
const STAYS: f64 = 0.75;
const SHORT: f64 = 2.0;
/// Others contradict each other from this mean square of their innovations on, one where all is as predicted.
const CONTRADICTED: f64 = 10.0;
/// What is left out on either side of it, s: where it begins and ends is known to a window, and to what the others
/// need to tell.
const BESIDE: f64 = 7.5;
/// Within this, s, it is stuck or is not.
const WINDOW: f64 = 5.0;

/// An output that was asked.
struct Asked {
    output: usize,
    /// Scale where it moves least, with its standard deviation.
    scale: [f64; 2],
    /// When it is stuck.
    spans: Vec<[f64; 2]>,
}

/// Masks what is stuck in `measured`; it goes into the rows and notes of the path. The flight, driven by
/// `driving`, comes back with nothing measured.
///
/// # Errors
/// The model is none that the smoother can run.
pub fn mask(
    model: &Model,
    (driving, flight): (&[Series], Flight),
    measured: &mut [Logged],
    settings: &Settings,
    path: &mut FlightPath,
) -> Result<Flight, Errors> {
    let (all, flight) = all(model, (driving, flight), measured, settings)?;
    for asked in all {
        let name = &model.outputs[asked.output].name;
        path.checks.push(row(name, &asked));
        let Some(m) = measured.iter_mut().find(|m| m.output == asked.output) else { continue };
        for [from, to] in asked.spans {
            let (begin, end) = (from - BESIDE, to + BESIDE);
            let (a, b) = (m.t.partition_point(|t| *t < begin), m.t.partition_point(|t| *t <= end));
            m.z.to_mut()[a..b].fill(f64::NAN);
            let text = format!(
                "{name} stands still from {from:.1} s to {to:.1} s, but for its noise, while all other sensors say that it moves: not used there, nor {BESIDE} s before and behind"
            );
            path.notes.push(Note::of(name, b - a, text));
        }
    }
    Ok(flight.measuring(model, []))
}

fn row(name: &str, asked: &Asked) -> Row {
    let [k, sd] = asked.scale;
    let (verdict, why) = match asked.spans.is_empty() {
        true => ("good", String::new()),
        false => {
            let each = |[from, to]: &[f64; 2]| format!("{from:.1} to {to:.1} s");
            let spans: Vec<String> = asked.spans.iter().map(each).collect();
            ("stuck", format!(", in which it is stuck but for its noise: {}", spans.join(", ")))
        }
    };
    let text = format!(
        "where it moves least beside what it else moves with, it does {k:.2} +- {:.2} (95%) of what the others say{why}",
        crate::math::distribution::INTERVAL_95 * sd
    );
    let row = Row::of(name, "follows", k, "-", (verdict, text));
    Row { low: STANDS, high: f64::INFINITY, ..row }
}

/// All outputs that can be asked, and the flight.
fn all(
    model: &Model,
    (driving, flight): (&[Series], Flight),
    measured: &[Logged],
    settings: &Settings,
) -> Result<(Vec<Asked>, Flight), Errors> {
    let plain =
        Settings { late: Vec::new(), candidates: Vec::new(), free: Vec::new(), ..settings.clone() };
    // Air data that mean nothing, while it rolls slowly, are no stuck vanes.
    let same = measured.iter().map(|m| Logged { z: (&m.z[..]).into(), ..*m });
    let mut moving: Vec<Logged> = same.collect();
    slow(model, &mut moving, settings, &mut FlightPath::default());
    let found = Found::default();
    let kinematics = Kinematics::new(model, found.free(model, &plain))?;
    let flight = flight.measuring(model, moving.iter().map(|m| (m.output, &m.z[..])));
    let flight = found.flight(flight, &moving);
    let smoother = Smoother::new(&kinematics, &flight, f64::INFINITY);
    let stretches = stretches(&flight, &plain);
    let (levels, _) = guess(&kinematics, &flight, &plain);
    let parts = slices(&stretches);
    let inputs = driving.iter().map(|(t, y)| movements(t, y, &parts));
    let outputs: Vec<Vec<f64>> = moving.iter().map(|m| movements(m.t, &m.z, &parts)).collect();
    let all: Vec<Vec<f64>> = inputs.chain(outputs.iter().cloned()).collect();
    let work = Work { smoother: &smoother, levels: &levels, parts: &parts };
    let channels: Vec<(usize, usize)> = (0..flight.channels.len())
        .filter_map(|k| {
            let output = flight.channels[k].output;
            Some((k, moving.iter().position(|m| m.output == output)?))
        })
        .collect();
    let ask = |&(k, m): &(usize, usize)| {
        let own = driving.len() + m;
        work.asked(k, &all[own], &suspects(&all, own))
    };
    let asked = channels.par_iter().filter_map(ask).collect();
    Ok((asked, flight))
}

/// How much a series moves in each part: root mean square of its changes over `LAG`; NaN where it is not
/// known.
fn movements(t: &[f64], y: &[f64], parts: &[[f64; 2]]) -> Vec<f64> {
    let of = |part: &[f64; 2]| {
        let changes = lagged(t, *part).map(|(i, j)| y[j] - y[i]).filter(|d| d.is_finite());
        let (n, sum) = changes.fold((0.0, 0.0), |(n, sum), d| (n + 1.0, sum + d * d));
        if n < PART { f64::NAN } else { (sum / n).sqrt() }
    };
    parts.iter().map(of).collect()
}

/// The parts in which a series moves least beside those that it else moves with (beside all, where it moves
/// with none), the least first.
fn suspects(all: &[Vec<f64>], own: usize) -> Vec<usize> {
    let usual = |of: &[f64]| {
        let known: Vec<f64> = of.iter().copied().filter(|x| x.is_finite()).collect();
        median(&known)
    };
    let together = |other: &usize| {
        let both = all[own].iter().zip(&all[*other]);
        let known = both.filter(|(a, b)| a.is_finite() && b.is_finite());
        let (a, b): (Vec<f64>, Vec<f64>) = known.map(|(a, b)| (*a, *b)).unzip();
        a.len() >= FEW && correlation(&a, &b) > TOGETHER
    };
    let others: Vec<usize> = (0..all.len()).filter(|other| *other != own).collect();
    let mut with: Vec<usize> = others.iter().copied().filter(together).collect();
    if with.is_empty() {
        with = others;
    }
    let usuals: Vec<f64> = with.iter().map(|&other| usual(&all[other])).collect();
    let share = |p: usize| {
        let each = with.iter().zip(&usuals).map(|(&other, usual)| all[other][p] / usual);
        let known: Vec<f64> = each.filter(|x| x.is_finite()).collect();
        all[own][p] * known.len() as f64 / known.iter().sum::<f64>()
    };
    let mut parts: Vec<(f64, usize)> =
        (0..all[own].len()).map(|p| (share(p), p)).filter(|(x, _)| x.is_finite()).collect();
    if parts.len() < FEW {
        return Vec::new();
    }
    parts.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    parts.into_iter().map(|(_, p)| p).take(ASKED).collect()
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (of_a, of_b) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        a.iter().zip(b).map(|(a, b)| f(a - of_a, b - of_b)).sum()
    };
    sum(&|a, b| a * b) / (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt()
}

struct Work<'a> {
    smoother: &'a Smoother<'a>,
    levels: &'a Levels,
    parts: &'a [[f64; 2]],
}

impl Work<'_> {
    /// What an output does in the first of the `suspects` in which the others say that it moves, and where it
    /// is stuck; none where they do not tell it.
    fn asked(&self, k: usize, moves: &[f64], suspects: &[usize]) -> Option<Asked> {
        let known = (0..moves.len()).filter(|&p| moves[p].is_finite());
        let most = known.max_by(|&a, &b| moves[a].total_cmp(&moves[b]))?;
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        let in_part = |p: usize| Some((p, Following::of(&self.told(k, p)?, all)?));
        let (_, usual) = in_part(most)?;
        if (usual.k() - 1.0).abs() + 3.0 * usual.sd() > TOLD {
            return None;
        }
        let least = MOVES * usual.left();
        let mut told = suspects.iter().filter_map(|&p| in_part(p));
        let (part, there) = told.find(|(_, there)| there.moves() >= least)?;
        let scale = [there.k(), there.sd()];
        let output = self.smoother.flight.channels[k].output;
        if !(scale[0].abs() + 3.0 * scale[1] < STANDS) || !self.stays(k, self.parts[part]) {
            return Some(Asked { output, scale, spans: Vec::new() });
        }
        // Where the others contradict each other nothing is said of it.
        let (out, parts) = ([Which::Output(k)], [self.parts[part]]);
        if !(misfit_over(self.smoother, self.levels, &parts, &out) < CONTRADICTED) {
            return None;
        }
        let mut spans = self.spans(k, least);
        if spans.is_empty() {
            spans.push(self.parts[part]);
        }
        Some(Asked { output, scale, spans })
    }

    /// What was measured of an output, and what all others say of it, over one part.
    fn told(&self, k: usize, part: usize) -> Option<Pair> {
        let (which, part) = (Which::Output(k), self.parts[part]);
        let mut without = self.levels.clone();
        leave_out(self.smoother, &mut without, which);
        let x = self.smoother.begin(&without, part, None);
        pair(self.smoother, &without, which, part, &x)
    }

    /// Whether a channel stays where it is.
    fn stays(&self, k: usize, [from, to]: [f64; 2]) -> bool {
        let flight = self.smoother.flight;
        let channel = &flight.channels[k];
        let packet = flight.packets.iter().find(|packet| packet.channels.contains(&k));
        let Some(t) = packet.map(|packet| &packet.t) else { return false };
        let count = ((to - from) / SHORT).floor().max(1.0);
        let mean = |i: usize| {
            let at = |i: usize| t.partition_point(|t| *t < from + (to - from) * i as f64 / count);
            let known = channel.z[at(i)..at(i + 1)].iter().filter(|z| z.is_finite());
            let (n, sum) = known.fold((0.0, 0.0), |(n, sum), z| (n + 1.0, sum + z));
            sum / n
        };
        let means: Vec<f64> = (0..count as usize).map(mean).filter(|m| m.is_finite()).collect();
        let middle = median(&means);
        let near = means.iter().filter(|mean| (**mean - middle).abs() <= channel.sd).count();
        near as f64 >= STAYS * means.len().max(1) as f64
    }

    /// Where it does not follow what moves by `least`: at least two windows, and what is between them and beside
    /// them in which nothing tells.
    fn spans(&self, k: usize, least: f64) -> Vec<[f64; 2]> {
        let mut windows: Vec<([f64; 2], Option<bool>)> = Vec::new();
        for p in 0..self.parts.len() {
            let Some(told) = self.told(k, p) else { continue };
            let [from, to] = self.parts[p];
            let count = ((to - from) / WINDOW).round().max(1.0) as usize;
            let each = (to - from) / count as f64;
            for i in 0..count {
                let window = [from + each * i as f64, from + each * (i + 1) as f64];
                let says = Following::of(&told, window).filter(|f| f.moves() >= least);
                windows.push((window, says.map(|f| f.k() < FOLLOWS)));
            }
        }
        let mut spans = Vec::new();
        for run in windows.split(|(_, stuck)| *stuck == Some(false)) {
            let of = |(i, (_, stuck)): (usize, &([f64; 2], Option<bool>))| stuck.map(|_| i);
            let stuck: Vec<usize> = run.iter().enumerate().filter_map(of).collect();
            if let [first, .., last] = stuck[..]
                && self.stays(k, [run[first].0[0], run[last].0[1]])
            {
                let end = (last + 1).min(run.len() - 1);
                spans.push([run[first.saturating_sub(1)].0[0], run[end].0[1]]);
            }
        }
        spans
    }
}
