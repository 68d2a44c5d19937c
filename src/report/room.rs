//! What a page has room for: so that the report of a thousand flights can be opened.
//!
//! A page of a flight is to stay below 1 MB, and below 300 kB where there are so many that all of them
//! would come to more than some 300 MB; the index below 1 MB. What has no room is said where it is left out, and stands in the tables.

use minijinja::Value;

/// How much is shown on a page.
#[derive(Debug, Clone, Copy)]
pub struct Room {
    /// Rows of one table.
    pub rows: usize,
    /// Numbers that all plots together are drawn from.
    numbers: usize,
}

/// A curve of fewer samples shows nothing.
const LEAST: usize = 40;

impl Room {
    /// Whatever there is.
    pub const ALL: Room = Room { rows: usize::MAX, numbers: usize::MAX };
    /// Numbers stand here as text, nine bytes each.
    pub const INDEX: Room = Room { rows: 100, numbers: 40_000 };
    /// Numbers are packed, 2.7 bytes each.
    pub const FLIGHT: Room = Room { rows: 250, numbers: 240_000 };
    /// A page of a flight among many.
    pub const SMALL: Room = Room { rows: 150, numbers: 72_000 };

    /// Whether there is room for whatever there is.
    pub fn is_all(&self) -> bool {
        self.numbers == usize::MAX
    }

    /// How many fit into so many eighths of the page of what takes `numbers` each.
    pub fn count(&self, eighths: usize, numbers: usize) -> usize {
        (self.numbers / 8).saturating_mul(eighths) / numbers.max(1)
    }

    /// Samples drawn of every curve, at most `most`, where one sample of all curves takes `numbers`.
    pub fn samples(&self, most: usize, eighths: usize, numbers: usize) -> usize {
        most.min(self.count(eighths, numbers).max(LEAST))
    }
}

/// The rows of a grid that are shown (filter of the templates): all, or the most remarkable ones, in
/// their order.
pub fn most(rows: Vec<Value>, most: usize) -> Vec<Value> {
    if rows.len() <= most {
        return rows;
    }
    let mut order: Vec<usize> = (0..rows.len()).collect();
    let ranks: Vec<usize> = rows.iter().map(rank).collect();
    order.sort_by_key(|&i| ranks[i]);
    order.truncate(most);
    order.sort_unstable();
    order.into_iter().filter_map(|i| rows.get(i).cloned()).collect()
}

/// The smaller the more remarkable a row, or the most remarkable of its cells.
fn rank(row: &Value) -> usize {
    let of = |value: &Value| match value.get_attr("level").ok().as_ref().and_then(Value::as_str) {
        Some("bad") => 0,
        Some("warn") => 1,
        _ => 2,
    };
    let cells = row.get_attr("cells").ok();
    let cells = cells.iter().flat_map(|cells| cells.try_iter().into_iter().flatten());
    cells.map(|cell| of(&cell)).chain([of(row)]).min().unwrap_or(2)
}

#[cfg(test)]
mod tests {
    use super::super::grid::{Cell, Grid, Level};
    use super::*;

    #[test]
    fn what_is_remarkable_is_shown_first_and_in_its_place() {
        let mut grid = Grid::new(["a"]);
        for i in 0..9 {
            let level =
                [Level::Good, Level::Warn, Level::Bad][usize::from(i > 4) + usize::from(i == 7)];
            grid.push(vec![Cell::new(i.to_string()).level(level)]);
        }
        let rows: Vec<Value> =
            grid.rows.iter().map(|row| Value::from(minijinja::value::Serde(row))).collect();
        let shown = |n| {
            let text = |row: &Value| {
                let cell = row.get_attr("cells")?.get_item(&Value::from(0))?;
                Ok::<String, minijinja::Error>(cell.get_attr("text")?.to_string())
            };
            most(rows.clone(), n).iter().map(|row| text(row).expect("text")).collect::<String>()
        };
        assert_eq!([shown(1), shown(3), shown(5), shown(20)], ["7", "567", "05678", "012345678"]);
    }

    #[test]
    fn curves_share_the_room() {
        assert_eq!(Room::ALL.samples(1200, 4, 30), 1200);
        assert_eq!(Room::SMALL.samples(5000, 4, 30), 1200);
        assert_eq!(Room::SMALL.samples(5000, 4, 1_000_000), LEAST);
    }
}
