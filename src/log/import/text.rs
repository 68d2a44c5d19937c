//! Text columns in; time stamps and rows of numbers out.

use super::{Import, Rows, Separator, Wanted, stamp};
use crate::error::{Error, Errors, Place};

/// Mistakes shown before reading stops.
const SHOWN: usize = 10;

/// The unit of a column of dates with times.
pub const ISO: &str = "iso8601";

/// Names of the columns, from the line that has them; none without one.
pub fn header(settings: &Import, text: &str) -> Vec<String> {
    let line = settings.names_line.unwrap_or(settings.header_lines).checked_sub(1);
    let Some(line) = line.and_then(|n| plain(text).lines().nth(n)) else { return Vec::new() };
    let mut names = Vec::new();
    each_row(settings.separator, line, &mut |_, cells| {
        names = cells.iter().map(|name| name.to_string()).collect();
        true
    });
    names
}

/// Reads the wanted columns.
///
/// # Errors
/// Cells that are no numbers, rows that are too short, no row at all: all at once, up to ten.
pub fn read(settings: &Import, file: &str, text: &str, wanted: &Wanted) -> Result<Rows, Errors> {
    let text = plain(text);
    let data: usize = text.split_inclusive('\n').take(settings.header_lines).map(str::len).sum();
    let data = text.get(data..).unwrap_or("");
    let mut rows = Rows::new(wanted);
    let mut errors = Errors::default();
    each_row(settings.separator, data, &mut |start, cells| {
        let (before, row) = data.split_at_checked(start).unwrap_or((data, ""));
        let at = |i: usize| Place {
            file: file.to_string(),
            line: settings.header_lines + before.matches('\n').count() + 1,
            column: column_of(settings.separator, row.lines().next().unwrap_or(""), i),
        };
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
        let time = if settings.time.unit == ISO {
            cell(wanted.time).and_then(|c| {
                moment(c, settings.time.start_s).map_err(|e| Error::at(at(wanted.time), e))
            })
        } else {
            value(wanted.time)
                .and_then(|t| stamp(settings, t).map_err(|e| Error::at(at(wanted.time), e)))
        };
        if let Some(time) = errors.take(time) {
            rows.push_time(time);
        }
        for (of, out) in wanted.topics.iter().zip(&mut rows.values) {
            out.extend(of.iter().filter_map(|&i| errors.take(value(i))));
        }
        errors.0.len() < SHOWN
    });
    errors.or(rows)
}

