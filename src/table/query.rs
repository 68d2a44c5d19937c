//! An output folder and a query in SQL in; the rows it asks for out.
//!
//! polars plans the query and then asks each table for the columns that it needs: nothing else is
//! read. The answer is for a person or a script, and no table is made of it, so that polars may add
//! up here.

use std::any::Any;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use arrow_array::{Array, ArrayRef, BooleanArray, Float64Array, Int64Array};
use polars::prelude::{
    AnonymousScan, AnonymousScanArgs, AnyValue, Column as Series, DataFrame, DataType, LazyFrame,
    PlSmallStr, PolarsError, PolarsResult, ScanArgsAnonymous, Schema as Types, SchemaRef,
};
use polars::sql::{SQLContext, extract_table_identifiers};
use sqlparser::ast::Statement;
use sqlparser::dialect::GenericDialect;
use sqlparser::parser::Parser;

use super::parquet::TableFile;
pub use super::refused::HELP;
use super::refused::refused;
use super::rows::united;
use super::texts::{self, Texts};
use super::{Column, Kind, PartFile, Schema, parts, schema, schemas};
use crate::error::{Error, Errors, Place, Result};

/// A value of an answer.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// None.
    Null,
    /// Yes or no.
    Truth(bool),
    /// A whole number.
    Whole(i128),
    /// Any other number.
    Number(f64),
    /// A text.
    Text(String),
    /// Several of them, where a query makes lists.
    List(Vec<Cell>),
}

/// What a query asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Names of its columns.
    pub columns: Vec<String>,
    /// Its rows, a value for each column.
    pub rows: Vec<Vec<Cell>>,
}

/// Which files are parts of the tables, by their paths below the folder.
pub type Counts<'a> = &'a dyn Fn(&str) -> bool;

/// A table that there is, with its files that count and the paths of the others.
struct There {
    table: &'static str,
    parts: Vec<PartFile>,
    left_out: Vec<String>,
}

/// What there is of every table, in alphabetical order.
fn there(dir: &Path, counts: Counts) -> Result<Vec<There>> {
    let mut found = Vec::new();
    for schema in schemas() {
        let table = schema.name.as_str();
        let mut there = There { table, parts: Vec::new(), left_out: Vec::new() };
        for part in parts(dir, table)? {
            let path = part.path(table)?;
            if counts(&path) { there.parts.push(part) } else { there.left_out.push(path) }
        }
        found.push(there);
    }
    Ok(found)
}

/// The tables that there are below the folder `dir`, in alphabetical order.
///
/// # Errors
/// A folder cannot be read.
pub fn tables(dir: &Path) -> Result<Vec<&'static str>> {
    Ok(names(&there(dir, &|_| true)?))
}

fn names(found: &[There]) -> Vec<&'static str> {
    found.iter().filter(|there| !there.parts.is_empty()).map(|there| there.table).collect()
}

/// What the query `sql` asks of the tables below the folder `dir`: all parts of a table are one, with
/// the flight as a column.
///
/// # Errors
/// It is no query, or names a table or a column that is not there; a file cannot be read.
pub fn query(dir: &Path, sql: &str) -> std::result::Result<Answer, Errors> {
    query_of(dir, sql, &|_| true, &mut Vec::new())
}

/// The same of the files that count alone; those of the named tables that do not are added to `left_out`,
/// whatever becomes of the query.
///
/// # Errors
/// As `query`.
pub fn query_of(
    dir: &Path,
    sql: &str,
    counts: Counts,
    left_out: &mut Vec<String>,
) -> std::result::Result<Answer, Errors> {
    only_asks(sql)?;
    let found = there(dir, counts)?;
    let there = names(&found);
    let named =
        extract_table_identifiers(sql, false, true).map_err(|e| refused(&e, &there, &[]))?;
    let is_named = |there: &&There| named.is_empty() || named.iter().any(|n| *n == there.table);
    let named_of = || found.iter().filter(is_named);
    left_out.extend(named_of().flat_map(|there| there.left_out.iter().cloned()));
    let failed = Arc::new(Mutex::new(Errors::default()));
    let (mut context, mut columns) = (SQLContext::new(), Vec::new());
    for of in named_of().filter(|of| !of.parts.is_empty()) {
        let scan = Scan::of(dir, of, &failed)?;
        columns.extend(scan.columns.iter().map(|column| column.name.clone()));
        let frame = LazyFrame::anonymous_scan(Arc::new(scan), ScanArgsAnonymous::default())
            .map_err(|e| refused(&e, &there, &columns))?;
        context.register(of.table, frame);
    }
    let answer = context.execute(sql).and_then(LazyFrame::collect).and_then(|frame| rows(&frame));
    let failed = std::mem::take(&mut *failed.lock().unwrap_or_else(|p| p.into_inner()));
    failed.or(())?;
    Ok(answer.map_err(|e| refused(&e, &there, &columns))?)
}

