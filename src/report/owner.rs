//! Flights and their segments in; which flight a row of a table is about out.

use super::columns::Columns;
use super::flights::is_record;
use crate::error::Result;
use crate::table::Table;
use std::collections::{BTreeMap, BTreeSet};

/// Whose segments, groups of segments and records are: names repeat in many tables, flights do not.
#[derive(Debug, Clone, Default)]
pub struct Owners {
    flights: BTreeSet<String>,
    /// Flight by segment.
    segments: BTreeMap<String, String>,
}

/// Columns that say what a row is about, the first one that says something first.
const ABOUT: [&str; 2] = ["segment", "group"];

impl Owners {
    /// These flights with their rows of the table `segments`.
    pub fn of(flights: &[String], segments: Option<&Columns>) -> Owners {
        let row = |s: &Columns, row: usize| (s.text("segment", row), s.text("flight", row));
        let all = segments.map(|s| (0..s.rows()).map(|r| row(s, r)).collect());
        Owners { flights: flights.iter().cloned().collect(), segments: all.unwrap_or_default() }
    }

    /// The same for one flight and the tables of its own segments.
    ///
    /// # Errors
    /// The table lacks a column.
    pub fn of_flight(flight: &str, segments: Option<&Table>) -> Result<Owners> {
        let names = segments.map(|s| s.strings("segment")).transpose()?.unwrap_or_default();
        Ok(Owners {
            flights: BTreeSet::from([flight.to_string()]),
            segments: names.iter().map(|s| (s.to_string(), flight.to_string())).collect(),
        })
    }

    /// The flight of a segment, of a group that is one, of a record or a piece of one.
    pub fn flight(&self, name: &str) -> Option<&str> {
        let record = || {
            let piece = name.rsplit_once('-').map(|(flight, _)| flight);
            let known = |flight: &str| self.flights.get(flight);
            known(name).or_else(|| known(piece.filter(|flight| is_record(name, flight))?))
        };
        self.segments.get(name).or_else(record).map(String::as_str)
    }

    /// The first and the last of the names that are a flight's, all of them between: of one flight's
    /// owners.
    pub fn reach(&self, flight: &str) -> [String; 2] {
        let named = || self.segments.keys().map(String::as_str);
        let (first, last) = (flight.to_string(), format!("{flight}-{}", char::MAX));
        let least = named().chain([first.as_str()]).min().unwrap_or_default().to_string();
        let most = named().chain([last.as_str()]).max().unwrap_or_default().to_string();
        [least, most]
    }

    /// Whether a table says of its rows which flight they are about.
    pub fn can_tell(has: impl Fn(&str) -> bool) -> bool {
        has("flight") || ABOUT.iter().any(|name| has(name))
    }

    /// The rows of a table by the flight that they are about.
    pub fn rows(&self, table: &Columns) -> BTreeMap<String, Vec<usize>> {
        let mut all: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for row in 0..table.rows() {
            let said = ABOUT.map(|name| table.text(name, row));
            let named = said.iter().find(|text| !text.is_empty());
            let flight = match table.has("flight") {
                true => Some(table.text("flight", row)),
                false => named.and_then(|name| self.flight(name)).map(String::from),
            };
            if let Some(flight) = flight {
                all.entry(flight).or_default().push(row);
            }
        }
        all
    }

    /// The rows of a table that are about one flight; a table that does not say so as it is.
    ///
    /// # Errors
    /// None that a caller can cause.
    pub fn part(&self, table: Table, flight: &str) -> Result<Table> {
        if table.has("flight") {
            let of = table.strings("flight")?;
            return table.filter(|row| of[row] == flight);
        }
        let about: Vec<Vec<&str>> = ABOUT
            .iter()
            .filter(|name| table.has(name))
            .map(|name| table.strings(name))
            .collect::<Result<_>>()?;
        if about.is_empty() {
            return Ok(table);
        }
        let named = |row: usize| about.iter().map(|c| c[row]).find(|text| !text.is_empty());
        table.filter(|row| named(row).and_then(|name| self.flight(name)) == Some(flight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_and_records_have_their_flights() {
        let segments = Table::build("conditions")
            .strings("flight", ["a", "b"])
            .strings("segment", ["a-s1", "wild"])
            .repeat("signal", "V")
            .repeat("unit", "m/s")
            .f64("value", [1.0, 2.0])
            .finish()
            .expect("rows");
        let owners = Owners::of(&["a".into(), "b".into()], Some(&Columns::of(&segments)));
        let of = |name: &str| owners.flight(name);
        assert_eq!([of("a-s1"), of("wild"), of("all")], [Some("a"), Some("b"), None]);
        assert_eq!([of("b"), of("b-003"), of("b-3")], [Some("b"), Some("b"), None]);
        let mine = Owners::of_flight("a", Some(&segments)).expect("segments");
        assert_eq!(mine.part(segments, "a").expect("rows").rows(), 1);
    }
}
