//! `next_models`, `estimates` and `residuals` in; an estimate and the same with what a diagnosis
//! added, side by side, out.

use super::columns::Columns;
use super::format::{number, plus_minus};
use super::grid::{Cell, Grid, Level};

/// Amended estimates: diagnosis, estimate, name of the amended one.
fn pairs(table: Option<&Columns>) -> Vec<[String; 3]> {
    let Some(table) = table else { return Vec::new() };
    (0..table.rows())
        .map(|r| ["diagnosis", "estimate", "next"].map(|column| table.text(column, r)))
        .collect()
}

/// Parameters of both, without those that belong to one maneuver of several and initial values.
pub fn parameters(next_models: Option<&Columns>, estimates: Option<&Columns>) -> Grid {
    let mut grid = Grid::new([
        "estimate",
        "parameter",
        "group",
        "#as it was",
        "#with what was added",
        "#shift|sd",
        "ended",
    ]);
    let Some(table) = estimates else { return Grid::missing("Nothing was estimated again.") };
    let key = |r: usize| ["group", "parameter", "of"].map(|column| table.text(column, r));
    let rows = |model: &str| -> Vec<usize> {
        let shown = |r: &usize| {
            table.text("per", *r) != "segment" && !table.text("parameter", *r).ends_with("(0)")
        };
        (0..table.rows()).filter(|&r| table.text("model", r) == model).filter(shown).collect()
    };
    for [_, estimate, next] in pairs(next_models) {
        let before = rows(&estimate);
        for row in rows(&next) {
            let old = before.iter().copied().find(|&r| key(r) == key(row));
            let value =
                |r: usize| Cell::new(plus_minus(table.number("value", r), table.number("sd", r)));
            let sd = |r: usize| table.number("sd", r);
            let shift = old.map_or(f64::NAN, |r| {
                (table.number("value", row) - table.number("value", r)) / sd(r)
            });
            let [group, name, of] = key(row);
            grid.push(vec![
                Cell::new(&estimate),
                Cell::new(if of.is_empty() { name } else { format!("{name} ({of})") })
                    .under(table.unit_in("unit", row)),
                Cell::new(group),
                old.map_or(Cell::new("").level(Level::Dim), value),
                value(row),
                if shift.is_finite() {
                    Cell::new(number(shift, 3)).level_if(shift.abs() > 3.0, Level::Warn)
                } else {
                    Cell::new(if old.is_none() { "new" } else { "" })
                },
                Cell::new(table.text("stop", row))
                    .level_if(table.text("stop", row) != "converged", Level::Bad),
            ]);
        }
    }
    grid.note = Some("The estimate of the pipeline and the same one with the amended model, over all its maneuvers.".into());
    grid.or_missing("Nothing was estimated again.")
}

/// Root mean square of the residuals of both, output by output over all maneuvers.
pub fn residuals(next_models: Option<&Columns>, residuals: Option<&Columns>) -> Grid {
    let mut grid =
        Grid::new(["estimate", "output", "#r.m.s. as it was", "#with what was added", "#left|%"]);
    let Some(table) = residuals else { return Grid::missing("Nothing was estimated again.") };
    let rms = |model: &str, output: &str| {
        let these = (0..table.rows())
            .filter(|&r| table.text("model", r) == model && table.text("output", r) == output);
        let (square, n) = these.fold((0.0, 0.0), |(square, n), r| {
            let (rms, count) = (table.number("rms", r), table.number("n", r));
            (square + count * rms * rms, n + count)
        });
        (square / n).sqrt()
    };
    for [_, estimate, next] in pairs(next_models) {
        for ([model, output], rows) in table.groups(["model", "output"]) {
            if model != next {
                continue;
            }
            let (before, after) = (rms(&estimate, &output), rms(&next, &output));
            grid.push(vec![
                Cell::new(&estimate),
                Cell::new(&output)
                    .under(rows.first().map_or(String::new(), |&r| table.unit_in("unit", r))),
                Cell::new(number(before, 3)),
                Cell::new(number(after, 3)),
                Cell::new(number(100.0 * after / before, 3)),
            ]);
        }
    }
    grid.or_missing("Nothing was estimated again.")
}
