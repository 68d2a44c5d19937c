//! A base at its fit in; parameters that demonstrably differ from maneuver to maneuver, with the angle
//! of attack, airspeed or flight, out.
//!
//! A parameter `theta` that is one number for all maneuvers may be another one in each. To first
//! order a maneuver in which it is larger by `b x` (`x`: mean of alpha or airspeed in the maneuver
//! about its mean over all; for flights, one `b` for each) differs by the column `x G_theta`, where
//! `G_theta` is the whitened sensitivity that the fit has anyway: no model is run. Projected on
//! everything free, the gain is that of a score test, as of a candidate effect (`search::screen`).
//! It counts where it is as many times what chance gives the best of all of them as a name takes,
//! and where held-out maneuvers, at `b x`, confirm it.

use crate::diagnose::base::found::Found;
use crate::diagnose::base::spread::Part;
use crate::diagnose::base::training::Task;
use crate::diagnose::effect::Context;
use crate::diagnose::effect::roles::find;
use crate::diagnose::residual::gain::gain;
use crate::diagnose::subject::Subject;
use crate::estimate::Case;
use crate::math::distribution::chi2_quantile;
use crate::math::products::{DEPENDENT, Gram};

/// A parameter that is not the same in all maneuvers.
#[derive(Debug, Clone, PartialEq)]
pub struct Varying {
    pub parameter: String,
    /// SI unit of the parameter.
    pub unit: String,
    /// `alpha`, `V`, or `flight`.
    pub with: String,
    /// Largest less smallest value over the maneuvers.
    pub spread: f64,
    /// Gain in log-likelihood over the training maneuvers, what it must exceed, and that of the
    /// held-out ones.
    pub gain: f64,
    pub limit: f64,
    pub held_out: f64,
}

/// What tells maneuvers apart: one row of numbers for each place.
struct Condition {
    name: String,
    /// `[place][column]`
    values: Vec<Vec<f64>>,
}

/// Parameters that vary, largest gain first; each with what it goes with most.
pub fn varying(found: &Found, case: &Case, subject: &Subject) -> Vec<Varying> {
    let thresholds = &subject.settings.thresholds;
    let conditions = conditions(found, case, subject.context);
    let noise = &found.noise;
    let segments = &found.places.training[..];
    let training = Task { case, noise, segments, free: &found.free, thresholds };
    let Some(parts) = training.parts(&found.fit.theta) else { return Vec::new() };
    let whole = training.together(&parts, &found.fit.theta);
    let unseen: Vec<Option<Part>> =
        found.places.held_out.iter().map(|&s| training.part(s, &found.theta(s))).collect();
    let shared: Vec<usize> =
        (0..found.free.len()).filter(|&k| case.unknowns[found.free[k]].group.is_none()).collect();
    let tests = (shared.len() * conditions.len()).max(1) as f64;
    let mut all = Vec::new();
    for &place in &shared {
        let of = |condition: &Condition| {
            let columns = condition.values.first().map_or(0, Vec::len);
            let chance =
                0.5 * chi2_quantile(1.0 - thresholds.false_alarm / tests, columns.max(1) as f64);
            let limit = thresholds.name_factor * chance;
            let values = |s: usize| &condition.values[s][..];
            let (gain, b) =
                fitted(&whole, &parts, &found.places.training, place, &values, columns)?;
            let changes = |s: usize| -> f64 { values(s).iter().zip(&b).map(|(x, b)| x * b).sum() };
            let confirmed: f64 = unseen
                .iter()
                .zip(&found.places.held_out)
                .filter_map(|(part, &s)| Some(realised(part.as_ref()?, place, changes(s))))
                .sum();
            let counts = gain > limit && confirmed > subject.settings.decisive;
            let all = found.places.training.iter().map(|&s| changes(s));
            let (low, high) = all.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
            let unknown = &case.unknowns[found.free[place]];
            counts.then(|| Varying {
                parameter: unknown.name.clone(),
                unit: unknown.unit.clone(),
                with: condition.name.clone(),
                spread: high - low,
                gain,
                limit,
                held_out: confirmed,
            })
        };
        let found = conditions.iter().filter_map(of);
        all.extend(found.max_by(|a, b| (a.gain / a.limit).total_cmp(&(b.gain / b.limit))));
    }
    all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    all
}

