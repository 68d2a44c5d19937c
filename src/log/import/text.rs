//! A text file of columns in; the rows of its topics out.

use super::cells::{column_of, each_row, is_missing, long, number, plain, whole};
use super::clock::Clock;
use super::head::Head;
use super::rows::{Read, Rows, SHOWN, Wanted as Named, named, timeless};
use super::settings::{Column, Import, Time};
use super::values::Rounded;
use super::width::Width;
use crate::config::Doc;
use crate::error::{Error, Errors, Place};
use std::ops::Range;

/// Where the time of a row comes from.
enum Origin {
    Column { at: usize, clock: Clock },
    Rate { rate_hz: f64, start_s: f64 },
}

/// A time that topics have; their own one may be missing in a row.
struct Timed {
    from: Origin,
    is_own: bool,
}

/// What is read of each row: times, and by topic which of them it has and its columns.
struct Wanted {
    times: Vec<Timed>,
    topics: Vec<(usize, Vec<usize>)>,
}

impl Wanted {
    /// Finds the columns by the names in the header.
    ///
    /// # Errors
    /// All that are not there, or are in another unit by the header.
    fn new(settings: &Import, doc: &Doc, head: &Head) -> Result<Wanted, Errors> {
        if head.is_numbers() && settings.has_names() {
            let line = settings.names_line.unwrap_or(settings.header_lines);
            let what = format!(
                "line {line}, which should have the names of the columns, has numbers: the file has no header, or another line has it"
            );
            return Err(doc.error("header_lines", what)
                .help("where there is no header: header_lines = 0, and each column by its number (from 1)")
                .into());
        }
        let names: Vec<&str> = head.names.iter().map(String::as_str).collect();
        let mut errors = Errors::default();
        let mut wanted = Wanted { times: Vec::new(), topics: Vec::new() };
        if let Some(time) = &settings.time {
            wanted.times.extend(errors.take(Timed::new(time, "time", false, doc, head)));
        }
        for (i, topic) in settings.topic.iter().enumerate() {
            let mut which = 0;
            if let Some(time) = &topic.time {
                which = wanted.times.len();
                let key = format!("topic.{i}.time");
                wanted.times.extend(errors.take(Timed::new(time, &key, true, doc, head)));
            }
            let columns = topic.fields.iter().enumerate().filter_map(|(k, field)| {
                let key = format!("topic.{i}.fields.{k}");
                let at = index(&field.column, field.matrix.is_some(), &key, doc, &names);
                let at = errors.take(at)?;
                let (unit, despite) = (&field.unit, field.despite.as_deref());
                let other = head.other_unit(at, unit, despite);
                errors.0.extend(other.map(|other| field.other_unit(doc, &key, &other)));
                Some(at)
            });
            wanted.topics.push((which, columns.collect()));
        }
        errors.or(wanted)
    }

    /// Gives topics without a column of time these rows, without values: a blank line of a recording
    /// at a rate is a sample that is missing, and what follows is as late as if it were there.
    fn blank(&self, numbers: Range<usize>, topics: &mut [Rows]) {
        for ((which, of), rows) in self.topics.iter().zip(topics) {
            let from = self.times.get(*which).map(|time| &time.from);
            let Some(Origin::Rate { rate_hz, start_s }) = from else { continue };
            // A time that is too late is a mistake of the row behind them.
            let at = |row| Clock::at_rate(*start_s, *rate_hz, row).ok();
            let stamps = numbers.clone().filter_map(at);
            stamps.for_each(|stamp| rows.push(stamp, of.iter().map(|_| f64::NAN)));
        }
    }
}

impl Timed {
    fn new(time: &Time, key: &str, is_own: bool, doc: &Doc, head: &Head) -> Result<Timed, Errors> {
        let names: Vec<&str> = head.names.iter().map(String::as_str).collect();
        let from = match (&time.column, time.rate_hz, time.unit.as_deref()) {
            (Some(column), _, Some(unit)) => {
                let at = index(column, time.matrix.is_some(), key, doc, &names)?;
                if let Some(other) = head.other_unit(at, unit, None) {
                    let what = format!(
                        "the column of time is in \"{other}\" by the header, not in \"{unit}\""
                    );
                    let help =
                        format!("write unit = \"{other}\"; where the header is wrong, mend it");
                    return Err(doc.error(&format!("{key}.unit"), what).help(help).into());
                }
                let clock = Clock::new(unit, time.start_s);
                let clock = clock.map_err(|e| doc.error(&format!("{key}.unit"), e))?;
                Origin::Column { at, clock }
            }
            (None, Some(rate_hz), _) => Origin::Rate { rate_hz, start_s: time.start_s },
            _ => {
                return Err(doc
                    .error(key, "the unit of the column of time is not said")
                    .help("unit = \"s\", \"iso8601\" for dates with times, \"hh:mm:ss\" for times of day")
                    .into());
            }
        };
        Ok(Timed { from, is_own })
    }
}

/// The position of a column.
fn index(
    column: &Column,
    matrix: bool,
    key: &str,
    doc: &Doc,
    names: &[&str],
) -> Result<usize, Error> {
    let wrong = |what: String| doc.error(&format!("{key}.column"), what);
    match column {
        _ if matrix => Err(doc.error(&format!("{key}.matrix"), "a text file has no matrices")),
        Column::Number(0) => Err(wrong("columns count from 1".into())),
        Column::Number(n) => Ok(n - 1),
        Column::Name(name) if names.is_empty() => {
            Err(wrong(format!("there is no header to find column \"{name}\" in: give its number")))
        }
        Column::Name(name) => named(name, names, "the header").map_err(wrong),
    }
}

/// What to do about a row that is wrong and the last thing in a file.
const CUT: &str = "the file ends in this row, without an end of line: it may have been cut short; copy it again, or leave the row out";

