//! A text file of columns in; the rows of its topics out.

use super::cells::{column_of, each_row, is_missing, number, plain};
use super::clock::Clock;
use super::rows::{Read, Rows, SHOWN, named, timeless};
use super::settings::{Column, Import, Time};
use super::width::Width;
use crate::config::Doc;
use crate::error::{Error, Errors, Place};
use std::ops::Range;

/// Names of the columns, from the line that has them; none without one.
fn header(settings: &Import, text: &str) -> Vec<String> {
    let line = settings.names_line.unwrap_or(settings.header_lines).checked_sub(1);
    let Some(line) = line.and_then(|n| plain(text).lines().nth(n)) else { return Vec::new() };
    let mut names = Vec::new();
    each_row(settings.separator, line, &mut |row| {
        names = row.cells.iter().map(|name| name.to_string()).collect();
        true
    });
    names
}

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
    /// All that are not there.
    fn new(settings: &Import, doc: &Doc, header: &[String]) -> Result<Wanted, Errors> {
        let names: Vec<&str> = header.iter().map(String::as_str).collect();
        let mut errors = Errors::default();
        let mut wanted = Wanted { times: Vec::new(), topics: Vec::new() };
        if let Some(time) = &settings.time {
            wanted.times.extend(errors.take(Timed::new(time, "time", false, doc, &names)));
        }
        for (i, topic) in settings.topic.iter().enumerate() {
            let mut which = 0;
            if let Some(time) = &topic.time {
                which = wanted.times.len();
                let key = format!("topic.{i}.time");
                wanted.times.extend(errors.take(Timed::new(time, &key, true, doc, &names)));
            }
            let columns = topic.fields.iter().enumerate().filter_map(|(k, field)| {
                let key = format!("topic.{i}.fields.{k}");
                errors.take(index(&field.column, field.matrix.is_some(), &key, doc, &names))
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
    fn new(
        time: &Time,
        key: &str,
        is_own: bool,
        doc: &Doc,
        names: &[&str],
    ) -> Result<Timed, Errors> {
        let from = match (&time.column, time.rate_hz, time.unit.as_deref()) {
            (Some(column), _, Some(unit)) => {
                let at = index(column, time.matrix.is_some(), key, doc, names)?;
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

/// Reads the columns that the description names; `file` is the file's name in messages.
///
/// # Errors
/// Columns that the header lacks; cells that are no numbers, rows that are too short: all at once,
/// up to ten.
pub fn read(settings: &Import, doc: &Doc, file: &str, text: &str) -> Result<Read, Errors> {
    let names = header(settings, text);
    let wanted = Wanted::new(settings, doc, &names)?;
    let text = plain(text);
    let data: usize = text.split_inclusive('\n').take(settings.header_lines).map(str::len).sum();
    let data = text.get(data..).unwrap_or("");
    let mut topics: Vec<Rows> = wanted.topics.iter().map(|_| Rows::default()).collect();
    let mut lost = vec![0; topics.len()];
    let mut errors = Errors::default();
    let mut row_number = 0;
    let mut width = Width::of(settings, &names);
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
        let cell = |i: usize| {
            cells.get(i).copied().ok_or_else(|| {
                let what = format!("column {} is wanted, the row has {}", i + 1, cells.len());
                Error::at(at(i), what)
            })
        };
        let value = |i: usize| {
            let cell = cell(i)?;
            let wrong = || Error::at(at(i), format!("column {}: \"{cell}\" is no number", i + 1));
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
            let stamp =
                if clock.is_written() { clock.read(cell(i)?) } else { clock.stamp(value(i)?) };
            stamp.map(Some).map_err(|e| Error::at(at(i), e))
        };
        let stamps: Vec<Option<u64>> =
            wanted.times.iter().map(|time| errors.take(stamp(time)).flatten()).collect();
        for (((which, of), rows), lost) in wanted.topics.iter().zip(&mut topics).zip(&mut lost) {
            match stamps.get(*which).copied().flatten() {
                Some(stamp) => rows.push(stamp, of.iter().filter_map(|&i| errors.take(value(i)))),
                // A row of another clock, or one that has an error already.
                None => {
                    let here = |&i: &usize| cells.get(i).is_some_and(|c| !is_missing(settings, c));
                    *lost += usize::from(of.iter().any(here));
                }
            }
        }
        row_number += 1;
        errors.0.len() < SHOWN
    });
    if errors.0.len() >= SHOWN {
        let what = format!("reading stopped after {SHOWN} mistakes: there may be more");
        errors.push(Error::at(Place::file(file), what));
    }
    let notes = settings.topic.iter().zip(lost).filter_map(|(t, n)| timeless(&t.name, n)).collect();
    errors.or(Read { topics, notes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(more: &str) -> (Import, Doc) {
        let text = format!(
            "input = [\"a.csv\"]\noutput = \"a.mcap\"\n{more}\n[[topic]]\nname = \"/t\"\nfields = [{{ column = \"v\", name = \"v\", unit = \"1\" }}]\n"
        );
        crate::config::parse::<Import>("import.toml", &text).unwrap()
    }

    fn read_all((settings, doc): &(Import, Doc), text: &str) -> Result<Rows, String> {
        read(settings, doc, "a.csv", text)
            .map(|mut read| read.topics.remove(0))
            .map_err(|e| e.to_string())
    }

    #[test]
    fn quotes_a_byte_order_mark_decimal_commas_a_row_of_units_and_words_for_missing() {
        let settings = settings(
            "separator = \"semicolon\"\ndecimal = \"comma\"\nheader_lines = 2\nnames_line = 1\nmissing = [\"n/a\", \"-9999\"]\ntime = { column = \"t\", unit = \"s\" }",
        );
        let text = "\u{feff}\"t\";\"a; b\";\"v\"\r\ns;-;m\r\n0,5;\"x;y\";1,25\r\n\r\n1,0;;n/a\r\n1,5;;-9999\r\n2,0;;\r\n2,5;;\"3,5\"\r\n";
        let rows = read_all(&settings, text).unwrap();
        assert_eq!(
            rows.stamp,
            [500_000_000, 1_000_000_000, 1_500_000_000, 2_000_000_000, 2_500_000_000]
        );
        let v = &rows.values;
        assert!(v[0] == 1.25 && v[4] == 3.5 && v[1..4].iter().all(|x| x.is_nan()), "{v:?}");
        let e = read_all(&settings, &text.replace("\"3,5\"", "\"3,5x\"")).err().unwrap();
        assert!(e.contains("a.csv:8:6: column 3: \"3,5x\" is no number"), "{e}");
        let e = read_all(&settings, &text.replace("\"3,5\"", "1.234")).err().unwrap();
        assert!(e.contains("\"1.234\" is no number"), "{e}");
    }

    #[test]
    fn blank_lines_keep_their_place_in_time_at_a_rate_and_have_no_meaning_beside_a_column_of_time()
    {
        let with = |more: &str| {
            settings(&format!("separator = \"comma\"\nheader_lines = 1\ntime = {{ {more} }}"))
        };
        for blank in ["", "  ", "\"\"", "NaN"] {
            let text = format!("v\n1\n2\n{blank}\n4\n{blank}\n{blank}\n7\n");
            let rows = read_all(&with("rate_hz = 50"), &text).unwrap();
            let at: Vec<u64> = (0..7).map(|k| 20_000_000 * k).collect();
            assert_eq!(rows.stamp, at, "{blank:?}");
            let known: Vec<usize> = (0..7).filter(|k| !rows.values[*k].is_nan()).collect();
            assert_eq!((known, rows.values[6]), (vec![0, 1, 3, 6], 7.0), "{blank:?}");
        }
        let rows = read_all(&with("rate_hz = 50"), "v\n\n1\n2\n\n\n").unwrap();
        assert_eq!((rows.stamp, rows.values), (vec![0, 20_000_000], vec![1.0, 2.0]));
        let rows = read_all(&with("column = \"t\", unit = \"s\""), "t,v\n0,1\n\n1,2\n").unwrap();
        assert_eq!((rows.stamp, rows.values), (vec![0, 1_000_000_000], vec![1.0, 2.0]));
    }

    #[test]
    fn dates_with_times_are_read_with_and_without_a_zone() {
        let settings = settings(
            "separator = \"comma\"\nheader_lines = 1\ntime = { column = \"t\", unit = \"iso8601\" }",
        );
        let text = "t,v\n1970-01-01T00:00:01.5Z,1\n1970-01-01 01:00:02+01:00,2\n1970-01-01T00:00:03.000000001,3\n";
        let rows = read_all(&settings, text).unwrap();
        assert_eq!(rows.stamp, [1_500_000_000, 2_000_000_000, 3_000_000_001]);
        let e = read_all(
            &settings,
            "t,v\n1970-01-01T00:00:01Z,1\n1970-01-01T00:00:02Z,\"2\n1970-01-01T00:00:03Z,3\n",
        );
        assert!(
            e.as_ref().is_err_and(|e| e.contains("a.csv:3:1: a quoted cell of 2 lines")),
            "{e:?}"
        );
        for (bad, wanted) in
            [("noon", "is no date with time"), ("1969-12-31T00:00:00Z", "before 1970")]
        {
            let e = read_all(&settings, &format!("t,v\n{bad},1\n")).err().unwrap();
            assert!(e.contains("a.csv:2:1: ") && e.contains(wanted), "{e}");
        }
    }
}