/// Whether a query leaves tables as they are: polars would answer as if it had changed them.
/// What is no SQL at all is refused where it is answered.
fn only_asks(sql: &str) -> Result<()> {
    let asks = |statement: &Statement| {
        let shows = matches!(statement, Statement::Explain { .. } | Statement::ShowTables { .. });
        shows || matches!(statement, Statement::Query(_))
    };
    let all = Parser::parse_sql(&GenericDialect {}, sql).unwrap_or_default();
    let Some(change) = all.iter().find(|statement| !asks(statement)) else {
        return Ok(());
    };
    let change = change.to_string();
    let first = change.split_whitespace().next().unwrap_or_default();
    Err(Error::new(format!("a query changes no table, and this one has {first}")).help(HELP))
}

/// A table that is read when a query wants something of it.
struct Scan {
    dir: PathBuf,
    schema: &'static Schema,
    parts: Vec<PartFile>,
    columns: Vec<Column>,
    /// Files that could not be read: polars hands on no more than a text.
    failed: Arc<Mutex<Errors>>,
}

impl Scan {
    fn of(dir: &Path, there: &There, failed: &Arc<Mutex<Errors>>) -> Result<Scan> {
        let mut scan = Scan {
            dir: dir.to_path_buf(),
            schema: schema(there.table)?,
            parts: there.parts.clone(),
            columns: schema(there.table)?.columns.clone(),
            failed: failed.clone(),
        };
        if scan.schema.dynamic.is_some() {
            let all: Vec<Vec<Column>> = scan
                .parts
                .iter()
                .map(|part| scan.at(part, |file| Ok(file.columns)))
                .collect::<Result<_>>()?;
            scan.columns = united(scan.schema, all.iter().map(Vec::as_slice))?;
        }
        Ok(scan)
    }

    /// What `take` makes of a part.
    fn at<T>(&self, part: &PartFile, take: impl FnOnce(TableFile<File>) -> Result<T>) -> Result<T> {
        let path = self.dir.join(part.path(&self.schema.name)?);
        let place = || Some(Place::file(path.to_string_lossy()));
        let file = File::open(&path).map_err(|e| Error {
            place: place(),
            what: format!("cannot read the file: {e}"),
            help: None,
        })?;
        let taken = TableFile::open(&self.schema.name, file).and_then(take);
        taken.map_err(|e| Error { place: place(), ..e })
    }

    /// These columns of the first parts that have `limit` rows together, one below the other.
    fn frame(&self, wanted: &[PlSmallStr], limit: usize) -> Result<PolarsResult<DataFrame>> {
        let mut pieces: Vec<Vec<ArrayRef>> = wanted.iter().map(|_| Vec::new()).collect();
        let mut rows = 0;
        for part in &self.parts {
            if rows >= limit {
                break;
            }
            let (here, arrays) =
                self.at(part, |file| self.read(file, part.flight.as_deref(), wanted))?;
            rows += here;
            pieces.iter_mut().zip(arrays).for_each(|(pieces, array)| pieces.push(array));
        }
        let series = wanted.iter().zip(&pieces).map(|(name, pieces)| {
            let pieces: Vec<&dyn Array> = pieces.iter().map(AsRef::as_ref).collect();
            let whole = arrow_select::concat::concat(&pieces)
                .map_err(|e| Error::new(format!("column \"{name}\": {e}")))?;
            series(name, &whole)
        });
        let series = series.collect::<Result<Vec<_>>>()?;
        Ok(DataFrame::new(rows, series).map(|frame| frame.head(Some(limit))))
    }

