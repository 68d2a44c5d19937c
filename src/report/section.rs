//! A section of the page as a value: what it is called, which tables it is made from, and how it is
//! built from them.

use super::columns::Columns;
use super::grid::Grid;
use super::{FlightStyle, ReportInput, fault, json};
use crate::error::Result;
use serde::Serialize;
use std::collections::BTreeMap;

/// One section: an entry of [`super::SECTIONS`], from which the page's order, its navigation and
/// the tables that are read follow.
#[derive(Debug)]
pub struct Section {
    /// Name of the section, and target of links to it.
    pub id: &'static str,
    pub heading: &'static str,
    /// Tables that it reads. The first one is what it is about: where no stage of a campaign writes
    /// that, the section has no place.
    pub tables: &'static [&'static str],
    /// None where there is nothing that anybody would look for; what was to be there and is not, it
    /// says.
    pub build: fn(&Given) -> Result<Option<Body>>,
}

/// What a section is built from.
pub struct Given<'a> {
    pub input: &'a ReportInput,
    /// All flights of all tables, in alphabetical order.
    pub flights: &'a [FlightStyle],
    pub(super) tables: &'a BTreeMap<String, Columns>,
    /// Tables that may be looked at.
    pub(super) named: &'static [&'static str],
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
