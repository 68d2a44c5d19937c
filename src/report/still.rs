//! `channels` in, what the checks say of those that stand still although they are those of a live
//! sensor, out.

use super::columns::Columns;
use super::flights::is_record;
use super::format::{count, few, plain};
use super::grid::Level;

/// A maneuver or record that was estimated.
struct Estimated {
    flight: String,
    from: f64,
    to: f64,
}

/// A maneuver of which this share or more was flown while a sensor stood still stands on it: as much as
/// of a channel that is rejected makes a problem.
const STANDS_ON_IT: f64 = 0.1;

/// The sentence of the checks. What the sensors' own comparison (`consistency`) calls frozen is said
/// there.
pub fn summary(
    channels: Option<&Columns>,
    consistency: Option<&Columns>,
    segments: Option<&Columns>,
    responses: Option<&Columns>,
) -> Option<(Level, String)> {
    let channels = channels?;
    let estimated = estimated(segments, responses);
    let (mut bad, mut odd, mut idle) = (Vec::new(), Vec::new(), Vec::new());
    let mut dropped = Vec::new();
    for row in (0..channels.rows()).filter(|&row| channels.number("still_to_s", row).is_finite()) {
        let (flight, signal) = (channels.text("flight", row), channels.text("signal", row));
        let (from, to) = (channels.number("still_from_s", row), channels.number("still_to_s", row));
        if is_said(consistency, &flight, &signal) {
            continue;
        }
        let mine = || estimated.iter().filter(|e| e.flight == flight);
        let share = |e: &Estimated| (to.min(e.to) - from.max(e.from)) / (e.to - e.from);
        let stands = mine().filter(|e| share(e) >= STANDS_ON_IT).count();
        let touched = mine().filter(|e| share(e) > 0.0).count();
        let when =
            format!("{flight} {signal} (from {} s for {} s", plain(from, 1), plain(to - from, 1));
        match (stands, touched) {
            _ if channels.number("dropped_still", row) > 0.0 => dropped.push(format!("{when})")),
            (0, 0) => idle.push(format!("{when})")),
            (0, n) => odd.push(format!("{when}, less than a tenth of {})", count(n, "maneuver"))),
            (n, _) => bad.push(format!("{when}, a tenth or more of {})", count(n, "maneuver"))),
        }
    }
    let told = |names: &[String], words: &str| {
        (!names.is_empty()).then(|| format!("{words}: {}.", few(names)))
    };
    let sentences = [
        told(&bad, "Sensors that stand still in what is estimated"),
        told(&odd, "Sensors that stand still for a small part of what is estimated"),
        told(&dropped, "Sensors that stood still, and are left out there"),
        told(&idle, "Sensors that stand still where nothing is estimated"),
    ];
    let all =
        [(&bad, Level::Bad), (&odd, Level::Warn), (&dropped, Level::Warn), (&idle, Level::Info)];
    let level = all.into_iter().find(|(names, _)| !names.is_empty())?.1;
    Some((level, sentences.into_iter().flatten().collect::<Vec<_>>().join(" ")))
}

fn is_said(consistency: Option<&Columns>, flight: &str, signal: &str) -> bool {
    let says = |t: &Columns, row: usize| {
        t.text("flight", row) == flight
            && t.text("channel", row) == signal
            && t.text("verdict", row) == "frozen"
    };
    consistency.is_some_and(|t| (0..t.rows()).any(|row| says(t, row)))
}

