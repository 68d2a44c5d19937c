//! A description of an import and files of columns or messages in; MCAP logs out.

mod back;
mod cells;
mod check;
mod clock;
mod cut;
mod find;
mod head;
mod letters;
mod level5;
mod mat;
mod midnight;
mod parquet;
mod rows;
mod settings;
mod settle;
mod spans;
mod steps;
#[cfg(test)]
mod tests;
mod text;
#[cfg(test)]
mod text_tests;
mod ulog;
mod ulog_field;
mod values;
mod width;

pub use settings::Import;

use super::write::{FieldSpec, LogWriter, Stream, TopicId, foreign};
use crate::config::{self, Doc};
use crate::error::{Error, Errors, Place};
use crate::guard;
use find::Source;
use rows::{Read, Rows};
use settings::Along;
use std::path::{Path, PathBuf};

/// What an import has done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Imported {
    pub input: PathBuf,
    pub output: PathBuf,
    /// Of the topic that has most.
    pub rows: usize,
    /// Of all topics.
    pub messages: usize,
    pub topics: usize,
    pub fields: usize,
    /// What was lost, or is worth knowing.
    pub notes: Vec<String>,
}

impl std::fmt::Display for Imported {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let (rows, topics, fields) = (self.rows, self.topics, self.fields);
        let many = if self.messages == rows * topics {
            format!("{rows} rows")
        } else {
            format!("{} messages", self.messages)
        };
        write!(
            f,
            "{} -> {}: {many}, {fields} fields in {topics} topics",
            self.input.display(),
            self.output.display()
        )
    }
}

/// Imports what the description at `description` describes; `output` replaces the description's own
/// (of a single file). With `force`, files that are no logs of ours are written over; inputs never
/// are.
///
/// # Errors
/// Mistakes in the description; no input found (the message says where it was looked for); outputs
/// that may not be written, before anything is read. What is wrong with a file after that stands
/// beside what was done: the logs of the others are written.
pub fn run(
    description: &Path,
    output: Option<&Path>,
    force: bool,
) -> Result<(Vec<Imported>, Errors), Errors> {
    let (settings, doc) = config::load::<Import>(description)?;
    settings.check(&doc, output.is_some())?;
    let folder = description.parent().unwrap_or(Path::new(""));
    let sources = find::find(&settings, &doc, folder)?;
    let output = |source: &Source| {
        output.map_or_else(|| folder.join(source.named(&settings.output)), Path::to_path_buf)
    };
    let inputs: Vec<&Path> =
        sources.iter().map(|s| s.path.as_path()).chain([description]).collect();
    let mut errors = Errors::default();
    for source in &sources {
        errors.take(guard::file(&output(source), &inputs, force, foreign));
    }
    errors.or(())?;
    let mut errors = Errors::default();
    let done = sources
        .iter()
        .filter_map(|source| {
            let made = convert(&settings, &doc, source, output(source));
            errors.take(made.map_err(|e| left_behind(e, &output(source))))
        })
        .collect();
    Ok((done, errors))
}

/// The mistakes of a file that gave no log, with a word on one that an earlier import has left in its place:
/// runs would go on with it.
fn left_behind(mut errors: Errors, output: &Path) -> Errors {
    if let Some(last) = errors.0.last_mut().filter(|_| output.exists()) {
        let stays = format!(
            "{} is still that of an earlier import: what reads it reads the old log",
            output.display()
        );
        let help = last.help.take();
        last.help = Some(help.map_or(stays.clone(), |help| format!("{help}; {stays}")));
    }
    errors
}

