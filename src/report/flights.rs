//! `flightpath`, `samples` and `segments` in, the overview of every flight with its maneuvers and
//! the table of maneuvers out.

use super::columns::Columns;
use super::format::{count, display_unit, every, number, plain, thin};
use super::grid::{Cell, Grid, Level, Row};
use super::packed::Packed;
use super::place::On;
use super::room::Room;
use super::section::{Body, Given, Section};
use crate::error::Result;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

pub const SECTION: Section = Section {
    id: "flights",
    heading: "Flights and the maneuvers found",
    on: On::Flights,
    tables: &["samples", "flightpath", "segments", "channels", "responses"],
    build,
};

#[derive(Serialize)]
struct Shown {
    overview: Overview,
    segments: Grid,
}

fn build(given: &Given) -> Result<Option<Body>> {
    let (flightpath, samples, segments) =
        (given.get("flightpath"), given.get("samples"), given.get("segments"));
    let searched = &given.input.searched;
    let (overview, flights) =
        overview(flightpath, samples, segments, searched, &given.ids(), given.room());
    let unit = |input: &str| {
        unit_of(searched.get(input).map_or(input, String::as_str), samples, given.get("channels"))
    };
    let section = Shown {
        overview,
        segments: table(
            segments,
            given.get("responses"),
            given.input.unasked.contains(&"segments"),
            unit,
        ),
    };
    Body::new(include_str!("html/flights.html"), section).plot("overview", &flights).map(Some)
}

/// SI unit of a column of the samples, or of a signal of the logs; "" where neither says.
fn unit_of(name: &str, samples: Option<&Columns>, channels: Option<&Columns>) -> String {
    let column = samples.map(|s| s.unit(name)).filter(|unit| !unit.is_empty());
    let signal = || {
        channels.and_then(|t| {
            (0..t.rows()).find(|&r| t.text("signal", r) == name).map(|r| t.unit_in("unit", r))
        })
    };
    column.map(String::from).or_else(signal).unwrap_or_default()
}

/// Whether a segment is the record of a flight, or one of its equal pieces (`flight-003`).
pub fn is_record(segment: &str, flight: &str) -> bool {
    let piece = segment.strip_prefix(flight).and_then(|rest| rest.strip_prefix('-'));
    segment == flight || piece.is_some_and(is_piece)
}

fn is_piece(number: &str) -> bool {
    number.len() >= 3 && number.chars().all(|c| c.is_ascii_digit())
}

/// What was estimated: maneuvers that were found, and records (or pieces of them) that were taken
/// as they are.
#[derive(Debug, Default, PartialEq)]
pub struct Used {
    pub maneuvers: usize,
    pub records: usize,
}

pub fn used(responses: Option<&Columns>, segments: Option<&Columns>) -> Used {
    let Some(responses) = responses else { return Used::default() };
    let found = segments.map(|s| s.rows_by(["segment"])).unwrap_or_default();
    let all = responses.rows_by(["segment"]);
    let maneuvers = all.keys().filter(|segment| found.contains_key(*segment)).count();
    Used { maneuvers, records: all.len() - maneuvers }
}

/// What one flight's plot is drawn from (JSON).
#[derive(Debug, Serialize)]
pub struct Flight {
    pub flight: String,
    pub traces: Vec<Trace>,
    pub segments: Vec<Mark>,
}

#[derive(Debug, Serialize)]
pub struct Trace {
    pub name: String,
    pub unit: String,
    pub t: Packed,
    pub value: Packed,
}

#[derive(Debug, Serialize)]
pub struct Mark {
    pub mark: String,
    pub label: String,
    pub start: f64,
    pub end: f64,
    pub included: bool,
}

/// The text around the plot (template).
#[derive(Debug, Default, Serialize)]
pub struct Overview {
    pub missing: Option<String>,
    pub shown: String,
}

/// Signals of the overview: the first name of a row that is in `flightpath` or `samples` is drawn.
const OVERVIEW: [&[&str]; 3] =
    [&["V", "tas", "V_t", "airspeed"], &["h", "altitude"], &["alpha", "alpha_vane", "alpha_v"]];
/// The columns that the overview looks for.
pub fn overview_columns() -> impl Iterator<Item = &'static str> {
    OVERVIEW.into_iter().flatten().copied()
}

