//! `flightpath`, `samples` and `segments` in, the overview of every flight with its maneuvers and the table of maneuvers out.

use super::columns::Columns;
use super::format::{count, display_unit, every, number, plain, shorts, thin};
use super::grid::{Cell, Grid, Level, Row};
use super::maneuvers::times;
use serde::Serialize;
use std::collections::BTreeMap;

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
    pub t: Vec<Option<f64>>,
    pub value: Vec<Option<f64>>,
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
const OVERVIEW: [&[&str]; 3] = [&["V", "tas", "V_t", "airspeed"], &["h", "altitude"], &["alpha", "alpha_vane", "alpha_v"]];
/// Samples drawn per trace, at most about.
const LIMIT: usize = 2400;

/// Flights in alphabetical order, each with the traces there are and its segments.
pub fn overview(
    flightpath: Option<&Columns>,
    samples: Option<&Columns>,
    segments: Option<&Columns>,
    searched: &BTreeMap<String, String>,
    ids: &[String],
) -> (Overview, Vec<Flight>) {
    let tables: Vec<&Columns> = [flightpath, samples].into_iter().flatten().filter(|t| t.rows() > 0).collect();
    if tables.is_empty() {
        let missing = Some("No flight traces: neither the flight path nor the samples table has a row.".into());
        return (Overview { missing, ..Overview::default() }, Vec::new());
    }
    let rows: Vec<BTreeMap<[String; 1], Vec<usize>>> = tables.iter().map(|t| t.rows_by(["flight"])).collect();
    let mut thinned = false;
    let mut flight = |id: &String| {
        let mut traces = Vec::new();
        let segments = segments.map_or(Vec::new(), |s| marks(s, id));
        let mut inputs: Vec<String> = segments.iter().map(|(_, input)| searched.get(input).unwrap_or(input).clone()).collect();
        inputs.sort();
        inputs.dedup();
        let wanted = OVERVIEW.iter().map(|names| names.to_vec()).chain(inputs.iter().map(|name| vec![name.as_str()]));
        for names in wanted {
            let found = tables.iter().zip(&rows).find_map(|(table, rows)| {
                let rows = rows.get(std::slice::from_ref(id))?;
                names.iter().find_map(|name| trace(table, rows, name))
            });
            if let Some((trace, was_thinned)) = found {
                thinned |= was_thinned;
                traces.push(trace);
            }
        }
        Flight { flight: id.clone(), traces, segments: segments.into_iter().map(|(mark, _)| mark).collect() }
    };
    let flights: Vec<Flight> = ids.iter().map(&mut flight).collect();
    let thinned = if thinned { " Traces are thinned for display, extremes kept." } else { "" };
    let shown = format!("Shaded: maneuvers that are used (blue) and left out (grey), numbered as in the table below.{thinned}");
    (Overview { missing: None, shown }, flights)
}

fn trace(table: &Columns, rows: &[usize], name: &str) -> Option<(Trace, bool)> {
    let (time, column) = (table.column("t_s"), table.column(name));
    let pick = |values: &[f64]| -> Vec<f64> { rows.iter().map(|&i| values.get(i).copied().unwrap_or(f64::NAN)).collect() };
    let (t, value) = (pick(time), pick(column));
    if !value.iter().any(|v| v.is_finite()) {
        return None;
    }
    let keep = thin(t.len(), &[&value], LIMIT);
    let thinned = keep.len() < t.len();
    let (factor, unit) = display_unit(table.unit(name));
    let kept = |v: &[f64]| -> Vec<f64> { keep.iter().filter_map(|&i| v.get(i).copied()).collect() };
    Some((Trace { name: name.into(), unit, t: times(&kept(&t)), value: shorts(kept(&value), factor) }, thinned))
}

/// Segments of a flight with the input channel each was found in.
fn marks(segments: &Columns, flight: &str) -> Vec<(Mark, String)> {
    let mark = |row: usize| {
        let (segment, kind, input) = (segments.text("segment", row), segments.text("kind", row), segments.text("input", row));
        let [start, end] = ["t_start_s", "t_end_s"].map(|name| segments.number(name, row));
        let label = format!("{segment}: {kind} of {input}");
        // Ids repeat the flight: what is left of them stands above the plot.
        let mark = segment.strip_prefix(flight).unwrap_or(&segment).trim_start_matches(['-', '_', '/', ' ', '.']).to_string();
        (Mark { mark, label, start, end, included: included(segments, row) }, input)
    };
    let own = |row: &usize| segments.text("flight", *row) == flight;
    (0..segments.rows()).filter(own).map(mark).filter(|(m, _)| m.start.is_finite() && m.end.is_finite()).collect()
}

/// Whether a segment is used; one that does not say so is.
pub fn included(segments: &Columns, row: usize) -> bool {
    segments.flag("included", row).unwrap_or(true)
}

/// The table of maneuvers found.
pub fn segments(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("No table of segments: the segment stage has not run.") };
    let columns =
        ["flight", "segment", "kind", "input", "#start|s", "#end|s", "#unit time|s", "#amplitude", "#score", "used", "~reason"];
    let mut grid = Grid::new(columns);
    for row in 0..table.rows() {
        let used = included(table, row);
        let mut cells: Vec<Cell> =
            ["flight", "segment", "kind", "input"].iter().map(|name| Cell::new(table.text(name, row))).collect();
        cells.extend([
            plain(table.number("t_start_s", row), 2).into(),
            plain(table.number("t_end_s", row), 2).into(),
            number(table.number("unit_time_s", row), 3).into(),
            number(table.number("amplitude", row), 3).into(),
            number(table.number("score", row), 3).into(),
            Cell::new(if used { "yes" } else { "no" }),
            table.text("reason", row).into(),
        ]);
        grid.rows.push(Row { level: (!used).then_some(Level::Dim), pick: None, cells });
    }
    grid.or_missing("No maneuver was found.")
}

/// The sentence of the checks about flights without a maneuver that is used.
pub fn summary(segments: Option<&Columns>, flights: &[String]) -> Option<(Level, String)> {
    let segments = segments?;
    let used = |flight: &&String| (0..segments.rows()).any(|r| segments.text("flight", r) == **flight && included(segments, r));
    let without: Vec<&str> = flights.iter().filter(|f| !used(f)).map(String::as_str).collect();
    Some(if without.is_empty() {
        (Level::Good, format!("{} has a maneuver that is used.", every(flights.len(), "flight")))
    } else {
        (Level::Bad, format!("{} without a maneuver that is used: {}.", count(without.len(), "flight"), without.join(", ")))
    })
}
