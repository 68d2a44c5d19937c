//! What `flights`, `except` and `where` of a stage's settings say comes in; which flights and
//! maneuvers that stage uses, the mistakes in what was said, and notes on what was left out, go
//! out.

use crate::config::{list, nearest};
use crate::stage::check::{Columns, Given};
use crate::stage::{Note, Severity};
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A range of numbers; both ends count as inside.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Range {
    /// `[0.02, 0.06]`
    Within([f64; 2]),
    /// `{ min = 0.02 }`, `{ max = 0.06 }`
    Open(Ends),
}

/// A range that may be open at one end.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Ends {
    /// Smallest value; none unless given.
    #[serde(default)]
    pub min: Option<f64>,
    /// Largest value; none unless given.
    #[serde(default)]
    pub max: Option<f64>,
}

impl Range {
    /// Both ends; infinite where the range is open.
    fn ends(self) -> (f64, f64) {
        match self {
            Range::Within([min, max]) => (min, max),
            Range::Open(Ends { min, max }) => {
                (min.unwrap_or(f64::NEG_INFINITY), max.unwrap_or(f64::INFINITY))
            }
        }
    }

    /// What is wrong with it, and what to do.
    pub fn fault(self) -> Option<(String, &'static str)> {
        let (min, max) = self.ends();
        if min == f64::NEG_INFINITY && max == f64::INFINITY {
            let help = "give it `min`, `max` or both: { min = 0.02 }";
            return Some(("the range has no end, so it leaves nothing out".to_string(), help));
        }
        (min > max).then(|| {
            (format!("no value is in a range from {min} to {max}"), "the smaller end comes first")
        })
    }
}

/// Which flights and maneuvers a stage uses, of all that it could. A stage has the three as fields
/// of its own settings and makes this of them where it asks.
#[derive(Debug, Clone, Copy)]
pub struct Chosen<'a> {
    /// Ids of the flights used, with `*` for any characters; empty for all.
    pub flights: &'a [String],
    /// Flights or maneuvers left out of them, with `*` for any characters.
    pub except: &'a [String],
    /// By condition, the range (SI) that its mean in the quiet time before a maneuver is in.
    pub conditions: &'a IndexMap<String, Range>,
}

/// What becomes of a maneuver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict<'a> {
    Used,
    /// `except` names it.
    Excepted,
    /// A condition before it is out of its range.
    Outside,
    /// This condition has no value before it, so nobody knows.
    Unknown(&'a str),
}

impl<'a> Chosen<'a> {
    /// Whether a flight is used.
    pub fn flight(&self, id: &str) -> bool {
        let wanted = self.flights.is_empty() || self.flights.iter().any(|p| matches(p, id));
        wanted && !self.except.iter().any(|p| matches(p, id))
    }

    /// What becomes of a maneuver of a flight that is used. Several names are those of maneuvers
    /// that overlap and are used as one; `condition` gives the mean of a column before it.
    pub fn maneuver(&self, names: &[&str], condition: impl Fn(&str) -> Option<f64>) -> Verdict<'a> {
        if names.iter().any(|name| self.except.iter().any(|p| matches(p, name))) {
            return Verdict::Excepted;
        }
        let mut verdict = Verdict::Used;
        for (name, range) in self.conditions {
            let (min, max) = range.ends();
            match condition(name).filter(|v| v.is_finite()) {
                Some(value) if min <= value && value <= max => (),
                Some(_) => return Verdict::Outside,
                None => verdict = Verdict::Unknown(name),
            }
        }
        verdict
    }

    /// Files the mistakes in what is said at `key`. Without `maneuvers`, whole records are used,
    /// which have no conditions. Without flights (their logs have mistakes of their own) nothing is
    /// said about names of flights.
    pub fn check(
        &self,
        (given, key): (&mut Given, &str),
        flights: &[String],
        columns: &Columns,
        maneuvers: bool,
    ) {
        if !flights.is_empty() {
            let before = given.errors.0.len();
            self.check_names((given, key), flights);
            if given.errors.0.len() == before && !flights.iter().any(|id| self.flight(id)) {
                let what = "no flight is left: `except` takes away all of them";
                given.push(&format!("{key}.except"), what, "");
            }
        }
        for (name, range) in self.conditions {
            let at = format!("{key}.where.{name}");
            given.look_up(columns, name, "signal or column", &at);
            if let Some((what, help)) = range.fault() {
                given.push(&at, what, help);
            }
        }
        if !maneuvers && !self.conditions.is_empty() {
            let what = "there is no quiet time before a whole record, so it has no conditions";
            given.push(&format!("{key}.where"), what, "give `input`, so that maneuvers are used");
        }
    }

    fn check_names(&self, (given, key): (&mut Given, &str), flights: &[String]) {
        for (i, name) in self.flights.iter().enumerate() {
            if !flights.iter().any(|id| matches(name, id)) {
                nothing((given, &format!("{key}.flights.{i}")), flights, "flight", name);
            }
        }
        for (i, name) in self.except.iter().enumerate() {
            if !flights.iter().any(|id| matches(name, id) || may_be_of(name, id)) {
                let at = format!("{key}.except.{i}");
                nothing((given, &at), flights, "flight or maneuver", name);
            }
        }
    }
}

