//! Columns of text and a description of them in; an MCAP log out.

use super::write::{FieldSpec, LogWriter, Stream, TopicId};
use crate::config::{self, Doc};
use crate::error::{Error, Errors, Place};
use crate::units::Unit;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Describes a text file with one row per time and one column per quantity, and the log that becomes of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Import {
    /// Where the text file may be, relative to this file; `$NAME` at the start stands for an environment variable. The first file
    /// that exists is read.
    pub input: Vec<String>,
    /// The log to write, relative to this file.
    pub output: String,
    /// Where the data come from and how to get them; part of the message when no input is found.
    #[serde(default)]
    pub source: String,
    /// What stands between two columns.
    #[serde(default)]
    pub separator: Separator,
    /// Lines before the data. With names in the last of them, columns may be given by name.
    #[serde(default)]
    pub header_lines: usize,
    /// The column of time.
    pub time: TimeColumn,
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

/// The column of time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TimeColumn {
    /// Number (from 1) or name of the column.
    pub column: Column,
    /// Unit of the column, for example "s" or "ms".
    pub unit: String,
    /// Seconds from 1970 to time zero of the column, where that is known.
    #[serde(default)]
    pub start_s: f64,
}

/// A column by its number (from 1) or by its name in the header.
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
    /// The fields, in the order of the message.
    pub fields: Vec<Field>,
}

/// One column as a field of a topic. Numbers are copied as they are, in their unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Field {
    /// Number (from 1) or name of the column.
    pub column: Column,
    /// Name of the field in the message.
    pub name: String,
    /// Unit of the numbers, for example "deg" or "m/s".
    pub unit: String,
    /// What it is, with its sign convention.
    #[serde(default)]
    pub doc: String,
}

/// What an import has done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Imported {
    pub input: PathBuf,
    pub output: PathBuf,
    pub rows: usize,
    pub topics: usize,
    pub fields: usize,
}

impl std::fmt::Display for Imported {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let (rows, topics, fields) = (self.rows, self.topics, self.fields);
        write!(f, "{} -> {}: {rows} rows, {fields} fields in {topics} topics", self.input.display(), self.output.display())
    }
}

/// Imports what the description at `description` describes; `output` replaces the description's own.
///
/// # Errors
/// Mistakes in the description; no input found (the message says where it was looked for); rows that are no numbers.
pub fn run(description: &Path, output: Option<&Path>) -> Result<Imported, Errors> {
    let (settings, doc) = config::load::<Import>(description)?;
    check(&settings, &doc)?;
    let folder = description.parent().unwrap_or(Path::new(""));
    let input = find_input(&settings, &doc, folder)?;
    let text = config::read_text(&input)?;
    let output = output.map_or_else(|| folder.join(&settings.output), Path::to_path_buf);
    let rows = convert(&settings, &doc, &input.to_string_lossy(), &text, &output)?;
    let fields = settings.topic.iter().map(|t| t.fields.len()).sum();
    Ok(Imported { input, output, rows, topics: settings.topic.len(), fields })
}

fn check(settings: &Import, doc: &Doc) -> Result<(), Errors> {
    let mut errors = Errors::default();
    match Unit::parse(&settings.time.unit) {
        Ok(unit) if unit.dim == Unit::parse("s").map(|s| s.dim).unwrap_or_default() => {}
        Ok(_) => errors.push(doc.error("time.unit", format!("\"{}\" is no unit of time", settings.time.unit))),
        Err(e) => errors.push(doc.error("time.unit", e)),
    }
    let mut topics: Vec<&str> = Vec::new();
    for (i, topic) in settings.topic.iter().enumerate() {
        if topics.contains(&topic.name.as_str()) {
            errors.push(doc.error(&format!("topic.{i}.name"), format!("there are two topics \"{}\"", topic.name)));
        }
        topics.push(&topic.name);
        let mut fields: Vec<&str> = Vec::new();
        for (k, field) in topic.fields.iter().enumerate() {
            let at = |key: &str| format!("topic.{i}.fields.{k}.{key}");
            errors.take(Unit::parse(&field.unit).map_err(|e| doc.error(&at("unit"), e)));
            if fields.contains(&field.name.as_str()) {
                errors.push(doc.error(&at("name"), format!("topic \"{}\" has two fields \"{}\"", topic.name, field.name)));
            }
            fields.push(&field.name);
        }
    }
    errors.or(())
}

fn find_input(settings: &Import, doc: &Doc, folder: &Path) -> Result<PathBuf, Errors> {
    let mut looked = Vec::new();
    for candidate in &settings.input {
        let path = match candidate.strip_prefix('$') {
            None => folder.join(candidate),
            Some(rest) => {
                let (name, tail) = rest.split_once('/').unwrap_or((rest, ""));
                match std::env::var_os(name) {
                    Some(root) => Path::new(&root).join(tail),
                    None => {
                        looked.push(format!("{candidate} (${name} is not set)"));
                        continue;
                    }
                }
            }
        };
        if path.is_file() {
            return Ok(path);
        }
        looked.push(path.display().to_string());
    }
    let error = doc.error("input", format!("no input file found; looked for {}", looked.join(", ")));
    Err(error.help(if settings.source.is_empty() { "put the file at one of these places" } else { &settings.source }).into())
}

