//! The tables of a run in, one self-contained HTML page for a flight-test engineer out; it works
//! offline and holds no clock.
//!
//! [`SECTIONS`] is the one list of what is on the page: its order, its navigation and the tables
//! that it is made from follow. The templates in `html/` are filled with escaped text;
//! `html/page.js` draws the plots from numbers embedded as JSON; the plotting script comes out of
//! the `plotly` crate. What is not there is said on the page, it never fails it.

mod adequacy;
mod again;
mod checks;
mod columns;
mod consistency;
mod correlations;
mod diagnosis;
mod equations;
mod estimates;
mod figures;
mod flights;
mod format;
mod gap;
mod grid;
mod limits;
mod lines;
mod logs;
mod maneuvers;
mod modes;
mod paths;
mod predictions;
mod provenance;
mod section;
mod still;
mod tolerances;
mod uncertainty;
mod used;
mod validation;
mod verdict;

use crate::error::Result;
use crate::table::Table;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

pub use checks::Check;
pub use columns::Columns;
pub use flights::overview_columns;
pub use grid::{Cell, Grid, Level};
pub use section::{Body, Given, ReportInput, Section};

use section::{fault, flight_styles, json};

/// The sections in the order of the page. Adding one is adding a file that has it, and a line here.
pub const SECTIONS: &[Section] = &[
    checks::SECTION,
    verdict::SECTION,
    lines::PLOTS,
    lines::TABLE,
    figures::SECTION,
    predictions::SECTION,
    validation::SECTION,
    maneuvers::SECTION,
    estimates::SECTION,
    equations::SECTION,
    modes::SECTION,
    correlations::SECTION,
    uncertainty::SECTION,
    limits::SECTION,
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

/// A page with figures alone: those of the table `figures`.
///
/// # Errors
/// As `page`.
pub fn of_figures(input: &ReportInput) -> Result<String> {
    page_of([&figures::SECTION], input, false)
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
        sections: SECTIONS,
    })
}

fn columns(wanted: &[&str], tables: &BTreeMap<String, Table>) -> BTreeMap<String, Columns> {
    let each_once: BTreeSet<&str> = wanted.iter().copied().collect();
    let named = each_once.into_iter().filter_map(|name| Some((name, tables.get(name)?)));
    named.map(|(name, table)| (name.to_string(), Columns::of(table))).collect()
}

fn page_with(
    sections: impl IntoIterator<Item = &'static Section>,
    input: &ReportInput,
) -> Result<String> {
    page_of(sections, input, true)
}

/// With the counts of a campaign and what its numbers mean at the top, or without.
fn page_of(
    sections: impl IntoIterator<Item = &'static Section>,
    input: &ReportInput,
    of_campaign: bool,
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
        sections: SECTIONS,
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
        tiles: if of_campaign { checks::tiles(&given(&checks::SECTION)) } else { Vec::new() },
        meaning: if of_campaign { format::MEANING } else { "" },
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

#[cfg(test)]
mod tests;
