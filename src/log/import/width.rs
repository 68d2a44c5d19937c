//! The rows of a text file in; whether each has as many cells as there are columns, out.

use super::cells::Row;
use super::settings::{Import, Separator};

/// How many cells a row may have. A cell too many (a comma in a remark, a decimal comma) moves all behind it
/// by one.
pub struct Width {
    cells: Option<usize>,
    of: &'static str,
    /// Names with blanks in them have other numbers of cells than their columns.
    exact: bool,
    blanks: bool,
}

/// Ends of lines in one quoted cell, at most: more are rows that a quote without its end has swallowed.
const LINES: usize = 4;

impl Width {
    /// What the settings and the line of names say.
    pub fn of(settings: &Import, header: &[String]) -> Width {
        let named = settings.has_names();
        let blanks = settings.separator == Separator::Whitespace;
        let cells = (named && !header.is_empty()).then_some(header.len());
        Width { cells, of: "the line of names", exact: blanks && cells.is_some(), blanks }
    }

    /// Without names the first row says how many there are, but for columns between blanks, behind which
    /// remarks may stand.
    ///
    /// # Errors
    /// In words: the row has others.
    pub fn holds(&mut self, row: &Row) -> Result<(), String> {
        let cells = row.cells;
        let lines = cells.iter().map(|cell| cell.matches('\n').count()).max().unwrap_or(0);
        let is_open = lines > 0 && row.text.matches('"').count() % 2 == 1;
        if lines > LINES || is_open {
            return Err(format!(
                "a quoted cell of {} lines begins in this row: the quote at its end is missing",
                lines + 1
            ));
        }
        let has = cells.iter().rposition(|cell| !cell.is_empty()).map_or(0, |last| last + 1);
        let Some(wanted) = self.cells else {
            if !self.blanks {
                (self.cells, self.of) = (Some(cells.len()), "the first row");
            }
            return Ok(());
        };
        let wrong = has > wanted || self.exact && has < wanted;
        let why = if self.blanks {
            "a name with a blank in it counts as two: give the columns by number"
        } else {
            "a separator within a cell that is not quoted?"
        };
        if wrong {
            return Err(format!("the row has {has} cells, {} has {wanted}: {why}", self.of));
        }
        Ok(())
    }
}
