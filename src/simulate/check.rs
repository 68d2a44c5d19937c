//! A campaign file and its truth model's names in, every mistake with its place out.

use super::input::Shape;
use super::settings::{Flight, Maneuver, Settings, Timing, Topic};
use super::timeline::{Placed, Timeline};
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

    fn timing(&mut self, path: &str, timing: &Timing) {
        let times = [
            ("settle_s", timing.settle_s),
            ("hold_before_s", timing.hold_before_s),
            ("hold_after_s", timing.hold_after_s),
            ("recover_s", timing.recover_s),
            ("end_s", timing.end_s),
        ];
        for (key, value) in times.into_iter().filter(|t| !(0.0..=LONGEST_S).contains(&t.1)) {
            self.push(
                &format!("{path}.{key}"),
                format!("`{key}` must be 0 to {LONGEST_S} s, not {value}"),
                "",
            );
        }
    }

    fn flight(&mut self, id: &str, flight: &Flight, shapes: &IndexMap<String, Shape>) {
        let path = format!("flights.{id}");
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if id.is_empty() || id.starts_with('.') || !id.chars().all(plain) {
            self.push(
                &path,
                format!("\"{id}\" cannot name a file"),
                "use letters, digits, - and _",
            );
        }
        if let Some(timing) = &flight.timing {
            self.timing(&format!("{path}.timing"), timing);
        }
        match (flight.speeds_kt.is_empty(), flight.points.is_empty()) {
            (true, true) => self.push(
                &path,
                "the flight has no test point",
                "give `speeds_kt` with `at_each`, or `points`",
            ),
            (false, false) => self.push(
                &format!("{path}.points"),
                "the flight has both `speeds_kt` and `points`",
                "keep one of them",
            ),
            _ => {}
        }
        if flight.speeds_kt.is_empty() && !flight.at_each.is_empty() {
            self.push(
                &format!("{path}.at_each"),
                "`at_each` belongs to `speeds_kt`, which is missing",
                "",
            );
        }
        self.references(&path, flight);
        let timeline = Timeline::new(self.settings, shapes, id, flight);
        if timeline.duration() > LONGEST_S {
            self.push(
                &path,
                format!("the flight would last {:.0} h", timeline.duration() / 3600.0),
                "look at its speeds, altitudes, rates and times",
            );
        }
        self.overlaps(&path, &timeline);
    }

    /// Names that the flight refers to.
    fn references(&mut self, path: &str, flight: &Flight) {
        let each = flight
            .at_each
            .iter()
            .enumerate()
            .map(|(i, name)| (format!("{path}.at_each.{i}"), name));
        let points = flight.points.iter().enumerate();
        let points = points.flat_map(|(i, p)| {
            p.maneuvers
                .iter()
                .enumerate()
                .map(move |(k, name)| (format!("{path}.points.{i}.maneuvers.{k}"), name))
        });
        let events = flight
            .events
            .iter()
            .enumerate()
            .map(|(i, e)| (format!("{path}.events.{i}.maneuver"), &e.maneuver));
        let settings = self.settings;
        for (place, name) in each.chain(points).chain(events) {
            if !settings.maneuvers.contains_key(name) {
                self.unknown(&place, name, "maneuver", settings.maneuvers.keys());
            }
        }
        for name in
            flight.constant.keys().filter(|name| !settings.drive.constant.contains_key(*name))
        {
            self.unknown(
                &format!("{path}.constant.{name}"),
                name,
                "input in [drive.constant]",
                settings.drive.constant.keys(),
            );
        }
        if flight.turbulence != 0.0
            && settings.drive.noise.is_empty()
            && settings.drive.turbulence.is_none()
        {
            self.push(
                &format!("{path}.turbulence"),
                "no input of the truth model receives turbulence",
                "name `noise` and `turbulence` in [drive]",
            );
        }
    }

    /// Maneuvers whose holds meet, or that begin before the flight.
    fn overlaps(&mut self, path: &str, timeline: &Timeline) {
        for (i, m) in timeline.maneuvers.iter().enumerate() {
            if m.hold_s[0] < 0.0 {
                self.push(
                    path,
                    format!(
                        "the maneuver \"{}\" at {:.1} s begins before the flight",
                        m.maneuver, m.t_start_s
                    ),
                    "fly it later",
                );
            }
            // Test points follow each other without a gap where `recover_s` is 0: only a real
            // overlap counts.
            let overlaps =
                |next: &&Placed| next.hold_s != m.hold_s && next.hold_s[0] < m.hold_s[1] - 1e-6;
            if let Some(next) = timeline.maneuvers.get(i + 1).filter(overlaps) {
                let what = format!(
                    "the maneuver \"{}\" at {:.1} s begins before \"{}\" is over at {:.1} s (with `hold_before_s` and `hold_after_s`)",
                    next.maneuver, next.t_start_s, m.maneuver, m.hold_s[1]
                );
                self.push(path, what, "move the event, or shorten the holds");
            }
        }
    }

    fn topic(&mut self, name: &str, topic: &Topic) {
        let path = format!("topics.{name}");
        if topic.fields.is_empty() {
            self.push(&path, format!("the topic \"{name}\" has no field"), "");
        }
        if let Some(field) = topic.time_field.as_ref().filter(|f| topic.fields.contains_key(*f)) {
            self.push(
                &format!("{path}.time_field"),
                format!("\"{field}\" is also a sensor's field"),
                "give the time another name",
            );
        }
        for (i, gap) in topic.gaps.iter().enumerate() {
            let settings = self.settings;
            if !settings.flights.contains_key(&gap.flight) {
                self.unknown(
                    &format!("{path}.gaps.{i}.flight"),
                    &gap.flight,
                    "flight",
                    settings.flights.keys(),
                );
            }
            if gap.to_s <= gap.from_s {
                self.push(
                    &format!("{path}.gaps.{i}.to_s"),
                    format!("the gap ends at {} s, before it begins", gap.to_s),
                    "",
                );
            }
        }
        for (field, sensor) in &topic.fields {
            let path = format!("{path}.fields.{field}");
            if sensor.sign.abs() != 1.0 {
                self.push(
                    &format!("{path}.sign"),
                    format!("the sign must be 1 or -1, not {}", sensor.sign),
                    "",
                );
            }
            let Some(truth) = self.truth else { continue };
            let Some(unit) = truth.unit(&sensor.truth) else {
                self.unknown(
                    &format!("{path}.truth"),
                    &sensor.truth,
                    "truth-model output or input",
                    truth.outputs.keys().chain(truth.inputs.keys()),
                );
                continue;
            };
            match Unit::parse(&sensor.unit) {
                Err(what) => self.push(&format!("{path}.unit"), what, ""),
                Ok(_) if same_kind(unit, &sensor.unit) => {}
                Ok(_) => {
                    let what = format!(
                        "\"{}\" has unit \"{unit}\" in the truth model, which cannot be recorded in \"{}\"",
                        sensor.truth, sensor.unit
                    );
                    self.push(&format!("{path}.unit"), what, "");
                }
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
mod tests {
    use super::*;

    const GOOD: &str = r#"
title = "t"
seed = 1
truth = "truth.model.toml"
start_unix_s = 1245052800

[drive]
speed = "V_cmd"
hold = "hold"
noise = ["n_w"]
turbulence = "sigma_w"
constant = { wind = 0.0 }

[maneuvers.lateral]
input = "aileron"
kind = "3211"
unit_time_s = 1.0
amplitude = 2.5

[flights.flight-01]
altitude_ft = 17000
speeds_kt = [160, 150]
at_each = ["lateral"]
constant = { wind = 3.0 }

[topics."/air"]
rate_hz = 50

[topics."/air".fields]
tas = { truth = "V", unit = "kt", noise = 0.1 }
cmd = { truth = "aileron", unit = "V" }
"#;

    fn interface() -> Interface {
        let map = |list: &[(&str, &str)]| {
            list.iter().map(|(n, u)| (n.to_string(), u.to_string())).collect()
        };
        Interface {
            inputs: map(&[
                ("V_cmd", "m/s"),
                ("hold", "-"),
                ("n_w", "-"),
                ("sigma_w", "m/s"),
                ("wind", "m/s"),
                ("aileron", "V"),
            ]),
            outputs: map(&[("V", "m/s"), ("alpha", "rad")]),
        }
    }

    fn mistakes(text: &str) -> Vec<String> {
        let (settings, doc) = crate::config::parse::<Settings>("campaign.toml", text).unwrap();
        check(&settings, &doc, Some(&interface())).0.iter().map(|e| e.to_string()).collect()
    }

    #[test]
    fn a_good_file_has_no_mistakes() {
        assert_eq!(mistakes(GOOD), Vec::<String>::new());
    }

    #[test]
    fn all_mistakes_are_found_at_once_with_their_places() {
        let text = GOOD
            .replace("speed = \"V_cmd\"", "speed = \"V_cdm\"")
            .replace("kind = \"3211\"", "kind = \"32-1\"")
            .replace("at_each = [\"lateral\"]", "at_each = [\"latteral\"]")
            .replace("constant = { wind = 3.0 }", "constant = { wnd = 3.0 }")
            .replace("unit = \"kt\"", "unit = \"deg\"")
            .replace("truth = \"aileron\"", "truth = \"ailerons\"");
        let found = mistakes(&text);
        let expected = [
            "campaign.toml:8:9: there is no truth-model input \"V_cdm\"\n    did you mean \"V_cmd\"?",
            "campaign.toml:7:1: nothing drives these inputs of the truth model: V_cmd",
            "campaign.toml:16:8: \"32-1\" is no kind of maneuver",
            "campaign.toml:23:12: there is no maneuver \"latteral\"\n    did you mean \"lateral\"?",
            "campaign.toml:24:14: there is no input in [drive.constant] \"wnd\"\n    did you mean \"wind\"?",
            "campaign.toml:30:29: \"V\" has unit \"m/s\" in the truth model, which cannot be recorded in \"deg\"",
            "campaign.toml:31:17: there is no truth-model output or input \"ailerons\"\n    did you mean \"aileron\"?",
        ];
        assert_eq!(found.len(), expected.len(), "{found:#?}");
        for (found, expected) in found.iter().zip(expected) {
            assert!(found.starts_with(expected), "{found}\n{expected}");
        }
    }

    #[test]
    fn maneuvers_that_overlap_or_begin_too_early_are_refused() {
        let with = |events: &str| {
            mistakes(&GOOD.replace(
                "at_each = [\"lateral\"]",
                &format!("at_each = [\"lateral\"]\nevents = [{events}]"),
            ))
        };
        assert_eq!(with("{ at_s = 20, maneuver = \"lateral\" }"), Vec::<String>::new());
        let early = with("{ at_s = 1, maneuver = \"lateral\" }");
        assert!(early.len() == 1 && early[0].contains("begins before the flight"), "{early:?}");
        let overlap = with("{ at_s = 35, maneuver = \"lateral\" }");
        assert!(
            overlap.len() == 1 && overlap[0].contains("begins before \"lateral\" is over"),
            "{overlap:?}"
        );
    }

    #[test]
    fn maneuvers_flown_together_are_known_and_bring_no_others() {
        let with = |own: &str| {
            let text = GOOD.replace("at_each = [\"lateral\"]", "at_each = [\"pair\"]");
            let second = "[maneuvers.lateral_late]\ninput = \"aileron\"\nkind = \"step\"\nunit_time_s = 1.0\namplitude = 1.0\n";
            let pair = format!(
                "[maneuvers.pair]\ninput = \"aileron\"\nkind = \"step\"\nunit_time_s = 9.0\namplitude = 1.0\nwith = [{own}]\n"
            );
            mistakes(
                &text.replace("[flights.flight-01]", &format!("{second}{pair}[flights.flight-01]")),
            )
        };
        assert_eq!(
            with("{ maneuver = \"lateral\" }, { maneuver = \"lateral_late\", after_s = 8.0 }"),
            Vec::<String>::new()
        );
        let unknown = with("{ maneuver = \"latteral\" }");
        assert!(
            unknown.len() == 1 && unknown[0].contains("did you mean \"lateral\""),
            "{unknown:?}"
        );
        let itself = with("{ maneuver = \"pair\" }");
        assert!(itself.len() == 1 && itself[0].contains("brings others itself"), "{itself:?}");
    }

    #[test]
    fn an_input_is_driven_once_and_in_its_own_unit() {
        let twice = mistakes(&GOOD.replace("hold = \"hold\"", "hold = \"V_cmd\""));
        assert!(twice.iter().any(|e| e.contains("what it is given here has \"-\"")), "{twice:?}");
        assert!(
            twice.iter().any(|e| e.contains("already driven"))
                && twice.iter().any(|e| e.contains("nothing drives")),
            "{twice:?}"
        );
        let both = mistakes(
            &GOOD.replace("constant = { wind = 0.0 }", "constant = { wind = 0.0, aileron = 0.0 }"),
        );
        assert!(
            both.len() == 1 && both[0].contains("driven by [drive] and by this maneuver"),
            "{both:?}"
        );
    }
}
