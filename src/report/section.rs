//! A section of the page as a value: what it is called, which tables it is made from, and how it is
//! built from them.

use super::columns::Columns;
use super::grid::Grid;
use super::place::{Form, On};
use super::room::Room;
use crate::error::{Error, Result};
use crate::table::Table;
use serde::Serialize;
use std::collections::BTreeMap;

/// What a page is made from.
#[derive(Debug, Default)]
pub struct ReportInput {
    /// Which page is made: all in one where nothing is said.
    pub form: Form,
    /// Title of the campaign.
    pub title: String,
    /// One line under the title: what was run (pipeline, stages, models).
    pub subtitle: String,
    /// Tables by name, as listed by `tables`, all flights of a table in one. Others are ignored;
    /// absent ones are said to be absent.
    pub tables: BTreeMap<String, Table>,
    /// Columns of `samples` that drive each model, drawn below its outputs; without an entry the
    /// segment's own input is drawn.
    pub inputs: BTreeMap<String, Vec<String>>,
    /// Column of `samples` in which each input of `segments` was searched; without an entry it has
    /// the input's own name.
    pub searched: BTreeMap<String, String>,
    /// Sections that stages bring along; they stand behind the page's own.
    pub more: Vec<&'static Section>,
    /// Tables that no stage of this campaign writes: sections about them have no place on the page.
    pub unasked: Vec<&'static str>,
    /// Name and value of everything that says where the numbers come from: program version, code
    /// hash, configuration hashes.
    pub provenance: Vec<(String, String)>,
}

impl ReportInput {
    /// Whether this campaign asks for what a section is about.
    pub(super) fn asks_for(&self, section: &Section) -> bool {
        section.tables.first().is_none_or(|table| !self.unasked.contains(table))
    }

    /// Whether a section has its place on this page.
    pub(super) fn has(&self, section: &Section) -> bool {
        self.form.shows(section.on) && self.asks_for(section)
    }
}

/// One flight in the legend.
#[derive(Debug, Clone, Serialize)]
pub struct FlightStyle {
    id: String,
    colour: &'static str,
    symbol: &'static str,
    path: &'static str,
}

/// Colours that stay apart for colour-blind readers (Okabe and Ito), each with a shape of its own,
/// so that print works too.
const STYLES: [(&str, &str, &str); 6] = [
    ("#0072b2", "circle", "M0-5A5 5 0 1 1 0 5A5 5 0 1 1 0-5Z"),
    ("#d55e00", "square", "M-4.5-4.5H4.5V4.5H-4.5Z"),
    ("#009e73", "triangle-up", "M0-5.5L5.5 4.5H-5.5Z"),
    ("#cc79a7", "diamond", "M0-6L6 0L0 6L-6 0Z"),
    ("#b8860b", "triangle-down", "M0 5.5L5.5-4.5H-5.5Z"),
    ("#4ba3d9", "cross", "M-2-5.5H2V-2H5.5V2H2V5.5H-2V2H-5.5V-2H-2Z"),
];

/// One section: an entry of `SECTIONS`, from which the page's order, its navigation and
/// the tables that are read follow.
#[derive(Debug)]
pub struct Section {
    /// Name of the section, and target of links to it.
    pub id: &'static str,
    pub heading: &'static str,
    /// The pages that it is on, where the report has more than one.
    pub on: On,
    /// Tables that it reads. The first one is what it is about: where no stage of a campaign writes
    /// that, the section has no place.
    pub tables: &'static [&'static str],
    /// None where there is nothing that anybody would look for; what was to be there and is not, it
    /// says.
    pub build: fn(&Given) -> Result<Option<Body>>,
}

/// What a section is built from.
#[derive(Clone, Copy)]
pub struct Given<'a> {
    pub input: &'a ReportInput,
    /// All flights of all tables, in alphabetical order.
    pub flights: &'a [FlightStyle],
    pub(super) tables: &'a BTreeMap<String, Columns>,
    /// Tables that may be looked at.
    pub(super) named: &'static [&'static str],
    /// The page's own sections.
    pub(super) sections: &'static [Section],
}

impl<'a> Given<'a> {
    /// A table that the section names; none where the campaign has none.
    pub fn get(&self, table: &str) -> Option<&'a Columns> {
        debug_assert!(
            self.named.contains(&table),
            "a section reads the table {table}, which it does not name"
        );
        self.tables.get(table).filter(|_| self.named.contains(&table))
    }

    /// What the page has room for.
    pub(super) fn room(&self) -> Room {
        self.input.form.room()
    }

    /// Ids of the flights.
    pub fn ids(&self) -> Vec<String> {
        self.flights.iter().map(|f| f.id.clone()).collect()
    }
}

/// What a section shows below its heading: a template (minijinja, escaped) with what fills it, and
/// the numbers of its plots.
pub struct Body {
    template: &'static str,
    values: minijinja::Value,
    /// Name in the page's data, and JSON.
    pub(super) plots: Vec<(&'static str, String)>,
}

#[derive(Serialize)]
struct Alone {
    grid: Grid,
}

impl Body {
    /// A template that is filled with `values`. `{% from "grid.html" import grid %}` draws a
    /// [`Grid`].
    pub fn new(template: &'static str, values: impl Serialize) -> Body {
        Body {
            template,
            values: minijinja::Value::from(minijinja::value::Serde(values)),
            plots: Vec::new(),
        }
    }

    /// One table and nothing else.
    pub fn grid(grid: Grid) -> Body {
        Body::new("{% from 'grid.html' import grid as drawn %}{{ drawn(grid) }}", Alone { grid })
    }

    /// The same with numbers that `page.js` finds under `name`.
    ///
    /// # Errors
    /// They cannot be written as JSON.
    pub fn plot(mut self, name: &'static str, numbers: &impl Serialize) -> Result<Body> {
        self.plots.push((name, json(numbers)?));
        Ok(self)
    }

    /// The section's HTML.
    pub(super) fn html(&self, environment: &minijinja::Environment) -> Result<String> {
        // The ending decides the escaping: everything in a .html template is escaped unless it is
        // marked safe.
        environment
            .render_named_str("section.html", self.template, self.values.clone())
            .map_err(fault)
    }
}

/// All flights any table knows, in alphabetical order, with colour and shape.
pub(super) fn flight_styles(tables: &BTreeMap<String, Columns>) -> Vec<FlightStyle> {
    let mut ids: Vec<String> = tables
        .values()
        .flat_map(|t| t.rows_by(["flight"]).into_keys().flatten())
        .filter(|id| !id.is_empty())
        .collect();
    ids.sort();
    ids.dedup();
    let style = |(i, id): (usize, String)| {
        let (colour, symbol, path) = STYLES[i % STYLES.len()];
        FlightStyle { id, colour, symbol, path }
    };
    ids.into_iter().enumerate().map(style).collect()
}

pub(super) fn fault(e: minijinja::Error) -> Error {
    Error::new(format!("the report page could not be written: {e:#}"))
}

pub(super) fn json(value: &impl Serialize) -> Result<String> {
    serde_json::to_string(value)
        .map_err(|e| Error::new(format!("the report's numbers could not be written: {e}")))
}