/// The text without the mark that some programs put in front of it.
fn plain(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// Calls `each` with the first byte and the cells of every row that is not blank, as long as it says
/// to go on.
fn each_row(separator: Separator, text: &str, each: &mut dyn FnMut(usize, &[&str]) -> bool) {
    let Some(by) = separator.byte() else {
        let mut start = 0;
        for line in text.split_inclusive('\n') {
            let cells: Vec<&str> = line.split_whitespace().collect();
            if !cells.is_empty() && !each(start, &cells) {
                return;
            }
            start += line.len();
        }
        return;
    };
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .delimiter(by)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let mut record = csv::StringRecord::new();
    while let Ok(true) = reader.read_record(&mut record) {
        let from = record.position().map_or(0, |p| p.byte() as usize);
        // Blank lines before a row count as its beginning.
        let row = text.get(from..).unwrap_or("").trim_start_matches(['\r', '\n']);
        let cells: Vec<&str> = record.iter().collect();
        if cells != [""] && !each(text.len() - row.len(), &cells) {
            return;
        }
    }
}

/// Where a cell of a line begins, in letters from 1; behind the line where it has no such cell.
fn column_of(separator: Separator, line: &str, cell: usize) -> usize {
    let (mut before, mut quoted, mut blank) = (0, false, true);
    for (i, c) in line.chars().enumerate() {
        match separator.byte() {
            Some(by) => {
                let starts = before == cell && (i == 0 || !c.is_whitespace());
                if starts && c != char::from(by) {
                    return i + 1;
                }
                quoted ^= c == '"';
                before += usize::from(c == char::from(by) && !quoted);
            }
            None => {
                let begins = blank && !c.is_whitespace();
                if begins && before == cell {
                    return i + 1;
                }
                before += usize::from(begins);
                blank = c.is_whitespace();
            }
        }
    }
    line.chars().count() + 1
}

/// A number, or NaN where the cell is empty or says that it is missing.
fn number(settings: &Import, cell: &str) -> Option<f64> {
    if cell.is_empty() || settings.missing.iter().any(|m| m == cell) {
        return Some(f64::NAN);
    }
    match settings.decimal {
        super::Decimal::Point => fast_float2::parse::<f64, _>(cell).ok(),
        // A point would be one of thousands: read as a decimal point, it makes 1.234 a thousandth of itself.
        super::Decimal::Comma if cell.contains('.') => None,
        super::Decimal::Comma => fast_float2::parse::<f64, _>(cell.replacen(',', ".", 1)).ok(),
    }
}

/// The stamp of a date with its time, ns since 1970; one without a time zone is UTC.
fn moment(cell: &str, start_s: f64) -> Result<u64, String> {
    let utc = || {
        let civil = cell.parse::<jiff::civil::DateTime>().ok()?;
        civil.to_zoned(jiff::tz::TimeZone::UTC).ok().map(|z| z.timestamp())
    };
    let at = cell.parse::<jiff::Timestamp>().ok().or_else(utc).ok_or_else(|| {
        format!("\"{cell}\" is no date with time, such as 2024-05-06T10:00:00.25Z")
    })?;
    let ns = at.as_nanosecond().saturating_add(libm::round(start_s * 1e9) as i128);
    u64::try_from(ns).map_err(|_| format!("\"{cell}\" lies before 1970 or too late"))
}

impl Separator {
    /// The letter between two columns; none for blanks of any number.
    fn byte(self) -> Option<u8> {
        match self {
            Separator::Whitespace => None,
            Separator::Comma => Some(b','),
            Separator::Semicolon => Some(b';'),
            Separator::Tab => Some(b'\t'),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(more: &str) -> Import {
        let text = format!(
            "input = [\"a.csv\"]\noutput = \"a.mcap\"\n{more}\n[[topic]]\nname = \"/t\"\nfields = [{{ column = \"v\", name = \"v\", unit = \"1\" }}]\n"
        );
        crate::config::parse::<Import>("import.toml", &text).unwrap().0
    }

    fn read_all(settings: &Import, text: &str) -> Result<Rows, String> {
        let names = header(settings, text);
        let place = |name: &str| names.iter().position(|n| n == name).unwrap();
        let wanted = Wanted { time: place("t"), topics: vec![vec![place("v")]] };
        read(settings, "a.csv", text, &wanted).map_err(|e| e.to_string())
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
        let v = &rows.values[0];
        assert!(v[0] == 1.25 && v[4] == 3.5 && v[1..4].iter().all(|x| x.is_nan()), "{v:?}");
        let e = read_all(&settings, &text.replace("\"3,5\"", "\"3,5x\"")).err().unwrap();
        assert!(e.contains("a.csv:8:6: column 3: \"3,5x\" is no number"), "{e}");
        let e = read_all(&settings, &text.replace("\"3,5\"", "1.234")).err().unwrap();
        assert!(e.contains("\"1.234\" is no number"), "{e}");
    }

    #[test]
    fn dates_with_times_are_read_with_and_without_a_zone() {
        let settings = settings(
            "separator = \"comma\"\nheader_lines = 1\ntime = { column = \"t\", unit = \"iso8601\" }",
        );
        let text = "t,v\n1970-01-01T00:00:01.5Z,1\n1970-01-01 01:00:02+01:00,2\n1970-01-01T00:00:03.000000001,3\n";
        let rows = read_all(&settings, text).unwrap();
        assert_eq!(rows.stamp, [1_500_000_000, 2_000_000_000, 3_000_000_001]);
        for (bad, wanted) in
            [("noon", "is no date with time"), ("1969-12-31T00:00:00Z", "before 1970")]
        {
            let e = read_all(&settings, &format!("t,v\n{bad},1\n")).err().unwrap();
            assert!(e.contains("a.csv:2:1: ") && e.contains(wanted), "{e}");
        }
    }
}
