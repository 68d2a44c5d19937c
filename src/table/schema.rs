//! The table schemas of `schemas/tables/` in; names, types, units and meanings of every table's
//! columns out.

use std::sync::{Arc, LazyLock};

use arrow_schema::{DataType, Field, Schema as ArrowSchema};
use serde::Deserialize;

use crate::config;
use crate::error::{Error, Result};

// `EMBEDDED`, the list of the files in `schemas/tables/` with their texts: written by `build.rs`,
// so that adding a table is adding a file.
include!(concat!(env!("OUT_DIR"), "/tables.rs"));

/// What a table is: its columns in order, and where it lies.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schema {
    /// Its name.
    pub name: String,
    /// What it means.
    pub doc: String,
    /// Whether the table is written flight by flight, into `flight=<id>` folders.
    pub per_flight: bool,
    /// The columns by which the rows of a part are sorted, for the reader's information; empty: in
    /// the order of events.
    pub sorted_by: Vec<String>,
    /// Where further f64 columns are allowed beside those listed: what they are.
    #[serde(default)]
    pub dynamic: Option<String>,
    /// In the order of the file.
    pub columns: Vec<Column>,
}

/// One column of a table.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Type of its values.
    #[serde(rename = "type")]
    pub kind: Kind,
    /// `-` where there is none; `SI` where another column or the table says which.
    pub unit: String,
    /// Whether a row may have no value. An f64 without a value is NaN in memory and null in the
    /// file.
    #[serde(default)]
    pub nullable: bool,
    /// What it means.
    pub doc: String,
}

/// The type of a column's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum Kind {
    /// Double-precision numbers.
    #[serde(rename = "f64")]
    F64,
    /// Integers.
    #[serde(rename = "i64")]
    I64,
    /// Truth values.
    #[serde(rename = "bool")]
    Bool,
    /// Texts.
    #[serde(rename = "string")]
    String,
}

impl Kind {
    /// As files have it.
    pub fn data_type(self) -> DataType {
        match self {
            Kind::F64 => DataType::Float64,
            Kind::I64 => DataType::Int64,
            Kind::Bool => DataType::Boolean,
            Kind::String => DataType::Utf8,
        }
    }

    /// As it is in memory: each text once.
    pub(super) fn in_memory(self) -> DataType {
        match self {
            Kind::String => {
                DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8))
            }
            other => other.data_type(),
        }
    }

    /// As `schemas/tables` has it.
    pub fn word(self) -> &'static str {
        match self {
            Kind::F64 => "f64",
            Kind::I64 => "i64",
            Kind::Bool => "bool",
            Kind::String => "string",
        }
    }
}

impl Column {
    /// The Arrow field, unit and meaning in its metadata.
    fn field(&self, kind: DataType) -> Field {
        let metadata =
            [("unit".to_string(), self.unit.clone()), ("doc".to_string(), self.doc.clone())].into();
        Field::new(&self.name, kind, self.nullable).with_metadata(metadata)
    }
}

/// The Arrow schema of columns in memory.
pub(super) fn arrow(columns: &[Column]) -> Arc<ArrowSchema> {
    let field = |column: &Column| column.field(column.kind.in_memory());
    Arc::new(ArrowSchema::new(columns.iter().map(field).collect::<Vec<_>>()))
}

/// The Arrow schema of columns in a file.
pub(super) fn in_file<'c>(columns: impl Iterator<Item = &'c Column>) -> Arc<ArrowSchema> {
    let field = |column: &Column| column.field(column.kind.data_type());
    Arc::new(ArrowSchema::new(columns.map(field).collect::<Vec<_>>()))
}

static SCHEMAS: LazyLock<Vec<Schema>> = LazyLock::new(|| {
    EMBEDDED.iter().filter_map(|(_, text)| serde_json::from_str(text).ok()).collect()
});

/// All tables, in alphabetical order.
pub fn schemas() -> &'static [Schema] {
    &SCHEMAS
}

/// The schema of a table.
///
/// # Errors
/// There is no table of that name.
pub fn schema(name: &str) -> Result<&'static Schema> {
    schemas().iter().find(|s| s.name == name).ok_or_else(|| {
        let names: Vec<&str> = schemas().iter().map(|s| s.name.as_str()).collect();
        Error::new(format!("there is no table \"{name}\""))
            .help(format!("the tables are {}", config::list(&names)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_schema_file_reads_and_is_listed_once() {
        for (name, text) in EMBEDDED {
            let schema: Schema =
                serde_json::from_str(text).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(schema.name, *name);
            let names: std::collections::BTreeSet<&str> =
                schema.columns.iter().map(|c| c.name.as_str()).collect();
            assert_eq!(names.len(), schema.columns.len(), "{name} has a column twice");
            assert_eq!(
                super::super::build::alike(&schema.columns).next(),
                None,
                "{name}: readers such as DuckDB take these for one"
            );
            assert_eq!(
                schema.per_flight,
                schema.per_flight && names.contains("flight"),
                "{name} lacks the flight"
            );
            assert!(
                schema.sorted_by.iter().all(|s| names.contains(s.as_str())),
                "{name}: sorted_by"
            );
            assert!(
                schema.columns.iter().all(|c| c.doc.ends_with('.') && !c.unit.is_empty()),
                "{name}: doc or unit"
            );
        }
        assert_eq!(schemas().len(), EMBEDDED.len());
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("schemas/tables");
        assert_eq!(std::fs::read_dir(folder).unwrap().count(), EMBEDDED.len());
    }

    #[test]
    fn an_unknown_table_is_refused_with_the_list() {
        let e = schema("estimate").unwrap_err().to_string();
        assert!(
            e.starts_with(
                "there is no table \"estimate\"\n    the tables are additions, adequacy, bands"
            ),
            "{e}"
        );
    }
}
