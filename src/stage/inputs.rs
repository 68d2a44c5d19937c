//! What a unit of a stage reads and hands back: tables by name and part, the log's path; tables, files
//! and notes.

use super::notes::Note;
use crate::engine::{Engine, Kept};
use crate::error::{Error, Result};
use crate::table::{Rows, Table, Want};
use indexmap::IndexMap;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

/// A part of a table: one file of the dataset.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Part {
    /// `<table>/flight=<id>/part-0.parquet`
    Flight(String),
    /// `<table>/part-<number>.parquet`
    Number(usize),
    /// What one flight has of a numbered part: `<table>/part-<number>-<id>.parquet`
    Of(usize, String),
}

/// By flight, or by number and then by flight.
impl Ord for Part {
    fn cmp(&self, other: &Part) -> Ordering {
        (self.number(), self.flight()).cmp(&(other.number(), other.flight()))
    }
}

impl PartialOrd for Part {
    fn partial_cmp(&self, other: &Part) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Part {
    /// The part's file, relative to the output folder.
    pub fn path(&self, table: &str) -> String {
        match self {
            Part::Flight(id) => format!("{table}/flight={id}/part-0.parquet"),
            Part::Number(i) => format!("{table}/part-{i}.parquet"),
            Part::Of(i, id) => format!("{table}/part-{i}-{id}.parquet"),
        }
    }

    /// The flight that it is of alone.
    pub fn flight(&self) -> Option<&str> {
        match self {
            Part::Flight(id) | Part::Of(_, id) => Some(id),
            Part::Number(_) => None,
        }
    }

    /// The flight in whose folder it stands: a column that its file does not have.
    pub fn folder(&self) -> Option<&str> {
        if let Part::Flight(id) = self { Some(id) } else { None }
    }

    /// Its number, where parts are numbered.
    pub fn number(&self) -> Option<usize> {
        match self {
            Part::Number(i) | Part::Of(i, _) => Some(*i),
            Part::Flight(_) => None,
        }
    }

    /// The table and the part that a file is, by its path relative to the output folder; none for a
    /// file that is no part of a table.
    pub fn of_path(path: &str) -> Option<(&str, Part)> {
        let (folder, file) = path.rsplit_once('/')?;
        let name = file.strip_prefix("part-")?.strip_suffix(".parquet")?;
        let (number, piece) = name.split_once('-').map_or((name, None), |(n, id)| (n, Some(id)));
        let number = number.parse().ok()?;
        match (folder.split_once("/flight="), piece) {
            (Some((table, flight)), _) => Some((table, Part::Flight(flight.to_string()))),
            (None, Some(id)) => Some((folder, Part::Of(number, id.to_string()))),
            (None, None) => Some((folder, Part::Number(number))),
        }
    }

    /// The part in words.
    pub fn words(&self, table: &str) -> String {
        match self {
            Part::Flight(id) => format!("{table} of {id}"),
            Part::Number(0) => table.to_string(),
            Part::Number(i) => format!("{table}, part {i}"),
            Part::Of(i, id) => format!("{table} of {id}, part {i}"),
        }
    }
}

/// What a unit of a stage is given.
pub struct Inputs<'a> {
    /// Which parts of which tables there are.
    pub parts: BTreeSet<(&'static str, Part)>,
    /// Brings one of them. A stage asks when it needs one and lets it go when it is done: not all
    /// flights of a campaign fit into memory at once.
    pub table: &'a (dyn Fn(&'static str, &Part, Want) -> Result<Table> + Sync),
    /// The flight's log, for a stage that reads it.
    pub log: Option<&'a Path>,
    /// Reports work done to whoever watches: so many steps done of so many.
    pub progress: &'a (dyn Fn(usize, usize) + Sync),
    /// Tells whoever watches what is being done.
    pub tell: &'a (dyn Fn(&str) + Sync),
    /// Does the work that a unit hands on.
    pub engine: &'a dyn Engine,
    /// What this process keeps.
    pub kept: &'a Kept,
}

