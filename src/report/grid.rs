//! A table of a page: columns, rows, cells and what is remarkable about them, in the form the
//! template draws.

use serde::Serialize;

/// How remarkable something is; the template turns it into a colour and, where it matters, a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    Good,
    Info,
    Warn,
    Bad,
    /// Left out: drawn pale.
    Dim,
}

#[derive(Debug, Clone, Serialize)]
pub struct Column {
    pub name: String,
    pub unit: Option<String>,
    pub numeric: bool,
    /// Whether long text is broken into lines.
    pub wrap: bool,
}

#[derive(Debug, Clone, Default, Serialize)]
pub struct Cell {
    pub text: String,
    /// A second, smaller line.
    pub sub: Option<String>,
    pub level: Option<Level>,
}

#[derive(Debug, Clone, Default, Serialize)]
pub struct Row {
    pub level: Option<Level>,
    /// What a click on the row selects (`m3`: maneuver 3 of the time histories).
    pub pick: Option<String>,
    pub cells: Vec<Cell>,
}

/// A table, or the sentence that says why there is none.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Grid {
    pub columns: Vec<Column>,
    pub rows: Vec<Row>,
    pub note: Option<String>,
    pub missing: Option<String>,
}

impl Grid {
    /// Columns from `"name"`, `"name|unit"`, `"#name|unit"` for numbers and `"~name"` for long
    /// text.
    pub fn new<S: AsRef<str>>(columns: impl IntoIterator<Item = S>) -> Self {
        let column = |text: S| {
            let text = text.as_ref();
            let (numeric, wrap) = (text.starts_with('#'), text.starts_with('~'));
            let (name, unit) = text
                .trim_start_matches(['#', '~'])
                .split_once('|')
                .unwrap_or((text.trim_start_matches(['#', '~']), ""));
            Column {
                name: name.into(),
                unit: (!unit.is_empty()).then(|| unit.into()),
                numeric,
                wrap,
            }
        };
        Grid { columns: columns.into_iter().map(column).collect(), ..Grid::default() }
    }

    pub fn missing(why: impl Into<String>) -> Self {
        Grid { missing: Some(why.into()), ..Grid::default() }
    }

    pub fn push(&mut self, cells: Vec<Cell>) {
        self.rows.push(Row { cells, ..Row::default() });
    }

    /// The grid, or the sentence `empty` when it has no row.
    pub fn or_missing(self, empty: &str) -> Self {
        if self.rows.is_empty() && self.missing.is_none() { Grid::missing(empty) } else { self }
    }
}

impl Cell {
    pub fn new(text: impl Into<String>) -> Self {
        Cell { text: text.into(), ..Cell::default() }
    }

    pub fn under(mut self, sub: impl Into<String>) -> Self {
        self.sub = Some(sub.into());
        self
    }

    pub fn level(mut self, level: Level) -> Self {
        self.level = Some(level);
        self
    }

    pub fn level_if(self, condition: bool, level: Level) -> Self {
        if condition { self.level(level) } else { self }
    }
}

impl<S: Into<String>> From<S> for Cell {
    fn from(text: S) -> Self {
        Cell::new(text)
    }
}
