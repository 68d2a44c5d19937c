//! The reasons why a unit is run again come in; one line for each cause, in words of the campaign, goes
//! out: a flight that was taken out is one cause, and not every table that there was of it.

use super::explain::named;
use super::provenance::Reason;
use indexmap::IndexMap;

/// Settings that no file has under this name, and what they are.
const MADE: [(&str, &str); 6] = [
    ("setting `flights`", "the list of flights"),
    ("setting `beside`", "which flights come before and after it"),
    ("setting `left_out`", "what of the flights is left out"),
    ("setting `model`", "its model, or a constant in it,"),
    ("setting `derived`", "the model of [derive], or a constant in it,"),
    ("setting `driven`", "whether noise drives its model"),
];

/// What follows where a flight is not part of the campaign any more.
const FOLLOWS: [&str; 2] = ["setting `flights`", "setting `beside`"];

/// The causes behind these reasons, of a campaign with these flights, in their order.
pub fn causes(reasons: &[Reason], flights: &[String]) -> Vec<String> {
    let is_out = |reason: &Reason| out(reason, flights).is_some();
    let lacking = reasons.iter().any(is_out);
    let follows = |reason: &&Reason| matches!(reason, Reason::Changed(name) if lacking && FOLLOWS.contains(&name.as_str()));
    let mut all: IndexMap<Cause, Vec<(&Reason, String)>> = IndexMap::new();
    for reason in reasons.iter().filter(|reason| !follows(reason)) {
        let (cause, what) = cause(reason, flights);
        all.entry(cause).or_default().push((reason, what));
    }
    all.into_iter().map(|(cause, of)| words(&cause, &of)).collect()
}

/// What makes one of several reasons.
#[derive(PartialEq, Eq, Hash)]
enum Cause {
    /// This flight is not part of the campaign any more.
    Out(String),
    /// What became of the tables of a unit.
    Tables(String, &'static str),
    /// What became of the files that it made.
    Files(&'static str),
    /// None but itself.
    Own(String),
}

/// The cause of a reason, and what of it the reason is about.
fn cause(reason: &Reason, flights: &[String]) -> (Cause, String) {
    if let Some((table, flight)) = out(reason, flights) {
        return (Cause::Out(flight), table);
    }
    let (name, became) = match reason {
        Reason::New(name) => (name, "are new"),
        Reason::Changed(name) => (name, "changed"),
        Reason::Gone(name) => (name, "are gone"),
        Reason::Removed(path) => return (Cause::Files("are gone"), path.clone()),
        Reason::Touched(path) => {
            return (Cause::Files("were changed by something else"), path.clone());
        }
        other => return (Cause::Own(other.to_string()), String::new()),
    };
    match table_of(name) {
        Some((table, unit)) => (Cause::Tables(unit, became), table),
        None => (Cause::Own(reason.to_string()), name.clone()),
    }
}

/// Table and flight, where a table of a flight is gone that is not part of the campaign.
fn out(reason: &Reason, flights: &[String]) -> Option<(String, String)> {
    let Reason::Gone(name) = reason else { return None };
    table_of(name).filter(|(_, flight)| !flights.contains(flight))
}

/// The table and the flight of an ingredient that is a part of a table (`Part::words`).
fn table_of(name: &str) -> Option<(String, String)> {
    // No table has a space in its name.
    let (table, rest) = name.split_once(" of ").filter(|(table, _)| !table.contains(' '))?;
    let flight = rest.split(", part ").next()?;
    Some((table.to_string(), flight.to_string()))
}

fn words(cause: &Cause, of: &[(&Reason, String)]) -> String {
    let names = || named(&of.iter().map(|(_, what)| what.clone()).collect::<Vec<_>>());
    match (cause, of) {
        (Cause::Out(flight), _) => format!("{flight} is no longer part of the campaign"),
        (_, [(reason, what)]) => one(reason, what),
        (Cause::Tables(unit, became), _) => {
            format!("{} tables of {unit} {became}: {}", of.len(), names())
        }
        (Cause::Files(became), _) => {
            format!("{} files that it made {became}: {}", of.len(), names())
        }
        (Cause::Own(words), _) => words.clone(),
    }
}

/// A reason that is the only one of its cause.
fn one(reason: &Reason, name: &str) -> String {
    let made = MADE.iter().find(|(made, _)| *made == name).map(|(_, words)| words);
    match (reason, made) {
        (Reason::New(_) | Reason::Changed(_) | Reason::Gone(_), Some(words)) => {
            format!("{words} changed")
        }
        _ => reason.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_that_was_taken_out_is_one_cause() {
        let flights = ["flight-2".to_string()];
        let gone = |table: &str| Reason::Gone(format!("{table} of flight-1, part 0"));
        let changed = |name: &str| Reason::Changed(name.to_string());
        let reasons = [changed("setting `flights`"), gone("doubts"), gone("modes")];
        assert_eq!(causes(&reasons, &flights), ["flight-1 is no longer part of the campaign"]);
        assert_eq!(causes(&reasons[..1], &flights), ["the list of flights changed"]);
    }

    #[test]
    fn tables_of_one_unit_and_files_are_one_cause_each() {
        let flights = ["a".to_string()];
        let changed = |name: &str| Reason::Changed(name.to_string());
        let reasons = [
            changed("log"),
            changed("samples of a"),
            changed("segments of a"),
            changed("setting `level`"),
            Reason::Gone(crate::pipeline::provenance::TWIN.to_string()),
            Reason::Removed("fits/part-0.parquet".to_string()),
        ];
        let wanted = [
            "log changed",
            "2 tables of a changed: samples, segments",
            "setting `level` changed",
            "another flight of the same log is gone",
            "fits/part-0.parquet is gone",
        ];
        assert_eq!(causes(&reasons, &flights), wanted);
    }
}