/// There is nothing of this name, or that this pattern matches.
fn nothing((given, key): (&mut Given, &str), flights: &[String], kind: &str, name: &str) {
    let flight = name.rsplit_once('.').map_or(name, |(flight, _)| flight);
    let near = nearest(flight, flights.iter().map(String::as_str))
        .filter(|_| !name.contains('*'))
        .map_or(String::new(), |near| format!("did you mean \"{near}\"? "));
    let what = if name.contains('*') {
        format!("no {kind} matches \"{name}\"")
    } else {
        format!("there is no {kind} \"{name}\"")
    };
    given.push(key, what, &format!("{near}the flights are {}", list(flights)));
}

/// Whether a name is this pattern, in which `*` stands for any characters, or none.
pub fn matches(pattern: &str, name: &str) -> bool {
    let Some((first, rest)) = pattern.split_once('*') else { return pattern == name };
    let (middle, last) = rest.rsplit_once('*').unwrap_or(("", rest));
    let inner = name.strip_prefix(first).and_then(|name| name.strip_suffix(last));
    let Some(mut inner) = inner else { return false };
    middle.split('*').all(|part| {
        let found = inner.split_once(part);
        inner = found.map_or("", |(_, behind)| behind);
        found.is_some()
    })
}

/// Whether a pattern may be meant for maneuvers of a flight, which are called `flight.01` or
/// `flight-001`: up to its first star it agrees with such a name.
fn may_be_of(pattern: &str, flight: &str) -> bool {
    match pattern.split_once('*') {
        Some((begin, _)) if flight.starts_with(begin) => true,
        split => {
            let begin = split.map_or(pattern, |(begin, _)| begin);
            begin.strip_prefix(flight).is_some_and(|rest| {
                let mut rest = rest.chars();
                matches!(rest.next(), Some('.' | '-')) && rest.all(|c| c.is_ascii_digit())
            })
        }
    }
}

/// What notes on a choice are about.
pub struct About<'a> {
    pub stage: &'a str,
    /// Entry of the stage.
    pub entry: &'a str,
    /// The flight; empty for all of them.
    pub flight: &'a str,
}

impl About<'_> {
    fn note(&self, severity: Severity, subject: &str, count: usize, text: String) -> Note {
        Note {
            flight: self.flight.to_string(),
            stage: self.stage.to_string(),
            severity,
            subject: subject.to_string(),
            count: count as u64,
            text: format!("{}: {text}", self.entry),
        }
    }
}

/// What a stage used and left out, counted flight by flight.
#[derive(Debug)]
pub struct Tally<'a> {
    chosen: Chosen<'a>,
    flights: usize,
    left: Vec<&'a str>,
    /// Flights that are used and have nothing to choose from, because they failed.
    empty: Vec<&'a str>,
    maneuvers: usize,
    excepted: usize,
    outside: usize,
    /// Maneuvers without a value of a condition, and that condition.
    unknown: Vec<(String, &'a str)>,
    /// Which entries of `except` matched something.
    met: Vec<bool>,
}

