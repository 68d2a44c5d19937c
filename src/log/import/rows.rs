//! Columns of numbers and times in; the messages of each topic, with their stamps, out: the form in
//! which every kind of file is handed on.

use super::clock::Clock;
use super::head::other_unit;
use super::settings::{Column, Import, Time, Topic};
use super::values::{Rounded, Values};
use crate::config::Doc;
use crate::error::{Error, Errors, Place};
use crate::log::words::nearest_first;

/// Mistakes in the data that are shown before reading stops.
pub const SHOWN: usize = 10;

/// What is read of one file.
#[derive(Debug, Default)]
pub struct Read {
    /// By topic of the description.
    pub topics: Vec<Rows>,
    /// What was lost, or is worth knowing.
    pub notes: Vec<String>,
}

/// The messages of one topic.
#[derive(Debug, Default)]
pub struct Rows {
    /// ns since 1970, or since whatever the time counts from.
    pub stamp: Vec<u64>,
    /// `[rows][fields]`, in the units of the description.
    pub values: Vec<f64>,
}

impl Rows {
    /// Adds a row.
    pub fn push(&mut self, stamp: u64, values: impl IntoIterator<Item = f64>) {
        self.stamp.push(stamp);
        self.values.extend(values);
    }
}

/// A topic's rows that have values but no time.
pub fn timeless(topic: &str, count: usize) -> Option<String> {
    (count > 0).then(|| format!("topic {topic}: {count} rows with values and no time, left out"))
}

/// The place of the one column of this name; `has`: what has the names.
///
/// # Errors
/// There is none, with the nearest names; there are several.
pub fn named(name: &str, names: &[&str], has: &str) -> Result<usize, String> {
    let mut all = names.iter().enumerate().filter(|(_, n)| **n == name).map(|(i, _)| i);
    match (all.next(), all.next()) {
        (Some(one), None) => Ok(one),
        (Some(one), Some(other)) => Err(format!(
            "columns {} and {} are both called \"{name}\": give the number of the one that is meant",
            one + 1,
            other + 1
        )),
        _ => {
            Err(format!("there is no column \"{name}\"; {has} has {}", nearest_first(name, names)))
        }
    }
}

/// A column that a description asks for.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a> {
    pub column: &'a Column,
    pub matrix: Option<&'a str>,
}

impl Wanted<'_> {
    /// What it is called in messages.
    pub fn words(&self) -> String {
        match (self.column, self.matrix) {
            (Column::Name(name), _) => format!("\"{name}\""),
            (Column::Number(n), Some(matrix)) => format!("column {n} of \"{matrix}\""),
            (Column::Number(n), None) => format!("column {n}"),
        }
    }
}

/// A file that holds whole columns.
pub trait Columns {
    /// A column of it.
    ///
    /// # Errors
    /// There is none, with what there is; it has no numbers.
    fn column(&mut self, wanted: Wanted) -> Result<Values, String>;
}

/// A column of time and what makes stamps of it.
#[derive(Debug, Clone)]
struct Times {
    words: String,
    values: Values,
    clock: Clock,
}

impl Times {
    /// The column of the time that stands at `key`.
    fn read(time: &Time, key: &str, doc: &Doc, columns: &mut dyn Columns) -> Result<Times, Error> {
        let at = format!("{key}.column");
        let Some(column) = &time.column else { return Err(doc.error(key, "there is no column")) };
        let wanted = Wanted { column, matrix: time.matrix.as_deref() };
        let values = columns.column(wanted).map_err(|e| doc.error(&at, e))?;
        let clock = match (&values, time.unit.as_deref()) {
            // Stamps are ns already.
            (Values::Stamps(_), _) => Ok(Clock::seconds(time.start_s)),
            (_, Some(unit)) => Clock::new(unit, time.start_s),
            (_, None) => {
                let what = format!("{} has numbers: their unit is not said", wanted.words());
                return Err(doc.error(key, what).help("unit = \"s\""));
            }
        };
        let clock = clock.map_err(|e| doc.error(&format!("{key}.unit"), e))?;
        if clock.is_written() && !values.are_stamps() {
            let what = format!("{} has numbers, no times that are written", wanted.words());
            return Err(doc.error(&format!("{key}.unit"), what));
        }
        Ok(Times { words: wanted.words(), values, clock })
    }

    /// The stamp of a row, ns; none where its time is missing.
    fn stamp(&self, row: usize) -> Result<Option<u64>, String> {
        match &self.values {
            Values::Stamps(all) => {
                let ns = all.get(row).copied().flatten();
                ns.map(|ns| self.clock.later(i128::from(ns))).transpose()
            }
            Values::Whole(all) => {
                let t = all.get(row).copied().flatten();
                t.map(|t| self.clock.whole(t)).transpose()
            }
            Values::Numbers(all) => {
                let t = all.get(row).filter(|t| !t.is_nan());
                t.map(|&t| self.clock.stamp(t)).transpose()
            }
        }
    }
}

