//! TOML text in; checked settings structs with the place of every key out, or every mistake of the
//! file at once.
//!
//! A settings struct derives `Deserialize` and `JsonSchema`; the schema is the contract. A file is
//! parsed with positions, its whole tree is held against the schema (`check`), and only then
//! deserialized. Editors complete and check the same files with the same schemas: [`schema_text`]
//! writes them.

mod check;
mod doc;
mod form;
mod union;
mod watch;
mod words;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{Error, Errors, Place};
use check::Key;
pub use doc::Doc;
pub use watch::{Texts, watched};
pub use words::{list, nearest, quoted};

/// Reads and checks a configuration file; the name in messages is the path as given.
///
/// # Errors
/// The file cannot be read, is not UTF-8, is not TOML, or does not fit `T`: all mistakes, in the
/// order of the file.
pub fn load<T: DeserializeOwned + JsonSchema>(path: &Path) -> Result<(T, Doc), Errors> {
    let text = read_text(path)?;
    parse(&path.to_string_lossy(), &text)
}

/// The text of a file a person wrote.
///
/// # Errors
/// The file cannot be read or is not UTF-8.
pub fn read_text(path: &Path) -> crate::error::Result<String> {
    let name = path.to_string_lossy();
    let bytes = std::fs::read(path).map_err(|e| {
        let what = match e.kind() {
            std::io::ErrorKind::NotFound => "there is no such file".to_string(),
            _ => format!("cannot read the file: {e}"),
        };
        Error::at(Place::file(name.as_ref()), what)
            .help("check the path; paths in a file are relative to the folder of that file")
    })?;
    let text = String::from_utf8(bytes).map_err(|e| {
        let good =
            String::from_utf8_lossy(&e.as_bytes()[..e.utf8_error().valid_up_to()]).into_owned();
        Error::at(Place::in_text(&name, &good, good.len()), "the text is not UTF-8 from here on")
            .help("save the file as UTF-8")
    })?;
    watch::seen(path, &text);
    Ok(text)
}

/// Checks configuration text; `file_name` is the name that messages carry.
///
/// # Errors
/// The text is not TOML (syntax errors, one per line), or does not fit `T`: all mistakes, in the
/// order of the text.
pub fn parse<T: DeserializeOwned + JsonSchema>(
    file_name: &str,
    text: &str,
) -> Result<(T, Doc), Errors> {
    let tree = syntax(file_name, text)?;
    let doc = Doc::new(file_name, text, tree.get_ref());
    let root = Spanned::new(tree.span(), DeValue::Table(tree.into_inner()));
    check::check(&schema::<T>(), &root, &doc)?;
    // The schema has accepted the tree, so this fails only where a type's own `Deserialize` asks
    // for more than its schema says.
    let value = T::deserialize(toml::de::ValueDeserializer::from(root)).map_err(|e| {
        let offset = e.span().map_or(0, |span| span.start);
        Errors::from(Error::at(Place::in_text(file_name, text, offset), e.message()))
    })?;
    Ok((value, doc))
}

/// What is sound of a file with mistakes: every misspelt key and every value in another form read as
/// it was meant, and every one that does not fit `T` taken away, as if it had not been written. So that what only the rest can
/// tell is told in one go with the mistakes that `load` found, and nothing that follows from them.
/// `None` where too little is left.
pub fn load_sound<T: DeserializeOwned + JsonSchema>(path: &Path) -> Option<(T, Doc)> {
    let (name, text) = (path.to_string_lossy(), read_text(path).ok()?);
    let text = as_meant(&schema::<T>(), &name, text)?;
    let tree = syntax(&name, &text).ok()?;
    let doc = Doc::new(&name, &text, tree.get_ref());
    let root = Spanned::new(tree.span(), DeValue::Table(tree.into_inner()));
    let mut rest = text.clone().into_bytes();
    for found in check::find(&schema::<T>(), &root) {
        let key = innermost(root.get_ref(), found.at)?;
        // what is left keeps its place
        rest.get_mut(key)?.iter_mut().filter(|b| **b != b'\n').for_each(|b| *b = b' ');
    }
    let (value, _) = parse(&name, &String::from_utf8(rest).ok()?).ok()?;
    Some((value, doc))
}