/// Everything that has a response: maneuvers with their own times, records from their first sample
/// to their last.
fn estimated(segments: Option<&Columns>, responses: Option<&Columns>) -> Vec<Estimated> {
    let Some(responses) = responses else { return Vec::new() };
    let found = segments.map(|s| s.rows_by(["segment"])).unwrap_or_default();
    let one = |([segment], rows): ([String; 1], Vec<usize>)| match (
        segments,
        found.get(std::slice::from_ref(&segment)),
    ) {
        (Some(s), Some(own)) => {
            let row = *own.first()?;
            let [from, to] = ["t_start_s", "t_end_s"].map(|name| s.number(name, row));
            Some(Estimated { flight: s.text("flight", row), from, to })
        }
        _ => {
            let times = || rows.iter().map(|&row| responses.number("t_s", row));
            let flight = segment
                .rsplit_once('-')
                .map(|(flight, _)| flight)
                .filter(|flight| is_record(&segment, flight));
            let flight = flight.unwrap_or(&segment).to_string();
            Some(Estimated {
                flight,
                from: times().fold(f64::INFINITY, f64::min),
                to: times().fold(f64::NEG_INFINITY, f64::max),
            })
        }
    };
    responses.rows_by(["segment"]).into_iter().filter_map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    fn columns(table: crate::error::Result<Table>) -> Columns {
        Columns::of(&table.expect("a table"))
    }

    fn said(from: f64, to: f64, verdict: &str) -> Option<(Level, String)> {
        let channels = Table::build("channels")
            .repeat("flight", "f")
            .strings("signal", ["servo", "V"])
            .repeat("topic", "/t");
        let channels = channels
            .repeat("field", "x")
            .repeat("unit", "A")
            .i64("count", [9, 9])
            .f64("rate_hz", [10.0; 2]);
        let channels = [
            "dropped_duplicate",
            "reordered",
            "dropped_out_of_order",
            "dropped_nan",
            "dropped_unreadable",
            "dropped_out_of_range",
            "dropped_spikes",
            "dropped_still",
            "dropped_times",
        ]
        .into_iter()
        .fold(channels, |table, name| table.i64(name, [0, 0]));
        let channels = channels
            .f64("longest_gap_s", [0.1; 2])
            .f64("t_first_s", [0.0; 2])
            .f64("t_last_s", [99.0; 2]);
        let channels =
            channels.f64("still_from_s", [from, f64::NAN]).f64("still_to_s", [to, f64::NAN]);
        let channels = columns(channels.f64("min", [0.0; 2]).f64("max", [1.0; 2]).finish());
        let responses = Table::build("responses")
            .repeat("model", "m")
            .repeat("group", "g")
            .strings("segment", ["f", "f", "g-001"]);
        let responses =
            responses.repeat("unit", "rad").repeat("output", "y").f64("t_s", [20.0, 30.0, 5.0]);
        let responses = responses
            .f64("measured", [0.0; 3])
            .f64("modelled", [0.0; 3])
            .f64("residual", [0.0; 3])
            .f64("simulated", [f64::NAN; 3])
            .finish();
        let consistency = Table::build("consistency")
            .repeat("flight", "f")
            .strings("channel", ["servo"])
            .repeat("check", "health");
        let consistency = consistency
            .f64("value", [1.0])
            .repeat("unit", "s")
            .f64("low", [0.0])
            .f64("high", [0.0]);
        let consistency =
            columns(consistency.repeat("verdict", verdict).repeat("text", "").finish());
        summary(Some(&channels), Some(&consistency), None, Some(&columns(responses)))
    }

    #[test]
    fn a_sensor_that_stands_still_is_a_problem_where_something_is_estimated_in_it() {
        let level = |from, to| said(from, to, "good").map(|(level, _)| level);
        assert_eq!(level(10.0, 40.0), Some(Level::Bad));
        assert_eq!(level(25.0, 40.0), Some(Level::Bad), "half of it");
        assert_eq!(level(29.5, 40.0), Some(Level::Warn), "a twentieth of it");
        assert_eq!(level(40.0, 90.0), Some(Level::Info));
        assert_eq!(level(f64::NAN, f64::NAN), None);
        assert_eq!(said(10.0, 40.0, "frozen"), None, "said where the sensors are compared");
        let (_, text) = said(10.0, 40.0, "good").expect("a sentence");
        assert!(
            text.contains("f servo (from 10.0 s for 30.0 s, a tenth or more of 1 maneuver)"),
            "{text}"
        );
    }
}