/// Means of the angle of attack and of airspeed about their means over all maneuvers; flights as
/// columns of ones, the first left out.
fn conditions(found: &Found, case: &Case, context: &Context) -> Vec<Condition> {
    let places = case.records.len();
    let mut all = Vec::new();
    for (role, sensor) in [("alpha", "alpha-sensor"), ("airspeed", "airspeed-sensor")] {
        let input = |name: &str| case.model.inputs.iter().position(|i| i.name == name);
        let driven = find(role, &case.model, context).iter().find_map(|b| input(&b.ident));
        let output = find(sensor, &case.model, context)
            .iter()
            .find_map(|b| case.model.outputs.iter().position(|o| o.name == b.ident));
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, n) =
                values.filter(|v| v.is_finite()).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
            sum / n
        };
        let of = |s: usize| -> f64 {
            let record = &case.records[s];
            match (driven, output) {
                (Some(i), _) => {
                    let inputs = record.inputs.chunks_exact(case.model.inputs.len());
                    mean(&mut inputs.skip(record.start).map(|row| row[i]))
                }
                (None, Some(o)) => {
                    let channels = record.channels.iter().filter(|c| c.output == o);
                    mean(&mut channels.flat_map(|c| c.z.iter().copied()))
                }
                (None, None) => f64::NAN,
            }
        };
        let values: Vec<f64> = (0..places).map(of).collect();
        if values.iter().all(|v| v.is_finite()) {
            let middle = values.iter().sum::<f64>() / places.max(1) as f64;
            let name = find(role, &case.model, context).first().map(|b| b.ident.clone());
            all.push(Condition {
                name: name.unwrap_or_else(|| role.to_string()),
                values: values.into_iter().map(|v| vec![v - middle]).collect(),
            });
        }
    }
    all.extend(flights(found, places));
    all
}

/// Which flight each maneuver belongs to; none where there is one only.
fn flights(found: &Found, places: usize) -> Option<Condition> {
    let label =
        |s: usize| found.prepared.segments[found.prepared.used[s]].labels.get("flight").cloned();
    let of: Vec<String> = (0..places).map(label).collect::<Option<_>>()?;
    let mut names = of.clone();
    names.sort_unstable();
    names.dedup();
    let row = |flight: &String| {
        names.iter().skip(1).map(|name| f64::from(u8::from(name == flight))).collect()
    };
    (names.len() > 1)
        .then(|| Condition { name: "flight".into(), values: of.iter().map(row).collect() })
}

/// Gain of letting the free parameter at `place` change with the columns of a condition, and its
/// change per unit of each; none where everything else imitates that.
fn fitted<'v>(
    whole: &Gram,
    parts: &[Part],
    training: &[usize],
    place: usize,
    values: &dyn Fn(usize) -> &'v [f64],
    columns: usize,
) -> Option<(f64, Vec<f64>)> {
    let n = whole.n - 1;
    let m = n + columns + 1;
    let mut all = Gram::zero(m);
    let known: Vec<usize> = (0..n).chain([m - 1]).collect();
    all.add(whole, 0, &known);
    for (part, &s) in parts.iter().zip(training) {
        let Some(k) = part.to[..part.to.len() - 1].iter().position(|&to| to == place) else {
            continue;
        };
        let product = |a: usize, b: usize| part.gram.at(part.own + a, part.own + b);
        for (c, x) in values(s).iter().enumerate() {
            for (j, &to) in part.to.iter().enumerate() {
                let to = if j + 1 == part.to.len() { m - 1 } else { to };
                all.sums[to.min(n + c) * m + to.max(n + c)] += x * product(k, j);
            }
            all.scale[n + c] += x * x * part.gram.scale[part.own + k];
            for (d, y) in values(s).iter().enumerate().skip(c) {
                all.sums[(n + c) * m + n + d] += x * y * product(k, k);
            }
        }
    }
    all.eliminate(0, n);
    let rest = all.rest(n);
    let sound: Vec<usize> = (0..columns)
        .filter(|&c| rest.scale[c] > 0.0 && rest.at(c, c) > 1e3 * DEPENDENT * rest.scale[c])
        .collect();
    if sound.is_empty() {
        return None;
    }
    let slopes: Vec<f64> = sound.iter().map(|&c| rest.at(c, columns)).collect();
    let free = vec![(f64::NEG_INFINITY, f64::INFINITY); sound.len()];
    let (gain, b) = gain(&rest.block(&sound), &slopes, &free);
    let mut changes = vec![0.0; columns];
    sound.iter().zip(&b).for_each(|(&c, b)| changes[c] = *b);
    (gain.is_finite()).then_some((gain, changes))
}

/// Gain of a maneuver in which the parameter at `place` is larger by `change`.
fn realised(part: &Part, place: usize, change: f64) -> f64 {
    let m = part.gram.n;
    let Some(k) = part.to[..part.to.len() - 1].iter().position(|&to| to == place) else {
        return 0.0;
    };
    let (slope, information) =
        (part.gram.at(part.own + k, m - 1), part.gram.at(part.own + k, part.own + k));
    change * slope - 0.5 * change * change * information
}
