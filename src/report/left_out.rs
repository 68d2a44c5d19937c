//! `left_out` in, every signal of a flight with the samples that were taken for wrong out.

use super::columns::Columns;
use super::format::{count, display_unit, few, number, plain};
use super::packed::Packed;
use super::place::On;
use super::section::{Body, Given, Section};
use crate::error::Result;
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "left-out",
    heading: "Samples that were left out",
    on: On::Flights,
    tables: &["left_out"],
    build,
};

/// Signals that are drawn.
const SIGNALS: usize = 12;
/// Kept samples that are drawn of one signal, at most about.
const LIMIT: usize = 600;

/// One signal (JSON).
#[derive(Debug, Serialize)]
struct Plot {
    signal: String,
    unit: String,
    /// What was kept: a null stands between two places.
    t: Packed,
    kept: Packed,
    out: Vec<Out>,
}

/// What was left out for one reason.
#[derive(Debug, Serialize)]
struct Out {
    why: String,
    t: Packed,
    value: Packed,
}

#[derive(Debug, Serialize)]
struct Caption {
    title: String,
    text: String,
}

#[derive(Debug, Serialize)]
struct Shown {
    signals: Vec<Caption>,
    more: Option<String>,
}

fn build(given: &Given) -> Result<Option<Body>> {
    let Some(table) = given.get("left_out").filter(|table| table.rows() > 0) else {
        return Ok(None);
    };
    let groups = table.groups(["flight", "signal"]);
    let (mut signals, mut plots) = (Vec::new(), Vec::new());
    for ([flight, signal], rows) in groups.iter().take(SIGNALS) {
        let (factor, unit) = display_unit(&table.unit_in("unit", rows[0]));
        let title =
            if given.flights.len() > 1 { format!("{flight} {signal}") } else { signal.clone() };
        signals.push(Caption { title, text: said(table, rows, (factor, &unit)) });
        plots.push(plot(table, (signal, rows), (factor, unit)));
    }
    let others: Vec<String> = groups
        .iter()
        .skip(SIGNALS)
        .map(|([flight, signal], _)| format!("{flight} {signal}"))
        .collect();
    let more = (!others.is_empty())
        .then(|| format!("Not drawn: {}; the table left_out has all.", few(&others)));
    Body::new(include_str!("html/left_out.html"), Shown { signals, more })
        .plot("leftOut", &plots)
        .map(Some)
}

const REASONS: [&str; 2] = ["spike", "out of range"];

/// How many there are for each reason, and the first of them.
fn said(table: &Columns, rows: &[usize], (factor, unit): (f64, &str)) -> String {
    let of = |why: &&str| -> Option<String> {
        let mut out = rows.iter().copied().filter(|&row| table.text("fate", row) == *why);
        let first = out.next()?;
        let n = 1 + out.count();
        Some(format!(
            "{} ({}{} {unit} at {} s)",
            count(n, if *why == "spike" { "spike" } else { "sample out of range" })
                .replace("sample out of ranges", "samples out of range"),
            if n > 1 { "the first: " } else { "" },
            number(factor * table.number("value", first), 4),
            plain(table.number("t_s", first), 2)
        ))
    };
    format!("{}.", REASONS.iter().filter_map(of).collect::<Vec<_>>().join(", "))
}

fn plot(table: &Columns, (signal, rows): (&str, &[usize]), (factor, unit): (f64, String)) -> Plot {
    let number = |name: &str, row: usize| table.number(name, row);
    let is_kept = |row: &usize| table.text("fate", *row) == "kept";
    let kept: Vec<usize> = rows.iter().copied().filter(is_kept).collect();
    let every = kept.len().div_ceil(LIMIT).max(1);
    let (mut t, mut y) = (Vec::new(), Vec::new());
    for place in kept.chunk_by(|a, b| number("place", *a) == number("place", *b)) {
        t.extend(place.iter().step_by(every).map(|&row| number("t_s", row)));
        y.extend(place.iter().step_by(every).map(|&row| number("value", row)));
        t.push(f64::NAN);
        y.push(f64::NAN);
    }
    let out = |why: &&str| {
        let all = rows.iter().copied().filter(|&row| table.text("fate", row) == *why);
        let all: Vec<usize> = all.take(LIMIT).collect();
        let of = |name, factor| Packed::of(all.iter().map(|&row| number(name, row)), factor);
        let out = Out { why: why.to_string(), t: of("t_s", 1.0), value: of("value", factor) };
        (!all.is_empty()).then_some(out)
    };
    Plot {
        signal: signal.to_string(),
        unit,
        t: Packed::of(t, 1.0),
        kept: Packed::of(y, factor),
        out: REASONS.iter().filter_map(out).collect(),
    }
}
