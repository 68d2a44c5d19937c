//! `estimates` and `correlations` in, the tables of estimates and what the checks say about them
//! out.

use super::columns::Columns;
use super::correlations::CLOSE;
use super::format::{count, every, few, number, plus_minus};
use super::grid::{Cell, Grid, Level};
use super::maneuvers::name;
use super::place::On;
use super::section::{Body, Section};
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "estimates",
    heading: "Estimates",
    on: On::Both,
    tables: &["estimates"],
    build: |given| {
        Ok(Some(Body::new(include_str!("html/estimates.html"), estimates(given.get("estimates")))))
    },
};

/// The estimates of the page: one table per model and group.
#[derive(Debug, Default, Serialize)]
pub struct Estimates {
    pub missing: Option<String>,
    pub tables: Vec<Table>,
}

#[derive(Debug, Serialize)]
pub struct Table {
    pub heading: String,
    pub grid: Grid,
}

/// Stop reason of an estimate that reached its minimum.
const CONVERGED: &str = "converged";
/// More parameters than this are listed below each other, not side by side.
const WIDE: usize = 8;

/// Tables of estimates: maneuvers down and parameters across where there are many maneuvers, else
/// one row per parameter.
pub fn estimates(table: Option<&Columns>) -> Estimates {
    let Some(table) = table.filter(|t| t.rows() > 0) else {
        return Estimates {
            missing: Some(
                "No estimate: the estimate stage has not run, or no maneuver was found.".into(),
            ),
            tables: Vec::new(),
        };
    };
    // One estimate per maneuver is one group per maneuver: those belong into one table per model.
    let mut tables = Vec::new();
    for ([model], rows) in table.groups(["model"]) {
        let parameters: Vec<String> =
            names(table, &rows).into_iter().filter(|name| !is_initial(name)).collect();
        let runs = runs(table, &model);
        let grid = if parameters.len() <= WIDE && runs.len() > 1 {
            across(table, &parameters, &runs)
        } else {
            down(table, &runs)
        };
        tables.push(Table { heading: model, grid });
    }
    Estimates { missing: None, tables }
}

/// Whether a parameter is the initial value of a state, as `x(0)`.
fn is_initial(name: &str) -> bool {
    name.ends_with("(0)")
}

