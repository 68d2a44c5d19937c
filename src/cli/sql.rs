//! The verb sql: a run and a query come in; the rows it asks for go out, as a table for people, as CSV
//! or as JSON.

use super::args::Form;
use super::diff::{folder, tell_left_out};
use super::words::{End, document, say};
use crate::error::{Error, Errors, Result};
use crate::pipeline::{Recorded, Store};
use crate::table::query::{self, Answer, Cell};
use serde_json::{Map, Number, Value};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Significant digits of a number in a table for people.
const DIGITS: usize = 6;

/// In which form the rows are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rows {
    Table,
    Csv,
    Json,
}

impl Rows {
    /// What the arguments ask for.
    pub fn of(csv: bool, form: Form) -> Rows {
        match (csv, form.json) {
            (true, _) => Rows::Csv,
            (false, true) => Rows::Json,
            (false, false) => Rows::Table,
        }
    }
}

/// `koehler sql`
pub fn sql(run: &Path, sql: &str, form: Rows) -> std::result::Result<End, Errors> {
    let folder = folder(run)?;
    let recorded = Recorded::of(&Store::look(&folder)?);
    let mut left_out = Vec::new();
    let answer =
        guarded(|| query::query_of(&folder, sql, &|path| recorded.has(path), &mut left_out));
    tell_left_out(&left_out);
    let answer = answer?;
    match form {
        Rows::Table => say(&table(&answer)),
        Rows::Csv => say(csv(&answer)?.trim_end_matches('\n')),
        Rows::Json => document(&json(&answer))?,
    }
    Ok(End::Complete)
}

/// A query is a user's text: where the library that answers it gives up, that is an error as well.
fn guarded(
    ask: impl FnOnce() -> std::result::Result<Answer, Errors>,
) -> std::result::Result<Answer, Errors> {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let answer = catch_unwind(AssertUnwindSafe(ask));
    std::panic::set_hook(hook);
    answer.unwrap_or_else(|_| {
        let what = "the query is more than the library that answers it can do";
        Err(Error::new(what).help(query::HELP).into())
    })
}

/// Columns as wide as their widest value, numbers to the right.
fn table(answer: &Answer) -> String {
    let shown: Vec<Vec<String>> =
        answer.rows.iter().map(|row| row.iter().map(short).collect()).collect();
    let width = |i: usize| {
        let of = |text: &String| text.chars().count();
        shown.iter().map(|row| of(&row[i])).chain([of(&answer.columns[i])]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..answer.columns.len()).map(width).collect();
    let is_number = |cell: &Cell| matches!(cell, Cell::Whole(_) | Cell::Number(_) | Cell::Null);
    let right: Vec<bool> = (0..widths.len())
        .map(|i| !answer.rows.is_empty() && answer.rows.iter().all(|row| is_number(&row[i])))
        .collect();
    let line = |row: &Vec<String>| {
        let cells =
            row.iter().zip(&widths).zip(&right).map(|((text, &width), right)| match right {
                true => format!("{text:>width$}"),
                false => format!("{text:<width$}"),
            });
        cells.collect::<Vec<_>>().join("  ").trim_end().to_string()
    };
    [&answer.columns].into_iter().chain(&shown).map(line).collect::<Vec<_>>().join("\n")
}

/// A value in a table for people: a line, and few digits.
fn short(cell: &Cell) -> String {
    match cell {
        Cell::Null => "null".to_string(),
        Cell::Number(value) if value.is_finite() => digits(*value),
        other => exact(other).replace(['\n', '\r', '\t'], " "),
    }
}

fn digits(value: f64) -> String {
    let rounded = format!("{value:.*e}", DIGITS - 1).parse().unwrap_or(value);
    match value.abs() {
        0.0 | 1e-4..1e15 => format!("{rounded}"),
        _ => format!("{rounded:e}"),
    }
}

/// A value with every digit that tells it from its neighbours.
fn exact(cell: &Cell) -> String {
    match cell {
        Cell::Null => String::new(),
        Cell::Truth(truth) => truth.to_string(),
        Cell::Whole(value) => value.to_string(),
        Cell::Number(value) => format!("{value:?}"),
        Cell::Text(text) => text.clone(),
        Cell::List(_) => value(cell).to_string(),
    }
}

fn csv(answer: &Answer) -> Result<String> {
    let fail =
        |e: &dyn std::fmt::Display| Error::new(format!("cannot write the answer as CSV: {e}"));
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(&answer.columns).map_err(|e| fail(&e))?;
    for row in &answer.rows {
        writer.write_record(row.iter().map(exact)).map_err(|e| fail(&e))?;
    }
    let bytes = writer.into_inner().map_err(|e| fail(&e))?;
    String::from_utf8(bytes).map_err(|e| fail(&e))
}

fn json(answer: &Answer) -> Vec<Map<String, Value>> {
    let record =
        |row: &Vec<Cell>| answer.columns.iter().cloned().zip(row.iter().map(value)).collect();
    answer.rows.iter().map(record).collect()
}

/// A value in JSON, which has no infinite number.
fn value(cell: &Cell) -> Value {
    match cell {
        Cell::Null => Value::Null,
        Cell::Truth(truth) => Value::Bool(*truth),
        Cell::Whole(value) => Number::from_i128(*value).map_or(Value::Null, Value::Number),
        Cell::Number(value) => Number::from_f64(*value).map_or(Value::Null, Value::Number),
        Cell::Text(text) => Value::String(text.clone()),
        Cell::List(all) => Value::Array(all.iter().map(value).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer() -> Answer {
        let text = |text: &str| Cell::Text(text.into());
        Answer {
            columns: ["name", "value", "n"].map(String::from).into(),
            rows: vec![
                vec![text("a, \"b\""), Cell::Number(0.1 + 0.2), Cell::Whole(3)],
                vec![text("c"), Cell::Null, Cell::Whole(-12)],
                vec![Cell::Null, Cell::Number(-1.5e-9), Cell::Null],
            ],
        }
    }

    #[test]
    fn a_table_is_aligned_and_rounded() {
        let lines = [
            "name      value     n",
            "a, \"b\"      0.3     3",
            "c          null   -12",
            "null    -1.5e-9  null",
        ];
        assert_eq!(table(&answer()), lines.join("\n"));
        let none = Answer { rows: Vec::new(), ..answer() };
        assert_eq!(table(&none), "name  value  n");
        assert_eq!(digits(123456.7), "123457");
        assert_eq!(digits(-0.00012345678), "-0.000123457");
        assert_eq!((digits(0.0).as_str(), digits(1e300).as_str()), ("0", "1e300"));
    }

    #[test]
    fn csv_and_json_lose_no_digit_and_know_nothing_from_empty() {
        let lines =
            ["name,value,n", "\"a, \"\"b\"\"\",0.30000000000000004,3", "c,,-12", ",-1.5e-9,"];
        assert_eq!(csv(&answer()).expect("CSV"), lines.map(|l| format!("{l}\n")).concat());
        let json = serde_json::to_string(&json(&answer())).expect("JSON");
        assert!(
            json.starts_with(
                r#"[{"name":"a, \"b\"","value":0.30000000000000004,"n":3},{"name":"c","value":null"#
            ),
            "{json}"
        );
        let number = |v: f64| value(&Cell::Number(v));
        assert_eq!((number(f64::NAN), number(f64::INFINITY)), (Value::Null, Value::Null));
        let list = Cell::List(vec![Cell::Whole(1), Cell::Null]);
        assert_eq!(exact(&list), "[1,null]");
    }
}
