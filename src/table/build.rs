//! Columns by name in; a checked table, or everything that is wrong with the columns, out.

use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray, Float64Array, Int64Array};

use super::Table;
use super::schema::{Column, Kind, Schema, schema};
use super::texts;
use crate::error::{Error, Result};

/// A table under construction.
///
/// ```
/// # use koehler::table::Table;
/// let table = Table::build("conditions")
///     .repeat("flight", "flight-01")
///     .strings("segment", ["s1", "s1"])
///     .strings("signal", ["alpha", "V"])
///     .strings("unit", ["rad", "m/s"])
///     .f64("value", vec![0.05, f64::NAN])
///     .finish()?;
/// assert_eq!(table.rows(), 2);
/// # Ok::<(), koehler::error::Error>(())
/// ```
#[derive(Debug)]
pub struct Builder {
    table: String,
    given: Vec<Given>,
}

#[derive(Debug)]
struct Given {
    name: String,
    values: Values,
    /// Unit and meaning of a dynamic column.
    dynamic: Option<(String, String)>,
}

#[derive(Debug)]
enum Values {
    Repeat(String),
    Array(ArrayRef, Kind),
    /// Texts of more bytes than an Arrow array holds.
    TooLong,
}

impl Builder {
    pub(super) fn new(table: &str) -> Self {
        Builder { table: table.into(), given: Vec::new() }
    }

    fn array(mut self, name: &str, array: ArrayRef, kind: Kind) -> Self {
        self.given.push(Given {
            name: name.into(),
            values: Values::Array(array, kind),
            dynamic: None,
        });
        self
    }

    /// Numbers; NaN where there is none, which the column must allow.
    pub fn f64(self, name: &str, values: impl Into<Vec<f64>>) -> Self {
        self.array(name, Arc::new(Float64Array::from(values.into())), Kind::F64)
    }

    /// A column of integers.
    pub fn i64(self, name: &str, values: impl Into<Vec<i64>>) -> Self {
        self.array(name, Arc::new(Int64Array::from(values.into())), Kind::I64)
    }

    /// A column of integers that may be absent.
    pub fn opt_i64(self, name: &str, values: impl Into<Vec<Option<i64>>>) -> Self {
        self.array(name, Arc::new(Int64Array::from(values.into())), Kind::I64)
    }

    /// A column of truth values.
    pub fn bools(self, name: &str, values: impl Into<Vec<bool>>) -> Self {
        self.array(name, Arc::new(BooleanArray::from(values.into())), Kind::Bool)
    }

    /// A column of texts.
    pub fn strings<S: AsRef<str>>(self, name: &str, values: impl IntoIterator<Item = S>) -> Self {
        self.opt_strings(name, values.into_iter().map(Some))
    }

    /// A column of texts that may be absent.
    pub fn opt_strings<S: AsRef<str>>(
        self,
        name: &str,
        values: impl IntoIterator<Item = Option<S>>,
    ) -> Self {
        self.texts(name, texts::column(values))
    }

    /// A column of texts, each in so many rows.
    pub fn runs<S: AsRef<str>>(
        self,
        name: &str,
        runs: impl IntoIterator<Item = (S, usize)>,
    ) -> Self {
        let runs: Vec<(S, usize)> = runs.into_iter().collect();
        let mut all = texts::Collector::of(runs.iter().map(|(_, rows)| rows).sum());
        runs.iter().for_each(|(text, rows)| all.run(text.as_ref(), *rows));
        self.texts(name, all.finish())
    }

    fn texts(mut self, name: &str, array: Option<ArrayRef>) -> Self {
        let values = array.map_or(Values::TooLong, |array| Values::Array(array, Kind::String));
        self.given.push(Given { name: name.into(), values, dynamic: None });
        self
    }

    /// One text for all rows.
    pub fn repeat(mut self, name: &str, value: &str) -> Self {
        self.given.push(Given {
            name: name.into(),
            values: Values::Repeat(value.into()),
            dynamic: None,
        });
        self
    }

