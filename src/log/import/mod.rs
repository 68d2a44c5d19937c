//! Columns of text or of a MAT file and a description of them in; an MCAP log out.

mod mat;
mod text;

use super::write::{FieldSpec, LogWriter, Stream, TopicId};
use crate::config::{self, Doc};
use crate::error::{Error, Errors, Place};
use crate::units::Unit;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Describes a text file, or a matrix of a MATLAB 5 MAT file, with one row per time and one column
/// per quantity, and the log that becomes of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Import {
    /// Several files of the same layout: each name takes the place of `{name}` in `input`, `output`
    /// and `variable`.
    #[serde(default)]
    pub names: Vec<String>,
    /// Where the file may be, relative to this file; `$NAME` at the start stands for an environment
    /// variable. The first file that exists is read.
    pub input: Vec<String>,
    /// The matrix to read from a MAT file; not needed where it is the only one.
    #[serde(default)]
    pub variable: Option<String>,
    /// The log to write, relative to this file.
    pub output: String,
    /// Where the data come from and how to get them; part of the message when no input is found.
    #[serde(default)]
    pub source: String,
    /// What stands between two columns.
    #[serde(default)]
    pub separator: Separator,
    /// How numbers are written in a text file.
    #[serde(default)]
    pub decimal: Decimal,
    /// What stands in a cell without a value, besides nothing: `["n/a", "-9999"]`.
    #[serde(default)]
    pub missing: Vec<String>,
    /// Lines before the data. With names in one of them, columns may be given by name.
    #[serde(default)]
    pub header_lines: usize,
    /// The line (from 1) that has the names, where it is not the last one before the data: units may
    /// stand below them.
    #[serde(default)]
    pub names_line: Option<usize>,
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

/// The column of time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TimeColumn {
    /// Number (from 1) or name of the column.
    pub column: Column,
    /// Unit of the column, for example "s" or "ms"; "iso8601" for dates with times, such as
    /// 2024-05-06T10:00:00.25Z (UTC where they name no zone).
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
        write!(
            f,
            "{} -> {}: {rows} rows, {fields} fields in {topics} topics",
            self.input.display(),
            self.output.display()
        )
    }
}

