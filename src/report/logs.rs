//! `channels`, `biases` and `notes` in, their tables and what the checks say about them out.

use super::columns::Columns;
use super::format::{count, few, number, plain, with_sd};
use super::grid::{Cell, Grid, Level};
use super::place::On;
use super::section::{Body, Section};

pub const CHANNELS: Section = Section {
    id: "channels",
    heading: "Channels as read from the logs",
    on: On::Flights,
    tables: &["channels"],
    build: |given| Ok(Some(Body::grid(channels(given.get("channels"))))),
};

pub const BIASES: Section = Section {
    id: "biases",
    heading: "Sensor biases from flight-path reconstruction",
    on: On::Flights,
    tables: &["biases", "consistency"],
    build: |given| Ok(Some(Body::grid(biases(given.get("biases"), given.get("consistency"))))),
};

pub const NOTES: Section = Section {
    id: "notes",
    heading: "Notes",
    on: On::Both,
    tables: &["notes"],
    build: |given| Ok(Some(Body::grid(notes(given.get("notes"))))),
};

/// Counts of what was lost, with the words for them.
const DROPPED: [(&str, &str); 9] = [
    ("dropped_duplicate", "duplicate"),
    ("dropped_out_of_order", "out of order"),
    (REORDERED, "reordered"),
    ("dropped_nan", "NaN"),
    ("dropped_unreadable", "unreadable"),
    ("dropped_out_of_range", "out of range"),
    ("dropped_spikes", "spikes"),
    ("dropped_still", "standing still"),
    ("dropped_times", "wrong times"),
];
/// Put in order again, and not lost.
const REORDERED: &str = "reordered";
/// A gap is remarkable when it is longer than this many sample periods.
const LONG_GAP: f64 = 10.0;

/// The account of channels: rates, gaps, what was dropped.
pub fn channels(table: Option<&Columns>) -> Grid {
    let Some(table) = table else {
        return Grid::missing("No account of channels: the ingest stage has not run.");
    };
    let any = |name: &str| table.column(name).iter().any(|n| *n > 0.0);
    let still = any("still_to_s");
    let (present, absent): (Vec<_>, Vec<_>) = DROPPED.into_iter().partition(|(name, _)| any(name));
    let mut columns: Vec<String> =
        ["flight", "signal", "~topic and field", "unit", "#samples", "#rate|Hz", "#longest gap|s"]
            .map(String::from)
            .into();
    columns.extend(present.iter().map(|(_, words)| format!("#{words}")));
    columns.extend(still.then(|| "#stands still|s".to_string()));
    columns.extend(["#from|s", "#to|s", "#min", "#max"].map(String::from));
    let mut grid = Grid::new(columns);
    for row in 0..table.rows() {
        let mut cells: Vec<Cell> =
            ["flight", "signal"].map(|name| Cell::new(table.text(name, row))).into();
        cells.extend([
            Cell::new(format!("{} {}", table.text("topic", row), table.text("field", row))),
            table.unit_in("unit", row).into(),
            plain(table.number("count", row), 0).into(),
            plain(table.number("rate_hz", row), 1).into(),
            Cell::new(plain(table.number("longest_gap_s", row), 3))
                .level_if(long_gap(table, row), Level::Warn),
        ]);
        cells.extend(present.iter().map(|(name, _)| {
            let n = table.number(name, row);
            Cell::new(plain(n, 0)).level_if(many_dropped(table, name, row), Level::Warn)
        }));
        if still {
            let lasts = table.number("still_to_s", row) - table.number("still_from_s", row);
            cells.push(
                Cell::new(if lasts.is_finite() { plain(lasts, 1) } else { String::new() })
                    .level_if(lasts > 0.0, Level::Warn),
            );
        }
        cells.extend(
            ["t_first_s", "t_last_s"].map(|name| Cell::new(plain(table.number(name, row), 1))),
        );
        cells.extend(["min", "max"].map(|name| Cell::new(number(table.number(name, row), 4))));
        grid.push(cells);
    }
    if !absent.is_empty() {
        let words: Vec<&str> = absent.iter().map(|(_, words)| *words).collect();
        grid.note = Some(format!("No sample was {}.", words.join(", ")));
    }
    grid.or_missing("The account of channels is empty.")
}

/// Whether what was dropped is more than one sample in a thousand; what was put in order again is
/// not lost.
fn many_dropped(table: &Columns, name: &str, row: usize) -> bool {
    name != REORDERED && table.number(name, row) > 1e-3 * table.number("count", row)
}

fn long_gap(table: &Columns, row: usize) -> bool {
    table.number("longest_gap_s", row) * table.number("rate_hz", row) > LONG_GAP
}

/// The sentence of the checks about what the logs lost.
pub fn losses(table: Option<&Columns>) -> Option<(Level, String)> {
    let table = table.filter(|t| t.rows() > 0)?;
    let total = |name: &str| table.column(name).iter().filter(|v| v.is_finite()).sum::<f64>();
    let lost = DROPPED.iter().filter(|(name, _)| total(name) > 0.0);
    let lost: Vec<String> =
        lost.map(|(name, words)| format!("{} {words}", plain(total(name), 0))).collect();
    let gaps: Vec<String> = (0..table.rows())
        .filter(|&row| long_gap(table, row))
        .map(|row| format!("{} {}", table.text("flight", row), table.text("signal", row)))
        .collect();
    let many =
        (0..table.rows()).any(|row| DROPPED.iter().any(|(name, _)| many_dropped(table, name, row)));
    let mut sentences = Vec::new();
    if !lost.is_empty() {
        let dropped = DROPPED.iter().filter(|(name, _)| *name != REORDERED);
        let all = total("count") + dropped.map(|(name, _)| total(name)).sum::<f64>();
        sentences.push(format!(
            "Samples not taken as they came: {} (of {}).",
            lost.join(", "),
            plain(all, 0)
        ));
    }
    sentences.push(match gaps.as_slice() {
        [] => format!(
            "No gap in the {} is longer than {LONG_GAP} sample periods.",
            count(table.rows(), "channel")
        ),
        gaps => format!("Gaps longer than {LONG_GAP} sample periods in {}.", few(gaps)),
    });
    let level = if many || !gaps.is_empty() { Level::Warn } else { Level::Good };
    Some((level, sentences.join(" ")))
}

