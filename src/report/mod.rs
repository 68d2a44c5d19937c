//! The tables of a run in, one self-contained HTML page for a flight-test engineer out; it works offline and holds no clock.
//!
//! `page.html` is the frame, filled with escaped text; `page.js` draws the plots from numbers embedded as JSON; the plotting script
//! comes out of the `plotly` crate. What is not there is said on the page, it never fails it.

mod again;
mod checks;
mod columns;
mod consistency;
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
mod uncertainty;

use crate::error::{Error, Result};
use crate::table::Table;
use columns::Columns;
use grid::Grid;
use serde::Serialize;
use std::collections::BTreeMap;

/// What a page is made from.
#[derive(Debug, Default)]
pub struct ReportInput {
    /// Title of the campaign.
    pub title: String,
    /// One line under the title: what was run (pipeline, stages, models).
    pub subtitle: String,
    /// Tables by name, as listed in [`TABLES`], all flights of a table in one. Others are ignored; absent ones are said to be absent.
    pub tables: BTreeMap<String, Table>,
    /// Columns of `samples` that drive each model, drawn below its outputs; without an entry the segment's own input is drawn.
    pub inputs: BTreeMap<String, Vec<String>>,
    /// Column of `samples` in which each input of `segments` was searched; without an entry it has the input's own name.
    pub searched: BTreeMap<String, String>,
    /// Sections (by their names in [`CONTENTS`]) that have no place on the page, because the campaign does not ask for what they show.
    pub unasked: Vec<&'static str>,
    /// Name and value of everything that says where the numbers come from: program version, code hash, configuration hashes.
    pub provenance: Vec<(String, String)>,
}

/// One flight in the legend.
#[derive(Debug, Serialize)]
struct FlightStyle {
    id: String,
    colour: &'static str,
    symbol: &'static str,
    path: &'static str,
}

/// Colours that stay apart for colour-blind readers (Okabe and Ito), each with a shape of its own, so that print works too.
const STYLES: [(&str, &str, &str); 6] = [
    ("#0072b2", "circle", "M0-5A5 5 0 1 1 0 5A5 5 0 1 1 0-5Z"),
    ("#d55e00", "square", "M-4.5-4.5H4.5V4.5H-4.5Z"),
    ("#009e73", "triangle-up", "M0-5.5L5.5 4.5H-5.5Z"),
    ("#cc79a7", "diamond", "M0-6L6 0L0 6L-6 0Z"),
    ("#b8860b", "triangle-down", "M0 5.5L5.5-4.5H-5.5Z"),
    ("#4ba3d9", "cross", "M-2-5.5H2V-2H5.5V2H2V5.5H-2V2H-5.5V-2H-2Z"),
];

/// The numbers that `page.js` draws.
#[derive(Serialize)]
struct Data<'a> {
    flights: &'a [FlightStyle],
    lines: Vec<lines::LinePlot>,
    maneuvers: Vec<maneuvers::Maneuver>,
    overview: Vec<flights::Flight>,
    profiles: Vec<uncertainty::ProfilePlot>,
    overlays: Vec<diagnosis::Overlay>,
    gaps: Vec<gap::Where>,
    paths: Vec<paths::PathPlot>,
}

/// What the template is filled with.
#[derive(Serialize)]
struct Page<'a> {
    title: &'a str,
    subtitle: &'a str,
    contents: Vec<Heading>,
    unasked: &'a [&'static str],
    tiles: Vec<checks::Tile>,
    checks: Vec<checks::Check>,
    flights: &'a [FlightStyle],
    lines: lines::Lines,
    fits: Grid,
    maneuvers: maneuvers::Maneuvers,
    estimates: estimates::Estimates,
    uncertainty: uncertainty::Uncertainty,
    diagnosis: diagnosis::Diagnosis,
    overview: flights::Overview,
    segments: Grid,
    channels: Grid,
    consistency: Grid,
    /// There are measured channels to be drawn beside the flight path.
    compared: bool,
    biases: Grid,
    notes: Grid,
    provenance: Grid,
    stages: Option<Grid>,
    /// JSON of [`Data`].
    data: String,
    style: &'static str,
    script: &'static str,
    plotly: String,
}