    /// The rows of a part, and these of its columns. What a flight lacks is null.
    fn read(
        &self,
        mut file: TableFile<File>,
        flight: Option<&str>,
        wanted: &[PlSmallStr],
    ) -> Result<(usize, Vec<ArrayRef>)> {
        let rows = file.rows();
        file.columns.retain(|column| wanted.iter().any(|name| *name == column.name));
        let names: Vec<String> = file.columns.iter().map(|column| column.name.clone()).collect();
        let arrays = file.read(flight)?;
        let of = |wanted: &PlSmallStr| match names.iter().position(|name| *wanted == *name) {
            Some(i) => arrays[i].clone(),
            None => Arc::new(Float64Array::from(vec![f64::NAN; rows])),
        };
        Ok((rows, wanted.iter().map(of).collect()))
    }
}

impl AnonymousScan for Scan {
    fn as_any(&self) -> &dyn Any {
        self
    }

    fn schema(&self, _: Option<usize>) -> PolarsResult<SchemaRef> {
        let field = |column: &Column| {
            let kind = match column.kind {
                Kind::F64 => DataType::Float64,
                Kind::I64 => DataType::Int64,
                Kind::Bool => DataType::Boolean,
                Kind::String => DataType::String,
            };
            (PlSmallStr::from_str(&column.name), kind)
        };
        Ok(Arc::new(Types::from_iter(self.columns.iter().map(field))))
    }

    fn allows_projection_pushdown(&self) -> bool {
        true
    }

    fn scan(&self, asked: AnonymousScanArgs) -> PolarsResult<DataFrame> {
        let all = || asked.schema.iter_names().cloned().collect();
        let wanted: Vec<PlSmallStr> = asked.with_columns.as_ref().map_or_else(all, |c| c.to_vec());
        self.frame(&wanted, asked.n_rows.unwrap_or(usize::MAX)).unwrap_or_else(|e| {
            let text = e.to_string();
            self.failed.lock().unwrap_or_else(|p| p.into_inner()).push(e);
            Err(PolarsError::ComputeError(text.into()))
        })
    }
}

fn series(name: &PlSmallStr, array: &ArrayRef) -> Result<Series> {
    let (any, key) = (array.as_any(), name.clone());
    if let Some(numbers) = any.downcast_ref::<Float64Array>() {
        let known = |v: &f64| (!v.is_nan()).then_some(*v);
        return Ok(Series::new(key, numbers.values().iter().map(known).collect::<Vec<_>>()));
    }
    if let Some(numbers) = any.downcast_ref::<Int64Array>() {
        return Ok(Series::new(key, numbers.iter().collect::<Vec<_>>()));
    }
    if let Some(truths) = any.downcast_ref::<BooleanArray>() {
        return Ok(Series::new(key, truths.iter().collect::<Vec<_>>()));
    }
    match any.downcast_ref::<Texts>() {
        Some(texts) => Ok(Series::new(key, texts::each(texts).collect::<Vec<_>>())),
        None => Err(Error::new(format!("column \"{name}\" is {}", array.data_type()))),
    }
}

fn rows(frame: &DataFrame) -> PolarsResult<Answer> {
    let row = |i: usize| frame.columns().iter().map(|c| Ok(cell(&c.get(i)?))).collect();
    Ok(Answer {
        columns: frame.get_column_names().iter().map(|name| name.to_string()).collect(),
        rows: (0..frame.height()).map(row).collect::<PolarsResult<_>>()?,
    })
}

fn cell(value: &AnyValue) -> Cell {
    match value {
        AnyValue::Null => Cell::Null,
        AnyValue::Boolean(truth) => Cell::Truth(*truth),
        AnyValue::String(text) => Cell::Text(text.to_string()),
        AnyValue::StringOwned(text) => Cell::Text(text.to_string()),
        AnyValue::List(all) => Cell::List(all.iter().map(|value| cell(&value)).collect()),
        number if number.is_float() => number.extract().map_or(Cell::Null, Cell::Number),
        number @ AnyValue::Decimal(..) => number.extract().map_or(Cell::Null, Cell::Number),
        number if number.is_integer() => number.extract().map_or(Cell::Null, Cell::Whole),
        other => Cell::Text(other.to_string()),
    }
}

#[cfg(test)]
mod tests;
