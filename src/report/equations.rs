//! `equations`, `regressions` and `searches` in; what the regressions on equations found, what noise
//! in their regressors did, and how terms were searched for, out.

use super::columns::Columns;
use super::format::{number, plain, plus_minus};
use super::grid::{Cell, Grid, Level};
use super::place::On;
use super::section::{Body, Given, Section};
use crate::error::Result;
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "equation-error",
    heading: "Regression on equations",
    on: On::Both,
    tables: &["equations", "regressions", "searches"],
    build,
};

#[derive(Debug, Serialize)]
struct Shown {
    equations: Grid,
    parameters: Grid,
    searches: Grid,
}

/// Rows shown per model.
const MOST: usize = 40;

fn build(given: &Given) -> Result<Option<Body>> {
    let Some(table) = given.get("equations").filter(|table| table.rows() > 0) else {
        return Ok(None);
    };
    let shown = Shown {
        equations: equations(table),
        parameters: parameters(given.get("regressions")),
        searches: searches(given.get("searches")),
    };
    Ok(Some(Body::new(include_str!("html/equations.html"), shown)))
}

/// The rows that are shown, and a sentence about the others.
fn shown(table: &Columns, name: &str) -> (Vec<usize>, String) {
    let (mut rows, mut left) = (Vec::new(), 0);
    for (_, all) in table.groups(["model"]) {
        left += all.len().saturating_sub(MOST);
        rows.extend(all.into_iter().take(MOST));
    }
    let more = if left == 0 { String::new() } else { format!(" {left} more stand in {name}.") };
    (rows, more)
}

fn equations(table: &Columns) -> Grid {
    let mut grid =
        Grid::new(["model", "maneuver", "equation", "~outcome", "#n", "#rms", "#R²", "#AR order"]);
    let (rows, more) = shown(table, "equations");
    for row in rows {
        let used = table.text("outcome", row) == "used";
        let when = |text: String| if used { text } else { String::new() };
        grid.push(vec![
            table.text("model", row).into(),
            table.text("group", row).into(),
            table.text("equation", row).into(),
            table.text("outcome", row).into(),
            when(plain(table.number("n", row), 0)).into(),
            Cell::new(when(number(table.number("rms", row), 3))).under(table.unit_in("unit", row)),
            when(number(table.number("r2", row), 5)).into(),
            when(plain(table.number("ar_order", row), 0)).into(),
        ]);
    }
    grid.note =
        Some(format!("R² is the share of the left side's variance that is explained.{more}"));
    grid
}

fn parameters(table: Option<&Columns>) -> Grid {
    let none = "No parameter is in these equations.";
    let Some(table) = table else { return Grid::missing(none) };
    let mut grid = Grid::new([
        "model",
        "maneuver",
        "parameter",
        "~outcome",
        "#value",
        "#sd / sd if white",
        "#partial F",
        "#shift by noise|in regressors",
        "#shift / sd",
    ]);
    let (rows, more) = shown(table, "regressions");
    for row in rows {
        let of = |name: &str| table.number(name, row);
        let ratio = of("shift") / of("sd");
        let known = of("sd").is_finite();
        let when = |value: f64, digits| if known { number(value, digits) } else { String::new() };
        grid.push(vec![
            table.text("model", row).into(),
            table.text("group", row).into(),
            table.text("parameter", row).into(),
            table.text("outcome", row).into(),
            Cell::new(plus_minus(of("value"), of("sd"))).under(table.unit_in("unit", row)),
            when(of("sd") / of("sd_white"), 3).into(),
            when(of("partial_f"), 4).into(),
            when(of("shift"), 2).into(),
            Cell::new(when(ratio, 2)).level_if(ratio.abs() > 1.0, Level::Warn),
        ]);
    }
    grid.note = Some(format!(
        "Least squares takes measured regressors for exact. Their noise moves the values, towards zero as a rule: by how much is told, not corrected.{more}"
    ));
    grid.or_missing(none)
}

fn searches(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::default() };
    let mut grid = Grid::new([
        "model",
        "maneuver",
        "equation",
        "#step",
        "term",
        "#partial F",
        "#limit",
        "#terms",
        "#PSE",
        "#R²",
        "#s",
    ]);
    let (rows, more) = shown(table, "searches");
    for row in rows {
        let of = |name: &str, digits| {
            let value = table.number(name, row);
            if value.is_finite() { number(value, digits) } else { String::new() }
        };
        let whole = |name: &str| plain(table.number(name, row), 0);
        let term = match (table.text("action", row), table.text("parameter", row)) {
            (action, name) if name.is_empty() => action,
            (action, name) => format!("{name} {action}"),
        };
        let kept = table.flag("kept", row) == Some(true);
        grid.push(vec![
            table.text("model", row).into(),
            table.text("group", row).into(),
            table.text("equation", row).into(),
            whole("step").into(),
            Cell::new(term).level_if(kept, Level::Good),
            of("partial_f", 4).into(),
            of("limit_f", 2).into(),
            whole("terms").into(),
            of("pse", 5).into(),
            of("r2", 5).into(),
            Cell::new(of("s", 4)).under(table.unit_in("unit", row)),
        ]);
    }
    grid.note = Some(format!(
        "The equation after the marked step is the one that is estimated. PSE is the predicted square error.{more}"
    ));
    grid
}
