//! Columns in; tables of a known schema, Parquet datasets and campaign-level selections out.
//!
//! Every table the program writes has its schema in `schemas/tables/`, and goes through this
//! module: names, types, units and lengths are checked when a table is built, and the same table
//! gives the same bytes. `docs/tables.md` is the reader's page.

mod build;
pub mod campaign;
mod dataset;
mod flight;
mod page;
mod parquet;
pub mod query;
mod refused;
mod rows;
mod schema;
mod texts;
mod version;
mod want;

use std::ops::Range;
use std::sync::Arc;

use arrow_array::{Array, ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch};

use crate::config;
use crate::error::{Error, Result};
pub use build::Builder;
pub use dataset::{
    PartFile, Unfinished, part_path, parts, read_dataset, read_dataset_of, read_file, read_part,
    read_wanted, write_atomic, write_part,
};
pub use flight::{check_flight, flight_id};
pub use page::page;
pub use schema::{Column, Kind, Schema, schema, schemas};
use texts::Texts;
pub use version::{SCHEMA_VERSION, known};
pub use want::{Is, Rows, Want};

/// What stands in a `stop` column when all is well.
pub const CONVERGED: &str = "converged";

/// Rows of one table: a schema and its columns.
///
/// In memory a missing f64 is NaN; in a file it is null.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    schema: &'static Schema,
    /// The schema's columns, then the dynamic ones.
    columns: Arc<[Column]>,
    batch: RecordBatch,
}

impl Table {
    /// Starts a table of the schema `name`; `finish` checks it.
    pub fn build(name: &str) -> Builder {
        Builder::new(name)
    }

    /// Memory that its columns take.
    pub fn bytes(&self) -> usize {
        self.batch.get_array_memory_size()
    }

    /// The table `name` without rows (and without dynamic columns).
    ///
    /// # Errors
    /// There is no such table.
    pub fn empty(name: &str) -> Result<Table> {
        let schema = schema(name)?;
        let columns: Arc<[Column]> = schema.columns.clone().into();
        let batch = RecordBatch::new_empty(schema::arrow(&columns));
        Ok(Table { schema, columns, batch })
    }

    fn from_arrays(
        schema: &'static Schema,
        columns: Vec<Column>,
        arrays: Vec<ArrayRef>,
    ) -> Result<Table> {
        if let Some((one, other)) = build::alike(&columns).next() {
            let what = format!(
                "table \"{}\": columns \"{one}\" and \"{other}\" differ by case only",
                schema.name
            );
            return Err(Error::new(what)
                .help("many readers take them for one: give one of the signals another name"));
        }
        let batch = RecordBatch::try_new(schema::arrow(&columns), arrays)
            .map_err(|e| Error::new(format!("table \"{}\": {e}", schema.name)))?;
        Ok(Table { schema, columns: columns.into(), batch })
    }

    /// Name of the table.
    pub fn name(&self) -> &'static str {
        &self.schema.name
    }

    /// Its columns, with units and meaning.
    pub fn schema(&self) -> &'static Schema {
        self.schema
    }

    /// The columns of this table, dynamic ones at the end.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.batch.num_rows()
    }

    /// The table as an Arrow batch; every text is held once.
    pub fn batch(&self) -> &RecordBatch {
        &self.batch
    }

    /// Whether there is a column `name`; worth asking only about dynamic ones.
    pub fn has(&self, name: &str) -> bool {
        self.columns.iter().any(|c| c.name == name)
    }

    /// The description of a column.
    ///
    /// # Errors
    /// There is no such column.
    pub fn column(&self, name: &str) -> Result<&Column> {
        self.columns.iter().find(|c| c.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.columns.iter().map(|c| c.name.as_str()).collect();
            let help = match config::nearest(name, names.iter().copied()) {
                Some(near) => format!("did you mean \"{near}\"? It has {}", config::list(&names)),
                None => format!("it has {}", config::list(&names)),
            };
            Error::new(format!("table \"{}\" has no column \"{name}\"", self.name())).help(help)
        })
    }

    fn array<A: 'static>(&self, name: &str, kind: Kind) -> Result<&A> {
        let column = self.column(name)?;
        self.batch.column_by_name(name).and_then(|a| a.as_any().downcast_ref::<A>()).ok_or_else(
            || {
                Error::new(format!(
                    "column \"{name}\" of table \"{}\" is {}, not {}",
                    self.name(),
                    column.kind.word(),
                    kind.word()
                ))
            },
        )
    }

    /// The values of an f64 column; NaN where there is none.
    ///
    /// # Errors
    /// There is no such column, or it is of another type; likewise for the other types.
    pub fn f64(&self, name: &str) -> Result<&[f64]> {
        Ok(self.array::<Float64Array>(name, Kind::F64)?.values())
    }

    /// The values of an i64 column without nulls.
    pub fn i64(&self, name: &str) -> Result<&[i64]> {
        let array = self.array::<Int64Array>(name, Kind::I64)?;
        match array.null_count() {
            0 => Ok(array.values()),
            n => Err(Error::new(format!(
                "column \"{name}\" of table \"{}\" has {n} rows without a value",
                self.name()
            ))),
        }
    }

    /// The values of a column of integers that may be absent.
    pub fn opt_i64(&self, name: &str) -> Result<Vec<Option<i64>>> {
        Ok(self.array::<Int64Array>(name, Kind::I64)?.iter().collect())
    }

    /// The values of a column of truth values.
    pub fn bools(&self, name: &str) -> Result<Vec<bool>> {
        Ok(self
            .array::<BooleanArray>(name, Kind::Bool)?
            .iter()
            .map(|b| b.unwrap_or(false))
            .collect())
    }

    /// The texts of a string column; a missing one is empty.
    pub fn strings(&self, name: &str) -> Result<Vec<&str>> {
        let texts = self.array::<Texts>(name, Kind::String)?;
        Ok(texts::each(texts).map(|text| text.unwrap_or("")).collect())
    }

    /// The values of a column of texts that may be absent.
    pub fn opt_strings(&self, name: &str) -> Result<Vec<Option<&str>>> {
        Ok(texts::each(self.array::<Texts>(name, Kind::String)?).collect())
    }

    /// The rows of a string column whose neighbours have the same text, with that text (empty where
    /// there is none).
    pub fn runs(&self, name: &str) -> Result<Vec<(&str, Range<usize>)>> {
        let texts = self.array::<Texts>(name, Kind::String)?;
        let mut runs: Vec<(&str, Range<usize>)> = Vec::new();
        for (row, text) in texts::each(texts).enumerate() {
            let text = text.unwrap_or("");
            match runs.last_mut().filter(|(last, _)| *last == text) {
                Some((_, rows)) => rows.end = row + 1,
                None => runs.push((text, row..row + 1)),
            }
        }
        Ok(runs)
    }
}

#[cfg(test)]
mod tests;