    /// A further f64 column of a table that allows them; NaN where there is no value.
    pub fn dynamic(
        mut self,
        name: &str,
        unit: &str,
        doc: &str,
        values: impl Into<Vec<f64>>,
    ) -> Self {
        let values = Values::Array(Arc::new(Float64Array::from(values.into())), Kind::F64);
        self.given.push(Given {
            name: name.into(),
            values,
            dynamic: Some((unit.into(), doc.into())),
        });
        self
    }

    /// The table.
    ///
    /// # Errors
    /// A column is missing, unknown, given twice (also when spelled with other capitals), of
    /// another type or length, or lacks values that it must have: all of it in one error.
    pub fn finish(self) -> Result<Table> {
        let schema = schema(&self.table)?;
        let rows = self.given.iter().find_map(|g| g.rows()).unwrap_or(0);
        let mut wrong = Vec::new();
        let mut columns = schema.columns.clone();
        for (i, given) in self.given.iter().enumerate() {
            if self.given.iter().take(i).any(|g| g.name == given.name) {
                wrong.push(format!("column \"{}\" is given twice", given.name));
            } else if !schema.columns.iter().any(|c| c.name == given.name) {
                match given.column(schema) {
                    Some(column) => columns.push(column),
                    None => wrong.push(format!("column \"{}\" is not of this table", given.name)),
                }
            }
        }
        wrong.extend(
            alike(&columns).map(|(one, other)| {
                format!("columns \"{one}\" and \"{other}\" differ by case only")
            }),
        );
        let mut arrays = Vec::new();
        for column in &columns {
            match self.given.iter().find(|g| g.name == column.name) {
                Some(given) => arrays.extend(given.checked(column, rows, &mut wrong)),
                None => wrong.push(format!("column \"{}\" is missing", column.name)),
            }
        }
        if wrong.is_empty() {
            Table::from_arrays(schema, columns, arrays)
        } else {
            Err(Error::new(format!("table \"{}\": {}", self.table, wrong.join("; "))))
        }
    }
}

/// The columns whose names differ by case only, each with the one before it: DuckDB and Spark take
/// the two for one.
pub(super) fn alike(columns: &[Column]) -> impl Iterator<Item = (&str, &str)> {
    let lower: Vec<String> = columns.iter().map(|c| c.name.to_lowercase()).collect();
    let before = move |i: usize| {
        (0..i).find(|&k| lower[k] == lower[i] && columns[k].name != columns[i].name)
    };
    (0..columns.len()).filter_map(move |i| {
        before(i).map(|k| (columns[k].name.as_str(), columns[i].name.as_str()))
    })
}

impl Given {
    fn rows(&self) -> Option<usize> {
        match &self.values {
            Values::Array(array, _) => Some(array.len()),
            Values::Repeat(_) | Values::TooLong => None,
        }
    }

    /// The description of a dynamic column, where the schema allows them.
    fn column(&self, schema: &Schema) -> Option<Column> {
        schema.dynamic.as_ref()?;
        let (unit, doc) = self.dynamic.clone()?;
        Some(Column { name: self.name.clone(), kind: Kind::F64, unit, nullable: true, doc })
    }

    fn checked(&self, column: &Column, rows: usize, wrong: &mut Vec<String>) -> Option<ArrayRef> {
        let name = &column.name;
        let given = match &self.values {
            Values::Repeat(text) => texts::repeated(text, rows).map(|array| (array, Kind::String)),
            Values::Array(array, kind) => Some((array.clone(), *kind)),
            Values::TooLong => None,
        };
        let Some((array, kind)) = given else {
            wrong.push(format!("column \"{name}\" has more than 2 GiB of text"));
            return None;
        };
        if kind != column.kind {
            wrong.push(format!(
                "column \"{name}\" must be {}, not {}",
                column.kind.word(),
                kind.word()
            ));
            return None;
        }
        if array.len() != rows {
            wrong.push(format!("column \"{name}\" has {} rows, the others {rows}", array.len()));
        }
        let missing = match array.as_any().downcast_ref::<Float64Array>() {
            Some(numbers) => numbers.values().iter().position(|v| v.is_nan()),
            None => (0..array.len()).find(|&i| array.is_null(i)),
        };
        if let Some(row) = missing.filter(|_| !column.nullable) {
            wrong.push(format!("column \"{name}\" has no value in row {row}, and must have one"));
        }
        Some(array)
    }
}
