//! A table's columns by name, read without fear: a missing column or an empty cell is NaN or "",
//! never a failure of the page.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::table::{self, Kind, Table};

/// Columns of one table in row order.
#[derive(Debug, Clone, Default)]
pub struct Columns {
    rows: usize,
    numbers: BTreeMap<String, Vec<f64>>,
    /// Equal neighbours are one text: ids of flights repeat on every row.
    texts: BTreeMap<String, Vec<Arc<str>>>,
    flags: BTreeMap<String, Vec<bool>>,
    units: BTreeMap<String, String>,
}

/// A unit as a page shows it: "-" is none.
fn no_dash(unit: &str) -> &str {
    if unit == "-" { "" } else { unit }
}

/// Texts, of which equal neighbours are one.
fn shared(texts: &[&str]) -> Vec<Arc<str>> {
    let mut all: Vec<Arc<str>> = Vec::with_capacity(texts.len());
    for text in texts {
        let one = all.last().filter(|last| &***last == *text).cloned();
        all.push(one.unwrap_or_else(|| Arc::from(*text)));
    }
    all
}

/// The values of one column.
#[derive(Debug, Clone)]
enum Column {
    Number(Vec<f64>),
    Text(Vec<Arc<str>>),
    Flag(Vec<bool>),
}

impl Columns {
    /// The columns of a table.
    pub fn of(table: &Table) -> Self {
        let column = |column: &table::Column| {
            let name = column.name.as_str();
            let values = match column.kind {
                Kind::F64 => table.f64(name).map(|v| Column::Number(v.to_vec())),
                Kind::I64 => table.opt_i64(name).map(|v| {
                    Column::Number(
                        v.into_iter().map(|n| n.map_or(f64::NAN, |n| n as f64)).collect(),
                    )
                }),
                Kind::Bool => table.bools(name).map(Column::Flag),
                Kind::String => table.strings(name).map(|v| Column::Text(shared(&v))),
            };
            // "SI" says that another column names the unit.
            let unit = if column.unit == "SI" { "" } else { no_dash(&column.unit) };
            values.ok().map(|values| (name.to_string(), unit.to_string(), values))
        };
        Columns::from_columns(table.columns().iter().filter_map(column))
    }

    /// The columns of those tables that are wanted.
    pub fn of_all(wanted: &[&str], tables: &BTreeMap<String, Table>) -> BTreeMap<String, Columns> {
        let each_once: BTreeSet<&str> = wanted.iter().copied().collect();
        let named = each_once.into_iter().filter_map(|name| Some((name, tables.get(name)?)));
        named.map(|(name, table)| (name.to_string(), Columns::of(table))).collect()
    }

    /// Columns from name, unit and values; the shortest column decides how many rows there are.
    fn from_columns(columns: impl IntoIterator<Item = (String, String, Column)>) -> Self {
        let mut all = Columns::default();
        let mut rows: Option<usize> = None;
        for (name, unit, column) in columns {
            let n = match column {
                Column::Number(values) => all.numbers.entry(name.clone()).or_insert(values).len(),
                Column::Text(values) => all.texts.entry(name.clone()).or_insert(values).len(),
                Column::Flag(values) => all.flags.entry(name.clone()).or_insert(values).len(),
            };
            rows = Some(rows.map_or(n, |rows| rows.min(n)));
            all.units.insert(name, unit);
        }
        all.rows = rows.unwrap_or(0);
        all
    }

    /// These rows, in this order.
    pub fn take(&self, rows: &[usize]) -> Columns {
        fn of<T: Clone>(
            all: &BTreeMap<String, Vec<T>>,
            rows: &[usize],
        ) -> BTreeMap<String, Vec<T>> {
            let pick = |v: &[T]| rows.iter().filter_map(|&row| v.get(row).cloned()).collect();
            all.iter().map(|(name, values)| (name.clone(), pick(values))).collect()
        }
        Columns {
            rows: rows.len(),
            numbers: of(&self.numbers, rows),
            texts: of(&self.texts, rows),
            flags: of(&self.flags, rows),
            units: self.units.clone(),
        }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    pub fn has(&self, name: &str) -> bool {
        self.numbers.contains_key(name)
            || self.texts.contains_key(name)
            || self.flags.contains_key(name)
    }

    /// The number in a cell; NaN when there is none.
    pub fn number(&self, name: &str, row: usize) -> f64 {
        self.column(name).get(row).copied().unwrap_or(f64::NAN)
    }

    /// The whole number column; empty when there is none.
    pub fn column(&self, name: &str) -> &[f64] {
        self.numbers.get(name).map_or(&[], |v| v.as_slice())
    }

    /// The unit that a cell names, "" where there is none.
    pub fn unit_in(&self, name: &str, row: usize) -> String {
        no_dash(&self.text(name, row)).to_string()
    }

    /// The text in a cell; "" when there is none. Whole numbers read as text too (a segment may be
    /// numbered).
    pub fn text(&self, name: &str, row: usize) -> String {
        if let Some(text) = self.texts.get(name).and_then(|v| v.get(row)) {
            return text.to_string();
        }
        match self.numbers.get(name).and_then(|v| v.get(row)) {
            Some(v) if v.is_finite() => format!("{v}"),
            _ => String::new(),
        }
    }

    pub fn flag(&self, name: &str, row: usize) -> Option<bool> {
        self.flags.get(name).and_then(|v| v.get(row)).copied()
    }

    /// The unit of a column, "" when it has none.
    pub fn unit(&self, name: &str) -> &str {
        self.units.get(name).map_or("", |u| u.as_str())
    }

    /// Row numbers by the texts in columns `names`.
    pub fn rows_by<const N: usize>(&self, names: [&str; N]) -> BTreeMap<[String; N], Vec<usize>> {
        let mut rows: BTreeMap<[String; N], Vec<usize>> = BTreeMap::new();
        for row in 0..self.rows {
            rows.entry(names.map(|name| self.text(name, row))).or_default().push(row);
        }
        rows
    }

    /// The same, in order of first appearance.
    pub fn groups<const N: usize>(&self, names: [&str; N]) -> Vec<([String; N], Vec<usize>)> {
        let mut groups: Vec<_> = self.rows_by(names).into_iter().collect();
        groups.sort_by_key(|(_, rows)| rows.first().copied());
        groups
    }
}
