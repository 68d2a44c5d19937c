//! A TOML tree and a JSON Schema in; every place where the tree does not fit the schema out.
//!
//! Covers what schemars derives from settings structs: `$ref`, `type`, `enum`, `const`, bounds,
//! `properties`, `required`, `additionalProperties`, `unevaluatedProperties`, `items`,
//! `prefixItems`, `minItems`, `maxItems`, `allOf`, `oneOf`, `anyOf`.

use std::ops::Range;

use serde_json::{Map, Value as Json};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::doc::{Doc, join};
use super::words::{nearest, quoted, suggestion};
use crate::error::{Error, Errors};

/// A mistake at a byte of the file.
#[derive(Debug, Clone)]
pub(super) struct Found {
    pub at: usize,
    pub what: String,
    pub help: Option<String>,
    /// The key that it is about, where it is about one.
    pub key: Option<Key>,
}

/// A key by its path.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Key {
    /// It is not there.
    Lacking(String),
    /// An unknown one, which stands there in the text, is most likely a misspelling of it.
    Meant(String, Range<usize>),
    /// Its value, which stands there in the text, is of none of these JSON types, which are wanted.
    Value(Range<usize>, Vec<String>),
}

impl Found {
    pub fn new(at: usize, what: String) -> Self {
        Found { at, what, help: None, key: None }
    }

    /// Whether it only follows from another mistake: the key that is lacking is there, misspelt.
    fn follows_from(&self, all: &[Found]) -> bool {
        let Some(Key::Lacking(path)) = &self.key else { return false };
        all.iter().any(|other| matches!(&other.key, Some(Key::Meant(meant, _)) if meant == path))
    }
}

/// Holds the tree against the schema.
///
/// # Errors
/// Every mistake, in the order of the text.
pub(super) fn check(schema: &Json, root: &Spanned<DeValue>, doc: &Doc) -> Result<(), Errors> {
    let mut found = find(schema, root);
    // Stable: mistakes at one place stay in the order of the schema.
    found.sort_by_key(|f| f.at);
    found.dedup_by(|a, b| a.at == b.at && a.what == b.what);
    let own = found.iter().filter(|f| !f.follows_from(&found)).cloned();
    let errors = own.map(|f| Error { place: Some(doc.at(f.at)), what: f.what, help: f.help });
    Errors(errors.collect()).or(())
}

/// All mistakes, in no order.
pub(super) fn find(schema: &Json, root: &Spanned<DeValue>) -> Vec<Found> {
    let mut found = Vec::new();
    Checker { root: schema }.value(schema, root, "", &mut found);
    found
}

pub(super) struct Checker<'s> {
    pub root: &'s Json,
}

