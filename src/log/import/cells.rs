//! Text in; its rows as cells, and what is in a cell, out.

use super::settings::{Decimal, Import, Separator};

/// The text without the mark that some programs put in front of it.
pub fn plain(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// A row of a text.
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    /// Its first byte in the text.
    pub start: usize,
    /// All of it, with the end of its last line.
    pub text: &'a str,
    pub cells: &'a [&'a str],
    /// Blank lines between the row before it and this one.
    pub blank: usize,
}

/// Calls `each` with every row that is not blank, as long as it says to go on.
pub fn each_row(separator: Separator, text: &str, each: &mut dyn FnMut(Row) -> bool) {
    let mut blanks = Blanks::default();
    let Some(by) = separator.byte() else {
        let mut start = 0;
        for line in text.split_inclusive('\n') {
            let cells: Vec<&str> = line.split_whitespace().collect();
            if cells.is_empty() {
                blanks.add(1);
            } else if !each(Row { start, text: line, cells: &cells, blank: blanks.end() }) {
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
        let to = reader.position().byte() as usize;
        // Blank lines before a row count as its beginning.
        let row = text.get(from..to).unwrap_or("").trim_start_matches(['\r', '\n']);
        let start = to - row.len();
        blanks.add(blank_lines(text, from, start));
        let cells: Vec<&str> = record.iter().collect();
        if cells == [""] {
            blanks.add(1);
        } else if !each(Row { start, text: row, cells: &cells, blank: blanks.end() }) {
            return;
        }
    }
}

/// Blank lines since the last row; before the first row there are none that count.
#[derive(Default)]
struct Blanks {
    behind_a_row: bool,
    count: usize,
}

impl Blanks {
    fn add(&mut self, lines: usize) {
        self.count += if self.behind_a_row { lines } else { 0 };
    }

    /// Their number, where a row ends them.
    fn end(&mut self) -> usize {
        self.behind_a_row = true;
        std::mem::take(&mut self.count)
    }
}

/// The ends of lines from `from` to `start`. The reader stops between the two letters of one that has
/// two: the second is no line of its own.
fn blank_lines(text: &str, from: usize, start: usize) -> usize {
    let ends = text.get(from..start).unwrap_or("");
    let is_cut = text.get(..from).is_some_and(|before| before.ends_with('\r'));
    let ends = ends.strip_prefix('\n').filter(|_| is_cut).unwrap_or(ends);
    ends.len() - ends.matches("\r\n").count()
}

/// Where a cell of a line begins, in letters from 1; behind the line where it has no such cell.
pub fn column_of(separator: Separator, line: &str, cell: usize) -> usize {
    let (mut before, mut quoted, mut blank) = (0, false, true);
    for (i, c) in line.chars().enumerate() {
        match separator.byte() {
            Some(by) => {
                let is_by = c == char::from(by);
                let starts = before == cell && (i == 0 || is_by || !c.is_whitespace());
                // An empty cell begins where it ends.
                if starts {
                    return i + 1;
                }
                quoted ^= c == '"';
                before += usize::from(is_by && !quoted);
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

/// Whether a cell has no value: nothing, or what stands for a missing one, however a number is written.
pub fn is_missing(settings: &Import, cell: &str) -> bool {
    cell.is_empty()
        || settings.missing.iter().any(|m| m == cell)
        || parsed(settings, cell).is_some_and(|number| settings.says_missing(number))
}

/// A number, or NaN where the cell is empty or says that it is missing.
pub fn number(settings: &Import, cell: &str) -> Option<f64> {
    if cell.is_empty() || settings.missing.iter().any(|m| m == cell) {
        return Some(f64::NAN);
    }
    parsed(settings, cell).map(|x| if settings.says_missing(x) { f64::NAN } else { x })
}

/// The whole number that a cell is, all its digits; none where it has a point or an exponent, or more digits
/// than fit.
pub fn whole(cell: &str) -> Option<i128> {
    let digits = cell.strip_prefix('-').unwrap_or(cell);
    let is_whole = !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit());
    is_whole.then(|| cell.parse().ok()).flatten()
}

/// Whole numbers with fewer letters than this are `f64` with all their digits: 2^53 has so many.
const LONG: usize = 16;

/// The whole number that a cell is, where it is so long that digits of it may be lost, and stands for no missing
/// value.
pub fn long(settings: &Import, cell: &str) -> Option<i128> {
    let n = Some(cell).filter(|cell| cell.len() >= LONG).and_then(whole)?;
    (!is_missing(settings, cell)).then_some(n)
}

fn parsed(settings: &Import, cell: &str) -> Option<f64> {
    match settings.decimal {
        Decimal::Point => fast_float2::parse::<f64, _>(cell).ok(),
        // A point would be one of thousands: read as a decimal point, it makes 1.234 a thousandth of itself.
        Decimal::Comma if cell.contains('.') => None,
        Decimal::Comma => fast_float2::parse::<f64, _>(cell.replacen(',', ".", 1)).ok(),
    }
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

    #[test]
    fn blank_lines_between_rows_are_counted_whatever_ends_them() {
        let blank = |separator, text: &str| {
            let mut all = Vec::new();
            each_row(separator, text, &mut |row| {
                all.push(row.blank);
                true
            });
            all
        };
        for end in ["\n", "\r\n", "\r"] {
            let text = "\n\n1\n2\n\n3\n  \n\n\"\"\n4\n5\n\n".replace('\n', end);
            assert_eq!(blank(Separator::Comma, &text), [0, 0, 1, 3, 0], "{end:?}");
        }
        assert_eq!(blank(Separator::Whitespace, "\n1 2\r\n \r\n\r\n3 4\r\n5 6\n\n"), [0, 2, 0]);
    }
}
