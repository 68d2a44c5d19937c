//! What a stage was made from and what it made: in come a unit's ingredients and outputs, out goes
//! the record that decides about reruns.

use crate::engine::Key;
use crate::stage::Note;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

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
    /// What was lost or is worth knowing, in the order in which it was met.
    pub notes: Vec<Note>,
    /// Why there are no outputs, where the stage failed.
    pub error: Option<String>,
    /// Settings that a command asked for, not the pipeline file: see [`crate::stage::Stage::asked`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked: Option<Value>,
}

/// The ingredient that says which part of its tables a unit writes.
pub const PLACE: &str = "place in the list";

/// The ingredient that says which code a unit was made by.
pub const PROGRAM: &str = "program";

/// The ingredients of one unit, gathered by name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Ingredients(pub BTreeMap<String, String>);

impl Ingredients {
    /// The code of the stage and the configuration slice. Every top-level entry of the slice
    /// becomes an ingredient of its own, so that `status` can say which setting changed.
    pub fn new(code: &str, slice: &Value) -> Self {
        let mut all = BTreeMap::from([(PROGRAM.to_string(), code.to_string())]);
        match slice {
            Value::Object(entries) => {
                for (name, value) in entries {
                    all.insert(
                        format!("setting `{name}`"),
                        hash_bytes(canonical(value).as_bytes()),
                    );
                }
            }
            other => {
                all.insert("settings".to_string(), hash_bytes(canonical(other).as_bytes()));
            }
        }
        Ingredients(all)
    }

    pub fn add(&mut self, name: String, hash: String) {
        self.0.insert(name, hash);
    }

    /// The cache key: stage and unit names with every ingredient.
    pub fn key(&self, stage: &str, unit: &str) -> String {
        let mut hasher = blake3::Hasher::new();
        for part in [stage, unit] {
            hasher.update(part.as_bytes());
            hasher.update(&[0]);
        }
        for (name, hash) in &self.0 {
            hasher.update(name.as_bytes());
            hasher.update(&[0]);
            hasher.update(hash.as_bytes());
            hasher.update(&[0]);
        }
        Key::from(hasher.finalize()).0
    }

    /// What differs from the ingredients of an earlier run, in words.
    pub fn differences(&self, earlier: &BTreeMap<String, String>) -> Vec<String> {
        let mut all = Vec::new();
        for (name, hash) in &self.0 {
            match earlier.get(name) {
                None => all.push(format!("{name} is new")),
                Some(old) if old != hash => all.push(format!("{name} changed")),
                Some(_) => {}
            }
        }
        all.extend(
            earlier
                .keys()
                .filter(|name| !self.0.contains_key(*name))
                .map(|name| format!("{name} is gone")),
        );
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
        assert_eq!(after.differences(&before.0), ["setting `rate_hz` changed"]);
        after.add("signals of f1".into(), "00".into());
        assert_eq!(
            after.differences(&before.0),
            ["setting `rate_hz` changed", "signals of f1 is new"]
        );
    }
}