/// Samples drawn per trace, at most about.
const LIMIT: usize = 2400;

/// Flights in alphabetical order, each with the traces there are and its segments.
pub fn overview(
    flightpath: Option<&Columns>,
    samples: Option<&Columns>,
    segments: Option<&Columns>,
    searched: &BTreeMap<String, String>,
    ids: &[String],
    room: Room,
) -> (Overview, Vec<Flight>) {
    let tables: Vec<&Columns> =
        [flightpath, samples].into_iter().flatten().filter(|t| t.rows() > 0).collect();
    if tables.is_empty() {
        let missing = Some(
            "No flight traces: neither the flight path nor the samples table has a row.".into(),
        );
        return (Overview { missing, ..Overview::default() }, Vec::new());
    }
    let rows: Vec<BTreeMap<[String; 1], Vec<usize>>> =
        tables.iter().map(|t| t.rows_by(["flight"])).collect();
    let mut thinned = false;
    let mut flight = |id: &String| {
        let mut traces = Vec::new();
        let segments = segments.map_or(Vec::new(), |s| marks(s, id));
        let mut inputs: Vec<String> = segments
            .iter()
            .map(|(_, input)| searched.get(input).unwrap_or(input).clone())
            .collect();
        inputs.sort();
        inputs.dedup();
        let wanted = OVERVIEW
            .iter()
            .map(|names| names.to_vec())
            .chain(inputs.iter().map(|name| vec![name.as_str()]));
        let limit = room.samples(LIMIT, 1, 2 * (OVERVIEW.len() + inputs.len()));
        for names in wanted {
            let found = tables.iter().zip(&rows).find_map(|(table, rows)| {
                let rows = rows.get(std::slice::from_ref(id))?;
                names.iter().find_map(|name| trace(table, rows, name, limit))
            });
            if let Some((trace, was_thinned)) = found {
                thinned |= was_thinned;
                traces.push(trace);
            }
        }
        Flight {
            flight: id.clone(),
            traces,
            segments: segments.into_iter().map(|(mark, _)| mark).collect(),
        }
    };
    let flights: Vec<Flight> = ids.iter().map(&mut flight).collect();
    let thinned = if thinned { " Traces are thinned for display, extremes kept." } else { "" };
    let shaded = match segments {
        Some(_) => {
            "Shaded: maneuvers that may be used (blue) and those left out (grey), numbered as in the \
             table below."
        }
        None => "",
    };
    let shown = format!("{shaded}{thinned}").trim_start().to_string();
    (Overview { missing: None, shown }, flights)
}

fn trace(table: &Columns, rows: &[usize], name: &str, limit: usize) -> Option<(Trace, bool)> {
    let (time, column) = (table.column("t_s"), table.column(name));
    let pick = |values: &[f64]| -> Vec<f64> {
        rows.iter().map(|&i| values.get(i).copied().unwrap_or(f64::NAN)).collect()
    };
    let (t, value) = (pick(time), pick(column));
    if !value.iter().any(|v| v.is_finite()) {
        return None;
    }
    let keep = thin(t.len(), &[&value], limit);
    let thinned = keep.len() < t.len();
    let (factor, unit) = display_unit(table.unit(name));
    let kept = |v: &[f64]| -> Vec<f64> { keep.iter().filter_map(|&i| v.get(i).copied()).collect() };
    Some((
        Trace {
            name: name.into(),
            unit,
            t: Packed::of(kept(&t), 1.0),
            value: Packed::of(kept(&value), factor),
        },
        thinned,
    ))
}

/// Segments of a flight with the input channel each was found in.
fn marks(segments: &Columns, flight: &str) -> Vec<(Mark, String)> {
    let mark = |row: usize| {
        let (segment, kind, input) = (
            segments.text("segment", row),
            segments.text("kind", row),
            segments.text("input", row),
        );
        let [start, end] = ["t_start_s", "t_end_s"].map(|name| segments.number(name, row));
        let label = format!("{segment}: {kind} of {input}");
        // Ids repeat the flight: what is left of them stands above the plot.
        let mark = segment
            .strip_prefix(flight)
            .unwrap_or(&segment)
            .trim_start_matches(['-', '_', '/', ' ', '.'])
            .to_string();
        (Mark { mark, label, start, end, included: included(segments, row) }, input)
    };
    let own = |row: &usize| segments.text("flight", *row) == flight;
    (0..segments.rows())
        .filter(own)
        .map(mark)
        .filter(|(m, _)| m.start.is_finite() && m.end.is_finite())
        .collect()
}

