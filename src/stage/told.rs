//! What the pipeline file says under the key of a stage's name comes in; the stage's settings go
//! out, as the stage's file declares them.

use crate::config::{self, Doc};
use crate::error::Result;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::any::{Any, TypeId};
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

/// What stages read from the pipeline file, by the name of the stage and by type: the settings as
/// they stand there, and what the stage's check made of them.
#[derive(Default)]
pub struct Told(BTreeMap<(&'static str, TypeId), Settings>);

impl std::fmt::Debug for Told {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_set().entries(self.0.keys().map(|key| key.0)).finish()
    }
}

impl Told {
    /// Files what the pipeline file says under the name of a stage.
    ///
    /// # Errors
    /// The value is none of the key's type.
    pub fn put(&mut self, stage: &'static str, key: &Key, value: Value, doc: &Doc) -> Result<()> {
        let settings = (key.read)(value).map_err(|e| doc.error(stage, e.to_string()))?;
        self.0.insert((stage, (*settings).type_id()), settings);
        Ok(())
    }

    /// Files what a stage's check has made of its settings, as its units want it.
    pub fn keep<T: Any + Send + Sync>(&mut self, stage: &'static str, checked: T) {
        self.0.insert((stage, TypeId::of::<T>()), Box::new(checked));
    }

    /// The settings of a stage, or what its check made of them; none where the pipeline file does
    /// not have its key.
    pub fn get<T: Any>(&self, stage: &'static str) -> Option<&T> {
        self.0.get(&(stage, TypeId::of::<T>()))?.downcast_ref()
    }
}