impl<'a> Tally<'a> {
    pub fn new(chosen: Chosen<'a>) -> Tally<'a> {
        let met = vec![false; chosen.except.len()];
        Tally {
            chosen,
            flights: 0,
            left: Vec::new(),
            empty: Vec::new(),
            maneuvers: 0,
            excepted: 0,
            outside: 0,
            unknown: Vec::new(),
            met,
        }
    }

    /// Whether a flight is used.
    pub fn flight(&mut self, id: &'a str) -> bool {
        let used = self.chosen.flight(id);
        self.flights += 1;
        self.meet(id);
        if !used {
            self.left.push(id);
        }
        used
    }

    /// A flight that is used has no tables.
    pub fn empty(&mut self, id: &'a str) {
        self.empty.push(id);
    }

    /// A maneuver that the stage does not use for another reason; that `except` names it as well is
    /// no mistake.
    pub fn meet(&mut self, name: &str) {
        for (pattern, met) in self.chosen.except.iter().zip(&mut self.met) {
            *met |= matches(pattern, name);
        }
    }

    /// Whether a maneuver of a flight that is used counts: as [`Chosen::maneuver`].
    pub fn maneuver(&mut self, names: &[&str], condition: impl Fn(&str) -> Option<f64>) -> bool {
        names.iter().for_each(|name| self.meet(name));
        self.maneuvers += 1;
        let verdict = self.chosen.maneuver(names, condition);
        match verdict {
            Verdict::Used => (),
            Verdict::Excepted => self.excepted += 1,
            Verdict::Outside => self.outside += 1,
            Verdict::Unknown(condition) => {
                let name = names.first().map(ToString::to_string).unwrap_or_default();
                self.unknown.push((name, condition));
            }
        }
        verdict == Verdict::Used
    }

    /// What to say about it, as notes of a stage on one of its entries.
    pub fn notes(&self, stage: &str, entry: &str) -> Vec<Note> {
        let on = About { stage, entry, flight: "" };
        [self.of_flights(&on), self.of_maneuvers(&on), self.of_names(&on)].concat()
    }

    /// The flights that are left out.
    pub fn of_flights(&self, on: &About) -> Vec<Note> {
        let (left, all) = (self.left.len(), self.flights);
        let text = format!("{left} of {all} flights left out by choice: {}", list(&self.left));
        let note = on.note(Severity::Info, on.entry, left, text);
        (left > 0).then_some(note).into_iter().collect()
    }

    /// The maneuvers that are left out.
    pub fn of_maneuvers(&self, on: &About) -> Vec<Note> {
        let mut notes = Vec::new();
        let left = self.excepted + self.outside;
        if left > 0 {
            let text = format!(
                "{left} of {} segments left out by choice: {} by `except`, {} by `where`",
                self.maneuvers, self.excepted, self.outside
            );
            notes.push(on.note(Severity::Info, on.entry, left, text));
        }
        for (name, condition) in &self.unknown {
            let text = format!(
                "{name} is not used: {condition}, which `where` asks for, has no value before it"
            );
            notes.push(on.note(Severity::Missing, name, 1, text));
        }
        notes
    }

    /// Names that are those of no maneuver.
    pub fn of_names(&self, on: &About) -> Vec<Note> {
        let mut notes = Vec::new();
        for (pattern, _) in self.chosen.except.iter().zip(&self.met).filter(|(_, met)| !**met) {
            let unseen = self.left.iter().chain(&self.empty);
            if !unseen.into_iter().any(|id| may_be_of(pattern, id)) {
                let text = format!("`except` names {pattern}, and there is no such maneuver");
                notes.push(on.note(Severity::Missing, pattern, 1, text));
            }
        }
        notes
    }
}

#[cfg(test)]
#[path = "chosen_tests.rs"]
mod tests;
