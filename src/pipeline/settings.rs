//! The pipeline file `pipeline.toml`: what is done with a campaign's logs, stage by stage.

use super::provenance::{PLACE, Provenance};
use super::store::Store;
use crate::stage;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::DeserializeOwned;
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeSeed, Deserializer, IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// What is done with a campaign's logs, stage by stage. Paths are relative to this file.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fields {
    /// One line that says what the campaign is about; the title of the report.
    pub title: String,
    /// Constants of the aircraft (areas, arms, inertias), for the models that declare them: a file, or
    /// a list of files and of values that other pipelines estimate,
    /// `["aircraft.toml", { from = "ground.toml", take = ["k_cable"] }]`.
    #[serde(default)]
    pub aircraft: Option<Aircraft>,
    /// The channel map: which topic and field of a log is which signal.
    pub channels: String,
    /// The logs: paths or patterns such as "logs/*.mcap", absolute ones as well; one that begins
    /// with "$NAME/" lies in the folder that this variable of the environment names. The flight's
    /// id is the file's name without its ending.
    pub logs: Vec<String>,
    /// A campaign file that simulates the logs that are not there yet. Logs that are there are
    /// data: after a change of the campaign file, `koehler simulate --force` makes them anew.
    #[serde(default)]
    pub simulate: Option<String>,
    /// Flight-path reconstruction; left out, there is none.
    #[serde(default)]
    pub reconstruct: Option<stage::reconstruct::Settings>,
    /// The uniform grid and the signals derived on it.
    pub derive: stage::derive::Settings,
    /// Maneuvers searched for; left out, there are none.
    #[serde(default)]
    pub segment: Option<stage::segment::Settings>,
    /// Estimates: one model each, over the maneuvers of one input.
    #[serde(default)]
    pub estimate: Vec<stage::estimate::Settings>,
    /// Straight lines through the estimates.
    #[serde(default)]
    pub fit: Vec<stage::fit::Settings>,
}

/// Where the constants come from.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Aircraft {
    One(String),
    Several(Vec<Entry>),
}

/// A file of constants, or values of another pipeline.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Entry {
    File(String),
    Taken(Taken),
}

/// Values that another pipeline estimates, with their standard deviations and covariances.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Taken {
    /// The other pipeline file, relative to this one. A run makes it first.
    pub from: String,
    /// Names of its parameters: the constants of the models here that have these names.
    pub take: Vec<String>,
    /// Name of its `[[estimate]]`, where several estimate a parameter of the same name.
    #[serde(default)]
    pub estimate: Option<String>,
}

impl Aircraft {
    /// All of them, in the order of the file.
    pub fn entries(&self) -> Vec<Entry> {
        match self {
            Aircraft::One(name) => vec![Entry::File(name.clone())],
            Aircraft::Several(all) => all.clone(),
        }
    }
}

/// A pipeline file: the fields that several stages share, and the keys of stages that have one of
/// their own.
#[derive(Debug, Clone)]
pub struct Settings {
    pub fields: Fields,
    /// What is said under the names of stages: see [`stage::Stage::key`].
    pub told: BTreeMap<String, Value>,
}

impl Deref for Settings {
    type Target = Fields;
    fn deref(&self) -> &Fields {
        &self.fields
    }
}

impl DerefMut for Settings {
    fn deref_mut(&mut self) -> &mut Fields {
        &mut self.fields
    }
}

/// The schemas of the keys of stages, by the name of the stage.
fn keys() -> impl Iterator<Item = (&'static str, &'static stage::Key)> {
    stage::STAGES.iter().filter_map(|stage| Some((stage.name, stage.key.as_ref()?)))
}

impl JsonSchema for Settings {
    fn schema_name() -> Cow<'static, str> {
        "Settings".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = Fields::json_schema(generator);
        if let Some(properties) = schema.get_mut("properties").and_then(Value::as_object_mut) {
            properties.extend(keys().map(|(name, key)| (name.to_string(), (key.schema)())));
        }
        schema
    }
}

impl<'de> Deserialize<'de> for Settings {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Settings, D::Error> {
        struct File;
        impl<'de> Visitor<'de> for File {
            type Value = Settings;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a pipeline file")
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Settings, A::Error> {
                let mut told = BTreeMap::new();
                let fields = Fields::deserialize(MapAccessDeserializer::new(Apart {
                    map,
                    told: &mut told,
                }))?;
                Ok(Settings { fields, told })
            }
        }
        deserializer.deserialize_map(File)
    }
}

/// The entries of a file without those of stages, which are put into `told`.
struct Apart<'a, A> {
    map: A,
    told: &'a mut BTreeMap<String, Value>,
}

impl<'de, A: MapAccess<'de>> MapAccess<'de> for Apart<'_, A> {
    type Error = A::Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, A::Error> {
        while let Some(key) = self.map.next_key::<String>()? {
            if !keys().any(|(name, _)| name == key) {
                return seed.deserialize(key.into_deserializer()).map(Some);
            }
            let value = self.map.next_value()?;
            self.told.insert(key, value);
        }
        Ok(None)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, A::Error> {
        self.map.next_value_seed(seed)
    }
}

impl Settings {
    /// What is said under the name of a stage, as its type; none where that has mistakes, which the
    /// plan says.
    pub fn read<T: DeserializeOwned + Default>(&self, stage: &str) -> Option<T> {
        match self.told.get(stage) {
            Some(value) => serde_json::from_value(value.clone()).ok(),
            None => Some(T::default()),
        }
    }

    /// Puts other settings under the name of a stage, as a command wants them.
    pub fn write<T: Serialize>(&mut self, stage: &str, settings: &T) {
        if let Ok(value) = serde_json::to_value(settings) {
            self.told.insert(stage.to_string(), value);
        }
    }

    /// Adds what commands asked for earlier and whose results are in the output folder.
    pub fn keep(&mut self, store: &Store) {
        let place = |record: &Arc<Provenance>| {
            record.ingredients.get(PLACE).and_then(|p| p.parse::<usize>().ok())
        };
        let estimates: Vec<String> = self.estimate.iter().map(|e| e.name()).collect();
        let mut records = store.records();
        records.sort_by_key(place);
        for stage in stage::STAGES {
            let of_stage = records.iter().filter(|r| r.stage == stage.name);
            let earlier: Vec<Value> = of_stage.filter_map(|r| r.asked.clone()).collect();
            if !earlier.is_empty() {
                let told = self.told.entry(stage.name.to_string());
                (stage.again)(told.or_insert_with(|| json!([])), earlier, &estimates);
            }
        }
    }
}