/// The text with misspelt keys written as they were meant, where the key that was meant is not
/// there as well, and numbers in quotes without them; what stands behind them in their lines moves.
fn as_meant(schema: &serde_json::Value, name: &str, text: String) -> Option<String> {
    let tree = syntax(name, &text).ok()?;
    let doc = Doc::new(name, &text, tree.get_ref());
    let root = Spanned::new(tree.span(), DeValue::Table(tree.into_inner()));
    let mut meant: Vec<(Range<usize>, String)> = Vec::new();
    for found in check::find(schema, &root) {
        let (span, instead) = match found.key {
            Some(Key::Meant(path, span)) if !doc.has(&path) => {
                (span, path.rsplit('.').next().map(str::to_string))
            }
            Some(Key::Value(span, kinds)) => {
                let kinds: Vec<&str> = kinds.iter().map(String::as_str).collect();
                (span.clone(), form::as_wanted(text.get(span)?, &kinds))
            }
            _ => continue,
        };
        if let Some(instead) = instead
            && !meant.iter().any(|(other, _)| *other == span)
        {
            meant.push((span, instead));
        }
    }
    let mut rest = text.clone();
    meant.sort_by_key(|(span, _)| std::cmp::Reverse(span.start));
    for (span, key) in meant {
        rest.get(span.clone())?;
        rest.replace_range(span, &key);
    }
    // Two keys may have been meant for one.
    Some(if syntax(name, &rest).is_ok() { rest } else { text })
}

/// From the innermost key at or around byte `at` to the end of its value.
fn innermost(value: &DeValue, at: usize) -> Option<Range<usize>> {
    match value {
        DeValue::Table(table) => table.iter().find_map(|(key, value)| {
            let all = key.span().start..value.span().end.max(key.span().end);
            innermost(value.get_ref(), at).or_else(|| all.contains(&at).then_some(all))
        }),
        DeValue::Array(array) => array.iter().find_map(|value| innermost(value.get_ref(), at)),
        _ => None,
    }
}

/// The TOML tree with positions, or the syntax errors: the first one of each line, as later ones
/// tend to follow from it.
fn syntax<'a>(file: &str, text: &'a str) -> Result<Spanned<DeTable<'a>>, Errors> {
    let (tree, found) = DeTable::parse_recoverable(text);
    let mut errors: Vec<Error> = found
        .iter()
        .map(|e| {
            let offset = e.span().map_or(text.len(), |span| span.start);
            Error::at(
                Place::in_text(file, text, offset),
                format!("this is not TOML: {}", e.message()),
            )
        })
        .collect();
    errors.sort_by(|a, b| a.place.cmp(&b.place));
    errors.dedup_by_key(|e| e.place.as_ref().map(|p| p.line));
    // The keys below a header that cannot be read count as keys of the table above it.
    if let Some(header) = errors.iter().position(|e| e.what.contains("unclosed table")) {
        let behind = errors.split_off(header + 1);
        errors.extend(behind.into_iter().filter(|e| !e.what.contains("duplicate key")));
    }
    Errors(errors).or(tree)
}

/// The JSON Schema of `T`, draft 2020-12: made once, as a search parses hundreds of models.
fn schema<T: JsonSchema>() -> Arc<serde_json::Value> {
    static MADE: Mutex<BTreeMap<Cow<'static, str>, Arc<serde_json::Value>>> =
        Mutex::new(BTreeMap::new());
    let make = || {
        let generator = schemars::generate::SchemaSettings::draft2020_12().into_generator();
        Arc::new(generator.into_root_schema_for::<T>().to_value())
    };
    // A thread that panicked while it held the lock has left the map as it was.
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    made.entry(T::schema_id()).or_insert_with(make).clone()
}

/// The JSON Schema of `T` as a part of another: without references and without a title.
pub fn schema_of<T: JsonSchema>() -> serde_json::Value {
    let settings =
        schemars::generate::SchemaSettings::draft2020_12().with(|s| s.inline_subschemas = true);
    let mut schema = settings.into_generator().into_root_schema_for::<T>().to_value();
    if let Some(object) = schema.as_object_mut() {
        object.retain(|key, _| key != "$schema" && key != "title");
    }
    schema
}

/// The JSON Schema of `T` as text for editors, pretty printed, under the title `title`.
pub fn schema_text<T: JsonSchema>(title: &str) -> String {
    let mut schema = (*schema::<T>()).clone();
    if let Some(object) = schema.as_object_mut() {
        object.insert("title".into(), title.into());
    }
    // `to_string_pretty` of a JSON value cannot fail; were it to, the compact form stands in.
    serde_json::to_string_pretty(&schema).unwrap_or_else(|_| schema.to_string()) + "\n"
}

#[cfg(test)]
mod tests;
