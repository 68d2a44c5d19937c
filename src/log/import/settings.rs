//! The settings of an import: what a description says of its files and of the logs that become of
//! them.

use super::clock::TIME_OF_DAY;
use crate::config::Doc;
use crate::error::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// In `names`: every file that there is.
pub const ALL: &str = "*";

/// Describes a file of columns (text, MATLAB 5 MAT, Parquet) or of messages (PX4's ULog), and the log
/// that becomes of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Import {
    /// Several files of the same layout: each name takes the place of `{name}` in `input`, `output`,
    /// `variable` and every `matrix`. `["*"]` stands for all files there are: those that `input`
    /// fits with some name.
    #[serde(default)]
    pub names: Vec<String>,
    /// Where the file may be, relative to this file; `$NAME` at the start stands for an environment
    /// variable. The first file that exists is read (with names = ["*"], the first place that has
    /// any).
    pub input: Vec<String>,
    /// The matrix of a MAT file whose columns are meant where only their number is given; not needed
    /// where it is the only one.
    #[serde(default)]
    pub variable: Option<String>,
    /// What a signal is in a matrix of a MAT file: a column of it, or a row; `column` gives the number
    /// of either.
    #[serde(default)]
    pub signals: Along,
    /// The log to write, relative to this file.
    pub output: String,
    /// Where the data come from and how to get them; part of the message when no input is found.
    #[serde(default)]
    pub source: String,
    /// What stands between two columns of a text file.
    #[serde(default)]
    pub separator: Separator,
    /// How numbers are written in a text file.
    #[serde(default)]
    pub decimal: Decimal,
    /// What stands in a cell without a value, besides nothing: `["n/a", "-9999"]`. A number is one in
    /// every kind of file, however it is written there (-9999.0).
    #[serde(default)]
    pub missing: Vec<String>,
    /// Lines before the data. With names in one of them, columns may be given by name.
    #[serde(default)]
    pub header_lines: usize,
    /// The line (from 1) that has the names, where it is not the last one before the data: units may
    /// stand below them.
    #[serde(default)]
    pub names_line: Option<usize>,
    /// The time of all topics that have none of their own. The messages of a ULog bear theirs.
    #[serde(default)]
    pub time: Option<Time>,
    /// The topics of the log.
    pub topic: Vec<Topic>,
}

/// What stands between two columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Separator {
    /// Any number of blanks or tabs.
    #[default]
    Whitespace,
    Comma,
    Semicolon,
    Tab,
}

/// How numbers are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Decimal {
    /// `1.5`
    #[default]
    Point,
    /// `1,5`
    Comma,
}

/// How a matrix holds signals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Along {
    #[default]
    Columns,
    Rows,
}

/// Time: a column, or a rate for data without one.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Time {
    /// Number (from 1) or name of the column; in a MAT file the name of a vector (`data.t` in a
    /// structure); in a ULog another field than `timestamp`.
    #[serde(default)]
    pub column: Option<Column>,
    /// The matrix of a MAT file that has the column of this number.
    #[serde(default)]
    pub matrix: Option<String>,
    /// Unit of the column, for example "s" or "ms"; "iso8601" for dates with times, such as
    /// 2024-05-06T10:00:00.25Z (UTC where they name no zone); "hh:mm:ss" for times of day, such as
    /// 10:00:00.25, or 127:10:00:00.25 with the day of the year before it (`start_s` is the start of
    /// that day or year, where it is to be known); "excel" for Excel's days, "datenum" for MATLAB's.
    /// Timestamps of Parquet have theirs, and those of a ULog are microseconds.
    #[serde(default)]
    pub unit: Option<String>,
    /// Rows per second, Hz, where there is no column of time: the first row is at time zero.
    #[serde(default)]
    pub rate_hz: Option<f64>,
    /// Seconds from 1970 to time zero of the column, where that is known.
    #[serde(default)]
    pub start_s: f64,
}

/// A column by its number (from 1) or by its name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Column {
    Number(usize),
    Name(String),
}

/// A topic of the log and the columns that go into it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Topic {
    /// For example "/air_data".
    pub name: String,
    /// The messages of a ULog that it is made from, for example "vehicle_attitude".
    #[serde(default)]
    pub from: Option<String>,
    /// Which of several sensors or estimators of the same message, from 0.
    #[serde(default)]
    pub instance: u8,
    /// Its own time, where several clocks have written into one file. Rows without such a time are
    /// none of this topic.
    #[serde(default)]
    pub time: Option<Time>,
    /// The fields, in the order of the message.
    pub fields: Vec<Field>,
}

/// One column as a field of a topic. Numbers are copied as they are, in their unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Field {
    /// Number (from 1) or name of the column; in a MAT file the name of a vector (`data.alpha` in a
    /// structure); in a ULog the field of the message, such as "rollspeed" or "q[0]".
    pub column: Column,
    /// The matrix of a MAT file that has the column of this number.
    #[serde(default)]
    pub matrix: Option<String>,
    /// Name of the field in the message.
    pub name: String,
    /// Unit of the numbers, for example "deg" or "m/s". Where the header of a text, or the name of the column,
    /// says another one in brackets, that is an error, unless `despite` says so.
    pub unit: String,
    /// The unit that the header says where that is wrong and `unit` is right: unit = "rad", despite = "deg".
    #[serde(default)]
    pub despite: Option<String>,
    /// What it is, with its sign convention.
    #[serde(default)]
    pub doc: String,
}

impl Field {
    /// The mistake of a field, which stands at `key`, whose column is in another unit by the file.
    pub fn other_unit(&self, doc: &Doc, key: &str, other: &str) -> Error {
        let column = match &self.column {
            Column::Number(n) => n.to_string(),
            Column::Name(name) => format!("\"{name}\""),
        };
        let unit = &self.unit;
        let what =
            format!("column {column} is in \"{other}\" by the header, but unit = \"{unit}\"");
        doc.error(&format!("{key}.unit"), what).help(format!(
            "write unit = \"{other}\"; where the header is wrong, keep unit = \"{unit}\" and add despite = \"{other}\""
        ))
    }
}

impl Import {
    /// Whether any column is given by its name.
    pub fn has_names(&self) -> bool {
        let is_name = |column: &Column| matches!(column, Column::Name(_));
        let times = self.time.iter().chain(self.topic.iter().filter_map(|t| t.time.as_ref()));
        self.topic.iter().flat_map(|t| &t.fields).any(|f| is_name(&f.column))
            || times.filter_map(|t| t.column.as_ref()).any(is_name)
    }

    /// Whether a number stands for a missing value.
    pub fn says_missing(&self, number: f64) -> bool {
        let is = |m: &String| fast_float2::parse::<f64, _>(m).is_ok_and(|m| m == number);
        !self.missing.is_empty() && self.missing.iter().any(is)
    }

    /// The time of a topic, and whether it is its own.
    pub fn time_of<'a>(&'a self, topic: &'a Topic) -> (Option<&'a Time>, bool) {
        (topic.time.as_ref().or(self.time.as_ref()), topic.time.is_some())
    }

    /// The start of the day of a topic whose clock tells the time of day, s since 1970; none for other
    /// clocks.
    pub fn day_of(&self, topic: &Topic) -> Option<f64> {
        let time = self.time_of(topic).0?;
        (time.unit.as_deref() == Some(TIME_OF_DAY)).then_some(time.start_s)
    }
}
