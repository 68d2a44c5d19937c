//! `reached` in, a table of the limits of states, where the motion reaches them and how near it comes to the others, out.

use super::columns::Columns;
use super::format::{display_unit, number, with_unit};
use super::grid::{Cell, Grid, Level};
use super::place::On;
use super::section::{Body, Given, Section};
use crate::error::Result;
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "limits",
    heading: "Limits that the motion reaches, or does not",
    on: On::Index,
    tables: &["reached"],
    build,
};

#[derive(Debug, Serialize)]
struct Limits {
    limits: Grid,
}

fn build(given: &Given) -> Result<Option<Body>> {
    let Some(limits) = given.get("reached").map(limits) else { return Ok(None) };
    if limits.rows.is_empty() {
        return Ok(None);
    }
    Ok(Some(Body::new(include_str!("html/limits.html"), Limits { limits })))
}

/// One row per model and limit.
fn limits(table: &Columns) -> Grid {
    let mut grid = Grid::new([
        "model",
        "limit",
        "verdict",
        "#segments",
        "#active|s",
        "~where it is active",
        "~what the motion reaches",
    ]);
    for ([model, _, state, limit], rows) in table.groups(["model", "group", "state", "limit"]) {
        let Some(&row) = rows.first() else { continue };
        let verdict = table.text("verdict", row);
        let level = match verdict.as_str() {
            "reached" => Level::Good,
            "not reached" => Level::Info,
            _ => Level::Warn,
        };
        let active = rows.iter().filter_map(|row| range(table, *row)).collect::<Vec<_>>();
        let at = rows.iter().filter_map(|row| place(table, *row)).collect::<Vec<_>>();
        let least = match (verdict.as_str(), limit.as_str()) {
            ("reached", _) => "",
            (_, "min") => "at most ",
            _ => "at least ",
        };
        let reaches = with_unit(table.number("extreme", row), &table.text("unit", row), 4);
        let at = if at.is_empty() { String::new() } else { format!(" at {}", at.join(", ")) };
        let counts = [table.number("segments", row), table.number("of", row)];
        grid.push(vec![
            model.into(),
            Cell::new(format!("{limit} of {state}")),
            Cell::new(verdict).level(level),
            Cell::new(format!("{} of {}", counts[0], counts[1])),
            Cell::new(number(table.number("seconds", row), 3)),
            Cell::new(active.join(", ")),
            Cell::new(format!("{least}{reaches}{at}")).under(follows(table, row)),
        ]);
    }
    grid.note = Some(
        "A limit that is not reached is known to be at least what the motion reaches there, if what was measured follows the motion: residuals \
         near its extreme are then as small as elsewhere. Where a limit depends on what drives the model, it is known over the range in which it \
         is active, and an extrapolation beyond."
            .into(),
    );
    grid
}

/// `V_c 72.0 to 111 m/s`
fn range(table: &Columns, row: usize) -> Option<String> {
    let [lower, upper] = ["lower", "upper"].map(|name| table.number(name, row));
    let (factor, _) = display_unit(&table.text("unit_input", row));
    let upper = with_unit(upper, &table.text("unit_input", row), 4);
    let name = table.text("input", row);
    lower.is_finite().then(|| format!("{name} {} to {upper}", number(factor * lower, 3)))
}

/// `V_c 72.1 m/s`
fn place(table: &Columns, row: usize) -> Option<String> {
    let (name, at) = (table.text("input", row), table.number("at", row));
    at.is_finite().then(|| format!("{name} {}", with_unit(at, &table.text("unit_input", row), 4)))
}

/// Whether what was measured follows the motion near its extreme.
fn follows(table: &Columns, row: usize) -> String {
    let unit = table.text("unit", row);
    let unit = unit.strip_suffix("/s").filter(|_| table.text("limit", row) == "rate_max");
    let unit = unit.map_or(table.text("unit", row), str::to_string);
    let [near, elsewhere] = ["rms_near", "rms_elsewhere"].map(|name| table.number(name, row));
    match near.is_finite() && elsewhere.is_finite() {
        true => {
            format!(
                "r.m.s. residual there {}, elsewhere {}",
                with_unit(near, &unit, 4),
                with_unit(elsewhere, &unit, 4)
            )
        }
        false => String::new(),
    }
}