/// Reads the rows and writes the log; the number of rows.
fn convert(settings: &Import, doc: &Doc, file: &str, text: &str, output: &Path) -> Result<usize, Errors> {
    let header = settings.header_lines.checked_sub(1).and_then(|n| text.lines().nth(n)).map(|l| settings.separator.split(l));
    let header: Vec<&str> = header.unwrap_or_default();
    let mut errors = Errors::default();
    let mut index = |column: &Column, key: String| errors.take(resolve(column, &header).map_err(|e| doc.error(&key, e)));
    let time = index(&settings.time.column, "time.column".into());
    let mut columns: Vec<Vec<usize>> = Vec::new();
    for (i, topic) in settings.topic.iter().enumerate() {
        let of = topic.fields.iter().enumerate();
        columns.push(of.filter_map(|(k, f)| index(&f.column, format!("topic.{i}.fields.{k}.column"))).collect());
    }
    errors.or(())?;
    let Some(time) = time else { return Err(doc.error("time.column", "no such column").into()) };
    let rows = read_rows(settings, file, text, time, &columns)?;

    let mut log = LogWriter::create(output)?;
    let add = |t: &Topic| {
        let fields: Vec<FieldSpec> = t.fields.iter().map(|f| FieldSpec::new(&f.name, &f.unit, &f.doc)).collect();
        log.add_topic(&t.name, &fields)
    };
    let topics: Vec<TopicId> = settings.topic.iter().map(add).collect::<Result<_, Error>>()?;
    let streams: Vec<Stream> = topics
        .iter()
        .zip(&rows.values)
        .map(|(&topic, values)| Stream { topic, log_time_ns: &rows.received, publish_time_ns: &rows.stamp, rows: values })
        .collect();
    log.write_streams(&streams)?;
    log.finish()?;
    Ok(rows.stamp.len())
}

fn resolve(column: &Column, header: &[&str]) -> Result<usize, String> {
    match column {
        Column::Number(0) => Err("columns count from 1".into()),
        Column::Number(n) => Ok(n - 1),
        Column::Name(name) => header
            .iter()
            .position(|h| h.trim_matches('"') == name)
            .ok_or_else(|| format!("there is no column \"{name}\"; the header has {}", super::words::nearest_first(name, header))),
    }
}

#[derive(Default)]
struct Rows {
    stamp: Vec<u64>,
    /// The stamp, never going back: a row that stands after a later one was also received after it.
    received: Vec<u64>,
    /// Per topic `[rows][fields]`.
    values: Vec<Vec<f64>>,
}

fn read_rows(settings: &Import, file: &str, text: &str, time: usize, columns: &[Vec<usize>]) -> Result<Rows, Errors> {
    const SHOWN: usize = 10;
    let unit = Unit::parse(&settings.time.unit).map_err(Error::new)?;
    let mut rows = Rows { values: vec![Vec::new(); columns.len()], ..Rows::default() };
    let mut errors = Errors::default();
    for (number, line) in text.lines().enumerate().skip(settings.header_lines).filter(|(_, l)| !l.trim().is_empty()) {
        let cells = settings.separator.split(line);
        let at = |cell: &str| {
            let column = line[..cell.as_ptr() as usize - line.as_ptr() as usize].chars().count() + 1;
            Place { file: file.to_string(), line: number + 1, column }
        };
        let value = |i: usize| match cells.get(i) {
            None => Err(Error::at(at(&line[line.len()..]), format!("column {} is wanted, the row has {}", i + 1, cells.len()))),
            Some(cell) => parse(cell).ok_or_else(|| Error::at(at(cell), format!("column {}: \"{cell}\" is no number", i + 1))),
        };
        let stamp = value(time).and_then(|t| {
            let ns = libm::round((unit.to_si(t) + settings.time.start_s) * 1e9);
            let fits = (0.0..9e18).contains(&ns);
            if fits { Ok(ns as u64) } else { Err(Error::at(at(cells[time]), "the time is negative, not a number or too large")) }
        });
        if let Some(stamp) = errors.take(stamp) {
            rows.received.push(rows.received.last().copied().unwrap_or(0).max(stamp));
            rows.stamp.push(stamp);
        }
        for (of, out) in columns.iter().zip(&mut rows.values) {
            out.extend(of.iter().filter_map(|&i| errors.take(value(i))));
        }
        if errors.0.len() >= SHOWN {
            break;
        }
    }
    if rows.stamp.is_empty() && errors.is_empty() {
        errors.push(Error::at(Place::file(file), "the file holds no row of data"));
    }
    errors.or(rows)
}

/// A number, or NaN where the cell is empty or says so.
fn parse(cell: &str) -> Option<f64> {
    if cell.is_empty() { Some(f64::NAN) } else { fast_float2::parse::<f64, _>(cell).ok() }
}

impl Separator {
    fn split(self, line: &str) -> Vec<&str> {
        let by = |c: char| line.split(c).map(str::trim).collect();
        match self {
            Separator::Whitespace => line.split_whitespace().collect(),
            Separator::Comma => by(','),
            Separator::Semicolon => by(';'),
            Separator::Tab => by('\t'),
        }
    }
}
