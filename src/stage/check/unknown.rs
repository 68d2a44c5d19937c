//! A name that stands for nothing, and those that there are, in; the mistake, with the nearest name, out.

use crate::config::{Doc, list, nearest};
use crate::error::Error;

/// `pipeline.toml:14:9: there is no column "alfa"`, with the nearest name.
pub fn unknown<S: AsRef<str>>(doc: &Doc, key: &str, kind: &str, name: &str, known: &[S]) -> Error {
    let known: Vec<&str> = known.iter().map(AsRef::as_ref).collect();
    let all = if known.is_empty() {
        "there are none".to_string()
    } else {
        format!("there are {}", list(&known))
    };
    let help = match nearest(name, known.iter().copied()) {
        Some(near) => format!("did you mean \"{near}\"? {all}"),
        None => all,
    };
    doc.error(key, format!("there is no {kind} \"{name}\"")).help(help)
}
