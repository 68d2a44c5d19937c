//! A campaign file and its truth model's names in, every mistake with its place out.

mod flight;
mod topic;

use super::input::Shape;
use super::settings::{Maneuver, Settings};
use crate::config::{Doc, list, nearest};
use crate::error::{Error, Errors};
use crate::units::Unit;
use indexmap::IndexMap;
use std::collections::BTreeSet;

/// The names and units that a campaign file may refer to.
#[derive(Debug, Clone, Default)]
pub struct Interface {
    /// Inputs of the truth model, with units.
    pub inputs: IndexMap<String, String>,
    /// Outputs of the truth model, with units.
    pub outputs: IndexMap<String, String>,
}

impl Interface {
    fn unit(&self, name: &str) -> Option<&str> {
        self.outputs.get(name).or_else(|| self.inputs.get(name)).map(String::as_str)
    }
}

/// Longest flight that is not taken for a mistake in a number.
const LONGEST_S: f64 = 24.0 * 3600.0;

/// Checks everything that the schema of the file cannot say; without a truth model (it has mistakes
/// of its own), all but its names.
pub fn check(settings: &Settings, doc: &Doc, truth: Option<&Interface>) -> Errors {
    let mut checker = Checker { settings, doc, truth, errors: Errors::default() };
    checker.timing("timing", &settings.timing);
    checker.drive();
    let shapes = checker.maneuvers();
    if settings.flights.is_empty() {
        checker.push("flights", "the campaign has no flight", "add one: [flights.flight-01]");
    }
    for (id, flight) in &settings.flights {
        checker.flight(id, flight, &shapes);
    }
    if settings.topics.is_empty() {
        checker.push("topics", "the recorder has no topic", "add one: [topics.\"/air_data\"]");
    }
    for (name, topic) in &settings.topics {
        checker.topic(name, topic);
    }
    checker.errors
}

struct Checker<'a> {
    settings: &'a Settings,
    doc: &'a Doc,
    truth: Option<&'a Interface>,
    errors: Errors,
}

impl Checker<'_> {
    fn push(&mut self, path: &str, what: impl Into<String>, help: impl Into<String>) {
        let help = help.into();
        let error = Error::at(self.doc.place(path), what);
        self.errors.push(if help.is_empty() { error } else { error.help(help) });
    }

    /// An unknown name, with the nearest known one.
    fn unknown<'n>(
        &mut self,
        path: &str,
        name: &str,
        what: &str,
        known: impl Iterator<Item = &'n String>,
    ) {
        let known: Vec<&str> = known.map(String::as_str).collect();
        let all = if known.is_empty() {
            "there are none".to_string()
        } else {
            format!("there are: {}", list(&known))
        };
        let help = match nearest(name, known.iter().copied()) {
            Some(near) => format!("did you mean \"{near}\"? {all}"),
            None => all,
        };
        // A name that is a key stands left of its value.
        let place = if path.ends_with(&format!(".{name}")) {
            self.doc.key_place(path)
        } else {
            self.doc.place(path)
        };
        self.errors.push(Error::at(place, format!("there is no {what} \"{name}\"")).help(help));
    }

    /// Reports an input that the truth model has not, or whose unit is of another kind than
    /// `wanted`.
    fn input(&mut self, path: &str, name: &str, wanted: Option<&str>) {
        let Some(truth) = self.truth else { return };
        let Some(unit) = truth.inputs.get(name) else {
            return self.unknown(path, name, "truth-model input", truth.inputs.keys());
        };
        if let Some(wanted) = wanted.filter(|w| !same_kind(w, unit)) {
            self.push(path, format!("the input \"{name}\" has unit \"{unit}\"; what it is given here has \"{wanted}\""), "");
        }
    }

    fn drive(&mut self) {
        let drive = &self.settings.drive;
        let roles = [
            ("speed", drive.speed.as_ref(), Some("m/s")),
            ("altitude", drive.altitude.as_ref(), Some("m")),
            ("hold", drive.hold.as_ref(), Some("-")),
            ("turbulence", drive.turbulence.as_ref(), Some("m/s")),
        ];
        let roles = roles
            .into_iter()
            .filter_map(|(key, name, unit)| Some((format!("drive.{key}"), name?, unit)));
        let noise = drive
            .noise
            .iter()
            .enumerate()
            .map(|(i, name)| (format!("drive.noise.{i}"), name, None));
        let constant =
            drive.constant.keys().map(|name| (format!("drive.constant.{name}"), name, None));
        let mut driven = BTreeSet::new();
        for (path, name, unit) in roles.chain(noise).chain(constant) {
            self.input(&path, name, unit);
            if !driven.insert(name.clone()) {
                self.push(
                    &path,
                    format!("the input \"{name}\" is already driven by another key of [drive]"),
                    "name every input once",
                );
            }
        }
        for (name, maneuver) in &self.settings.maneuvers {
            if driven.contains(&maneuver.input) {
                let what = format!(
                    "the input \"{}\" is driven by [drive] and by this maneuver",
                    maneuver.input
                );
                self.push(
                    &format!("maneuvers.{name}.input"),
                    what,
                    "take it out of [drive]: it is 0 between maneuvers by itself",
                );
            }
        }
        driven.extend(self.settings.maneuvers.values().map(|m| m.input.clone()));
        let left: Vec<&String> = self
            .truth
            .iter()
            .flat_map(|t| t.inputs.keys())
            .filter(|name| !driven.contains(*name))
            .collect();
        if !left.is_empty() {
            self.push(
                "drive",
                format!("nothing drives these inputs of the truth model: {}", list(&left)),
                "give each a value in [drive.constant], or a role",
            );
        }
    }

    fn maneuvers(&mut self) -> IndexMap<String, Shape> {
        let mut shapes = IndexMap::new();
        for (name, maneuver) in &self.settings.maneuvers {
            self.input(&format!("maneuvers.{name}.input"), &maneuver.input, None);
            self.companions(name, maneuver);
            match Shape::of(maneuver) {
                Ok(shape) => {
                    shapes.insert(name.clone(), shape);
                }
                Err(mistakes) => mistakes.into_iter().for_each(|(key, what)| {
                    self.push(&format!("maneuvers.{name}.{key}"), what, "")
                }),
            }
        }
        shapes
    }

    /// The maneuvers flown together with `name`: they exist and bring no others.
    fn companions(&mut self, name: &str, maneuver: &Maneuver) {
        let settings = self.settings;
        for (i, companion) in maneuver.with.iter().enumerate() {
            let path = format!("maneuvers.{name}.with.{i}");
            match settings.maneuvers.get(&companion.maneuver) {
                None => self.unknown(
                    &format!("{path}.maneuver"),
                    &companion.maneuver,
                    "maneuver",
                    settings.maneuvers.keys(),
                ),
                Some(other) if !other.with.is_empty() => {
                    let what =
                        format!("the maneuver \"{}\" brings others itself", companion.maneuver);
                    self.push(
                        &format!("{path}.maneuver"),
                        what,
                        "name all that are flown together here",
                    );
                }
                Some(_) => {}
            }
        }
    }
}

/// Whether two unit strings have the same dimension. Units that cannot be read are reported
/// elsewhere.
fn same_kind(a: &str, b: &str) -> bool {
    match (Unit::parse(a), Unit::parse(b)) {
        (Ok(a), Ok(b)) => a.dim == b.dim,
        _ => true,
    }
}

#[cfg(test)]
mod tests;
