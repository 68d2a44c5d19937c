//! `modes` in, a table of the modes of every identified model out.

use super::columns::Columns;
use super::format::{number, plain, plus_minus};
use super::grid::{Cell, Grid, Level};
use super::place::On;
use super::section::{Body, Given, Section};
use crate::error::Result;

pub const SECTION: Section = Section {
    id: "modes",
    heading: "Modes of the identified models",
    on: On::Both,
    tables: &["modes"],
    build,
};

/// Rows shown per model.
const MOST: usize = 24;

fn build(given: &Given) -> Result<Option<Body>> {
    let Some(table) = given.get("modes").filter(|table| table.rows() > 0) else {
        return Ok(None);
    };
    Ok(Some(Body::grid(modes(table))))
}

fn modes(table: &Columns) -> Grid {
    let mut grid = Grid::new([
        "model",
        "maneuver",
        "#mode",
        "states",
        "#eigenvalue|1/s",
        "#frequency|rad/s",
        "#damping ratio",
        "#period|s",
        "#time constant|s",
    ]);
    let mut left = 0;
    for ([model], rows) in table.groups(["model"]) {
        left += rows.len().saturating_sub(MOST);
        for &row in rows.iter().take(MOST) {
            let with_sd = |name: &str| {
                let value = table.number(name, row);
                let sd = table.number(&format!("{name}_sd"), row);
                if value.is_finite() { plus_minus(value, sd) } else { String::new() }
            };
            let (real, imag) = (table.number("real", row), table.number("imag", row));
            let value = match imag > 0.0 {
                true => format!("{} + {}i", number(real, 4), number(imag, 4)),
                false => number(real, 4),
            };
            let of = match table.text("segment", row) {
                segment if segment.is_empty() => table.text("group", row),
                segment => segment,
            };
            // Beyond what its sd allows.
            let grows = real > 2.0 * table.number("real_sd", row);
            grid.push(vec![
                model.clone().into(),
                of.into(),
                plain(table.number("number", row), 0).into(),
                table.text("states", row).into(),
                Cell::new(value).level_if(grows, Level::Warn),
                with_sd("frequency").into(),
                with_sd("damping").into(),
                with_sd("period").into(),
                with_sd("time_constant").into(),
            ]);
        }
    }
    let more = match left {
        0 => String::new(),
        left => format!(" {left} more stand in the table modes."),
    };
    grid.note = Some(format!(
        "Eigenvalues of the model, linearised where the maneuver starts; of a pair the one that turns forwards. \
         A negative time constant is that of a mode that grows.{more}"
    ));
    grid
}
