//! `channels`, `biases` and `notes` in, their tables and what the checks say about them out.

use super::columns::Columns;
use super::estimates::few;
use super::format::{count, number, plain, with_sd};
use super::grid::{Cell, Grid, Level};

/// Counts of what was lost, with the words for them.
const DROPPED: [(&str, &str); 5] = [
    ("dropped_duplicate", "duplicate"),
    ("dropped_out_of_order", "out of order"),
    ("reordered", "reordered"),
    ("dropped_nan", "NaN"),
    ("dropped_unreadable", "unreadable"),
];
/// A gap is remarkable when it is longer than this many sample periods.
const LONG_GAP: f64 = 10.0;

/// The account of channels: rates, gaps, what was dropped.
pub fn channels(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("No account of channels: the ingest stage has not run.") };
    let present: Vec<(&str, &str)> = DROPPED.into_iter().filter(|(name, _)| table.has(name)).collect();
    let mut columns: Vec<String> =
        ["flight", "signal", "~topic and field", "unit", "#samples", "#rate|Hz", "#longest gap|s"].map(String::from).into();
    columns.extend(present.iter().map(|(_, words)| format!("#{words}")));
    columns.extend(["#from|s", "#to|s", "#min", "#max"].map(String::from));
    let mut grid = Grid::new(columns);
    for row in 0..table.rows() {
        let mut cells: Vec<Cell> = ["flight", "signal"].map(|name| Cell::new(table.text(name, row))).into();
        cells.extend([
            Cell::new(format!("{} {}", table.text("topic", row), table.text("field", row))),
            table.text("unit", row).into(),
            plain(table.number("count", row), 0).into(),
            plain(table.number("rate_hz", row), 1).into(),
            Cell::new(plain(table.number("longest_gap_s", row), 3)).level_if(long_gap(table, row), Level::Warn),
        ]);
        cells.extend(present.iter().map(|(name, _)| {
            let n = table.number(name, row);
            Cell::new(plain(n, 0)).level_if(n > 0.0, Level::Warn)
        }));
        cells.extend(["t_first_s", "t_last_s"].map(|name| Cell::new(plain(table.number(name, row), 1))));
        cells.extend(["min", "max"].map(|name| Cell::new(number(table.number(name, row), 4))));
        grid.push(cells);
    }
    grid.or_missing("The account of channels is empty.")
}

fn long_gap(table: &Columns, row: usize) -> bool {
    table.number("longest_gap_s", row) * table.number("rate_hz", row) > LONG_GAP
}

/// The sentence of the checks about what the logs lost.
pub fn losses(table: Option<&Columns>) -> Option<(Level, String)> {
    let table = table.filter(|t| t.rows() > 0)?;
    let total = |name: &str| table.column(name).iter().filter(|v| v.is_finite()).sum::<f64>();
    let lost: Vec<String> =
        DROPPED.iter().filter(|(name, _)| total(name) > 0.0).map(|(name, words)| format!("{} {words}", total(name))).collect();
    let gap = |row: &usize| long_gap(table, *row);
    let gaps: Vec<String> =
        (0..table.rows()).filter(gap).map(|r| format!("{} {}", table.text("flight", r), table.text("signal", r))).collect();
    if lost.is_empty() && gaps.is_empty() {
        return Some((
            Level::Good,
            format!("No sample of the {} was dropped, and none has a long gap.", count(table.rows(), "channel")),
        ));
    }
    let mut sentences = Vec::new();
    if !lost.is_empty() {
        sentences.push(format!("Samples not taken as they came: {} (of {}).", lost.join(", "), plain(total("count"), 0)));
    }
    if !gaps.is_empty() {
        sentences.push(format!("Gaps longer than {LONG_GAP} sample periods in {}.", few(&gaps)));
    }
    Some((Level::Warn, sentences.join(" ")))
}

/// Sensor biases per flight and window.
pub fn biases(table: Option<&Columns>) -> Grid {
    let Some(table) = table else {
        return Grid::missing("No biases: the reconstruct stage has not run, or this campaign has none.");
    };
    let mut grid = Grid::new(["flight", "window", "#from|s", "#to|s", "parameter", "#value", "#sd", "unit", "#value / sd"]);
    for row in 0..table.rows() {
        let (value, sd) = (table.number("value", row), table.number("sd", row));
        let (text, sd_text) = with_sd(value, sd);
        let mut cells: Vec<Cell> = ["flight", "window"].map(|name| Cell::new(table.text(name, row))).into();
        cells.extend(["t_start_s", "t_end_s"].map(|name| Cell::new(plain(table.number(name, row), 1))));
        cells.extend([
            table.text("parameter", row).into(),
            text.into(),
            sd_text.unwrap_or("none".into()).into(),
            table.text("unit", row).into(),
            plain(value.abs() / sd, 1).into(),
        ]);
        grid.push(cells);
    }
    grid.note = Some("SI units, angles in rad: value is subtracted from the measured channel.".into());
    grid.or_missing("No bias was estimated.")
}

/// Counted notes of every stage.
pub fn notes(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("No table of notes.") };
    let mut grid = Grid::new(["flight", "stage", "severity", "~subject", "#count", "~note"]);
    for row in 0..table.rows() {
        let mut cells: Vec<Cell> = ["flight", "stage", "severity", "subject"].map(|name| Cell::new(table.text(name, row))).into();
        cells.extend([Cell::new(plain(table.number("count", row), 0)), table.text("text", row).into()]);
        grid.push(cells);
        if let Some(last) = grid.rows.last_mut() {
            last.level = severity(table, row);
        }
    }
    grid.or_missing("Nothing to note.")
}

fn severity(table: &Columns, row: usize) -> Option<Level> {
    match table.text("severity", row).as_str() {
        "warning" => Some(Level::Warn),
        "error" | "missing" => Some(Level::Bad),
        _ => None,
    }
}

/// The sentence of the checks about notes.
pub fn remarks(table: Option<&Columns>) -> Option<(Level, String)> {
    let table = table?;
    let of = |level: Level| (0..table.rows()).filter(|&row| severity(table, row) == Some(level)).count();
    let (errors, warnings) = (of(Level::Bad), of(Level::Warn));
    Some(match (errors, warnings) {
        (0, 0) => (Level::Good, "No stage has left a warning.".into()),
        (0, n) => (Level::Warn, format!("The notes name {}.", count(n, "warning"))),
        (n, 0) => (Level::Bad, format!("The notes name {}.", count(n, "missing result"))),
        (n, m) => (Level::Bad, format!("The notes name {} and {}.", count(n, "missing result"), count(m, "warning"))),
    })
}