/// Parameter names in order of first appearance.
fn names(table: &Columns, rows: &[usize]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for &row in rows {
        let name = table.text("parameter", row);
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

/// The segment or the group of segments of a row, as `flap 15`; empty for one value for all.
fn place(table: &Columns, row: usize) -> String {
    let (segment, of) = (table.text("segment", row), table.text("of", row));
    if segment.is_empty() && !of.is_empty() {
        format!("{} {of}", table.text("per", row))
    } else {
        segment
    }
}

/// One estimate of all parameters, or of those of one segment (or group of them) of it: its name
/// and its rows.
struct Run {
    name: String,
    rows: Vec<usize>,
}

/// The runs of a model, groups in order of first appearance. A group of one segment is one run: its
/// quantities are all of that segment.
fn runs(table: &Columns, model: &str) -> Vec<Run> {
    let mut runs = Vec::new();
    for ([_, group], rows) in
        table.groups(["model", "group"]).into_iter().filter(|([m, _], _)| m == model)
    {
        let mut segments: Vec<String> = Vec::new();
        for segment in rows.iter().map(|&row| place(table, row)) {
            if !segments.contains(&segment) {
                segments.push(segment);
            }
        }
        if segments.iter().filter(|s| !s.is_empty()).count() < 2 {
            let segment = segments.into_iter().find(|s| !s.is_empty()).unwrap_or_default();
            runs.push(Run { name: name(&group, &segment), rows });
            continue;
        }
        for segment in segments {
            let rows = rows.iter().copied().filter(|&row| place(table, row) == segment).collect();
            runs.push(Run { name: name(&group, &segment), rows });
        }
    }
    runs
}

fn across(table: &Columns, parameters: &[String], runs: &[Run]) -> Grid {
    let unit = |name: &String| {
        let row =
            runs.iter().flat_map(|run| &run.rows).find(|&&r| table.text("parameter", r) == *name);
        row.map_or(String::new(), |&r| table.unit_in("unit", r))
    };
    let mut columns: Vec<String> = vec!["maneuver".into()];
    columns.extend(parameters.iter().map(|name| format!("#{name}|{}", unit(name))));
    columns.push("stop".into());
    let mut grid = Grid::new(columns);
    for run in runs {
        let Some(&first) = run.rows.first() else { continue };
        let mut cells = vec![Cell::new(&run.name)];
        for name in parameters {
            let row = run.rows.iter().copied().find(|&r| table.text("parameter", r) == *name);
            cells.push(row.map_or(Cell::default(), |row| value(table, row)));
        }
        cells.push(stop(table, first));
        grid.push(cells);
        mark_failed(&mut grid, table, first);
    }
    grid
}

fn down(table: &Columns, runs: &[Run]) -> Grid {
    let mut grid = Grid::new([
        "maneuver",
        "parameter",
        "unit",
        "#value",
        "#sd",
        "#CR",
        "#sd / CR",
        "#total",
        "#start",
        "stop",
    ]);
    let listed = |row: &usize| !is_initial(&table.text("parameter", *row));
    for (run, row) in runs
        .iter()
        .flat_map(|run| run.rows.iter().copied().filter(listed).map(move |row| (run, row)))
    {
        let (sd, bound) = (table.number("sd", row), table.number("sd_crlb", row));
        let mut cells = vec![Cell::new(&run.name)];
        cells.extend(["parameter", "unit"].map(|name| Cell::new(table.text(name, row))));
        cells.extend([
            plus_minus(table.number("value", row), sd).into(),
            number(sd, 2).into(),
            number(bound, 2).into(),
            number(sd / bound, 2).into(),
            number(table.number("sd_total", row), 2).into(),
            number(table.number("start", row), 4).into(),
            stop(table, row),
        ]);
        grid.push(cells);
        mark_failed(&mut grid, table, row);
    }
    grid
}

fn value(table: &Columns, row: usize) -> Cell {
    let (sd, bound, total) =
        (table.number("sd", row), table.number("sd_crlb", row), table.number("sd_total", row));
    let text = plus_minus(table.number("value", row), sd);
    let more =
        if total > 1.005 * sd { format!(", total {}", number(total, 2)) } else { String::new() };
    let below = format!("sd {}, CR {}{more}", number(sd, 2), number(bound, 2));
    match (sd.is_finite(), is_at_bound(table, row)) {
        (true, _) => Cell::new(text).under(below),
        (false, true) => Cell::new(text).under("on its bound").level(Level::Warn),
        (false, false) => Cell::new(text),
    }
}

fn stop(table: &Columns, row: usize) -> Cell {
    Cell::new(table.text("stop", row))
}

fn mark_failed(grid: &mut Grid, table: &Columns, row: usize) {
    if !converged(table, row)
        && let Some(last) = grid.rows.last_mut()
    {
        last.level = Some(Level::Bad);
    }
}

pub fn converged(table: &Columns, row: usize) -> bool {
    table.text("stop", row) == CONVERGED
}

/// How many estimations there are, and how many of them converged.
pub fn counts(table: Option<&Columns>) -> (usize, usize) {
    let Some(table) = table else { return (0, 0) };
    let groups = table.groups(["model", "group"]);
    let good = groups.iter().filter(|(_, rows)| rows.iter().all(|&r| converged(table, r))).count();
    (groups.len(), good)
}

/// The sentence of the checks about convergence.
pub fn convergence(table: Option<&Columns>) -> Option<(Level, String)> {
    let table = table?;
    let (all, good) = counts(Some(table));
    if all == 0 {
        return None;
    }
    if good == all {
        let bound = at_bound(table);
        let level = if bound.is_empty() { Level::Good } else { Level::Warn };
        let said = match bound.is_empty() {
            true => String::new(),
            false => format!(
                " On a bound, so without sd, and with the others' sd as if they were known there: {}.",
                few(&bound)
            ),
        };
        return Some((level, format!("{} converged.{said}", every(all, "estimation"))));
    }
    let groups = table.groups(["model", "group"]);
    let failed = groups.iter().filter(|(_, rows)| !rows.iter().all(|&r| converged(table, r)));
    let names: Vec<String> = failed
        .map(|(key, rows)| {
            format!(
                "{} ({})",
                key.join(" "),
                rows.first().map_or(String::new(), |&r| table.text("stop", r))
            )
        })
        .collect();
    Some((
        Level::Bad,
        format!("{} did not converge: {}.", count(all - good, "estimation"), few(&names)),
    ))
}

fn is_at_bound(table: &Columns, row: usize) -> bool {
    table.flag("at_bound", row).unwrap_or(false)
}

/// Parameters on a bound, and in how many estimations; none of something (a bound of zero) is a result.
fn at_bound(table: &Columns) -> Vec<String> {
    let on = |row: &usize| is_at_bound(table, *row) && table.number("value", *row) != 0.0;
    let groups = table.groups(["model", "parameter"]);
    let one = |([model, parameter], rows): ([String; 2], Vec<usize>)| {
        let count = rows.iter().filter(|row| on(row)).count();
        (count > 0).then(|| format!("{parameter} of {model} ({count} of {})", rows.len()))
    };
    groups.into_iter().filter_map(one).collect()
}

/// The sentence of the checks about coloured residuals: how far the corrected sd stands above the
/// plain bound.
pub fn colour(table: Option<&Columns>) -> Option<(Level, String)> {
    let table = table?;
    let ratio = |row: usize| table.number("sd", row) / table.number("sd_crlb", row);
    let mut ratios: Vec<f64> =
        (0..table.rows()).map(ratio).filter(|r| r.is_finite() && *r > 0.0).collect();
    ratios.sort_by(f64::total_cmp);
    let (median, most) = (*ratios.get(ratios.len() / 2)?, *ratios.last()?);
    let level = if most > ABSURD { Level::Warn } else { Level::Info };
    let tail = match (median > COLOURED, most > COLOURED) {
        _ if most > ABSURD => {
            "no colour makes so much of it: the weights of outputs that go together are nearly singular (`noise = \"full\"`?), and such standard deviations say nothing."
        }
        (true, _) => {
            "the residuals are coloured, and the plain bound would be too optimistic by that factor."
        }
        (false, true) => "most residuals are close to white, and some are coloured.",
        (false, false) => "the residuals are close to white.",
    };
    Some((
        level,
        format!(
            "The standard deviations are {} times the plain Cramér-Rao bound (median; {} at most): {tail}",
            number(median, 2),
            number(most, 2)
        ),
    ))
}

/// More than so many times the plain bound, and a standard deviation says nothing. *Convention*: slow errors of
/// sensors in long records make some tens.
const ABSURD: f64 = 200.0;
/// More than so many times the plain bound, and residuals are not close to white.
const COLOURED: f64 = 1.5;

/// The sentence of the checks about parameter pairs the data hardly separate.
pub fn separation(correlations: Option<&Columns>) -> Option<(Level, String)> {
    let table = correlations?;
    let name =
        |row: usize| format!("{} and {}", table.text("parameter", row), table.text("other", row));
    let nuisance = |row: usize| {
        is_initial(&table.text("parameter", row)) && is_initial(&table.text("other", row))
    };
    let close = |row: &usize| table.number("value", *row).abs() > CLOSE && !nuisance(*row);
    let mut pairs: Vec<String> = (0..table.rows()).filter(close).map(name).collect();
    pairs.sort();
    pairs.dedup();
    Some(if pairs.is_empty() {
        (Level::Good, format!("No two parameters of an estimation are correlated above {CLOSE}."))
    } else {
        (
            Level::Warn,
            format!(
                "Correlated above {CLOSE} in some estimation, so hardly separable there: {}.",
                few(&pairs)
            ),
        )
    })
}
