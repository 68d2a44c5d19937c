//! `[[figure]]` of the pipeline file comes in; its checked settings, or the mistakes, go out.

use crate::stage::check::Given;
use crate::stage::estimate::Used;
use crate::stage::kind::Known;
use crate::stage::told::Told;
use crate::table::{Column, Kind, Schema, schema};
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The stage's name, and its key in the pipeline file.
pub const NAME: &str = "figure";

/// The table of which x and y are signals: it has a row for each.
pub const SIGNALS: &str = "conditions";

/// A figure of the report, drawn from columns of tables; its numbers are rows of the table
/// `figures`.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Name in the table.
    pub name: String,
    /// What stands above it.
    pub title: String,
    /// What is drawn.
    pub series: Vec<Series>,
    /// Straight lines and points of another source, drawn beside: the published ones, for example.
    #[serde(default)]
    pub reference: Vec<Reference>,
    /// What the abscissa is called; its column's name unless given.
    #[serde(default)]
    pub x_title: Option<String>,
    /// What the ordinate is called; its column's name unless given.
    #[serde(default)]
    pub y_title: Option<String>,
}

/// Rows of one table.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Series {
    /// A table that this pipeline writes.
    pub table: String,
    /// Rows with this text, or one of several, in a column: `where = { parameter = "C_h_delta" }`.
    #[serde(default, rename = "where")]
    pub rows: IndexMap<String, Used>,
    /// Only rows of this maneuver's flight from a second before its first step to two seconds after
    /// its last: `during = "flight-4.02"`; of a table with the columns `flight` and `t_s`.
    #[serde(default)]
    pub during: Option<String>,
    /// Column of the abscissa; of the table `conditions` a signal: its mean before each maneuver.
    pub x: String,
    /// Column of the ordinate, or signal.
    pub y: String,
    /// Column of standard deviations: an error bar of 95%.
    #[serde(default)]
    pub sd: Option<String>,
    /// Columns of both ends of a bar, or of a band where points are joined.
    #[serde(default)]
    pub ends: Option<[String; 2]>,
    /// Column of texts, each of which has a colour: `"flight"`.
    #[serde(default)]
    pub colour: Option<String>,
    /// Whether points are joined by a line, in the order of the rows.
    #[serde(default)]
    pub joined: bool,
    /// Whether `x` and `y` are ends of ranges of the abscissa, which are shaded: what a prediction does
    /// not reach, for example.
    #[serde(default)]
    pub strips: bool,
    /// What it is called in the legend; the text of `colour` unless given.
    #[serde(default)]
    pub label: Option<String>,
}

/// Something to compare with.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Where it comes from.
    pub label: String,
    /// A straight line, SI: `line = { slope = -0.3717, intercept = -0.3189 }`.
    #[serde(default)]
    pub line: Option<Line>,
    /// Points, SI: `[[x, y], ...]`.
    #[serde(default)]
    pub points: Vec<[f64; 2]>,
}

/// `y = slope x + intercept`, SI.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Change of the ordinate per change of the abscissa.
    pub slope: f64,
    /// Ordinate at the abscissa 0.
    pub intercept: f64,
}

/// Checks all `[[figure]]`.
pub fn check(told: &mut Told, known: &mut Known) {
    let Some(all) = told.get::<Vec<Settings>>(NAME).cloned() else { return };
    let name = |s: &Settings| s.name.clone();
    let known_tables = &known.tables[..];
    known.given.entries(NAME, all, name, |given, key, settings| {
        if settings.series.is_empty() {
            given.push(&format!("{key}.series"), "a figure without a series shows nothing", "");
        }
        for (i, one) in settings.series.iter().enumerate() {
            series(given, &format!("{key}.series.{i}"), one, known_tables);
        }
        for (i, one) in settings.reference.iter().enumerate() {
            if one.line.is_some() != one.points.is_empty() {
                let what = "a reference is either a `line` or `points`";
                given.push(&format!("{key}.reference.{i}"), what, "");
            }
        }
        Some(())
    });
}

fn series(given: &mut Given, key: &str, series: &Series, known: &[&'static str]) {
    let Some(table) = known.iter().find(|t| **t == series.table).and_then(|t| schema(t).ok())
    else {
        let at = format!("{key}.table");
        return given.unknown(&at, "table", &series.table, known);
    };
    let ends = series.ends.iter().flatten().map(|name| ("ends", name));
    let numbers = [("x", &series.x), ("y", &series.y)].into_iter();
    let numbers = numbers.filter(|_| table.name != SIGNALS);
    for (field, name) in numbers.chain(series.sd.iter().map(|name| ("sd", name))).chain(ends) {
        column(given, &format!("{key}.{field}"), table, name, Kind::String, false);
    }
    for name in series.rows.keys() {
        column(given, &format!("{key}.where.{name}"), table, name, Kind::String, true);
    }
    if let Some(name) = &series.colour {
        column(given, &format!("{key}.colour"), table, name, Kind::String, true);
    }
    if series.during.is_some() {
        let key = format!("{key}.during");
        column(given, &key, table, "flight", Kind::String, true);
        column(given, &key, table, "t_s", Kind::String, false);
    }
    if series.strips && (series.sd.is_some() || series.ends.is_some() || series.joined) {
        let what = "strips have no bars and are not joined";
        given.push(&format!("{key}.strips"), what, "leave `sd`, `ends` and `joined` out");
    }
    if series.sd.is_some() && series.ends.is_some() {
        given.push(&format!("{key}.sd"), "bars are given by `sd` or by `ends`, not by both", "");
    }
}

/// Checks that a table has a column, and that it is of a kind or is not.
fn column(given: &mut Given, key: &str, table: &Schema, name: &str, kind: Kind, is: bool) {
    let is_it = |column: &&Column| column.name == *name;
    let texts = |column: &&Column| (column.kind == kind) == is;
    match table.columns.iter().find(is_it) {
        Some(column) if texts(&column) => {}
        Some(_) => {
            let what = if is { "does not hold texts" } else { "does not hold numbers" };
            given.push(key, format!("column \"{name}\" of the table `{}` {what}", table.name), "");
        }
        // Samples have a column for every signal.
        None if table.dynamic.is_some() && !is => {}
        None => {
            let of: Vec<&str> =
                table.columns.iter().filter(texts).map(|c| c.name.as_str()).collect();
            given.unknown(key, &format!("column of the table `{}`", table.name), name, &of);
        }
    }
}
