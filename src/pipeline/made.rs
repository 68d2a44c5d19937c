//! What a unit made, as it is handed from where it was run to where it is filed: tables here; their
//! files, already written, from another process.

use crate::error::{Errors, Result};
use crate::stage::{Note, Output};
use crate::table::{Table, schema};
use bytes::Bytes;
use serde::de::Error as _;
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// What came of a unit.
pub struct Made(pub std::result::Result<Product, Errors>);

/// A unit's tables by name, its other files by path, and what it notes.
pub struct Product {
    pub tables: Vec<(&'static str, Sheet)>,
    pub files: Vec<(String, Bytes)>,
    pub notes: Vec<Note>,
}

/// A table, or the Parquet file of it: what another process has written is filed as it is, without
/// reading it.
pub enum Sheet {
    Table(Table),
    File(Bytes),
}

impl Made {
    /// What a stage handed back in this process.
    pub fn here(made: std::result::Result<Output, Errors>) -> Made {
        Made(made.map(|output| Product {
            tables: output.tables.into_iter().map(|(name, t)| (name, Sheet::Table(t))).collect(),
            files: output.files.into_iter().map(|(path, bytes)| (path, bytes.into())).collect(),
            notes: output.notes,
        }))
    }
}

impl Sheet {
    fn file(&self) -> Result<Bytes> {
        match self {
            Sheet::Table(table) => table.to_parquet().map(Bytes::from),
            Sheet::File(bytes) => Ok(bytes.clone()),
        }
    }
}

/// A product as bytes.
#[derive(Serialize, Deserialize)]
struct Parcel {
    /// Name, Parquet file.
    tables: Vec<(String, Bytes)>,
    files: Vec<(String, Bytes)>,
    notes: Vec<Note>,
}

impl Parcel {
    fn of(product: &Product) -> Result<Parcel> {
        let table = |(name, sheet): &(&'static str, Sheet)| Ok((name.to_string(), sheet.file()?));
        Ok(Parcel {
            tables: product.tables.iter().map(table).collect::<Result<_>>()?,
            files: product.files.clone(),
            notes: product.notes.clone(),
        })
    }

    fn open(self) -> Result<Product> {
        let table =
            |(name, file): (String, Bytes)| Ok((schema(&name)?.name.as_str(), Sheet::File(file)));
        Ok(Product {
            tables: self.tables.into_iter().map(table).collect::<Result<_>>()?,
            files: self.files,
            notes: self.notes,
        })
    }
}

impl Serialize for Made {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        match self.0.as_ref().map(Parcel::of) {
            Ok(Ok(parcel)) => Ok::<_, &Errors>(parcel).serialize(serializer),
            Ok(Err(e)) => Err(S::Error::custom(e)),
            Err(errors) => Err::<Parcel, _>(errors).serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Made {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Made, D::Error> {
        let parcel = std::result::Result::<Parcel, Errors>::deserialize(deserializer)?;
        Ok(Made(match parcel {
            Ok(parcel) => Ok(parcel.open().map_err(D::Error::custom)?),
            Err(errors) => Err(errors),
        }))
    }
}