#[derive(Serialize)]
struct Heading {
    id: &'static str,
    heading: &'static str,
}

/// The tables a page is made from.
pub const TABLES: [&str; 31] = [
    "segments",
    "estimates",
    "correlations",
    "separability",
    "budget",
    "profiles",
    "repeats",
    "responses",
    "residuals",
    "fits",
    "bands",
    "points",
    "samples",
    "flightpath",
    "pathmatch",
    "channels",
    "biases",
    "consistency",
    "findings",
    "candidates",
    "held_out",
    "closures",
    "shifts",
    "gaps",
    "overlays",
    "driven",
    "relations",
    "equation_errors",
    "next_models",
    "notes",
    "stages",
];

pub const CONTENTS: [(&str, &str); 13] = [
    ("checks", "Can these results be trusted?"),
    ("lines", "Coefficients versus angle of attack"),
    ("fits", "Fitted lines"),
    ("maneuvers", "Measured and modelled"),
    ("estimates", "Estimates"),
    ("uncertainty", "What the uncertainties are made of"),
    ("diagnosis", "What the models lack"),
    ("flights", "Flights and maneuvers"),
    ("channels", "Channels"),
    ("consistency", "Do the sensors agree?"),
    ("biases", "Sensor biases"),
    ("notes", "Notes"),
    ("provenance", "Provenance"),
];

/// A page, and what it calls a problem.
#[derive(Debug)]
pub struct Report {
    /// HTML.
    pub page: String,
    /// The sentences that the page marks as problems.
    pub problems: Vec<String>,
}

/// The page as HTML. The same input gives the same bytes. An error is a fault of the program, not of the tables.
pub fn page(input: &ReportInput) -> Result<String> {
    report(input).map(|report| report.page)
}

/// The page, and the problems that stand on it, from one look at the tables.
///
/// # Errors
/// As `page`.
pub fn report(input: &ReportInput) -> Result<Report> {
    let wanted = |(name, _): &(&String, &Table)| TABLES.contains(&name.as_str());
    let tables = input.tables.iter().filter(wanted).map(|(name, table)| (name.clone(), Columns::of(table))).collect();
    page_of(input, &tables)
}

fn page_of(input: &ReportInput, tables: &BTreeMap<String, Columns>) -> Result<Report> {
    let get = |name: &str| tables.get(name);
    let asked = |section: &str| !input.unasked.contains(&section);
    let styles = flight_styles(tables);
    let ids: Vec<String> = styles.iter().map(|f| f.id.clone()).collect();

    let (lines, line_plots) = lines::lines(get("fits"), get("bands"), get("points"));
    let sources = maneuvers::Sources {
        responses: get("responses"),
        segments: get("segments"),
        samples: get("samples"),
        estimates: get("estimates"),
        residuals: get("residuals"),
        inputs: &input.inputs,
    };
    let (maneuvers, histories, matches) = maneuvers::maneuvers(&sources);
    let (overview, flights) = flights::overview(get("flightpath"), get("samples"), get("segments"), &input.searched, &ids);
    let (uncertainty, profiles) = uncertainty::uncertainty(get);
    let (diagnosis, overlays) = diagnosis::diagnosis(get);
    let facts = checks::Facts {
        flights: &ids,
        segments: get("segments"),
        estimates: get("estimates"),
        correlations: get("correlations"),
        repeats: get("repeats"),
        fits: get("fits"),
        channels: get("channels"),
        consistency: get("consistency"),
        findings: get("findings"),
        notes: get("notes"),
        responses: get("responses"),
        matches: &matches,
    };
    let paths = paths::paths(get("pathmatch"));
    let compared = !paths.is_empty();
    let data = json(&Data {
        flights: &styles,
        lines: line_plots,
        maneuvers: histories,
        overview: flights,
        profiles,
        overlays,
        gaps: gap::figures(get),
        paths,
    })?;
    let checks = checks::checks(facts);
    let problems = checks::problems(&checks);
    let page = render(&Page {
        title: &input.title,
        subtitle: &input.subtitle,
        contents: CONTENTS.into_iter().filter(|(id, _)| asked(id)).map(|(id, heading)| Heading { id, heading }).collect(),
        unasked: &input.unasked,
        tiles: checks::tiles(facts, asked),
        checks,
        flights: &styles,
        lines,
        fits: lines::table(get("fits")),
        maneuvers,
        estimates: estimates::estimates(get("estimates")),
        uncertainty,
        diagnosis,
        overview,
        segments: flights::segments(get("segments")),
        channels: logs::channels(get("channels")),
        consistency: consistency::table(get("consistency")),
        compared,
        biases: logs::biases(get("biases"), get("consistency")),
        notes: logs::notes(get("notes")),
        provenance: provenance(&input.provenance),
        stages: stages(get("stages")),
        data,
        style: include_str!("page.css"),
        script: include_str!("page.js"),
        plotly: plotly_script(),
    })?;
    Ok(Report { page, problems })
}

