//! `adequacy` in; what each estimate leaves of its outputs, and what the checks say about it, out.

use super::columns::Columns;
use super::format::{few, number, plain};
use super::grid::{Cell, Grid, Level};
use super::place::On;
use super::section::{Body, Section};
use crate::signal::adequacy::{COLOUR, Leaves, SHARE};

pub const SECTION: Section = Section {
    id: "matches",
    heading: "What each estimate leaves",
    on: On::Index,
    tables: &["adequacy"],
    build: |given| {
        let grid = grid(given.get("adequacy"));
        Ok((!grid.rows.is_empty()).then(|| Body::grid(grid)))
    },
};

fn is_poor(table: &Columns, row: usize) -> bool {
    table.text("leaves", row) == Leaves::More.as_str()
}

/// One row for each output of each estimate.
pub fn grid(table: Option<&Columns>) -> Grid {
    let note = "Where noise drives the model, what its filter takes for noise of the sensors is looked at.";
    judged(table, "model", &[], note)
}

/// One row for each output of each diagnosis.
pub fn unexplained(table: Option<&Columns>) -> Grid {
    let note = "Foretold is the share of it that its own past tells; turbulence the share that noise driving the model explains.";
    judged(table, "diagnosis", &["foretold", "turbulence"], note)
}

/// Densities of noise that was let drive a model.
pub fn turbulence(table: Option<&Columns>) -> Grid {
    let Some(table) = table.filter(|t| t.rows() > 0) else {
        return Grid::missing("No noise was let drive a model.");
    };
    let mut grid =
        Grid::new(["diagnosis", "noise in the rate of", "#root of its density", "#sd", "accounts"]);
    for row in 0..table.rows() {
        let value = |name: &str| number(table.number(name, row), 3);
        grid.push(vec![
            table.text("diagnosis", row).into(),
            table.text("state", row).into(),
            Cell::new(value("density")).under(table.text("unit", row)),
            value("sd").into(),
            table.text("accounts", row).into(),
        ]);
    }
    grid
}

fn judged(table: Option<&Columns>, of: &str, shares: &[&str], note: &str) -> Grid {
    let mut columns: Vec<String> = [
        of,
        "output",
        "#sensor's noise",
        "#left",
        "#measured variation",
        "#beyond noise, part of variation|%",
        "#a mean|%",
        "#another size|%",
        "#another shape|%",
    ]
    .map(String::from)
    .into();
    columns.extend(shares.iter().map(|name| format!("#{name}|%")));
    columns.push("left is".into());
    let mut grid = Grid::new(columns);
    let Some(table) = table else { return grid };
    let percent = |name: &str, row: usize| plain(100.0 * table.number(name, row), 1);
    for row in 0..table.rows() {
        let unit = table.unit_in("unit", row);
        let value = |name: &str| Cell::new(number(table.number(name, row), 3)).under(&unit);
        let poor = is_poor(table, row);
        let mut cells: Vec<Cell> =
            [of, "output"].iter().map(|name| table.text(name, row).into()).collect();
        cells.extend(["noise", "left", "variation"].map(value));
        cells.push(Cell::new(percent("share", row)).level_if(poor, Level::Warn));
        cells.extend(["bias", "size", "shape"].map(|name| Cell::new(percent(name, row))));
        cells.extend(shares.iter().map(|name| Cell::new(percent(name, row))));
        cells.push(Cell::new(table.text("leaves", row)).level_if(poor, Level::Warn));
        grid.push(cells);
    }
    let note = format!(
        "Over all maneuvers. A model that is right leaves its sensors' noise, read from the fast part of the measurement; twice that may be slow noise. \
         \"more than noise\" is what exceeds the root of the squares of {COLOUR} times the noise and {:.0}% of the variation. The three parts of what is left are \
         Theil's. {note}",
        100.0 * SHARE
    );
    grid.note = Some(note);
    grid
}

/// The sentence of the checks.
pub fn summary(table: Option<&Columns>) -> Option<(Level, String)> {
    let table = table?;
    let told = |row: &usize| table.text("leaves", *row) != Leaves::Unmoved.as_str();
    let mut rows: Vec<usize> = (0..table.rows()).filter(told).collect();
    let share = |row: usize| table.number("share", row);
    rows.sort_by(|&a, &b| share(b).total_cmp(&share(a)));
    let name = |row: usize| {
        let of = ["output", "model"].map(|name| table.text(name, row));
        format!("{} of {} ({:.0}%)", of[0], of[1], 100.0 * share(row))
    };
    let worst = *rows.first()?;
    let poor: Vec<String> =
        rows.iter().copied().filter(|&row| is_poor(table, row)).map(name).collect();
    Some(if poor.is_empty() {
        let text = format!(
            "What the estimates leave is no more than noise of the sensors, or little beside the measured variation; most is left of {}.",
            name(worst)
        );
        (Level::Good, text)
    } else {
        let text = format!(
            "Estimates leave more than noise of the sensors, and no noise in the model accounts for it (what is left beyond noise, of the measured variation): {}. \
             Their standard deviations suppose that it is noise.",
            few(&poor)
        );
        (Level::Warn, text)
    })
}
