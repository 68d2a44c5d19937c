//! The tables of the checks in; the list of flights, each with what its own checks say and the link to
//! its page, out.

use super::checks::{LIST, SECTION as CHECKS, answers, word};
use super::columns::Columns;
use super::format::brief;
use super::grid::Level;
use super::logs;
use super::owner::Owners;
use super::place::{self, Form, On, Turn};
use super::section::{Body, Given, ReportInput, Section, flight_styles};
use crate::error::Result;
use serde::Serialize;
use std::collections::BTreeMap;

pub const SECTION: Section = Section {
    id: LIST,
    heading: "Flights",
    on: On::Index,
    // Those of the checks: the list says what the pages of the flights say.
    tables: CHECKS.tables,
    build,
};

/// A flight of the list.
#[derive(Debug, Serialize)]
struct Row {
    flight: String,
    /// None where its page could not be made.
    link: Option<String>,
    level: Level,
    word: &'static str,
    maneuvers: usize,
    text: String,
}

#[derive(Serialize)]
struct Shown {
    rows: Vec<Row>,
}

/// A table by its name, and its rows by flight.
type Named<'a> = (&'a str, &'a Columns, BTreeMap<String, Vec<usize>>);

fn build(given: &Given) -> Result<Option<Body>> {
    let Form::Index(flights) = &given.input.form else { return Ok(None) };
    let owners = Owners::of(flights, given.get("segments"));
    // What does not say which flight it is about answers for none.
    let tell = |table: &Columns| Owners::can_tell(|name| table.has(name));
    let tables: Vec<Named> = SECTION
        .tables
        .iter()
        .filter_map(|name| Some((*name, given.get(name).filter(|t| tell(t))?)))
        .map(|(name, table)| (name, table, owners.rows(table)))
        .collect();
    let row = |flight: &String| {
        let of =
            |(name, table, rows): &Named| Some((name.to_string(), table.take(rows.get(flight)?)));
        one(given, flight, flights, tables.iter().filter_map(of).collect())
    };
    let rows = flights.iter().map(row).collect();
    Ok(Some(Body::new(include_str!("html/list.html"), Shown { rows })))
}

/// A flight by its own tables.
fn one(given: &Given, flight: &str, flights: &[String], tables: BTreeMap<String, Columns>) -> Row {
    let input = ReportInput {
        form: Form::Flight(Turn::of(flight, flights)),
        unasked: given.input.unasked.clone(),
        ..ReportInput::default()
    };
    let styles = flight_styles(&tables);
    let own = Given { input: &input, flights: &styles, tables: &tables, ..*given };
    let answers = answers(&own);
    let worst = [Level::Bad, Level::Warn]
        .into_iter()
        .find(|level| answers.iter().any(|answer| answer.level == *level));
    let said = answers.iter().filter(|answer| Some(answer.level) == worst);
    let (lost, page) = missing(tables.get("notes"));
    let text: Vec<String> =
        lost.into_iter().chain(said.map(|answer| answer.text.clone())).collect();
    let link = page.then(|| place::link(&given.input.form, &place::of_flight(flight)));
    let level = worst.unwrap_or(Level::Good);
    Row {
        flight: flight.to_string(),
        link,
        level,
        word: word(level),
        maneuvers: tables.get("segments").map_or(0, Columns::rows),
        text: brief(&text.join(" ")),
    }
}

/// Why something of a flight is missing, the first reason alone; and whether its page is there.
fn missing(notes: Option<&Columns>) -> (Option<String>, bool) {
    let Some(notes) = notes else { return (None, true) };
    let lost = || (0..notes.rows()).filter(|&row| logs::severity(notes, row) == Some(Level::Bad));
    let why = |row: usize| format!("{}: {}.", notes.text("stage", row), notes.text("text", row));
    (lost().next().map(why), lost().all(|row| notes.text("stage", row) != place::STAGE))
}
