//! The tables of a run in, one self-contained HTML page for a flight-test engineer out; it works
//! offline and holds no clock.
//!
//! [`SECTIONS`] is the one list of what is on the page: its order, its navigation and the tables
//! that it is made from follow. The templates in `html/` are filled with escaped text;
//! `html/page.js` draws the plots from numbers embedded as JSON; the plotting script comes out of
//! the `plotly` crate. What is not there is said on the page, it never fails it.

mod again;
mod checks;
mod columns;
mod consistency;
mod correlations;
mod diagnosis;
mod estimates;
mod flights;
mod format;
mod gap;
mod grid;
mod lines;
mod logs;
mod maneuvers;
mod paths;
mod provenance;
mod section;
mod still;
mod uncertainty;
mod used;
mod verdict;

use crate::error::{Error, Result};
use crate::table::Table;
use serde::Serialize;
use std::collections::BTreeMap;

pub use checks::Check;
pub use columns::Columns;
pub use grid::{Cell, Grid, Level};
pub use section::{Body, Given, Section};

/// The sections in the order of the page. Adding one is adding a file that has it, and a line here.
pub const SECTIONS: &[Section] = &[
    checks::SECTION,
    verdict::SECTION,
    lines::PLOTS,
    lines::TABLE,
    maneuvers::SECTION,
    estimates::SECTION,
    correlations::SECTION,
    uncertainty::SECTION,
    diagnosis::SECTION,
    flights::SECTION,
    logs::CHANNELS,
    consistency::SECTION,
    logs::BIASES,
    logs::NOTES,
    provenance::SECTION,
];

