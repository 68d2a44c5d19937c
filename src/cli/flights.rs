//! The tables of flights come in; a row for each, or one for many of which the same is to be said, goes out.

use crate::error::Result;
use crate::pipeline::{Plan, Store};
use crate::stage::Part;
use crate::table::Table;
use indexmap::IndexMap;
use rayon::prelude::*;

/// Flights shown one by one; of more than these, those of which the same is to be said share a row.
const SHOWN: usize = 30;

/// What is said of the signals of a flight whose log was not read.
const UNREAD: &str = "none: not read";

pub const HEAD: [&str; 5] = ["flight", "signals", "maneuvers", "used", "kinds"];

/// What is shown of the flights, a row each, or one for many.
///
/// # Errors
/// A table cannot be read back.
pub fn rows(plan: &Plan, store: &Store) -> Result<Vec<Vec<String>>> {
    let rows: Vec<Result<Vec<String>>> =
        plan.campaign.flights.par_iter().map(|flight| row(store, flight)).collect();
    rows.into_iter().collect::<Result<_>>().map(gathered)
}

/// What is shown of one flight.
fn row(store: &Store, flight: &str) -> Result<Vec<String>> {
    let part = Part::Flight(flight.to_string());
    let signals = columns(store, "channels", &part, &["signal"])?.map(|t| t.rows());
    let (mut found, mut used, mut kinds) = (0, 0, Vec::new());
    if let Some(segments) = columns(store, "segments", &part, &["included", "kind"])? {
        let included = segments.bools("included")?;
        found = segments.rows();
        used = included.iter().filter(|b| **b).count();
        kinds = tally(&segments.strings("kind")?);
    }
    let signals = signals.map_or(UNREAD.to_string(), |n| n.to_string());
    Ok(vec![flight.to_string(), signals, found.to_string(), used.to_string(), kinds.join(", ")])
}

/// These columns of the part of a table, where there is one.
fn columns(store: &Store, table: &str, part: &Part, own: &[&str]) -> Result<Option<Table>> {
    match store.path(&part.path(table)).exists() {
        true => store.columns(table, part, own).map(Some),
        false => Ok(None),
    }
}

/// These columns of those parts of a table that there are.
pub fn parts(store: &Store, table: &str, parts: &[Part], own: &[&str]) -> Result<Vec<Table>> {
    let read = |part: &Part| columns(store, table, part, own);
    let found: Vec<Result<Option<Table>>> = parts.par_iter().map(read).collect();
    found.into_iter().filter_map(Result::transpose).collect()
}

/// The part of a table, where there is one.
pub fn read(store: &Store, table: &str, part: Part) -> Result<Option<Table>> {
    if store.path(&part.path(table)).exists() {
        store.table(table, &part).map(Some)
    } else {
        Ok(None)
    }
}

/// `["2 x 211", "8 x 3211"]`
pub fn tally(words: &[&str]) -> Vec<String> {
    let mut sorted = words.to_vec();
    sorted.sort_unstable();
    sorted.chunk_by(|a, b| a == b).map(|run| format!("{} x {}", run.len(), run[0])).collect()
}

/// Rows of many flights, the name in front: those that say the same become one; what was not read comes first, then
/// what few share.
fn gathered(rows: Vec<Vec<String>>) -> Vec<Vec<String>> {
    if rows.len() <= SHOWN {
        return rows;
    }
    let mut alike: IndexMap<Vec<String>, Vec<String>> = IndexMap::new();
    for mut row in rows {
        let name = row.remove(0);
        alike.entry(row).or_default().push(name);
    }
    let mut alike: Vec<_> = alike.into_iter().collect();
    alike.sort_by_key(|(row, names)| (row[0] != UNREAD, names.len()));
    let rest = alike.split_off(alike.len().min(SHOWN));
    let named = |names: &[String]| match names {
        [one] => one.clone(),
        many => format!("{} and {} more", many[0], many.len() - 1),
    };
    let mut rows: Vec<Vec<String>> =
        alike.iter().map(|(row, names)| [vec![named(names)], row.clone()].concat()).collect();
    let left: usize = rest.iter().map(|(_, names)| names.len()).sum();
    let last =
        |k: usize| if k == 0 { format!("{left} others, see the report") } else { String::new() };
    rows.extend((left > 0).then(|| (0..HEAD.len()).map(last).collect()));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: usize, maneuvers: usize) -> Vec<String> {
        [name, 3, maneuvers, maneuvers, 0].map(|n| n.to_string()).to_vec()
    }

    #[test]
    fn many_flights_share_rows_and_what_few_say_comes_first() {
        let few: Vec<_> = (0..SHOWN).map(|k| row(k, 24)).collect();
        assert_eq!(gathered(few.clone()), few);
        let many = (0..1000).map(|k| row(k, if k == 700 { 3 } else { 24 })).collect();
        let rows = gathered(many);
        assert_eq!(rows[0], row(700, 3));
        assert_eq!((rows.len(), &*rows[1][0], &*rows[1][2]), (2, "0 and 998 more", "24"));
        let mut each: Vec<_> = (0..100).map(|k| row(k, k)).collect();
        let unread = |k: usize| [&k.to_string(), UNREAD, "0", "0", ""].map(String::from).to_vec();
        each.extend((100..150).map(unread));
        assert_eq!(gathered(each.clone())[0][..2], ["100 and 49 more".to_string(), UNREAD.into()]);
        each.truncate(100);
        let rows = gathered(each);
        assert_eq!((rows.len(), &*rows[SHOWN][0]), (SHOWN + 1, "70 others, see the report"));
    }
}
