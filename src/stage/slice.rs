//! Models and settings in; what they say, as parts of a cache key, out.

use crate::model::Model;
use indexmap::IndexMap;
use serde::Serialize;
use serde_json::{Value, json};

/// What a model says, as a slice of the configuration: its text with fragments, and the values of
/// its constants.
pub(crate) fn said(model: &Model) -> Value {
    let constants: IndexMap<&str, [f64; 2]> =
        model.constants.iter().map(|c| (c.quantity.name.as_str(), [c.value, c.sd])).collect();
    json!({ "text": model.text, "constants": constants })
}

/// Settings as a slice of the configuration; what cannot be written as JSON (there is none) counts
/// as null.
pub(crate) fn slice_of<T: Serialize>(settings: &T) -> Value {
    serde_json::to_value(settings).unwrap_or(Value::Null)
}
