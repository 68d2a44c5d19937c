//! `predictions` and `unpredicted` in, a table of how far flight is from what was predicted, out.

use super::columns::Columns;
use super::format::{display_unit, number, with_unit};
use super::grid::{Cell, Grid, Level};
use super::place::On;
use super::section::{Body, Given, Section};
use crate::error::Result;
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "predictions",
    heading: "Predicted and flown",
    on: On::Index,
    tables: &["predictions", "unpredicted"],
    build,
};

#[derive(Debug, Serialize)]
struct Predictions {
    predictions: Grid,
}

fn build(given: &Given) -> Result<Option<Body>> {
    let Some(table) = given.get("predictions").filter(|table| table.rows() > 0) else {
        return Ok(None);
    };
    let predictions = predictions(table, given.get("unpredicted"));
    Ok(Some(Body::new(include_str!("html/predictions.html"), Predictions { predictions })))
}

/// One row per curve.
fn predictions(table: &Columns, unpredicted: Option<&Columns>) -> Grid {
    let mut grid = Grid::new([
        "curve",
        "equation",
        "where",
        "#predicted",
        "#beyond the band",
        "~largest difference, flown less predicted",
        "~flown, not predicted",
    ]);
    let names = ["curve", "group", "equation", "at"];
    for ([curve, group, equation, at], rows) in table.groups(names) {
        let beyond = rows.iter().filter(|row| table.flag("beyond", **row) == Some(true)).count();
        let off = |row: &usize| table.number("difference", *row);
        let largest = rows.iter().max_by(|a, b| off(a).abs().total_cmp(&off(b).abs()));
        let largest = largest.map(|row| difference(table, *row)).unwrap_or_default();
        let key = [&curve, &group, &equation, &at].map(String::as_str);
        let level = if beyond > 0 { Level::Warn } else { Level::Good };
        grid.push(vec![
            curve.clone().into(),
            equation.clone().into(),
            at.clone().into(),
            Cell::new(rows.len().to_string()),
            Cell::new(beyond.to_string()).level(level),
            Cell::new(largest),
            Cell::new(unpredicted.map(|table| ranges(table, key)).unwrap_or_default()),
        ]);
    }
    grid.note = Some(
        "The band holds the whole curve that flight shows in 95 of 100 cases, so a predicted value beyond it differs from flight, and not by \
         chance. It is that of the model: what the model cannot follow is in no band. Nothing is compared between or beyond the predicted values."
            .into(),
    );
    grid
}

/// `-0.051 at eta 20.0 deg`
fn difference(table: &Columns, row: usize) -> String {
    let (factor, unit) = display_unit(&table.text("unit", row));
    let value = format!("{} {unit}", number(factor * table.number("difference", row), 2));
    let at = with_unit(table.number("x", row), &table.text("unit_x", row), 3);
    format!("{} at {} {at}", value.trim_end_matches([' ', '-']), table.text("input", row))
}

/// `-24.0 to -20.0 deg, 15.0 to 19.3 deg`
fn ranges(table: &Columns, key: [&str; 4]) -> String {
    let names = ["curve", "group", "equation", "at"];
    let is = |row: &usize| names.iter().zip(key).all(|(name, text)| table.text(name, *row) == text);
    let range = |row: usize| {
        let unit = table.text("unit_x", row);
        let (factor, _) = display_unit(&unit);
        let from = number(factor * table.number("from", row), 3);
        format!("{from} to {}", with_unit(table.number("to", row), &unit, 3))
    };
    (0..table.rows()).filter(is).map(range).collect::<Vec<_>>().join(", ")
}