impl Inputs<'_> {
    /// This flight's part of a table.
    ///
    /// # Errors
    /// It is not among the unit's inputs, or cannot be read.
    pub fn of(&self, table: &'static str, flight: &str) -> Result<Table> {
        self.flight(table, flight)?.ok_or_else(|| {
            Error::new(format!("there is no table `{table}` of flight {flight}"))
                .help("run the pipeline again")
        })
    }

    /// This flight's part of a table, if there is one.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn flight(&self, table: &'static str, flight: &str) -> Result<Option<Table>> {
        self.get(table, Part::Flight(flight.to_string()))
    }

    /// This flight's samples: the grid and these columns, if there are any. Of a long flight all of
    /// them together are large.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn samples(&self, flight: &str, columns: &[String]) -> Result<Option<Table>> {
        self.wanted("samples", flight, Want { columns: Some(columns), ..Want::default() })
    }

    /// This flight's signals of these names, if there are any; the flight is not told again.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn signals(&self, flight: &str, names: &[String]) -> Result<Option<Table>> {
        let names: BTreeSet<String> = names.iter().cloned().collect();
        let rows = Rows::Of("signal", Arc::new(move |name| names.contains(name)));
        let own = ["signal", "t_s", "value"].map(String::from);
        self.wanted(
            "signals",
            flight,
            Want { own: Some(&own), rows: Some(&rows), ..Want::default() },
        )
    }

    /// What is wanted of this flight's part of a table, if there is one.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn wanted(&self, table: &'static str, flight: &str, want: Want) -> Result<Option<Table>> {
        let wanted = (table, Part::Flight(flight.to_string()));
        let read = || (self.table)(table, &wanted.1, want);
        self.parts.contains(&wanted).then(read).transpose()
    }

    /// One part of a table, if there is one.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn get(&self, table: &'static str, part: Part) -> Result<Option<Table>> {
        let wanted = (table, part);
        self.parts
            .contains(&wanted)
            .then(|| (self.table)(table, &wanted.1, Want::default()))
            .transpose()
    }

    /// The numbered part of a table with those of single flights, one below the other, if there is
    /// any.
    ///
    /// # Errors
    /// One cannot be read.
    pub fn numbered(&self, table: &'static str, number: usize) -> Result<Option<Table>> {
        let mut parts = self.read(table, |part| part.number() == Some(number), Want::default())?;
        match parts.len() {
            0 | 1 => Ok(parts.pop()),
            _ => Table::concat(table, &parts).map(Some),
        }
    }

    /// All parts of a table that exist, in order.
    ///
    /// # Errors
    /// One cannot be read.
    pub fn all(&self, table: &'static str) -> Result<Vec<Table>> {
        self.all_with(table, Want::default())
    }

    /// The same, with what is wanted of them alone.
    ///
    /// # Errors
    /// One cannot be read.
    pub fn all_with(&self, table: &'static str, want: Want) -> Result<Vec<Table>> {
        self.read(table, |_| true, want)
    }

    /// The parts of a table that are meant, in order; a campaign has one for each of its flights.
    fn read(
        &self,
        table: &'static str,
        is_meant: impl Fn(&Part) -> bool,
        want: Want,
    ) -> Result<Vec<Table>> {
        let of_table = self.parts.iter().filter(|(name, part)| *name == table && is_meant(part));
        let parts: Vec<&Part> = of_table.map(|(_, part)| part).collect();
        let read: Vec<Result<Table>> =
            parts.into_par_iter().map(|part| (self.table)(table, part, want)).collect();
        read.into_iter().collect()
    }
}

/// What a stage hands back: the pipeline files it.
#[derive(Debug, Default)]
pub struct Output {
    /// Tables by name; each becomes the unit's part of that table.
    pub tables: Vec<(&'static str, Table)>,
    /// Other files, by path relative to the output folder.
    pub files: Vec<(String, Vec<u8>)>,
    pub notes: Vec<Note>,
}

/// Times and values of a signal.
pub type Series<'a> = (&'a [f64], &'a [f64]);

/// The signals of the long table, by name: times and values.
///
/// # Errors
/// The table lacks a column.
pub fn series(signals: &Table) -> Result<IndexMap<&str, Series<'_>>> {
    let (t, values) = (signals.f64("t_s")?, signals.f64("value")?);
    let runs = signals.runs("signal")?.into_iter();
    Ok(runs.map(|(name, rows)| (name, (&t[rows.clone()], &values[rows]))).collect())
}
