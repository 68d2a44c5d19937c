//! What the page is told of its origin, and `stages`, in; their tables out.

use super::columns::Columns;
use super::grid::{Cell, Grid};
use super::place::On;
use super::section::{Body, Given, Section};
use crate::error::Result;
use serde::Serialize;

pub const SECTION: Section =
    Section { id: "provenance", heading: "Provenance", on: On::Index, tables: &["stages"], build };

#[derive(Serialize)]
struct Provenance {
    origin: Grid,
    stages: Option<Grid>,
}

fn build(given: &Given) -> Result<Option<Body>> {
    let section =
        Provenance { origin: origin(&given.input.provenance), stages: stages(given.get("stages")) };
    Ok(Some(Body::new(include_str!("html/provenance.html"), section)))
}

fn origin(entries: &[(String, String)]) -> Grid {
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
        let mut cells: Vec<Cell> = key.into_iter().map(Cell::new).collect();
        cells.push(rows.len().to_string().into());
        grid.push(cells);
    }
    grid.note = Some("A key is a hash over inputs, settings and program; the table stages lists what each covers.".into());
    Some(grid)
}