/// Whether a segment is used; one that does not say so is.
pub fn included(segments: &Columns, row: usize) -> bool {
    segments.flag("included", row).unwrap_or(true)
}

/// The table of maneuvers found; `unit` is that of an input.
fn table(
    table: Option<&Columns>,
    responses: Option<&Columns>,
    unasked: bool,
    unit: impl Fn(&str) -> String,
) -> Grid {
    let Some(table) = table else {
        let why = "No maneuvers are searched for in this campaign: records are used as they are.";
        return Grid::missing(if unasked {
            why
        } else {
            "No table of segments: the segment stage has not run."
        });
    };
    let columns = [
        "flight",
        "segment",
        "kind",
        "input",
        "#start|s",
        "#end|s",
        "#unit time|s",
        "#amplitude",
        "#score",
        "estimated",
        "~reason",
    ];
    let mut grid = Grid::new(columns);
    let estimated = responses.map(|r| r.rows_by(["segment"])).unwrap_or_default();
    for row in 0..table.rows() {
        let used = included(table, row);
        let words = match (used, estimated.contains_key(&[table.text("segment", row)])) {
            (false, _) => "left out",
            (true, true) => "yes",
            (true, false) => "not asked for",
        };
        let mut cells: Vec<Cell> = ["flight", "segment", "kind", "input"]
            .iter()
            .map(|name| Cell::new(table.text(name, row)))
            .collect();
        cells.extend([
            plain(table.number("t_start_s", row), 2).into(),
            plain(table.number("t_end_s", row), 2).into(),
            number(table.number("unit_time_s", row), 3).into(),
            Cell::new(number(table.number("amplitude", row), 3))
                .under(unit(&table.text("input", row))),
            number(table.number("score", row), 3).into(),
            Cell::new(words),
            table.text("reason", row).into(),
        ]);
        grid.rows.push(Row { level: (!used).then_some(Level::Dim), pick: None, cells });
    }
    grid.or_missing("No maneuver was found.")
}

/// The sentence of the checks about flights without a maneuver that is used. A record that is
/// estimated as it is needs none.
pub fn summary(
    segments: Option<&Columns>,
    responses: Option<&Columns>,
    flights: &[String],
) -> Option<(Level, String)> {
    let records: BTreeSet<String> = responses
        .map(|r| r.rows_by(["segment"]).into_keys().flatten().collect())
        .unwrap_or_default();
    let pieces = records.iter().filter_map(|segment| segment.rsplit_once('-'));
    let of_pieces: BTreeSet<&str> =
        pieces.filter(|(_, piece)| is_piece(piece)).map(|(flight, _)| flight).collect();
    let whole = |flight: &str| records.contains(flight) || of_pieces.contains(flight);
    let used: BTreeSet<String> = segments.map_or(BTreeSet::new(), |s| {
        (0..s.rows()).filter(|&r| included(s, r)).map(|r| s.text("flight", r)).collect()
    });
    let searched = |flight: &str| used.contains(flight);
    if segments.is_none() && !flights.iter().any(|f| whole(f)) {
        return None;
    }
    let without: Vec<&str> =
        flights.iter().map(String::as_str).filter(|f| !searched(f) && !whole(f)).collect();
    let as_they_are = flights.iter().filter(|f| whole(f)).count();
    Some(if !without.is_empty() {
        (
            Level::Bad,
            format!(
                "{} without a maneuver that is used: {}.",
                count(without.len(), "flight"),
                without.join(", ")
            ),
        )
    } else if as_they_are == flights.len() {
        (
            Level::Good,
            format!("{} is estimated as it was recorded.", every(flights.len(), "flight")),
        )
    } else if as_they_are > 0 {
        let n = flights.len();
        (
            Level::Good,
            format!(
                "{} has a maneuver that is used, or is estimated as it was recorded ({as_they_are}).",
                every(n, "flight")
            ),
        )
    } else {
        (Level::Good, format!("{} has a maneuver that is used.", every(flights.len(), "flight")))
    })
}