impl<'s> Checker<'s> {
    /// The schema that a chain of `$ref`s without siblings leads to.
    pub fn resolve(&self, schema: &'s Json) -> &'s Json {
        let mut schema = schema;
        // A chain longer than this is a circle.
        for _ in 0..32 {
            let Some(target) = schema
                .get("$ref")
                .and_then(Json::as_str)
                .and_then(|r| self.root.pointer(r.strip_prefix('#')?))
            else {
                break;
            };
            schema = target;
        }
        schema
    }

    pub fn value(
        &self,
        schema: &'s Json,
        value: &Spanned<DeValue>,
        path: &str,
        out: &mut Vec<Found>,
    ) {
        let Some(object) = schema.as_object() else { return };
        if object.contains_key("$ref") {
            self.value(self.resolve(schema), value, path, out);
        }
        if !fits_type(object.get("type"), value.get_ref()) {
            let mut kinds = Vec::new();
            self.kinds(schema, &mut kinds);
            return out.push(of_no_kind(value, path, &kinds));
        }
        for part in list_of(object, "allOf") {
            self.value(part, value, path, out);
        }
        for key in ["oneOf", "anyOf"] {
            if object.contains_key(key) {
                self.union(list_of(object, key), value, path, out);
            }
        }
        let allowed: Vec<&Json> =
            object.get("const").into_iter().chain(list_of(object, "enum")).collect();
        if !allowed.is_empty() {
            one_of(&allowed, value, path, out);
        }
        match value.get_ref() {
            DeValue::Integer(_) | DeValue::Float(_) => number(object, value, path, out),
            DeValue::Table(table) => self.table(schema, table, value.span().start, path, out),
            DeValue::Array(items) => self.array(object, items, value, path, out),
            _ => {}
        }
    }

    fn table(
        &self,
        schema: &'s Json,
        table: &DeTable,
        at: usize,
        path: &str,
        out: &mut Vec<Found>,
    ) {
        let Some(object) = schema.as_object() else { return };
        let known = object.get("properties").and_then(Json::as_object);
        let more = object.get("additionalProperties");
        for (key, value) in table.iter() {
            let name = key.get_ref().as_ref();
            let path = join(path, name);
            match (known.and_then(|k| k.get(name)), more) {
                (Some(schema), _) => self.value(schema, value, &path, out),
                (None, Some(more @ Json::Object(_))) => self.value(more, value, &path, out),
                (None, _) => {}
            }
        }
        if more == Some(&Json::Bool(false))
            || object.get("unevaluatedProperties") == Some(&Json::Bool(false))
        {
            self.unknown_keys(schema, table, path, out);
        }
        for name in list_of(object, "required").filter_map(Json::as_str) {
            if !table.keys().any(|k| k.get_ref() == name) {
                out.push(self.missing(name, known.and_then(|k| k.get(name)), at, path));
            }
        }
    }

    pub fn unknown_keys(
        &self,
        schema: &'s Json,
        table: &DeTable,
        path: &str,
        out: &mut Vec<Found>,
    ) {
        let mut known = Vec::new();
        self.all_keys(schema, &mut known);
        for key in table.keys().filter(|k| !known.contains(&k.get_ref().as_ref())) {
            let inside = if path.is_empty() { String::new() } else { format!(" in \"{path}\"") };
            out.push(Found {
                at: key.span().start,
                what: format!("unknown key \"{}\"{inside}", key.get_ref()),
                help: Some(suggestion(key.get_ref(), &known, "the keys here are")),
                key: nearest(key.get_ref(), known.iter().copied())
                    .map(|meant| Key::Meant(join(path, meant), key.span())),
            });
        }
    }

    /// Every key that the schema or a part of it names, in order.
    fn all_keys(&self, schema: &'s Json, out: &mut Vec<&'s str>) {
        let Some(object) = schema.as_object() else { return };
        if object.contains_key("$ref") {
            self.all_keys(self.resolve(schema), out);
        }
        for key in
            object.get("properties").and_then(Json::as_object).into_iter().flat_map(Map::keys)
        {
            if !out.contains(&key.as_str()) {
                out.push(key);
            }
        }
        for part in ["allOf", "oneOf", "anyOf"].into_iter().flat_map(|k| list_of(object, k)) {
            self.all_keys(part, out);
        }
    }

    pub fn missing(&self, name: &str, schema: Option<&'s Json>, at: usize, path: &str) -> Found {
        let owner = if path.is_empty() { "the file".to_string() } else { format!("\"{path}\"") };
        let mut found = Found::new(at, format!("{owner} lacks the key \"{name}\""));
        found.key = Some(Key::Lacking(join(path, name)));
        if let Some(schema) = schema {
            let doc = [schema, self.resolve(schema)]
                .into_iter()
                .find_map(|s| s.get("description").and_then(Json::as_str));
            let doc = doc
                .map(|d| format!(": {}", d.split_whitespace().collect::<Vec<_>>().join(" ")))
                .unwrap_or_default();
            found.help = Some(format!("add {name} = {}{doc}", self.wanted(schema)));
        }
        found
    }

    /// What a schema asks for, in words: `<a number or a text>`.
    fn wanted(&self, schema: &'s Json) -> String {
        let mut kinds = Vec::new();
        self.kinds(schema, &mut kinds);
        let words: Vec<String> = kinds.iter().map(|k| type_word(k).to_string()).collect();
        if words.is_empty() { "...".into() } else { format!("<{}>", words.join(" or ")) }
    }

    fn array(
        &self,
        object: &'s Map<String, Json>,
        items: &[Spanned<DeValue>],
        whole: &Spanned<DeValue>,
        path: &str,
        out: &mut Vec<Found>,
    ) {
        let prefix: Vec<&Json> = list_of(object, "prefixItems").collect();
        for (i, item) in items.iter().enumerate() {
            let schema = prefix.get(i).copied().or(object.get("items"));
            if let Some(schema) = schema {
                self.value(schema, item, &join(path, &i.to_string()), out);
            }
        }
        let limit = |key: &str| {
            object.get(key).and_then(Json::as_u64).and_then(|n| usize::try_from(n).ok())
        };
        let (least, most) =
            (limit("minItems").unwrap_or(0), limit("maxItems").unwrap_or(usize::MAX));
        if items.len() < least || items.len() > most {
            let wanted = match (least == most, items.len() < least) {
                (true, _) => format!("{least}"),
                (_, true) => format!("at least {least}"),
                _ => format!("at most {most}"),
            };
            let what = format!("{} must have {wanted} items, not {}", subject(path), items.len());
            out.push(Found::new(whole.span().start, what));
        }
    }
}

/// The schemas or values listed under `key`.
pub(super) fn list_of<'s>(
    object: &'s Map<String, Json>,
    key: &str,
) -> impl Iterator<Item = &'s Json> {
    object.get(key).and_then(Json::as_array).into_iter().flatten()
}

fn subject(path: &str) -> String {
    if path.is_empty() { "the file".into() } else { format!("\"{path}\"") }
}

/// `"fit.level" must be a number, not the text "abc"`.
pub(super) fn wrong(value: &Spanned<DeValue>, path: &str, wanted: &str) -> Found {
    Found::new(
        value.span().start,
        format!("{} must be {wanted}, not {}", subject(path), shown(value.get_ref())),
    )
}