/// Puts the topics of a description together from whole columns; `file` is its name in messages.
///
/// # Errors
/// Columns that are not there, columns of different lengths, times that are none.
pub fn gather(
    settings: &Import,
    doc: &Doc,
    file: &str,
    columns: &mut dyn Columns,
) -> Result<Read, Errors> {
    let mut errors = Errors::default();
    let mut read = Read::default();
    let mut times = |time: &Option<Time>, key: &str| {
        let time = time.as_ref().filter(|time| time.column.is_some())?;
        errors.take(Times::read(time, key, doc, columns))
    };
    let shared = times(&settings.time, "time");
    let own: Vec<Option<Times>> = (settings.topic.iter().enumerate())
        .map(|(i, topic)| times(&topic.time, &format!("topic.{i}.time")))
        .collect();
    for (i, own) in own.iter().enumerate() {
        let fields = fields(settings, doc, i, columns);
        let Some((fields, rounded)) = errors.take(fields) else { continue };
        read.notes.extend(rounded);
        let Some(topic) = settings.topic.get(i) else { continue };
        let (Some(time), is_own) = settings.time_of(topic) else { continue };
        let times = if is_own { own } else { &shared };
        if time.column.is_some() && times.is_none() {
            // Told above.
            continue;
        }
        let made = rows(topic, time, times.as_ref().map(|t| (t, is_own)), &fields);
        let at = |what| Error::at(Place::file(file), what);
        let made = made.map_err(|e| Errors(e.into_iter().map(at).collect()));
        let Some((rows, lost)) = errors.take(made) else { continue };
        read.notes.extend(timeless(&topic.name, lost));
        read.topics.push(rows);
    }
    errors.or(read)
}

/// What a column is called in messages, and its numbers.
type Called = (String, Vec<f64>);

/// The columns of a topic's fields, and what is said of whole numbers in them that lose digits.
fn fields(
    settings: &Import,
    doc: &Doc,
    topic: usize,
    columns: &mut dyn Columns,
) -> Result<(Vec<Called>, Vec<String>), Errors> {
    let mut errors = Errors::default();
    let Some(topic_settings) = settings.topic.get(topic) else {
        return errors.or(Default::default());
    };
    let (name, fields) = (&topic_settings.name, &topic_settings.fields);
    let (mut all, mut notes) = (Vec::with_capacity(fields.len()), Vec::new());
    for (k, field) in fields.iter().enumerate() {
        let wanted = Wanted { column: &field.column, matrix: field.matrix.as_deref() };
        let known = |x: f64| if settings.says_missing(x) { f64::NAN } else { x };
        let values = columns.column(wanted).and_then(|values| {
            notes.extend(rounded(settings, &values).words(name, &wanted.words(), values.len()));
            match values.numbers() {
                Some(all) => Ok((wanted.words(), all.into_iter().map(known).collect())),
                None => Err(format!("{} has times, no numbers", wanted.words())),
            }
        });
        let key = format!("topic.{topic}.fields.{k}");
        if let Column::Name(name) = &field.column {
            let other = other_unit(name, &field.unit, field.despite.as_deref());
            errors.0.extend(other.map(|other| field.other_unit(doc, &key, &other)));
        }
        all.extend(errors.take(values.map_err(|e| doc.error(&format!("{key}.column"), e))));
    }
    errors.or((all, notes))
}

/// The whole numbers of a column that lose digits in a log. Those that stand for a missing value lose nothing.
fn rounded(settings: &Import, values: &Values) -> Rounded {
    let mut rounded = Rounded::default();
    if let Values::Whole(all) = values {
        let known = |n: &i128| !settings.says_missing(*n as f64);
        for (row, n) in all.iter().enumerate() {
            n.filter(known).into_iter().for_each(|n| rounded.see(n, || format!("row {}", row + 1)));
        }
    }
    rounded
}

/// The rows of a topic, and how many were left out that have values and no time. A row without the
/// time of all topics is a mistake, one without the topic's own is none of the topic.
fn rows(
    topic: &Topic,
    time: &Time,
    times: Option<(&Times, bool)>,
    fields: &[Called],
) -> Result<(Rows, usize), Vec<String>> {
    let known = times.map(|(t, _)| (t.words.as_str(), t.values.len()));
    let mut lengths = known.into_iter().chain(fields.iter().map(|(w, v)| (w.as_str(), v.len())));
    let (first, n) = lengths.next().unwrap_or_default();
    if let Some((other, m)) = lengths.find(|(_, m)| *m != n) {
        return Err(vec![format!(
            "topic \"{}\" has columns of different lengths: {first} has {n} values, {other} has {m}",
            topic.name
        )]);
    }
    let (mut rows, mut lost, mut errors) = (Rows::default(), 0, Vec::new());
    for row in 0..n {
        let values = || fields.iter().filter_map(|(_, values)| values.get(row).copied());
        let stamp = match (times, time.rate_hz) {
            (Some((times, _)), _) => times.stamp(row),
            (None, Some(rate)) => Clock::at_rate(time.start_s, rate, row).map(Some),
            (None, None) => Ok(None),
        };
        match stamp {
            Ok(Some(stamp)) => rows.push(stamp, values()),
            Ok(None) if times.is_some_and(|(_, is_own)| is_own) => {
                lost += usize::from(values().any(|v| !v.is_nan()));
            }
            Ok(None) => errors.push(format!("row {}: its time is missing", row + 1)),
            Err(e) => errors.push(format!("row {}: {e}", row + 1)),
        }
        if errors.len() >= SHOWN {
            break;
        }
    }
    if errors.is_empty() { Ok((rows, lost)) } else { Err(errors) }
}
