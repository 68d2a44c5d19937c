//! Tables in; the same rows put together, chosen or sorted, out.

use std::borrow::Borrow;
use std::cmp::Ordering;
use std::ops::Range;
use std::sync::Arc;

use arrow_array::{
    Array, ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, UInt64Array,
};
use arrow_schema::SchemaRef;

use super::texts::{self, Texts};
use super::{Column, Schema, Table, schema};
use crate::error::{Error, Result};

impl Table {
    /// All rows of `tables`, one after the other. A dynamic column that one of them lacks is NaN
    /// there.
    ///
    /// # Errors
    /// A table is not of the schema `name`, or a dynamic column has two units.
    pub fn concat<T: Borrow<Table>>(name: &str, tables: &[T]) -> Result<Table> {
        let tables: Vec<&Table> = tables.iter().map(Borrow::borrow).collect();
        let schema = schema(name)?;
        if let Some(table) = tables.iter().find(|table| table.schema != schema) {
            return Err(Error::new(format!(
                "table \"{}\" cannot be put together with \"{name}\"",
                table.name()
            )));
        }
        if tables.is_empty() {
            return Table::empty(name);
        }
        let mut columns = united(schema, tables.iter().map(|table| table.columns()))?;
        // not all of them need have been read
        columns.retain(|column| tables.iter().any(|table| table.has(&column.name)));
        let arrays =
            columns.iter().map(|c| concat_column(c, &tables)).collect::<Result<Vec<_>>>()?;
        Table::from_arrays(schema, columns, arrays)
    }

    /// The rows of these numbers, in their order.
    ///
    /// # Errors
    /// There are fewer rows.
    pub fn take(&self, rows: &[usize]) -> Result<Table> {
        if let Some(row) = rows.iter().find(|&&r| r >= self.rows()) {
            return Err(Error::new(format!(
                "table \"{}\" has {} rows, no row {row}",
                self.name(),
                self.rows()
            )));
        }
        let indices = UInt64Array::from_iter_values(rows.iter().map(|&r| r as u64));
        let arrays =
            self.batch.columns().iter().map(|a| arrow_select::take::take(a, &indices, None));
        let arrays = arrays
            .collect::<std::result::Result<Vec<_>, _>>()
            .map_err(|e| Error::new(e.to_string()))?;
        Table::from_arrays(self.schema, self.columns.to_vec(), arrays)
    }

    /// The rows for which `keep` says yes.
    ///
    /// # Errors
    /// None that a caller can cause.
    pub fn filter(&self, keep: impl Fn(usize) -> bool) -> Result<Table> {
        self.take(&(0..self.rows()).filter(|&row| keep(row)).collect::<Vec<_>>())
    }

    /// The rows sorted by these columns; equal rows keep their order, missing values come first in
    /// text and whole numbers and last (as NaN) in numbers.
    ///
    /// # Errors
    /// There is no such column.
    pub fn sorted(&self, by: &[&str]) -> Result<Table> {
        let mut keys = Vec::new();
        for name in by {
            self.column(name)?;
            keys.extend(self.batch.column_by_name(name));
        }
        let mut rows: Vec<usize> = (0..self.rows()).collect();
        rows.sort_by(|&a, &b| {
            keys.iter().map(|k| compare(k, a, b)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
        });
        self.take(&rows)
    }
}

/// The columns of several tables of a schema: its own, then the dynamic ones that any of them has.
///
/// # Errors
/// A dynamic column has two units.
pub(super) fn united<'a>(
    schema: &Schema,
    all: impl Iterator<Item = &'a [Column]>,
) -> Result<Vec<Column>> {
    let mut columns = schema.columns.clone();
    for column in all.flatten() {
        match columns.iter().find(|c| c.name == column.name) {
            None => columns.push(column.clone()),
            Some(known) if known.unit != column.unit => {
                let what = format!(
                    "column \"{}\" of \"{}\" is in {} and in {}",
                    column.name, schema.name, known.unit, column.unit
                );
                return Err(Error::new(what).help("give the signal the same unit for all flights"));
            }
            Some(_) => {}
        }
    }
    Ok(columns)
}

fn compare(array: &ArrayRef, a: usize, b: usize) -> Ordering {
    fn values<T: Ord>(
        array: &dyn Array,
        a: usize,
        b: usize,
        value: impl Fn(usize) -> T,
    ) -> Ordering {
        let get = |i: usize| array.is_valid(i).then(|| value(i));
        get(a).cmp(&get(b))
    }
    let any = array.as_any();
    if let Some(x) = any.downcast_ref::<Float64Array>() {
        x.value(a).total_cmp(&x.value(b))
    } else if let Some(x) = any.downcast_ref::<Int64Array>() {
        values(x, a, b, |i| x.value(i))
    } else if let Some(x) = any.downcast_ref::<Texts>() {
        texts::at(x, a).cmp(&texts::at(x, b))
    } else if let Some(x) = any.downcast_ref::<BooleanArray>() {
        values(x, a, b, |i| x.value(i))
    } else {
        Ordering::Equal
    }
}

fn concat_column(column: &Column, tables: &[&Table]) -> Result<ArrayRef> {
    let arrays: Vec<ArrayRef> = tables
        .iter()
        .map(|t| match t.batch.column_by_name(&column.name) {
            Some(array) => array.clone(),
            None => Arc::new(Float64Array::from(vec![f64::NAN; t.rows()])),
        })
        .collect();
    let parts: Vec<&dyn Array> = arrays.iter().map(|a| a.as_ref()).collect();
    arrow_select::concat::concat(&parts)
        .map_err(|e| Error::new(format!("column \"{}\": {e}", column.name)))
}

impl Table {
    /// The columns of a file: that of the flight is in the path of a per-flight table.
    pub(super) fn file_columns(&self) -> impl Iterator<Item = &Column> {
        self.columns.iter().filter(|c| !self.is_in_path(c))
    }

    fn is_in_path(&self, column: &Column) -> bool {
        self.schema.per_flight && column.name == "flight"
    }

    /// These rows as they lie in a file of the columns `schema`.
    pub(super) fn in_file(&self, schema: &SchemaRef, rows: Range<usize>) -> Result<RecordBatch> {
        let all = self.columns.iter().zip(self.batch.columns());
        let arrays = all
            .filter(|(column, _)| !self.is_in_path(column))
            .map(|(column, array)| as_filed(column, &array.slice(rows.start, rows.len())))
            .collect();
        RecordBatch::try_new(schema.clone(), arrays)
            .map_err(|e| Error::new(format!("table \"{}\": {e}", self.name())))
    }
}

/// Null where a number is NaN, and plain texts.
fn as_filed(column: &Column, array: &ArrayRef) -> ArrayRef {
    let any = array.as_any();
    if let Some(texts) = any.downcast_ref::<Texts>() {
        return texts::plain(texts);
    }
    match any.downcast_ref::<Float64Array>().filter(|_| column.nullable) {
        Some(numbers) => {
            let known = |&v: &f64| (!v.is_nan()).then_some(v);
            Arc::new(numbers.values().iter().map(known).collect::<Float64Array>())
        }
        None => array.clone(),
    }
}
