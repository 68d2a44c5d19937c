//! What a stage was made from and what it made: in come a unit's ingredients and outputs, out goes
//! the record that decides about reruns.

use crate::engine::Key;
use crate::stage::Note;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;

/// The record of one stage for one unit (a flight, an estimate, the campaign), kept beside the
/// tables.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    pub stage: String,
    pub unit: String,
    /// Hash over all ingredients: the cache key.
    pub key: String,
    /// Everything the outputs depend on, by name. Never paths, times or thread counts.
    pub ingredients: BTreeMap<String, String>,
    /// Files made, relative to the output folder, each with the hash of its bytes.
    pub outputs: BTreeMap<String, String>,
    /// What was lost or is worth knowing, in the order in which it was met; where the stage failed, what is
    /// said of that: nothing, where an earlier program recorded it.
    pub notes: Vec<Note>,
    /// Why there are no outputs, where the stage failed.
    pub error: Option<String>,
    /// Settings that a command asked for, not the pipeline file: see [`crate::stage::Stage::asked`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked: Option<Value>,
    /// The settings behind the hashes, by the name of their ingredient; none where an earlier
    /// program kept no values and no run has found the unit fresh since.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settings: Option<BTreeMap<String, Value>>,
    /// Version of the program that made the outputs; none where it did not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
}

/// The ingredient that says which part of its tables a unit writes.
pub const PLACE: &str = "place in the list";

/// The ingredient that says which code a unit was made by.
pub const PROGRAM: &str = "program";

/// The ingredient that is the flight's log.
pub const LOG: &str = "log";
/// Name of the ingredient that is another flight with the same log.
pub const TWIN: &str = "another flight of the same log";

/// The version of this program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Why a unit would be run again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reason {
    /// It failed; why.
    Failed(String),
    /// An ingredient was not there when it ran.
    New(String),
    /// An ingredient has other content.
    Changed(String),
    /// An ingredient is not there any more.
    Gone(String),
    /// A file that it made was removed.
    Removed(String),
    /// A file that it made is another now.
    Touched(String),
    /// Its record says one key and has the ingredients of another.
    Key,
    /// The command wants it run.
    Asked,
    /// It will fail, by what is known of its log before it is read; why.
    Fails(String),
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Reason::Failed(why) => write!(f, "it failed: {why}"),
            Reason::New(name) => write!(f, "{name} is new"),
            Reason::Changed(name) => write!(f, "{name} changed"),
            Reason::Gone(name) | Reason::Removed(name) => write!(f, "{name} is gone"),
            Reason::Touched(path) => write!(f, "{path} was changed by something else"),
            Reason::Key => f.write_str("its record does not match its key"),
            Reason::Asked => f.write_str("it is asked for"),
            Reason::Fails(why) => write!(f, "it will fail: {why}"),
        }
    }
}

/// The ingredients of one unit, gathered by name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Ingredients {
    /// Hashes: what the cache key covers.
    pub hashes: BTreeMap<String, String>,
    /// The values of those that are settings.
    pub settings: BTreeMap<String, Value>,
}

impl Ingredients {
    /// The code of the stage and the configuration slice. Every top-level entry of the slice
    /// becomes an ingredient of its own, so that `status` can say which setting changed.
    pub fn new(code: &str, slice: &Value) -> Self {
        let settings: BTreeMap<String, Value> = match slice {
            Value::Object(entries) => {
                entries.iter().map(|(k, v)| (format!("setting `{k}`"), v.clone())).collect()
            }
            other => BTreeMap::from([("settings".to_string(), other.clone())]),
        };
        let hash = |value: &Value| hash_bytes(canonical(value).as_bytes());
        let mut hashes: BTreeMap<String, String> =
            settings.iter().map(|(name, value)| (name.clone(), hash(value))).collect();
        hashes.insert(PROGRAM.to_string(), code.to_string());
        Ingredients { hashes, settings }
    }

    pub fn add(&mut self, name: String, hash: String) {
        self.hashes.insert(name, hash);
    }

    /// The cache key: stage and unit names with every ingredient.
    pub fn key(&self, stage: &str, unit: &str) -> String {
        let mut hasher = blake3::Hasher::new();
        for part in [stage, unit] {
            hasher.update(part.as_bytes());
            hasher.update(&[0]);
        }
        for (name, hash) in &self.hashes {
            hasher.update(name.as_bytes());
            hasher.update(&[0]);
            hasher.update(hash.as_bytes());
            hasher.update(&[0]);
        }
        Key::from(hasher.finalize()).0
    }

    /// What differs from the ingredients of an earlier run.
    pub fn differences(&self, earlier: &BTreeMap<String, String>) -> Vec<Reason> {
        let mut all = Vec::new();
        for (name, hash) in &self.hashes {
            match earlier.get(name) {
                None => all.push(Reason::New(name.clone())),
                Some(old) if old != hash => all.push(Reason::Changed(name.clone())),
                Some(_) => {}
            }
        }
        let gone = earlier.keys().filter(|name| !self.hashes.contains_key(*name));
        all.extend(gone.map(|name| Reason::Gone(name.clone())));
        all
    }
}

/// JSON text with the keys of every object sorted: the same settings give the same bytes.
pub fn canonical(value: &Value) -> String {
    match value {
        Value::Object(map) => {
            let sorted: BTreeMap<&String, String> =
                map.iter().map(|(k, v)| (k, canonical(v))).collect();
            let parts: Vec<String> = sorted
                .into_iter()
                .map(|(k, v)| format!("{}:{v}", Value::String(k.clone())))
                .collect();
            format!("{{{}}}", parts.join(","))
        }
        Value::Array(items) => {
            format!("[{}]", items.iter().map(canonical).collect::<Vec<_>>().join(","))
        }
        other => other.to_string(),
    }
}

/// Hash of a file's or a table's bytes: its content key.
pub fn hash_bytes(bytes: &[u8]) -> String {
    Key::of(bytes).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_order_of_settings_does_not_matter() {
        let a = json!({ "x": 1, "y": { "b": [1, 2], "a": null } });
        let b = json!({ "y": { "a": null, "b": [1, 2] }, "x": 1 });
        assert_eq!(canonical(&a), canonical(&b));
        assert_eq!(Ingredients::new("0", &a), Ingredients::new("0", &b));
    }

    #[test]
    fn any_change_changes_the_key_and_is_named() {
        let before = Ingredients::new("0", &json!({ "rate_hz": 100.0, "gap_s": 0.5 }));
        let mut after = Ingredients::new("0", &json!({ "rate_hz": 50.0, "gap_s": 0.5 }));
        assert_ne!(before.key("derive", "f1"), after.key("derive", "f1"));
        assert_ne!(before.key("derive", "f1"), before.key("derive", "f2"));
        let rate = || Reason::Changed("setting `rate_hz`".into());
        assert_eq!(after.differences(&before.hashes), [rate()]);
        after.add("signals of f1".into(), "00".into());
        let signals = Reason::New("signals of f1".into());
        assert_eq!(after.differences(&before.hashes), [rate(), signals]);
        assert_eq!(rate().to_string(), "setting `rate_hz` changed");
    }
}