/// The tables that the page is made from, each once; `more` sections stand behind [`SECTIONS`].
pub fn tables(more: &[&'static Section]) -> Vec<&'static str> {
    let mut all: Vec<&str> = Vec::new();
    for table in SECTIONS.iter().chain(more.iter().copied()).flat_map(|s| s.tables) {
        if !all.contains(table) {
            all.push(table);
        }
    }
    all
}

/// What a page is made from.
#[derive(Debug, Default)]
pub struct ReportInput {
    /// Title of the campaign.
    pub title: String,
    /// One line under the title: what was run (pipeline, stages, models).
    pub subtitle: String,
    /// Tables by name, as listed by [`tables`], all flights of a table in one. Others are ignored;
    /// absent ones are said to be absent.
    pub tables: BTreeMap<String, Table>,
    /// Columns of `samples` that drive each model, drawn below its outputs; without an entry the
    /// segment's own input is drawn.
    pub inputs: BTreeMap<String, Vec<String>>,
    /// Column of `samples` in which each input of `segments` was searched; without an entry it has
    /// the input's own name.
    pub searched: BTreeMap<String, String>,
    /// Sections that stages bring along; they stand behind [`SECTIONS`].
    pub more: Vec<&'static Section>,
    /// Tables that no stage of this campaign writes: sections about them have no place on the page.
    pub unasked: Vec<&'static str>,
    /// Name and value of everything that says where the numbers come from: program version, code
    /// hash, configuration hashes.
    pub provenance: Vec<(String, String)>,
}

impl ReportInput {
    /// Whether this campaign asks for what a section is about.
    fn asks_for(&self, section: &Section) -> bool {
        section.tables.first().is_none_or(|table| !self.unasked.contains(table))
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

/// What the frame is filled with.
#[derive(Serialize)]
struct Page<'a> {
    title: &'a str,
    subtitle: &'a str,
    tiles: Vec<checks::Tile>,
    /// What an interval is, and which units stand where.
    meaning: &'static str,
    sections: Vec<Built>,
    /// JSON: what the plots are drawn from, by name.
    data: String,
    style: &'static str,
    script: &'static str,
    plotly: String,
}

/// A section as it stands on the page.
#[derive(Serialize)]
struct Built {
    id: &'static str,
    heading: &'static str,
    body: String,
}

/// A page, and what it calls a problem.
#[derive(Debug)]
pub struct Report {
    /// HTML.
    pub page: String,
    /// The sentences that the page marks as problems.
    pub problems: Vec<String>,
}

/// The page, and the problems that stand on it.
///
/// # Errors
/// As `page`.
pub fn report(input: &ReportInput) -> Result<Report> {
    Ok(Report { page: page(input)?, problems: checks::problems(&checks(&input.tables)) })
}

/// The page as HTML. The same input gives the same bytes. An error is a fault of the program, not
/// of the tables.
pub fn page(input: &ReportInput) -> Result<String> {
    page_with(SECTIONS.iter().chain(input.more.iter().copied()), input)
}

/// The answers to "can these results be trusted?", in the order of the processing: tables by name
/// in, as the page shows them out.
pub fn checks(tables: &BTreeMap<String, Table>) -> Vec<Check> {
    let columns = columns(checks::SECTION.tables, tables);
    let flights = flight_styles(&columns);
    let input = ReportInput::default();
    checks::answers(&Given {
        input: &input,
        flights: &flights,
        tables: &columns,
        named: checks::SECTION.tables,
    })
}

fn columns(wanted: &[&str], tables: &BTreeMap<String, Table>) -> BTreeMap<String, Columns> {
    let named = wanted.iter().filter_map(|name| Some((name.to_string(), tables.get(*name)?)));
    named.map(|(name, table)| (name, Columns::of(table))).collect()
}

fn page_with(
    sections: impl IntoIterator<Item = &'static Section>,
    input: &ReportInput,
) -> Result<String> {
    let sections: Vec<&'static Section> = sections.into_iter().collect();
    let named: Vec<&str> = sections.iter().flat_map(|s| s.tables).copied().collect();
    let tables = columns(&named, &input.tables);
    let flights = flight_styles(&tables);
    let given = |section: &'static Section| Given {
        input,
        flights: &flights,
        tables: &tables,
        named: section.tables,
    };
    let environment = environment()?;
    let mut built = Vec::new();
    let mut plots = vec![("flights", json(&flights)?)];
    for section in sections.into_iter().filter(|s| input.asks_for(s)) {
        if let Some(mut body) = (section.build)(&given(section))? {
            built.push(Built {
                id: section.id,
                heading: section.heading,
                body: body.html(&environment)?,
            });
            plots.append(&mut body.plots);
        }
    }
    let page = Page {
        title: &input.title,
        subtitle: &input.subtitle,
        tiles: checks::tiles(&given(&checks::SECTION)),
        meaning: format::MEANING,
        sections: built,
        data: object(&plots),
        style: include_str!("html/page.css"),
        script: include_str!("html/page.js"),
        plotly: plotly_script(),
    };
    environment
        .get_template("page.html")
        .and_then(|template| template.render(minijinja::value::Serde(&page)))
        .map_err(fault)
}

fn environment() -> Result<minijinja::Environment<'static>> {
    let mut environment = minijinja::Environment::new();
    for (name, text) in [
        ("grid.html", include_str!("html/grid.html")),
        ("page.html", include_str!("html/page.html")),
    ] {
        environment.add_template(name, text).map_err(fault)?;
    }
    Ok(environment)
}

fn fault(e: minijinja::Error) -> Error {
    Error::new(format!("the report page could not be written: {e:#}"))
}

fn json(value: &impl Serialize) -> Result<String> {
    serde_json::to_string(value)
        .map_err(|e| Error::new(format!("the report's numbers could not be written: {e}")))
}

/// JSON that may stand inside a script element: no `<` can end the element.
fn object(plots: &[(&str, String)]) -> String {
    let fields: Vec<String> =
        plots.iter().map(|(name, text)| format!("\"{name}\":{text}")).collect();
    format!("{{{}}}", fields.join(",")).replace('<', "\\u003c")
}

/// The plotting library without its formula typesetter, which is another 2 MB and not used.
fn plotly_script() -> String {
    let tags = plotly::Plot::offline_js_sources();
    let first = tags.split("</script>").next().unwrap_or_default();
    first.split_once('>').map_or("", |(_, script)| script).to_string()
}

/// All flights any table knows, in alphabetical order, with colour and shape.
fn flight_styles(tables: &BTreeMap<String, Columns>) -> Vec<FlightStyle> {
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

#[cfg(test)]
mod tests;
