//! `adequacy` in; what each estimate leaves of its outputs, and what the checks say about it, out.

use super::columns::Columns;
use super::format::{few, number, plain};
use super::grid::{Cell, Grid, Level};
use super::place::On;
use super::section::{Body, Section};
use crate::signal::adequacy::{COLOUR, Leaves, SHARE, WORSE, words};

pub const SECTION: Section = Section {
    id: "matches",
    heading: "What each estimate leaves",
    on: On::Both,
    tables: &["adequacy"],
    build: |given| {
        let grid = grid(given.get("adequacy"));
        Ok((!grid.rows.is_empty()).then(|| Body::grid(grid)))
    },
};

fn is_poor(table: &Columns, row: usize) -> bool {
    table.text("leaves", row) == Leaves::More.as_str()
}

/// One row for each output of each estimate: of several flights the one of which most is left.
pub fn grid(table: Option<&Columns>) -> Grid {
    let note = "Where noise drives the model, what its filter takes for noise of the sensors is looked at. What is left and goes with an input is \
         missing in the model: koehler diagnose looks for it. What goes with none may be turbulence: standard deviations of output error are too small \
         then, and a model whose states have `noise` is estimated by filter error.";
    let worst: Vec<usize> = table.iter().flat_map(|t| worst(t)).map(|(row, _)| row).collect();
    judged(table, &worst, ["model", "flight"].as_slice(), &[], note)
}

