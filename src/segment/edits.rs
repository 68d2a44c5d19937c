//! Found maneuvers and a person's edits in, maneuvers with inclusion and reason out.

use super::by_hand::{Source, by_hand};
use super::{Kind, Maneuver, Settings};
use crate::error::{Error, Errors, Place};

/// Edits by hand, each with a reason that stays in the table.
#[derive(
    Debug, Clone, Default, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema,
)]
#[serde(deny_unknown_fields, default)]
pub struct Edits {
    /// Intervals to include that were not found.
    pub include: Vec<Include>,
    /// Found maneuvers to leave out.
    pub exclude: Vec<Exclude>,
    /// Found maneuvers whose interval is wrong.
    #[serde(rename = "move")]
    pub moves: Vec<Move>,
}

/// An interval to include as a maneuver.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Include {
    pub flight: String,
    /// The input signal it was flown on.
    pub input: String,
    pub kind: Kind,
    /// First edge, s.
    pub t_start_s: f64,
    /// Last edge, s.
    pub t_end_s: f64,
    pub reason: String,
}

/// A found maneuver to leave out: the one nearest to `t_s`.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Exclude {
    pub flight: String,
    /// The input signal it was found on.
    pub input: String,
    /// A time inside the maneuver, or at most 2 s outside, s.
    pub t_s: f64,
    pub reason: String,
}

/// A found maneuver to give another interval: the one nearest to `t_s`.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Move {
    pub flight: String,
    /// The input signal it was found on.
    pub input: String,
    /// A time inside the maneuver, or at most 2 s outside, s.
    pub t_s: f64,
    /// First edge, s.
    pub t_start_s: f64,
    /// Last edge, s.
    pub t_end_s: f64,
    /// Its kind, where that was wrong as well.
    pub kind: Option<Kind>,
    pub reason: String,
}

/// How far from a maneuver an edit may point, s.
const REACH_S: f64 = 2.0;

impl Edits {
    /// The mistakes that show before any log is read: a flight or input that is not there, an empty
    /// reason, a reversed interval. `place` is that of the edits in their file.
    pub fn check(
        &self,
        flights: &[String],
        inputs: &[String],
        place: &Place,
    ) -> Result<(), Errors> {
        let mut errors = Errors::default();
        let mut one = |what: String,
                       flight: &String,
                       input: &String,
                       reason: &String,
                       interval: Option<(f64, f64)>| {
            let mut wrong = |why: String, help: &str| {
                errors.push(Error::at(place.clone(), format!("{what}: {why}")).help(help))
            };
            if !flights.contains(flight) {
                wrong(
                    format!("there is no flight {flight:?}"),
                    &format!("the flights are {}", flights.join(", ")),
                );
            }
            if !inputs.contains(input) {
                wrong(
                    format!("maneuvers are not sought on {input:?}"),
                    &format!("they are on {}", inputs.join(", ")),
                );
            }
            if reason.trim().is_empty() {
                wrong(
                    "the reason is empty".into(),
                    "say why in one line: it stays in the segments table",
                );
            }
            if interval.is_some_and(|(a, b)| !(a < b)) {
                wrong(
                    "t_start_s is not before t_end_s".into(),
                    "give the first and the last edge of the maneuver",
                );
            }
        };
        for e in &self.include {
            one(
                format!("include at {} s", e.t_start_s),
                &e.flight,
                &e.input,
                &e.reason,
                Some((e.t_start_s, e.t_end_s)),
            );
        }
        for e in &self.exclude {
            one(format!("exclude at {} s", e.t_s), &e.flight, &e.input, &e.reason, None);
        }
        for e in &self.moves {
            one(
                format!("move at {} s", e.t_s),
                &e.flight,
                &e.input,
                &e.reason,
                Some((e.t_start_s, e.t_end_s)),
            );
        }
        errors.or(())
    }
}

/// The maneuvers `found` on one input of one flight with the edits that concern them, in order of
/// time.
///
/// Levels, amplitude and polarity of an interval given by hand are measured in the signal. An
/// excluded maneuver stays, with `included` false. Errors: an edit near which no maneuver was
/// found; an included interval that overlaps a found maneuver or lies where the signal has no
/// samples. `place` is that of the edits in their file.
pub fn apply(
    found: Vec<Maneuver>,
    edits: &Edits,
    source: &Source,
    settings: &Settings,
    place: &Place,
) -> Result<Vec<Maneuver>, Errors> {
    let mut errors = Errors::default();
    let mut maneuvers = found;
    let here = |flight: &str, input: &str| flight == source.flight && input == source.input;
    for e in edits.exclude.iter().filter(|e| here(&e.flight, &e.input)) {
        if let Some(m) = errors.take(nearest(&mut maneuvers, e.t_s, "exclude", source, place)) {
            m.included = false;
            m.reason = e.reason.clone();
        }
    }
    for e in edits.moves.iter().filter(|e| here(&e.flight, &e.input)) {
        let Some(m) = errors.take(nearest(&mut maneuvers, e.t_s, "move", source, place)) else {
            continue;
        };
        let kind = e.kind.unwrap_or(m.kind);
        let measured = by_hand(source, kind, (e.t_start_s, e.t_end_s), &e.reason, settings, place);
        if let Some(new) = errors.take(measured) {
            *m = new;
        }
    }
    for e in edits.include.iter().filter(|e| here(&e.flight, &e.input)) {
        if let Some(m) = maneuvers.iter().find(|m| m.t_start < e.t_end_s && m.t_end > e.t_start_s) {
            let what = format!(
                "include at {} s: a {} was found at {:.2} to {:.2} s",
                e.t_start_s, m.kind, m.t_start, m.t_end
            );
            errors.push(
                Error::at(place.clone(), what)
                    .help("use `move` to change the interval or kind of a found maneuver"),
            );
            continue;
        }
        let measured =
            by_hand(source, e.kind, (e.t_start_s, e.t_end_s), &e.reason, settings, place);
        maneuvers.extend(errors.take(measured));
    }
    maneuvers.sort_by(|a, b| a.t_start.total_cmp(&b.t_start));
    errors.or(maneuvers)
}

/// The maneuver nearest to `t_s`, not farther than the reach of an edit.
fn nearest<'a>(
    found: &'a mut [Maneuver],
    t_s: f64,
    verb: &str,
    source: &Source,
    place: &Place,
) -> Result<&'a mut Maneuver, Error> {
    let distance = |m: &Maneuver| (m.t_start - t_s).max(t_s - m.t_end).max(0.0);
    let all: Vec<String> = found
        .iter()
        .map(|m| format!("{} at {:.2} to {:.2} s", m.kind, m.t_start, m.t_end))
        .collect();
    let there = if all.is_empty() {
        "none was found".to_string()
    } else {
        format!("found were {}", all.join(", "))
    };
    match found.iter_mut().min_by(|a, b| distance(a).total_cmp(&distance(b))) {
        Some(m) if distance(m) <= REACH_S => Ok(m),
        _ => Err(Error::at(
            place.clone(),
            format!(
                "{verb} at {t_s} s: flight {:?} has no maneuver on {:?} within {REACH_S} s; {there}",
                source.flight, source.input
            ),
        )
        .help("give a time inside the maneuver meant")),
    }
}