fn render(page: &Page) -> Result<String> {
    let fault = |e: minijinja::Error| Error::new(format!("the report page could not be written: {e:#}"));
    let mut environment = minijinja::Environment::new();
    // The name decides the escaping: everything in a .html template is escaped unless it is marked safe.
    environment.add_template("page.html", include_str!("page.html")).map_err(fault)?;
    environment.get_template("page.html").and_then(|template| template.render(minijinja::value::Serde(page))).map_err(fault)
}

/// JSON that may stand inside a script element: no `<` can end the element.
fn json(data: &Data) -> Result<String> {
    let text = serde_json::to_string(data).map_err(|e| Error::new(format!("the report's numbers could not be written: {e}")))?;
    Ok(text.replace('<', "\\u003c"))
}

/// The plotting library without its formula typesetter, which is another 2 MB and not used.
fn plotly_script() -> String {
    let tags = plotly::Plot::offline_js_sources();
    let first = tags.split("</script>").next().unwrap_or_default();
    first.split_once('>').map_or("", |(_, script)| script).to_string()
}

/// All flights any table knows, in alphabetical order, with colour and shape.
fn flight_styles(tables: &BTreeMap<String, Columns>) -> Vec<FlightStyle> {
    let mut ids: Vec<String> =
        tables.values().flat_map(|t| t.rows_by(["flight"]).into_keys().flatten()).filter(|id| !id.is_empty()).collect();
    ids.sort();
    ids.dedup();
    let style = |(i, id): (usize, String)| {
        let (colour, symbol, path) = STYLES[i % STYLES.len()];
        FlightStyle { id, colour, symbol, path }
    };
    ids.into_iter().enumerate().map(style).collect()
}

fn provenance(entries: &[(String, String)]) -> Grid {
    let mut grid = Grid::new(["what", "~value"]);
    for (name, value) in entries {
        grid.push(vec![name.as_str().into(), value.as_str().into()]);
    }
    grid.or_missing("Nothing is recorded about the origin of this page.")
}

/// One row per stage and unit of work: the key that covers all it was made from.
fn stages(table: Option<&Columns>) -> Option<Grid> {
    let table = table.filter(|t| t.rows() > 0)?;
    let mut grid = Grid::new(["stage", "for", "key", "code", "#ingredients"]);
    for (key, rows) in table.groups(["stage", "unit", "key", "code"]) {
        let mut cells: Vec<grid::Cell> = key.into_iter().map(grid::Cell::new).collect();
        cells.push(rows.len().to_string().into());
        grid.push(cells);
    }
    grid.note = Some("A key is a hash over inputs, settings and program; the table stages lists what each covers.".into());
    Some(grid)
}

#[cfg(test)]
mod tests;
