//! A TOML value and the alternatives of a `oneOf` or `anyOf` in; the mistakes against the
//! alternative that was meant out.

use serde_json::{Map, Value as Json};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::check::{Checker, Found, kind_fits, kind_of, list_of, of_no_kind, one_of, wrong};
use super::words::{quoted, suggestion};

impl<'s> Checker<'s> {
    /// Holds a value against alternatives: an enum of any serde representation, or an `Option`.
    pub fn union(
        &self,
        parts: impl Iterator<Item = &'s Json>,
        value: &Spanned<DeValue>,
        path: &str,
        out: &mut Vec<Found>,
    ) {
        let mut all = Vec::new();
        for part in parts {
            self.alternatives(part, &mut all);
        }
        let had = kind_of(value.get_ref());
        let fitting: Vec<&Json> = all.iter().copied().filter(|s| self.accepts(s, had)).collect();
        match fitting.as_slice() {
            [] => {
                let mut kinds = Vec::new();
                all.iter().for_each(|s| self.kinds(s, &mut kinds));
                out.push(of_no_kind(value, path, &kinds));
            }
            [only] => self.value(only, value, path, out),
            many => {
                let words: Vec<&Json> = many.iter().flat_map(|s| literals(s)).collect();
                match value.get_ref() {
                    DeValue::String(_) if many.iter().all(|s| literals(s).next().is_some()) => {
                        one_of(&words, value, path, out)
                    }
                    DeValue::Table(table) => self.table_union(many, value, table, path, out),
                    _ => self.best(many, value, path, out),
                }
            }
        }
    }

    /// The alternatives behind references and nested unions, without `null`.
    fn alternatives(&self, schema: &'s Json, out: &mut Vec<&'s Json>) {
        let Some(object) = schema.as_object() else { return out.push(schema) };
        // A reference with siblings (a description, a tag) is one alternative; `value` checks both.
        if object.contains_key("$ref") && !object.contains_key("properties") {
            return self.alternatives(self.resolve(schema), out);
        }
        let nested = ["oneOf", "anyOf"].into_iter().find(|k| object.contains_key(*k));
        match nested {
            Some(key) if !object.contains_key("properties") => {
                list_of(object, key).for_each(|s| self.alternatives(s, out))
            }
            _ if object.get("type").and_then(Json::as_str) == Some("null") => {}
            _ => out.push(schema),
        }
    }

