//! The tables of a run in, the report that a flight-test engineer reads out: an index and a page per
//! flight, or all on one page. It works offline, from a disk, and holds no clock.
//!
//! [`SECTIONS`] is the one list of what is shown: its order, its navigation and the tables that it is
//! made from follow. The templates in `html/` are filled with escaped text; `html/page.js` draws the
//! plots from numbers embedded as JSON; the plotting library is plotly.js (`html/plotly`). What is
//! not there is said on the page, it never fails it.
//!
//! # Many flights
//!
//! A page that holds the histories of all flights grows with their number, in memory and for whoever
//! opens it. So the report is a folder:
//!
//! | file | what it has |
//! |---|---|
//! | `report/index.html` | what is of the campaign, all that is a problem, the list of flights with a box that filters it |
//! | `report/flights/<flight>.html` | what is of one flight: its histories, maneuvers, fits, sensors, notes |
//! | `report/plots-<hash>.js` | the script, once for all pages |
//!
//! - A section says by [`Section::on`] on which of them it is; `Form` says which page is made. One that is
//!   on both is built from all rows for the index and from those of the flight for its page.
//! - The page of a flight is a unit of the stage `page`. It brings what is drawn of this flight alone and
//!   of the campaign's tables the flight's rows, so that memory does not grow with the number of flights. The
//!   index is the unit of the stage `report`: it brings no histories, only where they begin and end.
//! - Pages find each other and the script by relative paths, and the script is a plain one: both work from
//!   `file://`. Its name has the hash of its bytes, so that a page runs the one that it was made with.
//! - `Room` says what a page may hold. Tables on it are cut to what is remarkable, curves are thinned with their
//!   extremes kept; both are said where it is done. Histories are packed (`Packed`).
//! - A flight that is damaged has its page, which says why; where the page could not be made, the list says so.
//! - `report.single_file = true` makes the one page that holds everything, the script too: to be sent.

mod adequacy;
mod again;
mod checks;
mod columns;
mod consistency;
mod correlations;
mod diagnosis;
mod doubts;
mod equations;
mod estimates;
mod figures;
mod flights;
mod format;
mod frame;
mod gap;
mod grid;
mod left_out;
mod limits;
mod lines;
mod list;
mod logs;
mod maneuvers;
mod modes;
mod overlays;
mod owner;
mod packed;
mod paths;
mod place;
mod predictions;
mod provenance;
mod repeats;
mod room;
mod section;
mod signs;
mod still;
mod tolerances;
mod uncertainty;
mod used;
mod validation;
mod verdict;

use crate::error::Result;
use std::collections::BTreeMap;

pub use checks::Check;
pub use columns::Columns;
pub use flights::overview_columns;
pub use grid::{Cell, Grid, Level};
pub use owner::Owners;
pub use place::{Form, INDEX, On, STAGE, Turn, is_of_report, of_flight};
pub use section::{Body, Given, ReportInput, Section};

use section::flight_styles;

/// The sections in the order of the page. Adding one is adding a file that has it, and a line here.
pub const SECTIONS: &[Section] = &[
    checks::SECTION,
    verdict::SECTION,
    list::SECTION,
    lines::PLOTS,
    lines::TABLE,
    figures::SECTION,
    predictions::SECTION,
    validation::SECTION,
    maneuvers::SECTION,
    adequacy::SECTION,
    estimates::SECTION,
    equations::SECTION,
    modes::SECTION,
    correlations::SECTION,
    uncertainty::SECTION,
    limits::SECTION,
    diagnosis::SECTION,
    flights::SECTION,
    logs::CHANNELS,
    left_out::SECTION,
    consistency::SECTION,
    logs::BIASES,
    logs::NOTES,
    provenance::SECTION,
];

/// Tables with a row per sample: the index has none of them drawn.
pub const HISTORIES: [&str; 5] =
    ["samples", "flightpath", "pathmatch", "responses", "validation_traces"];

/// The tables that a page is made from, each once; `more` sections stand behind [`SECTIONS`].
pub fn tables(form: &Form, more: &[&'static Section]) -> Vec<&'static str> {
    let mut all: Vec<&str> = Vec::new();
    let sections = SECTIONS.iter().chain(more.iter().copied()).filter(|s| form.shows(s.on));
    let is_said = |section: &Section, table: &&&str| {
        let flight = matches!(form, Form::Flight(_)) && section.id == checks::SECTION.id;
        !flight || !checks::OF_THE_CAMPAIGN.contains(*table)
    };
    for table in sections.flat_map(|s| s.tables.iter().filter(move |table| is_said(s, table))) {
        if !all.contains(table) {
            all.push(table);
        }
    }
    all
}

/// The script that pages share: its file, relative to the output folder, and what is in it.
pub fn script() -> (&'static str, &'static str) {
    (&frame::SCRIPT.path, &frame::SCRIPT.text)
}

/// A page, and what it calls a problem.
#[derive(Debug)]
pub struct Report {
    /// HTML.
    pub page: String,
    /// The sentences that the page marks as problems.
    pub problems: Vec<String>,
    /// Those that it marks as worth a look and that no note of another stage says.
    pub looks: Vec<String>,
}

/// The page, and the problems that stand on it.
///
/// # Errors
/// As `page`.
pub fn report(input: &ReportInput) -> Result<Report> {
    let columns = Columns::of_all(checks::SECTION.tables, &input.tables);
    let problems = checks::problems(&checked(&columns));
    Ok(Report { page: page(input)?, problems, looks: checks::looks(&columns) })
}

/// The page as HTML. The same input gives the same bytes. An error is a fault of the program, not
/// of the tables.
pub fn page(input: &ReportInput) -> Result<String> {
    page_with(SECTIONS.iter().chain(input.more.iter().copied()), input)
}

/// A page with figures alone: those of the table `figures`.
///
/// # Errors
/// As `page`.
pub fn of_figures(input: &ReportInput) -> Result<String> {
    frame::page([&figures::SECTION], SECTIONS, input, false)
}

/// The answers to "can these results be trusted?", in the order of the processing.
fn checked(columns: &BTreeMap<String, Columns>) -> Vec<Check> {
    let flights = flight_styles(columns);
    let input = ReportInput::default();
    checks::answers(&Given {
        input: &input,
        flights: &flights,
        tables: columns,
        named: checks::SECTION.tables,
        sections: SECTIONS,
    })
}

fn page_with(
    sections: impl IntoIterator<Item = &'static Section>,
    input: &ReportInput,
) -> Result<String> {
    frame::page(sections, SECTIONS, input, true)
}

#[cfg(test)]
mod folder_tests;
#[cfg(test)]
mod tests;
