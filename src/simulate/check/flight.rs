//! A flight of the campaign file in; what is wrong with its test points, names and times out.

use super::{Checker, LONGEST_S};
use crate::simulate::input::Shape;
use crate::simulate::settings::{Flight, Timing};
use crate::simulate::timeline::{Placed, Timeline};
use indexmap::IndexMap;

impl Checker<'_> {
    pub(super) fn timing(&mut self, path: &str, timing: &Timing) {
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

    pub(super) fn flight(&mut self, id: &str, flight: &Flight, shapes: &IndexMap<String, Shape>) {
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
        self.test_points(&path, flight);
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
        self.length(&path, flight, &timeline);
    }

    /// Test points are given in one way, with their altitudes; or the flight has none.
    fn test_points(&mut self, path: &str, flight: &Flight) {
        let given = (!flight.speeds_kt.is_empty(), !flight.points.is_empty());
        match given {
            (false, false) => self.no_test_point(path, flight),
            (true, true) => self.push(
                &format!("{path}.points"),
                "the flight has both `speeds_kt` and `points`",
                "keep one of them",
            ),
            _ => {}
        }
        if !given.0 && !flight.at_each.is_empty() {
            self.push(
                &format!("{path}.at_each"),
                "`at_each` belongs to `speeds_kt`, which is missing",
                "",
            );
        }
        if flight.altitude_ft.is_some() {
            return;
        }
        if given.0 {
            self.push(
                path,
                "the test points of `speeds_kt` have no altitude",
                "give `altitude_ft`",
            );
        }
        for (i, _) in flight.points.iter().enumerate().filter(|p| p.1.altitude_ft.is_none()) {
            self.push(
                &format!("{path}.points.{i}"),
                "the test point has no altitude",
                "give it `altitude_ft`, or give the flight one for all",
            );
        }
    }

    /// A flight without test points has events or a length, and an altitude where an input of the
    /// truth model asks for one.
    fn no_test_point(&mut self, path: &str, flight: &Flight) {
        if flight.events.is_empty() && flight.duration_s.is_none() {
            self.push(
                path,
                "the flight has no test point",
                "give `speeds_kt` with `at_each`, or `points`; a test on the ground has `events` or `duration_s` instead",
            );
        }
        let settings = self.settings;
        if let (Some(input), None) = (&settings.drive.altitude, flight.altitude_ft) {
            self.push(
                path,
                format!("the flight has no altitude for the input \"{input}\" of [drive]"),
                "give `altitude_ft`",
            );
        }
    }

    /// A given length is that of a flight without test points, and all its maneuvers fit in.
    fn length(&mut self, path: &str, flight: &Flight, timeline: &Timeline) {
        let Some(duration) = flight.duration_s else { return };
        let path = format!("{path}.duration_s");
        if !(duration > 0.0 && duration <= LONGEST_S) {
            let what = format!("`duration_s` must be more than 0 and at most {LONGEST_S} s");
            self.push(&path, format!("{what}, not {duration}"), "");
        } else if !(flight.speeds_kt.is_empty() && flight.points.is_empty()) {
            self.push(
                &path,
                "`duration_s` is for a flight without test points",
                "leave it out: such a flight ends `end_s` of its timing after its last maneuver",
            );
        } else if let Some(m) = timeline.maneuvers.iter().find(|m| m.hold_s[1] > duration + 1e-6) {
            let what = format!(
                "the flight ends at {duration} s, before \"{}\" is over at {:.1} s (with `hold_after_s`)",
                m.maneuver, m.hold_s[1]
            );
            self.push(&path, what, "make the flight longer, or move the event");
        }
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
}