/// Sensor biases, summed up over the windows of a flight: a spread far above the sd says that a
/// bias drifts.
pub fn biases(table: Option<&Columns>, consistency: Option<&Columns>) -> Grid {
    if let Some(grid) = consistency.and_then(decided) {
        return grid;
    }
    let Some(table) = table else {
        return Grid::missing(
            "No biases: the reconstruct stage has not run, or this campaign has none.",
        );
    };
    let columns = [
        "flight",
        "parameter",
        "unit",
        "#windows",
        "#mean",
        "#sd of one window",
        "#spread of windows",
        "#smallest",
        "#largest",
    ];
    let mut grid = Grid::new(columns);
    for ([flight, parameter, unit], rows) in table.groups(["flight", "parameter", "unit"]) {
        let values = sorted(rows.iter().map(|&row| table.number("value", row)));
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let spread =
            (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0)).sqrt();
        let sds = sorted(rows.iter().map(|&row| table.number("sd", row)));
        let sd = sds.get(sds.len() / 2).copied().unwrap_or(f64::NAN);
        let ends = [values.first(), values.last()]
            .map(|v| Cell::new(number(v.copied().unwrap_or(f64::NAN), 3)));
        let mut cells: Vec<Cell> = [flight, parameter, unit].map(Cell::new).into();
        cells.extend([
            rows.len().to_string().into(),
            with_sd(mean, sd).0.into(),
            number(sd, 2).into(),
            number(spread, 2).into(),
        ]);
        cells.extend(ends);
        grid.push(cells);
    }
    let note = "SI units, angles in rad: the value is subtracted from the measured channel. Sd: median over the windows. Each window is in \
                the table biases.";
    grid.note = Some(note.into());
    grid.or_missing("No bias was estimated.")
}

/// Sensor errors with what was decided of each; none where nothing was.
fn decided(checks: &Columns) -> Option<Grid> {
    let mut grid =
        Grid::new(["flight", "sensor error", "unit", "#value", "#sd", "verdict", "~what it is"]);
    for row in (0..checks.rows()).filter(|&row| checks.text("check", row) == "sensor error") {
        // the limits are two standard deviations on either side
        let sd = (checks.number("high", row) - checks.number("low", row)) / 4.0;
        let verdict = checks.text("verdict", row);
        let mut cells: Vec<Cell> =
            ["flight", "channel", "unit"].map(|name| Cell::new(checks.text(name, row))).into();
        cells.extend([with_sd(checks.number("value", row), sd).0.into(), number(sd, 2).into()]);
        cells.push(if verdict == "not observable" {
            Cell::new(verdict).level(Level::Warn)
        } else {
            Cell::new(verdict)
        });
        cells.push(checks.text("text", row).into());
        grid.push(cells);
    }
    let note = "SI units, angles in rad. Significant: more than two standard deviations from what was assumed before. Not observable: these \
                data hardly say more than was assumed.";
    grid.note = Some(note.into());
    (!grid.rows.is_empty()).then_some(grid)
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Counted notes of every stage.
pub fn notes(table: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("No table of notes.") };
    let mut grid = Grid::new(["flight", "stage", "severity", "subject", "#count", "~note"]);
    for row in 0..table.rows() {
        let mut cells: Vec<Cell> = ["flight", "stage", "severity", "subject"]
            .map(|name| Cell::new(table.text(name, row)))
            .into();
        cells.extend([
            Cell::new(plain(table.number("count", row), 0)),
            table.text("text", row).into(),
        ]);
        grid.push(cells);
        if let Some(last) = grid.rows.last_mut() {
            last.level = severity(table, row);
        }
    }
    grid.or_missing("Nothing to note.")
}

/// How remarkable a note is.
pub fn severity(table: &Columns, row: usize) -> Option<Level> {
    match table.text("severity", row).as_str() {
        "warning" => Some(Level::Warn),
        "error" | "missing" | "problem" => Some(Level::Bad),
        _ => None,
    }
}

/// The sentence of the checks about notes.
pub fn remarks(table: Option<&Columns>) -> Option<(Level, String)> {
    let table = table?;
    let of = |severity: &str| {
        (0..table.rows()).filter(|&row| table.text("severity", row) == severity).count()
    };
    let kinds = [("problem", "problem"), ("missing", "missing result"), ("warning", "warning")];
    let counts = kinds.map(|(severity, what)| (of(severity), what));
    let named: Vec<String> =
        counts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| count(*n, what)).collect();
    let level = match counts {
        [(0, _), (0, _), (0, _)] => {
            return Some((Level::Good, "No stage has left a warning.".into()));
        }
        [(0, _), (0, _), _] => Level::Warn,
        _ => Level::Bad,
    };
    let (last, others) = named.split_last()?;
    let others = others.join(", ");
    let and = if others.is_empty() { "" } else { " and " };
    Some((level, format!("The notes name {others}{and}{last}.")))
}
