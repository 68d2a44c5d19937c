//! What is to be said of validated maneuvers: how they agree and what the tolerances say come in,
//! notes and sentences go out.

use super::config::Config;
use super::proof::{Judged, Verdict, worst};
use super::settings::{NAME, Settings};
use super::tolerances::Checked;
use super::validated::Validated;
use crate::config::list;
use crate::estimate::Row;
use crate::math::distribution::INTERVAL_95;
use crate::stage::{Note, Severity};
use crate::units::Unit;
use indexmap::IndexMap;

/// What is to be said of one maneuver that was validated.
pub fn doubts(config: &Config, one: &Validated) -> Vec<Note> {
    let mut notes = Vec::new();
    if !one.beyond.is_empty() {
        let text = format!(
            "{}: for {:.0}% of it the lines of {} are taken outside their points",
            one.segment,
            100.0 * one.outside,
            one.beyond.join(", ")
        );
        notes.push(note(config, &one.flight, Severity::Warning, &one.segment, text));
    }
    for (output, agreement) in &one.outputs {
        let text = match agreement {
            None => format!("{} of {}: nothing was measured", output.name, one.segment),
            Some(agreement) => {
                let Settings { within, theil, .. } = config.settings;
                let verdict = agreement.verdict(within, theil);
                if verdict == "good" {
                    continue;
                }
                format!("{} of {}: {verdict}", output.name, one.segment)
            }
        };
        notes.push(note(config, &one.flight, Severity::Warning, &one.segment, text));
    }
    notes.extend(far(config, one));
    notes
}

/// A maneuver that the model does not fly at all: half of its outputs, or more, are something else.
fn far(config: &Config, one: &Validated) -> Option<Note> {
    let theil = config.settings.theil;
    let judged = one.outputs.iter().filter_map(|(output, a)| Some((output, a.as_ref()?)));
    let far = judged.clone().filter(|(_, a)| a.is_far(theil));
    let each: Vec<String> =
        far.map(|(o, a)| format!("{} (Theil {:.2})", o.name, a.theil.coefficient)).collect();
    let text = format!(
        "{}: the model does not tell {}: another configuration, or a sign, a unit, a sensor?",
        one.segment,
        list(&each)
    );
    let is_problem = !each.is_empty() && 2 * each.len() >= judged.count();
    is_problem.then(|| note(config, &one.flight, Severity::Problem, &one.segment, text))
}

/// The tests of a maneuver that are not passed.
pub fn tolerances(config: &Config, one: &Validated) -> Vec<Note> {
    let mut tests: IndexMap<&str, Vec<&Judged>> = IndexMap::new();
    for judged in &one.judged {
        tests.entry(&config.tolerances[judged.place].told.test).or_default().push(judged);
    }
    let mut notes = Vec::new();
    for (test, all) in tests {
        let verdict = worst(all.iter().map(|judged| judged.group));
        let (words, severity) = match verdict {
            Verdict::Within => continue,
            Verdict::Outside => ("is outside its tolerances", Severity::Problem),
            Verdict::Undetermined => ("is not determined", Severity::Warning),
        };
        let those = all.iter().filter(|judged| judged.group == verdict);
        let each: Vec<String> = those.map(|j| sentence(&config.tolerances[j.place], j)).collect();
        let text = format!("{test} of {} {words}: {}", one.segment, each.join("; "));
        notes.push(note(config, &one.flight, severity, &one.segment, text));
    }
    notes
}

/// `q is off by 2.31 deg/s, 2 deg/s allowed`, in the unit of the tolerance.
fn sentence(tolerance: &Checked, judged: &Judged) -> String {
    if let Some(why) = &judged.why {
        return format!("{} ({why})", tolerance.about());
    }
    let unit = tolerance.told.unit.as_deref().unwrap_or(&tolerance.unit);
    let scale = Unit::parse(unit).map_or(1.0, |unit| unit.scale);
    let digits = |value: f64| crate::math::digits(value / scale);
    let unit = if unit == "-" { String::new() } else { format!(" {unit}") };
    format!(
        "{} is off by {}{unit}, {}{unit} allowed",
        tolerance.about(),
        digits(judged.error),
        digits(judged.allowed)
    )
}

/// Tolerances for which no maneuver was validated.
pub fn unused(config: &Config, done: &[Validated]) -> Vec<Note> {
    let is_used = |place: usize| done.iter().flat_map(|one| &one.judged).any(|j| j.place == place);
    let mut unused: IndexMap<&str, Vec<String>> = IndexMap::new();
    for (_, one) in config.tolerances.iter().enumerate().filter(|(place, _)| !is_used(*place)) {
        let of = unused.entry(&one.told.test).or_default();
        if !of.contains(&one.about()) {
            of.push(one.about());
        }
    }
    let said = unused.into_iter().map(|(test, of)| {
        let text = format!("no maneuver for the tolerances of {test} ({})", of.join(", "));
        note(config, "", Severity::Missing, &config.settings.name(), text)
    });
    said.collect()
}

/// What was estimated in the maneuver itself, with half of the 95% interval: zero shifts, initial states
/// and what is free.
pub fn followed(rows: &[Row]) -> String {
    let one = |row: &Row| {
        let unit = if row.unit == "-" { String::new() } else { format!(" {}", row.unit) };
        let sd = row.sd.map(|sd| format!(" +- {}", crate::math::digits(INTERVAL_95 * sd)));
        let value = crate::math::digits(row.value);
        format!("{} = {value}{}{unit}", row.name, sd.unwrap_or_default())
    };
    rows.iter().filter(|row| !row.idle).map(one).collect::<Vec<_>>().join(", ")
}

/// A note of this validation.
pub fn note(
    config: &Config,
    flight: &str,
    severity: Severity,
    subject: &str,
    text: String,
) -> Note {
    Note {
        flight: flight.to_string(),
        stage: NAME.to_string(),
        severity,
        subject: subject.to_string(),
        count: 1,
        text: format!("{}: {text}", config.settings.name()),
    }
}
