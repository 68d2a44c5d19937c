//! Tables of many flights in; joins, selections and counts over the whole campaign out. Only this and
//! what answers queries use polars.
//!
//! polars joins, filters, sorts and counts; it never adds up numbers that end in a table, as its
//! order of summation is its own.

use std::borrow::Borrow;

use polars::prelude::{
    Column as Series, DataFrame, IntoLazy, LazyFrame, PlSmallStr, PolarsError, SortMultipleOptions,
};
use polars::prelude::{coalesce, col, len, lit};

use super::{Kind, Table, schema};
use crate::error::{Error, Result};

/// The estimates that a line is fitted through, and those that had to be left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Points {
    /// A `points` table, sorted by flight and segment.
    pub table: Table,
    /// Segment and reason, in the same order.
    pub left_out: Vec<(String, String)>,
}

/// What is to be plotted against what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Line<'a> {
    /// Column `model` of the estimates.
    pub model: &'a str,
    /// Name of the parameter.
    pub parameter: &'a str,
    /// Signal of the conditions that is the abscissa.
    pub against: &'a str,
    /// Name of the fit.
    pub fit: &'a str,
}

/// Joins the estimates of one parameter with the flights of their segments and the trimmed value of
/// the abscissa.
///
/// An estimate belongs to the segment in its `segment` column or, without one, to the segment that
/// its group is named after. Rows of groups of several segments without a segment of their own
/// belong to no point and are passed over.
///
/// # Errors
/// A table lacks a column, or a segment has two estimates of the parameter (of two groups).
pub fn points<T: Borrow<Table>>(
    estimates: &[T],
    segments: &[T],
    conditions: &[T],
    line: Line,
) -> Result<Points> {
    let name =
        |from: &str, to: &str| col(PlSmallStr::from_str(from)).alias(PlSmallStr::from_str(to));
    let estimates = lazy(
        "estimates",
        estimates,
        &["model", "group", "segment", "parameter", "unit", "value", "sd", "stop"],
    )?
    .filter(col("model").eq(lit(line.model)).and(col("parameter").eq(lit(line.parameter))))
    .with_column(coalesce(&[col("segment"), col("group")]).alias("key"));
    let segments = lazy("segments", segments, &["segment", "flight", "included", "reason"])?
        .select([name("segment", "key"), col("flight"), col("included"), col("reason")]);
    let conditions = lazy("conditions", conditions, &["segment", "signal", "unit", "value"])?
        .filter(col("signal").eq(lit(line.against)))
        .select([name("segment", "key"), name("unit", "unit_x"), name("value", "x")]);
    let order = SortMultipleOptions::default().with_maintain_order(true);
    let joined = estimates
        .inner_join(segments, col("key"), col("key"))
        .left_join(conditions, col("key"), col("key"))
        .sort(["flight", "key", "group"], order)
        .collect()
        .map_err(|e| failed("points", &e))?;
    sift(&joined, line).map_err(|e| match e {
        Sift::Polars(e) => failed("points", &e),
        Sift::Twice(segment, groups) => {
            let what = format!(
                "segment {segment} has two estimates of {}: of the groups {}",
                line.parameter,
                groups.join(" and ")
            );
            Error::new(what).help("give the two estimates different model names")
        }
        Sift::Table(e) => e,
    })
}

enum Sift {
    Polars(PolarsError),
    Twice(String, [String; 2]),
    Table(Error),
}

impl From<PolarsError> for Sift {
    fn from(e: PolarsError) -> Self {
        Sift::Polars(e)
    }
}

