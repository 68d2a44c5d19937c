//! What the pipeline file says under the key of a stage's name comes in; the stage's settings go
//! out, as the stage's file declares them.

use crate::config::{self, Doc};
use crate::error::{Error, Errors, Result};
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::any::Any;
use std::collections::BTreeMap;

type Settings = Box<dyn Any + Send + Sync>;

/// A key of the pipeline file that belongs to a stage: `[name]` or `[[name]]`, read into the type
/// that the stage's file declares.
#[derive(Debug)]
pub struct Key {
    /// The JSON Schema of the type: editors complete by it, and the pipeline file is held against
    /// it.
    pub schema: fn() -> Value,
    read: fn(Value) -> serde_json::Result<Settings>,
}

impl Key {
    /// The key of settings of this type: a struct for `[name]`, a list of structs for `[[name]]`.
    pub const fn of<T: DeserializeOwned + JsonSchema + Any + Send + Sync>() -> Key {
        Key {
            schema: config::schema_of::<T>,
            read: |value| Ok(Box::new(serde_json::from_value::<T>(value)?)),
        }
    }
}

/// Settings by the name of the stage.
#[derive(Default)]
pub struct Told(BTreeMap<&'static str, Settings>);

impl std::fmt::Debug for Told {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_set().entries(self.0.keys()).finish()
    }
}

impl Told {
    /// Files what the pipeline file says under the name of a stage.
    ///
    /// # Errors
    /// The value is none of the key's type.
    pub fn put(&mut self, stage: &'static str, key: &Key, value: Value, doc: &Doc) -> Result<()> {
        let settings = (key.read)(value).map_err(|e| doc.error(stage, e.to_string()))?;
        self.0.insert(stage, settings);
        Ok(())
    }

    /// The settings of a stage; none where the pipeline file does not have its key.
    pub fn get<T: Any>(&self, stage: &str) -> Option<&T> {
        self.0.get(stage)?.downcast_ref()
    }
}

/// What the check of a stage's settings may hold them against.
pub struct Known<'a> {
    /// The pipeline file: it says where a key stands.
    pub doc: &'a Doc,
    /// Ids of the flights; empty where the logs have mistakes of their own.
    pub flights: &'a [String],
    /// SI unit of a column of the samples table; none where there is no such column.
    pub column: &'a dyn Fn(&str) -> Option<String>,
    /// Names of these columns.
    pub columns: &'a [&'a str],
}

impl Known<'_> {
    /// An error at a key of the pipeline file.
    pub fn error(&self, key: &str, what: impl Into<String>) -> Error {
        self.doc.error(key, what)
    }
}

/// Finds the mistakes in a stage's settings.
pub type Check = fn(&Told, &Known) -> Errors;