    /// The JSON types that a schema accepts; empty when it does not say.
    pub fn kinds(&self, schema: &'s Json, out: &mut Vec<&'s str>) {
        let mut add = |kind: &'s str| {
            if kind != "null" && !out.contains(&kind) {
                out.push(kind);
            }
        };
        match schema.get("type") {
            Some(Json::String(kind)) => return add(kind),
            Some(Json::Array(kinds)) => return kinds.iter().filter_map(Json::as_str).for_each(add),
            _ => {}
        }
        if literals(schema).any(Json::is_string) {
            add("string");
        }
        let Some(object) = schema.as_object() else { return };
        if object.contains_key("properties") {
            return add("object");
        }
        if object.contains_key("$ref") {
            self.kinds(self.resolve(schema), out);
        }
        ["oneOf", "anyOf"]
            .into_iter()
            .flat_map(|k| list_of(object, k))
            .for_each(|s| self.kinds(s, out));
    }

    fn accepts(&self, schema: &'s Json, had: &str) -> bool {
        let mut kinds = Vec::new();
        self.kinds(schema, &mut kinds);
        kinds.is_empty() || kinds.iter().any(|k| kind_fits(k, had))
    }

    fn table_union(
        &self,
        parts: &[&'s Json],
        value: &Spanned<DeValue>,
        table: &DeTable,
        path: &str,
        out: &mut Vec<Found>,
    ) {
        if let Some(tag) = tag_of(parts) {
            return self.tagged(tag, parts, value, table, path, out);
        }
        if let Some(names) = parts.iter().map(|s| variant_of(s)).collect::<Option<Vec<_>>>() {
            return self.named(&names, parts, value, table, path, out);
        }
        self.best(parts, value, path, out)
    }

    /// An enum with the variant's name under the key `tag`.
    fn tagged(
        &self,
        tag: &str,
        parts: &[&'s Json],
        value: &Spanned<DeValue>,
        table: &DeTable,
        path: &str,
        out: &mut Vec<Found>,
    ) {
        let names: Vec<&Json> = parts.iter().filter_map(|s| tag_value(s, tag)).collect();
        let Some((_, had)) = table.iter().find(|(k, _)| k.get_ref() == tag) else {
            let mut found = self.missing(tag, None, value.span().start, path);
            found.help = Some(format!(
                "add {tag} = one of {}",
                quoted(&names.iter().filter_map(|n| n.as_str()).collect::<Vec<_>>())
            ));
            return out.push(found);
        };
        let name = had.get_ref().as_str();
        match parts
            .iter()
            .find(|s| name.is_some() && tag_value(s, tag).and_then(Json::as_str) == name)
        {
            Some(part) => self.value(part, value, path, out),
            None => one_of(&names, had, &super::doc::join(path, tag), out),
        }
    }

    /// An enum with the variant's name as the one key of the table.
    fn named(
        &self,
        names: &[&'s str],
        parts: &[&'s Json],
        value: &Spanned<DeValue>,
        table: &DeTable,
        path: &str,
        out: &mut Vec<Found>,
    ) {
        let meant = names.iter().position(|n| table.keys().any(|k| k.get_ref() == n));
        if let Some(part) = meant.and_then(|i| parts.get(i)) {
            return self.value(part, value, path, out);
        }
        match table.keys().next() {
            None => {
                out.push(wrong(value, path, &format!("a table with one key of {}", quoted(names))))
            }
            Some(key) => out.push(Found {
                at: key.span().start,
                what: format!("unknown key \"{}\" in \"{path}\"", key.get_ref()),
                help: Some(suggestion(key.get_ref(), names, "one key of these is wanted")),
                key: None,
            }),
        }
    }

    /// Nothing tells which alternative was meant: the one with the fewest mistakes.
    fn best(&self, parts: &[&'s Json], value: &Spanned<DeValue>, path: &str, out: &mut Vec<Found>) {
        let tried = parts.iter().map(|part| {
            let mut found = Vec::new();
            self.value(part, value, path, &mut found);
            found
        });
        out.extend(tried.min_by_key(Vec::len).unwrap_or_default());
    }
}

/// The literal values of a `const` or `enum`.
fn literals(schema: &Json) -> impl Iterator<Item = &Json> {
    schema
        .get("const")
        .into_iter()
        .chain(schema.get("enum").and_then(Json::as_array).into_iter().flatten())
}

/// The key that every alternative requires with a literal of its own.
fn tag_of<'s>(parts: &[&'s Json]) -> Option<&'s str> {
    let keys = parts.first()?.get("properties")?.as_object()?.keys();
    keys.map(String::as_str)
        .find(|key| parts.iter().all(|s| tag_value(s, key).is_some() && requires(s, key)))
}

fn tag_value<'s>(schema: &'s Json, tag: &str) -> Option<&'s Json> {
    literals(schema.get("properties")?.get(tag)?).next()
}

fn requires(schema: &Json, key: &str) -> bool {
    schema.as_object().is_some_and(|o| list_of(o, "required").any(|r| r.as_str() == Some(key)))
}

/// The name of an alternative that is a table of one required key and nothing else.
fn variant_of(schema: &Json) -> Option<&str> {
    let keys: &Map<String, Json> = schema.get("properties")?.as_object()?;
    let closed = schema.get("additionalProperties") == Some(&Json::Bool(false));
    let name = keys.keys().next()?;
    (closed && keys.len() == 1 && requires(schema, name)).then_some(name)
}