/// Parts the joined rows into points and those left out, with the reason.
fn sift(joined: &DataFrame, line: Line) -> std::result::Result<Points, Sift> {
    let text = |name: &str| {
        Ok::<_, PolarsError>(
            joined.column(name)?.str()?.iter().map(|s| s.unwrap_or("")).collect::<Vec<_>>(),
        )
    };
    let number = |name: &str| {
        Ok::<_, PolarsError>(
            joined.column(name)?.f64()?.iter().map(|v| v.unwrap_or(f64::NAN)).collect::<Vec<_>>(),
        )
    };
    let (keys, groups, flights, stops, reasons) =
        (text("key")?, text("group")?, text("flight")?, text("stop")?, text("reason")?);
    let (units, units_x) = (text("unit")?, text("unit_x")?);
    let (x, value, sd) = (number("x")?, number("value")?, number("sd")?);
    let included: Vec<bool> =
        joined.column("included")?.bool()?.iter().map(|b| b.unwrap_or(false)).collect();
    let mut left_out = Vec::new();
    let mut kept: Vec<usize> = Vec::new();
    for i in 0..joined.height() {
        let why = if !included[i] {
            Some(format!("the segment is excluded: {}", reasons[i]))
        } else if stops[i] != super::CONVERGED {
            Some(format!("the estimate has no result: {}", stops[i]))
        } else if !value[i].is_finite() || !sd[i].is_finite() || sd[i] <= 0.0 {
            Some("the estimate has no standard deviation".to_string())
        } else if !x[i].is_finite() {
            Some(format!("{} has no value before the maneuver", line.against))
        } else {
            None
        };
        match (why, kept.last()) {
            (Some(why), _) => left_out.push((keys[i].to_string(), why)),
            (None, Some(&j)) if keys[j] == keys[i] => {
                return Err(Sift::Twice(
                    keys[i].to_string(),
                    [groups[j].to_string(), groups[i].to_string()],
                ));
            }
            (None, _) => kept.push(i),
        }
    }
    let texts = |column: &[&str]| kept.iter().map(|&i| column[i].to_string()).collect::<Vec<_>>();
    let numbers = |column: &[f64]| kept.iter().map(|&i| column[i]).collect::<Vec<_>>();
    let table = Table::build("points")
        .repeat("model", line.model)
        .repeat("parameter", line.parameter)
        .repeat("against", line.against)
        .repeat("fit", line.fit)
        .strings("unit", texts(&units))
        .strings("unit_x", texts(&units_x))
        .strings("flight", texts(&flights))
        .strings("segment", texts(&keys))
        .f64("x", numbers(&x))
        .f64("value", numbers(&value))
        .f64("sd", numbers(&sd))
        .finish()
        .map_err(Sift::Table)?;
    Ok(Points { table, left_out })
}

/// How many rows there are per combination of the columns `by` (texts, whole numbers or truth
/// values), sorted by them.
///
/// # Errors
/// A table is not of the schema `name`, or lacks a column.
pub fn counts<T: Borrow<Table>>(
    name: &str,
    tables: &[T],
    by: &[&str],
) -> Result<Vec<(Vec<String>, usize)>> {
    let keys: Vec<_> = by.iter().map(|b| col(PlSmallStr::from_str(b))).collect();
    let counted = lazy(name, tables, by)?
        .group_by_stable(keys)
        .agg([len().alias("rows of the group")])
        .sort(
            by.iter().map(|b| PlSmallStr::from_str(b)).collect::<Vec<_>>(),
            SortMultipleOptions::default().with_maintain_order(true),
        )
        .collect()
        .map_err(|e| failed(name, &e))?;
    let cells = |i: usize| -> std::result::Result<(Vec<String>, usize), PolarsError> {
        let key = by.iter().map(|b| Ok(counted.column(b)?.get(i)?.str_value().into_owned()));
        let rows = counted.column("rows of the group")?.get(i)?.extract::<usize>().unwrap_or(0);
        Ok((key.collect::<std::result::Result<_, PolarsError>>()?, rows))
    };
    (0..counted.height()).map(|i| cells(i).map_err(|e| failed(name, &e))).collect()
}

/// The columns of all tables, one after the other, as a polars frame.
fn lazy<T: Borrow<Table>>(name: &str, tables: &[T], columns: &[&str]) -> Result<LazyFrame> {
    let table = Table::concat(name, tables)?;
    let series = columns.iter().map(|c| series(&table, c)).collect::<Result<Vec<_>>>()?;
    let frame = DataFrame::new(table.rows(), series).map_err(|e| failed(name, &e))?;
    Ok(frame.lazy())
}

fn series(table: &Table, name: &str) -> Result<Series> {
    let key = PlSmallStr::from_str(name);
    Ok(match table.column(name)?.kind {
        Kind::F64 => Series::new(key, table.f64(name)?),
        Kind::I64 => Series::new(key, table.opt_i64(name)?),
        Kind::Bool => Series::new(key, table.bools(name)?),
        Kind::String => Series::new(key, table.opt_strings(name)?),
    })
}

fn failed(name: &str, e: &PolarsError) -> Error {
    // polars refuses only what the schemas rule out.
    let doc = schema(name).map_or(String::new(), |s| format!(" ({})", s.doc));
    Error::new(format!("the table \"{name}\"{doc} cannot be put together: {e}"))
}
