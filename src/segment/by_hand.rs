//! An interval that a person names as a maneuver in, the maneuver with what the signal says of its
//! levels out.

use super::cells::turning_points;
use super::{Kind, Maneuver, NO_RISES, Settings, Step};
use crate::error::{Error, Place};
use crate::math::{median, quantile};

/// What the maneuvers are found in.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    pub flight: &'a str,
    pub input: &'a str,
    /// Times, s, and values, SI, of the input channel.
    pub t: &'a [f64],
    pub u: &'a [f64],
}

/// A maneuver of the given kind and interval, with levels measured in the signal.
pub(super) fn by_hand(
    source: &Source,
    kind: Kind,
    (start, end): (f64, f64),
    reason: &str,
    settings: &Settings,
    place: &Place,
) -> Result<Maneuver, Error> {
    let missing = |what: &str| {
        Error::at(
            place.clone(),
            format!(
                "{kind} at {start} to {end} s: flight {:?} has no samples of {:?} {what}",
                source.flight, source.input
            ),
        )
        .help("give an interval inside the flight")
    };
    let within = |from: f64, to: f64| {
        let pairs = source.t.iter().zip(source.u);
        let values: Vec<f64> = pairs
            .filter(|(t, u)| **t >= from && **t < to && u.is_finite())
            .map(|(_, u)| *u)
            .collect();
        median(&values)
    };
    if kind == Kind::Sweep {
        let trim = within(start - settings.quiet_s, start);
        return sweep(source, (start, end), trim, reason)
            .ok_or_else(|| missing("inside it, or none in the quiet window before it"));
    }
    let pattern: &[f64] = if kind == Kind::Multistep { &[1.0] } else { kind.pattern() };
    let unit_time = (end - start) / pattern.iter().sum::<f64>();
    let trim = within(start - settings.quiet_s, start);
    if trim.is_nan() {
        return Err(missing("in the quiet window before it"));
    }
    let mut steps: Vec<Step> = vec![];
    let mut from = start;
    for k in pattern {
        let to = from + k * unit_time;
        // The last two thirds of a step: the level has been reached.
        let level = within(from + (to - from) / 3.0, to) - trim;
        if level.is_nan() {
            return Err(missing("inside it"));
        }
        steps.push(Step { start: from, end: to, level, rises: NO_RISES });
        from = to;
    }
    let amplitude = steps.iter().map(|s| s.level.abs()).sum::<f64>() / steps.len() as f64;
    let polarity = if steps[0].level < 0.0 { -1.0 } else { 1.0 };
    let reason = reason.to_string();
    Ok(Maneuver {
        kind,
        t_start: start,
        t_end: end,
        onset: start,
        unit_time,
        amplitude,
        polarity,
        trim,
        steps,
        score: 0.0,
        included: true,
        reason,
    })
}

/// A sweep over the interval, from the level `trim`: its amplitude is half of the signal's range,
/// without a hundredth at each end for noise, and its cycles are counted by reversals of more than
/// the amplitude. `None` without samples.
fn sweep(source: &Source, (start, end): (f64, f64), trim: f64, reason: &str) -> Option<Maneuver> {
    let pairs = source.t.iter().zip(source.u);
    let inside = pairs.filter(|(t, u)| **t >= start && **t < end && u.is_finite());
    let values: Vec<f64> = inside.map(|(_, u)| u - trim).collect();
    if values.is_empty() || trim.is_nan() {
        return None;
    }
    let amplitude = 0.5 * (quantile(&values, 0.99) - quantile(&values, 0.01));
    let turns = turning_points(&values, amplitude);
    let polarity = turns.first().map_or(1.0, |i| values[*i].signum());
    let sides = 2 * turns.len().div_ceil(2).max(1);
    let length = (end - start) / sides as f64;
    let step = |k: usize| Step {
        start: start + k as f64 * length,
        end: start + (k + 1) as f64 * length,
        level: if k.is_multiple_of(2) { polarity * amplitude } else { -polarity * amplitude },
        rises: NO_RISES,
    };
    Some(Maneuver {
        kind: Kind::Sweep,
        t_start: start,
        t_end: end,
        onset: start,
        unit_time: 0.5 * length,
        amplitude,
        polarity,
        trim,
        steps: (0..sides).map(step).collect(),
        score: 0.0,
        included: true,
        reason: reason.to_string(),
    })
}