/// Per model and output the flight of which most is left, and of how many others more than noise is.
fn worst(table: &Columns) -> Vec<(usize, usize)> {
    let share = |row: usize| {
        let share = table.number("share", row);
        // Nothing was measured to vary: all of it is left, or nothing can be told.
        if share.is_nan() && is_poor(table, row) { f64::INFINITY } else { share }
    };
    let key = |row: usize| (is_poor(table, row), share(row));
    let most = |rows: &[usize]| {
        let poor = rows.iter().filter(|&&row| is_poor(table, row)).count();
        let more = |a: &usize, b: &usize| {
            let (a, b) = (key(*a), key(*b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        };
        rows.iter().copied().max_by(more).map(|row| (row, poor.saturating_sub(1)))
    };
    table.groups(["model", "output"]).iter().filter_map(|(_, rows)| most(rows)).collect()
}

/// One row for each output of each diagnosis.
pub fn unexplained(table: Option<&Columns>) -> Grid {
    let note = "Foretold is the share of it that its own past tells; turbulence the share that noise driving the model explains.";
    let rows: Vec<usize> = (0..table.map_or(0, Columns::rows)).collect();
    judged(table, &rows, &["diagnosis"], &["foretold", "turbulence"], note)
}

/// Densities of noise that was let drive a model.
pub fn turbulence(table: Option<&Columns>) -> Grid {
    let Some(table) = table.filter(|t| t.rows() > 0) else {
        return Grid::missing("No noise was let drive a model.");
    };
    let mut grid = Grid::new([
        "diagnosis",
        "noise in the rate of",
        "#root of its density",
        "#sd",
        "#lasts (s)",
        "#sd",
        "accounts",
    ]);
    for row in 0..table.rows() {
        let value = |name: &str| number(table.number(name, row), 3);
        grid.push(vec![
            table.text("diagnosis", row).into(),
            table.text("state", row).into(),
            Cell::new(value("density")).under(table.text("unit", row)),
            value("sd").into(),
            value("lasts").into(),
            value("lasts_sd").into(),
            table.text("accounts", row).into(),
        ]);
    }
    grid
}

fn judged(
    table: Option<&Columns>,
    rows: &[usize],
    of: &[&str],
    shares: &[&str],
    note: &str,
) -> Grid {
    let mut columns: Vec<String> = of.iter().map(ToString::to_string).collect();
    columns.extend(
        [
            "output",
            "#sensor's noise",
            "#left",
            "#measured variation",
            "#beyond noise, part of variation|%",
            "#a mean|%",
            "#another size|%",
            "#another shape|%",
        ]
        .map(String::from),
    );
    columns.extend(shares.iter().map(|name| format!("#{name}|%")));
    columns.push("left is".into());
    let mut grid = Grid::new(columns);
    let Some(table) = table else { return grid };
    let percent = |name: &str, row: usize| plain(100.0 * table.number(name, row), 1);
    for &row in rows {
        let unit = table.unit_in("unit", row);
        let value = |name: &str| Cell::new(number(table.number(name, row), 3)).under(&unit);
        let poor = is_poor(table, row);
        let mut cells: Vec<Cell> =
            of.iter().chain(&["output"]).map(|name| table.text(name, row).into()).collect();
        cells.extend(["noise", "left", "variation"].map(value));
        cells.push(Cell::new(percent("share", row)).level_if(poor, Level::Warn));
        cells.extend(["bias", "size", "shape"].map(|name| Cell::new(percent(name, row))));
        cells.extend(shares.iter().map(|name| Cell::new(percent(name, row))));
        cells.push(Cell::new(table.text("leaves", row)).level_if(poor, Level::Warn));
        grid.push(cells);
    }
    let note = format!(
        "Over all maneuvers of a flight; of several flights the one of which most is left. A model that is right leaves its sensors' noise, read from the fast part of the measurement; twice that may be slow noise. \
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
    let told = |(row, _): &(usize, usize)| table.text("leaves", *row) != Leaves::Unmoved.as_str();
    let mut rows: Vec<(usize, usize)> = worst(table).into_iter().filter(told).collect();
    let share = |row: usize| table.number("share", row);
    rows.sort_by(|a, b| share(b.0).total_cmp(&share(a.0)));
    let name = |&(row, others): &(usize, usize)| {
        let of = ["output", "model", "flight"].map(|name| table.text(name, row));
        let left = words(share(row), table.number("variation", row));
        let more = if others > 0 { format!(" and {others} more") } else { String::new() };
        format!("{} of {} ({left}; {}{more})", of[0], of[1], of[2])
    };
    let worst = rows.first()?;
    let poor: Vec<&(usize, usize)> = rows.iter().filter(|(row, _)| is_poor(table, *row)).collect();
    let times = |row: usize| table.number("left", row) / table.number("noise", row);
    let beyond = |(row, _): &&(usize, usize)| table.text("leaves", *row) == Leaves::Little.as_str();
    let most = rows.iter().filter(beyond).max_by(|a, b| times(a.0).total_cmp(&times(b.0)));
    if let (true, Some(far)) = (poor.is_empty(), most) {
        let text = format!(
            "What the estimates leave is little beside the measured variation, but more than noise of the sensors: most of {}, {:.1} times its noise. \
             A term that is missing moves the others; diagnose tells whether one is.",
            name(far),
            times(far.0)
        );
        return Some((Level::Info, text));
    }
    if poor.is_empty() {
        let text = format!(
            "What the estimates leave is no more than noise of the sensors; most is left of {}.",
            name(worst)
        );
        return Some((Level::Good, text));
    }
    let is_worse = |(row, _): &&&(usize, usize)| !(share(*row) <= WORSE);
    let worse_than_none: Vec<String> = poor.iter().filter(is_worse).map(|row| name(row)).collect();
    if !worse_than_none.is_empty() {
        let text = format!(
            "Estimates are worse than no model: beyond noise of the sensors they leave, of the measured variation, {}. \
             Something basic is wrong there: a sign, a unit, an offset, a sensor, or another configuration.",
            few(&worse_than_none)
        );
        return Some((Level::Bad, text));
    }
    let poor: Vec<String> = poor.into_iter().map(name).collect();
    let text = format!(
        "Estimates leave more than noise of the sensors, and no noise in the model accounts for it (what is left beyond noise, of the measured variation): {}. \
         Their standard deviations suppose that it is noise.",
        few(&poor)
    );
    Some((Level::Warn, text))
}
