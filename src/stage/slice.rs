//! Models and settings in; what they say, as parts of a cache key, out.

use crate::model::Model;
use indexmap::IndexMap;
use serde::Serialize;
use serde_json::{Value, json};

/// What a model says, as a slice of the configuration: its text with fragments, and the values of
/// its constants.
pub(crate) fn said(model: &Model) -> Value {
    let constants: IndexMap<&str, Value> = model
        .constants
        .iter()
        .map(|c| (c.quantity.name.as_str(), json!([c.value, c.sd, c.source, c.origin])))
        .collect();
    json!({ "text": model.text, "constants": constants })
}

/// Settings as a slice of the configuration; what cannot be written as JSON (there is none) counts
/// as null.
pub(crate) fn slice_of<T: Serialize>(settings: &T) -> Value {
    serde_json::to_value(settings).unwrap_or(Value::Null)
}

/// The values of a model that other pipelines estimated: entries of a slice of their own, so that
/// `status` names the one that changed.
pub(crate) fn taken(model: &Model) -> impl Iterator<Item = (String, Value)> {
    model
        .constants
        .iter()
        .filter(|c| c.origin.is_some())
        .map(|c| (format!("{} ({})", c.quantity.name, c.source), json!([c.value, c.sd, c.origin])))
}