/// As `wrong`, of a value that is of none of the JSON types `kinds`.
pub(super) fn of_no_kind(value: &Spanned<DeValue>, path: &str, kinds: &[&str]) -> Found {
    let words: Vec<&str> = kinds.iter().map(|k| type_word(k)).collect();
    let kinds = kinds.iter().map(|k| k.to_string()).collect();
    let key = Some(Key::Value(value.span(), kinds));
    Found { key, ..wrong(value, path, &words.join(" or ")) }
}

fn number(object: &Map<String, Json>, value: &Spanned<DeValue>, path: &str, out: &mut Vec<Found>) {
    let Some(x) = as_f64(value.get_ref()).filter(|x| x.is_finite()) else {
        return out.push(wrong(value, path, "a finite number within range"));
    };
    let bound = |key: &str| object.get(key).and_then(Json::as_f64);
    let limits = [
        ("minimum", "at least", bound("minimum").is_some_and(|b| x < b)),
        ("maximum", "at most", bound("maximum").is_some_and(|b| x > b)),
        ("exclusiveMinimum", "greater than", bound("exclusiveMinimum").is_some_and(|b| x <= b)),
        ("exclusiveMaximum", "less than", bound("exclusiveMaximum").is_some_and(|b| x >= b)),
    ];
    for (key, words, _) in limits.into_iter().filter(|l| l.2) {
        let limit = object
            .get(key)
            .map(|l| l.as_f64().filter(|f| f.fract() != 0.0).map_or(whole(l), |f| f.to_string()));
        out.push(wrong(value, path, &format!("{words} {}", limit.unwrap_or_default())));
    }
}

/// A whole number of a schema without the `.0` that JSON gives it.
fn whole(json: &Json) -> String {
    json.to_string().trim_end_matches(".0").to_string()
}

/// Holds a value against an enumeration; all of the alternatives are named.
pub(super) fn one_of(
    allowed: &[&Json],
    value: &Spanned<DeValue>,
    path: &str,
    out: &mut Vec<Found>,
) {
    let equal = |json: &Json| match value.get_ref() {
        DeValue::String(s) => json.as_str() == Some(s),
        DeValue::Boolean(b) => json.as_bool() == Some(*b),
        other => as_f64(other).is_some_and(|x| json.as_f64() == Some(x)),
    };
    if allowed.iter().any(|json| equal(json)) {
        return;
    }
    let words: Vec<&str> = allowed.iter().filter_map(|j| j.as_str()).collect();
    let all = if words.len() == allowed.len() {
        quoted(&words)
    } else {
        allowed.iter().map(|j| j.to_string()).collect::<Vec<_>>().join(", ")
    };
    let wanted = if allowed.len() == 1 { all } else { format!("one of {all}") };
    let mut found = wrong(value, path, &wanted);
    if let DeValue::String(s) = value.get_ref() {
        found.help = super::nearest(s, words).map(|w| format!("did you mean \"{w}\"?"));
    }
    out.push(found);
}

/// The JSON Schema types that a TOML value counts as.
pub(super) fn kind_of(value: &DeValue) -> &'static str {
    match value {
        DeValue::String(_) => "string",
        DeValue::Integer(_) => "integer",
        DeValue::Float(_) => "number",
        DeValue::Boolean(_) => "boolean",
        DeValue::Datetime(_) => "date",
        DeValue::Array(_) => "array",
        DeValue::Table(_) => "object",
    }
}

/// Whether a value of kind `had` is one of kind `wanted`: every integer is a number.
pub(super) fn kind_fits(wanted: &str, had: &str) -> bool {
    wanted == had || (wanted == "number" && had == "integer")
}

fn fits_type(wanted: Option<&Json>, value: &DeValue) -> bool {
    let had = kind_of(value);
    match wanted {
        Some(Json::String(w)) => kind_fits(w, had),
        Some(Json::Array(ws)) => ws.iter().filter_map(Json::as_str).any(|w| kind_fits(w, had)),
        _ => true,
    }
}

pub(super) fn type_word(kind: &str) -> &'static str {
    match kind {
        "string" => "a text",
        "integer" => "a whole number",
        "number" => "a number",
        "boolean" => "true or false",
        "array" => "a list",
        "object" => "a table",
        _ => "nothing",
    }
}

fn as_f64(value: &DeValue) -> Option<f64> {
    match value {
        DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
        DeValue::Float(f) => f.as_str().parse().ok(),
        _ => None,
    }
}

/// A value as a message shows it.
fn shown(value: &DeValue) -> String {
    match value {
        DeValue::String(s) if s.chars().count() <= 60 => {
            format!("the text \"{}\"", s.escape_debug())
        }
        DeValue::String(_) => "a long text".into(),
        DeValue::Integer(i) => i.to_string(),
        DeValue::Float(f) => f.to_string(),
        DeValue::Boolean(b) => b.to_string(),
        DeValue::Datetime(d) => format!("the date {d}"),
        DeValue::Array(a) => format!("a list of {}", a.len()),
        DeValue::Table(_) => "a table".into(),
    }
}
