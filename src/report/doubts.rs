//! `doubts` in; what is known to move estimates and is not in their standard deviations, as a table and as a
//! sentence, out.

use super::columns::Columns;
use super::format::{count, few, number};
use super::grid::{Cell, Grid, Level};
use std::collections::BTreeSet;

/// One cause, over all estimates of a model that it moves.
struct Cause {
    model: String,
    cause: String,
    /// Estimates with it.
    groups: usize,
    /// Parameters with the standard deviations by which each is moved at most, the largest first.
    moved: Vec<(String, f64)>,
}

/// The causes, those that move a value most first.
fn causes(table: &Columns) -> Vec<Cause> {
    let of = |([model, cause], rows): ([String; 2], Vec<usize>)| {
        let groups: BTreeSet<String> = rows.iter().map(|&row| table.text("group", row)).collect();
        let mut moved: Vec<(String, f64)> = Vec::new();
        for &row in &rows {
            let (name, by) = (table.text("parameter", row), table.number("by_sd", row));
            match moved.iter_mut().find(|(known, _)| *known == name) {
                Some((_, most)) => *most = most.max(by),
                None => moved.push((name, by)),
            }
        }
        moved.sort_by(|a, b| b.1.total_cmp(&a.1));
        Cause { model, cause, groups: groups.len(), moved }
    };
    let mut all: Vec<Cause> = table.groups(["model", "cause"]).into_iter().map(of).collect();
    let most = |cause: &Cause| cause.moved.first().map_or(0.0, |(_, by)| *by);
    all.sort_by(|a, b| most(b).total_cmp(&most(a)));
    all
}

/// Every cause with what it moves.
pub fn doubts(table: Option<&Columns>) -> Grid {
    let none = "Nothing is known to move an estimate that its standard deviation does not know of.";
    let Some(table) = table.filter(|t| t.rows() > 0) else { return Grid::missing(none) };
    let mut grid = Grid::new(["model", "~cause", "#estimates", "parameter", "#by at most|sd"]);
    for cause in causes(table) {
        for (parameter, by) in &cause.moved {
            grid.push(vec![
                cause.model.as_str().into(),
                cause.cause.as_str().into(),
                Cell::new(cause.groups.to_string()),
                parameter.as_str().into(),
                Cell::new(number(*by, 2)),
            ]);
        }
    }
    grid.note = Some("What is to be done about each stands among the notes.".into());
    grid
}

/// The sentence of the checks; none where nothing is known to move anything.
pub fn summary(table: Option<&Columns>) -> Option<(Level, String)> {
    let words = |cause: &Cause| {
        let (name, by) = cause.moved.first()?;
        let more = match cause.moved.len() - 1 {
            0 => String::new(),
            more => format!(" and {} less", count(more, "other")),
        };
        let of = count(cause.groups, "estimate");
        let (model, cause) = (&cause.model, &cause.cause);
        Some(format!("{cause} ({of} of {model}: {name} by {} sd{more})", number(*by, 2)))
    };
    let all: Vec<String> = causes(table?).iter().filter_map(words).collect();
    (!all.is_empty()).then(|| {
        let text = format!(
            "Something that standard deviations know nothing of moves estimates: {}. The notes say what to do.",
            few(&all)
        );
        (Level::Warn, text)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    #[test]
    fn the_cause_that_moves_most_is_told_first() {
        let table = Table::build("doubts")
            .repeat("model", "six")
            .strings("group", ["a", "a", "b", "b"])
            .strings("cause", ["noise of inputs", "records shifted in time"].repeat(2))
            .strings("parameter", ["C_m_q", "C_m_de", "C_m_q", "C_m_alpha"])
            .f64("by_sd", [1.5, 12.0, 1.2, 3.0])
            .finish()
            .unwrap();
        let table = Columns::of(&table);
        let (level, text) = summary(Some(&table)).unwrap();
        assert_eq!(level, Level::Warn);
        let first = "records shifted in time (2 estimates of six: C_m_de by 12 sd and 1 other less), noise of inputs (2 estimates of six: C_m_q by 1.5 sd)";
        assert!(text.contains(first), "{text}");
        assert_eq!(doubts(Some(&table)).rows.len(), 3);
        assert_eq!(summary(None), None);
    }
}