/// One file to import.
struct Source {
    name: Option<String>,
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Source {
    fn named(&self, text: &str) -> String {
        named(self.name.as_deref(), text)
    }
}

fn named(name: Option<&str>, text: &str) -> String {
    name.map_or_else(|| text.to_string(), |name| text.replace("{name}", name))
}

/// Imports what the description at `description` describes; `output` replaces the description's own
/// (of a single file).
///
/// # Errors
/// Mistakes in the description; no input found (the message says where it was looked for); rows
/// that are no numbers.
pub fn run(description: &Path, output: Option<&Path>) -> Result<Vec<Imported>, Errors> {
    let (settings, doc) = config::load::<Import>(description)?;
    check(&settings, &doc, output.is_some())?;
    let folder = description.parent().unwrap_or(Path::new(""));
    let names: Vec<Option<&str>> = if settings.names.is_empty() {
        vec![None]
    } else {
        settings.names.iter().map(|n| Some(n.as_str())).collect()
    };
    let mut errors = Errors::default();
    let sources: Vec<Source> =
        names.iter().filter_map(|name| errors.take(find(&settings, &doc, folder, *name))).collect();
    errors.or(())?;
    let one = |source: Source| {
        let output =
            output.map_or_else(|| folder.join(source.named(&settings.output)), Path::to_path_buf);
        let rows = convert(&settings, &doc, &source, &output)?;
        let fields = settings.topic.iter().map(|t| t.fields.len()).sum();
        Ok(Imported { input: source.path, output, rows, topics: settings.topic.len(), fields })
    };
    sources.into_iter().map(one).collect()
}

fn check(settings: &Import, doc: &Doc, one_output: bool) -> Result<(), Errors> {
    let mut errors = Errors::default();
    if settings.names.len() > 1 && (one_output || !settings.output.contains("{name}")) {
        errors.push(
            doc.error("output", "several files are imported into one log")
                .help("put {name} into `output`, and give no --out"),
        );
    }
    if settings.names_line.is_some_and(|n| n == 0 || n > settings.header_lines) {
        let what = format!("the names stand in one of the {} header_lines", settings.header_lines);
        errors.push(doc.error("names_line", what).help("lines count from 1"));
    }
    if settings.decimal == Decimal::Comma && settings.separator == Separator::Comma {
        errors.push(
            doc.error("decimal", "a comma stands both in numbers and between columns")
                .help("what separates the columns then: separator = \"semicolon\" or \"tab\"?"),
        );
    }
    match Unit::parse(&settings.time.unit) {
        _ if settings.time.unit == text::ISO => {}
        Ok(unit) if unit.dim == Unit::parse("s").map(|s| s.dim).unwrap_or_default() => {}
        Ok(_) => errors
            .push(doc.error("time.unit", format!("\"{}\" is no unit of time", settings.time.unit))),
        Err(e) => errors.push(doc.error("time.unit", e)),
    }
    let mut topics: Vec<&str> = Vec::new();
    for (i, topic) in settings.topic.iter().enumerate() {
        if topics.contains(&topic.name.as_str()) {
            errors.push(doc.error(
                &format!("topic.{i}.name"),
                format!("there are two topics \"{}\"", topic.name),
            ));
        }
        topics.push(&topic.name);
        let mut fields: Vec<&str> = Vec::new();
        for (k, field) in topic.fields.iter().enumerate() {
            let at = |key: &str| format!("topic.{i}.fields.{k}.{key}");
            errors.take(Unit::parse(&field.unit).map_err(|e| doc.error(&at("unit"), e)));
            if fields.contains(&field.name.as_str()) {
                errors.push(doc.error(
                    &at("name"),
                    format!("topic \"{}\" has two fields \"{}\"", topic.name, field.name),
                ));
            }
            fields.push(&field.name);
        }
    }
    errors.or(())
}

fn find(settings: &Import, doc: &Doc, folder: &Path, name: Option<&str>) -> Result<Source, Errors> {
    let mut looked = Vec::new();
    for candidate in settings.input.iter().map(|input| named(name, input)) {
        let path = match candidate.strip_prefix('$') {
            None => folder.join(&candidate),
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
            let bytes = std::fs::read(&path)
                .map_err(|e| Error::at(Place::file(path.to_string_lossy()), e.to_string()))?;
            return Ok(Source { name: name.map(str::to_string), path, bytes });
        }
        looked.push(path.display().to_string());
    }
    let error =
        doc.error("input", format!("no input file found; looked for {}", looked.join(", ")));
    Err(error
        .help(if settings.source.is_empty() {
            "put the file at one of these places"
        } else {
            &settings.source
        })
        .into())
}

/// Reads the rows and writes the log; the number of rows.
fn convert(settings: &Import, doc: &Doc, source: &Source, output: &Path) -> Result<usize, Errors> {
    let file: &str = &source.path.to_string_lossy();
    let rows = if mat::is_mat(&source.bytes) {
        let variable = settings.variable.as_ref().map(|v| source.named(v));
        let matrix = mat::read(&source.bytes, variable.as_deref())
            .map_err(|e| Error::at(Place::file(file), e))?;
        matrix_rows(settings, file, &matrix, &wanted(settings, doc, &[])?)?
    } else {
        let text = std::str::from_utf8(&source.bytes).map_err(|e| {
            Error::at(
                Place::file(file),
                format!(
                    "neither text nor a MATLAB 5 MAT file: byte {} is no text",
                    e.valid_up_to()
                ),
            )
        })?;
        text::read(
            settings,
            file,
            text,
            &wanted(settings, doc, &names(&text::header(settings, text)))?,
        )?
    };
    if rows.stamp.is_empty() {
        return Err(Error::at(Place::file(file), "the file holds no row of data").into());
    }
    write(settings, &rows, output)?;
    Ok(rows.stamp.len())
}

fn write(settings: &Import, rows: &Rows, output: &Path) -> Result<(), Error> {
    let mut log = LogWriter::create(output)?;
    let add = |t: &Topic| {
        let fields: Vec<FieldSpec> =
            t.fields.iter().map(|f| FieldSpec::new(&f.name, &f.unit, &f.doc)).collect();
        log.add_topic(&t.name, &fields)
    };
    let topics: Vec<TopicId> = settings.topic.iter().map(add).collect::<Result<_, Error>>()?;
    let streams: Vec<Stream> = topics
        .iter()
        .zip(&rows.values)
        .map(|(&topic, values)| Stream {
            topic,
            log_time_ns: &rows.received,
            publish_time_ns: &rows.stamp,
            rows: values,
        })
        .collect();
    log.write_streams(&streams)?;
    log.finish()
}

/// The wanted columns of a matrix.
fn matrix_rows(
    settings: &Import,
    file: &str,
    matrix: &mat::Matrix,
    wanted: &Wanted,
) -> Result<Rows, Errors> {
    let most = wanted.topics.iter().flatten().chain([&wanted.time]).max().copied().unwrap_or(0);
    if most >= matrix.columns {
        let what =
            format!("column {} is wanted, matrix {} has {}", most + 1, matrix.name, matrix.columns);
        return Err(Error::at(Place::file(file), what).into());
    }
    let mut rows = Rows::new(wanted);
    let mut errors = Errors::default();
    for row in settings.header_lines..matrix.rows {
        let value = |column: usize| matrix.values[column * matrix.rows + row];
        let time = stamp(settings, value(wanted.time));
        let time = time.map_err(|e| {
            Error::at(Place::file(file), format!("row {} of matrix {}: {e}", row + 1, matrix.name))
        });
        if let Some(time) = errors.take(time) {
            rows.push_time(time);
        }
        for (of, out) in wanted.topics.iter().zip(&mut rows.values) {
            out.extend(of.iter().map(|&i| value(i)));
        }
    }
    errors.or(rows)
}

fn names(header: &[String]) -> Vec<&str> {
    header.iter().map(String::as_str).collect()
}

/// The stamp of a time in the file, ns.
fn stamp(settings: &Import, t: f64) -> Result<u64, String> {
    let unit = Unit::parse(&settings.time.unit)?;
    let ns = libm::round((unit.to_si(t) + settings.time.start_s) * 1e9);
    let fits = (0.0..9e18).contains(&ns);
    if fits { Ok(ns as u64) } else { Err("the time is negative, not a number or too large".into()) }
}

/// Positions of the columns that are read.
struct Wanted {
    time: usize,
    /// Per topic, its fields.
    topics: Vec<Vec<usize>>,
}

fn wanted(settings: &Import, doc: &Doc, header: &[&str]) -> Result<Wanted, Errors> {
    let mut errors = Errors::default();
    let mut index = |column: &Column, key: String| {
        errors.take(resolve(column, header).map_err(|e| doc.error(&key, e)))
    };
    let time = index(&settings.time.column, "time.column".into()).unwrap_or(0);
    let mut topics: Vec<Vec<usize>> = Vec::new();
    for (i, topic) in settings.topic.iter().enumerate() {
        let of = topic.fields.iter().enumerate();
        topics.push(
            of.filter_map(|(k, f)| index(&f.column, format!("topic.{i}.fields.{k}.column")))
                .collect(),
        );
    }
    errors.or(Wanted { time, topics })
}

fn resolve(column: &Column, header: &[&str]) -> Result<usize, String> {
    match column {
        Column::Number(0) => Err("columns count from 1".into()),
        Column::Number(n) => Ok(n - 1),
        Column::Name(name) if header.is_empty() => {
            Err(format!("there is no header to find column \"{name}\" in: give its number"))
        }
        Column::Name(name) => header.iter().position(|h| h == name).ok_or_else(|| {
            format!(
                "there is no column \"{name}\"; the header has {}",
                super::words::nearest_first(name, header)
            )
        }),
    }
}

/// What is read of one file.
#[derive(Default)]
struct Rows {
    stamp: Vec<u64>,
    /// The stamp, never going back: a row that stands after a later one was also received after it.
    received: Vec<u64>,
    /// Per topic `[rows][fields]`.
    values: Vec<Vec<f64>>,
}

impl Rows {
    fn new(wanted: &Wanted) -> Rows {
        Rows { values: vec![Vec::new(); wanted.topics.len()], ..Rows::default() }
    }

    fn push_time(&mut self, stamp: u64) {
        self.received.push(self.received.last().copied().unwrap_or(0).max(stamp));
        self.stamp.push(stamp);
    }
}