/// Reads the columns that the description names; `file` is the file's name in messages.
///
/// # Errors
/// Columns that the header lacks; cells that are no numbers, rows that are too short: all at once,
/// up to ten.
pub fn read(settings: &Import, doc: &Doc, file: &str, text: &str) -> Result<Read, Errors> {
    let head = Head::of(settings, text);
    let wanted = Wanted::new(settings, doc, &head)?;
    let text = plain(text);
    let data: usize = text.split_inclusive('\n').take(settings.header_lines).map(str::len).sum();
    let data = text.get(data..).unwrap_or("");
    let mut topics: Vec<Rows> = wanted.topics.iter().map(|_| Rows::default()).collect();
    let mut lost = vec![0; topics.len()];
    let mut rounded: Vec<Vec<Rounded>> =
        wanted.topics.iter().map(|(_, of)| vec![Rounded::default(); of.len()]).collect();
    let mut errors = Errors::default();
    let (mut row_number, mut first_row) = (0, 0);
    let mut width = Width::of(settings, &head.names);
    each_row(settings.separator, data, &mut |row| {
        wanted.blank(row_number..row_number + row.blank, &mut topics);
        row_number += row.blank;
        let (before, cells) = (data.get(..row.start).unwrap_or(data), row.cells);
        let at = |i: usize| Place {
            file: file.to_string(),
            line: settings.header_lines + before.matches('\n').count() + 1,
            column: column_of(settings.separator, row.text.lines().next().unwrap_or(""), i),
        };
        if let Err(what) = width.holds(&row) {
            errors.push(Error::at(at(0), what));
            return errors.0.len() < SHOWN;
        }
        let ends_here = row.start + row.text.len() >= data.len() && !data.ends_with(['\n', '\r']);
        let wrong = |i: usize, what: String| {
            let help = ends_here.then(|| CUT.to_string());
            Error { help, ..Error::at(at(i), what) }
        };
        let cell = |i: usize| {
            let short = || format!("column {} is wanted, the row has {}", i + 1, cells.len());
            cells.get(i).copied().ok_or_else(|| wrong(i, short()))
        };
        let value = |i: usize| {
            let cell = cell(i)?;
            let wrong = || wrong(i, format!("column {}: \"{cell}\" is no number", i + 1));
            number(settings, cell).ok_or_else(wrong)
        };
        let stamp = |time: &Timed| -> Result<Option<u64>, Error> {
            let (i, clock) = match &time.from {
                Origin::Rate { rate_hz, start_s } => {
                    let stamp = Clock::at_rate(*start_s, *rate_hz, row_number);
                    return stamp.map(Some).map_err(|e| Error::at(at(0), e));
                }
                Origin::Column { at, clock } => (*at, clock),
            };
            if time.is_own && cells.get(i).is_none_or(|cell| is_missing(settings, cell)) {
                return Ok(None);
            }
            let of_number = |t: f64, cell: &str| match whole(cell).filter(|_| t.is_finite()) {
                Some(t) => clock.whole(t),
                None => clock.stamp(t),
            };
            let stamp = match clock.is_written() {
                true => clock.read(cell(i)?),
                false => of_number(value(i)?, cell(i)?),
            };
            stamp.map(Some).map_err(|e| Error::at(at(i), e))
        };
        let stamps: Vec<Option<u64>> =
            wanted.times.iter().map(|time| errors.take(stamp(time)).flatten()).collect();
        let each = wanted.topics.iter().zip(&mut topics).zip(&mut lost).zip(&mut rounded);
        for ((((which, of), rows), lost), rounded) in each {
            match stamps.get(*which).copied().flatten() {
                Some(stamp) => {
                    rows.push(stamp, of.iter().filter_map(|&i| errors.take(value(i))));
                    for (&i, rounded) in of.iter().zip(rounded) {
                        let n = cells.get(i).and_then(|cell| long(settings, cell));
                        n.into_iter()
                            .for_each(|n| rounded.see(n, || format!("line {}", at(i).line)));
                    }
                }
                // A row of another clock, or one that has an error already.
                None => {
                    let here = |&i: &usize| cells.get(i).is_some_and(|c| !is_missing(settings, c));
                    *lost += usize::from(of.iter().any(here));
                }
            }
        }
        if row_number == 0 {
            first_row = cells.len();
        }
        row_number += 1;
        errors.0.len() < SHOWN
    });
    if errors.0.len() >= SHOWN {
        let what = format!("reading stopped after {SHOWN} mistakes: there may be more");
        errors.push(Error::at(Place::file(file), what));
    }
    let lost = settings.topic.iter().zip(lost).filter_map(|(t, n)| timeless(&t.name, n));
    let is_data =
        head.is_numbers() && head.names.len() == first_row && settings.names_line.is_none();
    let left_out = is_data.then(|| {
        let lines = settings.header_lines;
        format!(
            "line {lines} is left out by header_lines = {lines}, and has numbers as the rows have: header_lines = {} reads it",
            lines - 1
        )
    });
    let rounded = said(settings, &topics, &rounded);
    errors.or(Read { topics, notes: left_out.into_iter().chain(lost).chain(rounded).collect() })
}

/// What is said of whole numbers that lose digits, by topic and field.
fn said(settings: &Import, topics: &[Rows], rounded: &[Vec<Rounded>]) -> Vec<String> {
    let each = settings.topic.iter().zip(topics).zip(rounded);
    each.flat_map(|((topic, rows), rounded)| {
        let fields = topic.fields.iter().zip(rounded);
        fields.filter_map(move |(field, rounded)| {
            let column = Named { column: &field.column, matrix: None }.words();
            rounded.words(&topic.name, &column, rows.stamp.len())
        })
    })
    .collect()
}
