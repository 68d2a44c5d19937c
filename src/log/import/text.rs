//! Text columns in; time stamps and rows of numbers out.

use super::{Import, Rows, Separator, Wanted, stamp};
use crate::error::{Error, Errors, Place};

/// Mistakes shown before reading stops.
const SHOWN: usize = 10;

/// Names of the columns, from the last line of the header; none without one.
pub fn header<'t>(settings: &Import, text: &'t str) -> Vec<&'t str> {
    let line = settings.header_lines.checked_sub(1).and_then(|n| text.lines().nth(n));
    line.map(|l| settings.separator.split(l))
        .unwrap_or_default()
        .into_iter()
        .map(|name| name.trim_matches('"'))
        .collect()
}

/// Reads the wanted columns.
///
/// # Errors
/// Cells that are no numbers, rows that are too short, no row at all: all at once, up to ten.
pub fn read(settings: &Import, file: &str, text: &str, wanted: &Wanted) -> Result<Rows, Errors> {
    let mut rows = Rows::new(wanted);
    let mut errors = Errors::default();
    for (number, line) in
        text.lines().enumerate().skip(settings.header_lines).filter(|(_, l)| !l.trim().is_empty())
    {
        let cells = settings.separator.split(line);
        let at = |cell: &str| {
            let column =
                line[..cell.as_ptr() as usize - line.as_ptr() as usize].chars().count() + 1;
            Place { file: file.to_string(), line: number + 1, column }
        };
        let value = |i: usize| match cells.get(i) {
            None => Err(Error::at(
                at(&line[line.len()..]),
                format!("column {} is wanted, the row has {}", i + 1, cells.len()),
            )),
            Some(cell) => parse(cell).ok_or_else(|| {
                Error::at(at(cell), format!("column {}: \"{cell}\" is no number", i + 1))
            }),
        };
        let time = value(wanted.time)
            .and_then(|t| stamp(settings, t).map_err(|e| Error::at(at(cells[wanted.time]), e)));
        if let Some(time) = errors.take(time) {
            rows.push_time(time);
        }
        for (of, out) in wanted.topics.iter().zip(&mut rows.values) {
            out.extend(of.iter().filter_map(|&i| errors.take(value(i))));
        }
        if errors.0.len() >= SHOWN {
            break;
        }
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