/// Reads a file and writes its log.
fn convert(
    settings: &Import,
    doc: &Doc,
    source: &Source,
    output: PathBuf,
) -> Result<Imported, Errors> {
    let Read { mut topics, mut notes } = read(settings, doc, source).map_err(|e| of(e, source))?;
    for (topic, rows) in settings.topic.iter().zip(&mut topics) {
        let settled = rows.settle(&topic.name, settings.day_of(topic));
        notes.extend(
            settled.map_err(|what| Error::at(Place::file(source.path.to_string_lossy()), what))?,
        );
        if rows.stamp.is_empty() {
            let what = format!("the file holds no row of data for topic \"{}\"", topic.name);
            return Err(Error::at(Place::file(source.path.to_string_lossy()), what).into());
        }
    }
    let spans = spans::of(settings, &topics);
    if let Some(what) = spans::apart(&spans) {
        return Err(Error::at(Place::file(source.path.to_string_lossy()), what)
            .help("topics of a log share one clock: `start_s` of a topic's time says when its column is zero, in seconds since 1970")
            .into());
    }
    notes.extend(spans::strangers(&spans));
    write(settings, &topics, &notes, &output)?;
    Ok(Imported {
        input: source.path.clone(),
        output,
        rows: topics.iter().map(|t| t.stamp.len()).max().unwrap_or(0),
        messages: topics.iter().map(|t| t.stamp.len()).sum(),
        topics: topics.len(),
        fields: settings.topic.iter().map(|t| t.fields.len()).sum(),
        notes,
    })
}

/// Errors that say in which file they were met: a place in the description is one of all files.
fn of(errors: Errors, source: &Source) -> Errors {
    let file = source.path.to_string_lossy();
    let told = |mut error: Error| {
        if !error.to_string().contains(&*file) {
            error.what = format!("{file}: {}", error.what);
        }
        error
    };
    Errors(errors.0.into_iter().map(told).collect())
}

/// Reads a file as what it is by its first bytes.
fn read(settings: &Import, doc: &Doc, source: &Source) -> Result<Read, Errors> {
    let file: &str = &source.path.to_string_lossy();
    let at = |what: String| Error::at(Place::file(file), what);
    let bytes = std::fs::read(&source.path).map_err(|e| at(e.to_string()))?;
    if let Some(what) = cut::what_is_missing(&bytes) {
        return Err(at(what.into()).help("copy or record the file again").into());
    }
    if settings.signals == Along::Rows && !mat::is_mat(&bytes) {
        return Err(doc.error("signals", format!("{file} is no MAT file of matrices")).into());
    }
    if ulog::is_ulog(&bytes) {
        return ulog::read(settings, doc, file, &bytes);
    }
    if let Some(i) = settings.topic.iter().position(|topic| topic.from.is_some()) {
        let what =
            format!("{file} is no ULog: it has columns, no messages that a topic is made from");
        return Err(doc.error(&format!("topic.{i}.from"), what).into());
    }
    if mat::is_mat(&bytes) {
        return mat::read(settings, doc, (file, &bytes), &|name| source.named(name));
    }
    if mat::is_hdf(&bytes) {
        return Err(at("a MAT file of version 7.3, which is another format".into())
            .help("save it in MATLAB with -v7")
            .into());
    }
    if parquet::is_parquet(&bytes) {
        return parquet::read(settings, doc, (file, bytes));
    }
    let (text, note) = letters::text(&bytes).map_err(at)?;
    let mut read = text::read(settings, doc, file, &text)?;
    read.notes.extend(note);
    Ok(read)
}

fn write(settings: &Import, topics: &[Rows], notes: &[String], output: &Path) -> Result<(), Error> {
    let mut log = LogWriter::create(output)?;
    let add = |t: &settings::Topic| {
        let fields: Vec<FieldSpec> =
            t.fields.iter().map(|f| FieldSpec::new(&f.name, &f.unit, &f.doc)).collect();
        log.add_topic(&t.name, &fields)
    };
    let ids: Vec<TopicId> = settings.topic.iter().map(add).collect::<Result<_, Error>>()?;
    let streams: Vec<Stream> = (ids.iter().zip(topics))
        .map(|(&topic, rows)| Stream {
            topic,
            log_time_ns: &rows.stamp,
            publish_time_ns: &rows.stamp,
            rows: &rows.values,
        })
        .collect();
    log.write_streams(&streams)?;
    log.write_notes(notes)?;
    log.finish()
}
