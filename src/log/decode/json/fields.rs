//! A schema and messages in; the fields that they have out.

use super::super::encoding::{FieldInfo, MOST_FIELDS, MOST_ITEMS, is_unreadable};
use super::layout::{DEEPEST, Layout, number, scan};
use crate::log::channel::Channel;
use crate::units::Unit;
use std::collections::{BTreeMap, BTreeSet};

/// Of a message with more texts than this no layout is learnt: each is looked up among all of them.
const MOST_TEXTS: usize = 100;

/// Fields in the order in which messages first have them, with what the schema says; those of the
/// schema, in its order, where no message has any. Texts that hold no number are left out; the items
/// behind the first ones of a long list are one field, with `*` for their places.
pub(super) fn among(channel: &Channel, messages: &[&[u8]]) -> Vec<FieldInfo> {
    let mut told = Vec::new();
    if let Ok(schema) = serde_json::from_slice::<serde_json::Value>(&channel.schema) {
        schema_fields(&schema, &schema, "", 0, &mut told);
    }
    let mut seen = Seen::default();
    messages.iter().for_each(|message| seen.add(message));
    if seen.paths.is_empty() {
        return told;
    }
    let places: BTreeMap<&str, &FieldInfo> =
        told.iter().rev().map(|field| (field.path.as_str(), field)).collect();
    let one = |path: String| {
        let known = places.get(path.as_str()).or_else(|| places.get(generic(&path).as_str()));
        let (unit, doc) = known.map(|f| (f.unit.clone(), f.doc.clone())).unwrap_or_default();
        FieldInfo { path, unit, doc }
    };
    seen.paths.into_iter().map(one).collect()
}

/// The paths at which messages had a number.
#[derive(Default)]
struct Seen {
    paths: Vec<String>,
    taken: BTreeSet<String>,
    /// How the last message that was looked through is laid out, and where it has no number yet.
    layout: Option<Layout>,
    texts: Vec<String>,
}

impl Seen {
    fn add(&mut self, message: &[u8]) {
        if self.has_nothing_new(message) {
            return;
        }
        let (mut new, mut texts) = (Vec::<String>::new(), BTreeSet::new());
        let sound = scan(message, MOST_ITEMS as usize, &mut |path, start, _| {
            if self.taken.contains(path) || new.last().is_some_and(|last| last == path) {
                return;
            }
            if number(&message[start..]).is_some() {
                new.push(path.to_string());
            } else {
                texts.insert(path.to_string());
            }
        });
        // what stands before damage may be damaged as well
        if sound.is_none() {
            return;
        }
        let first = self.paths.is_empty();
        for path in new {
            // The first message is listed whole; names that change from one to the next have no end.
            let room = first || self.paths.len() < MOST_FIELDS;
            if room && self.taken.insert(path.clone()) {
                self.paths.push(path);
            }
        }
        self.texts = texts.into_iter().collect();
        let few = self.texts.len() <= MOST_TEXTS;
        self.layout = if few { Layout::learn(message, &self.texts) } else { None };
    }

    /// Most messages are laid out as the one before: only its texts can be numbers now.
    fn has_nothing_new(&self, message: &[u8]) -> bool {
        let mut out = vec![0.0; self.texts.len()];
        let same = self.layout.as_ref().is_some_and(|layout| layout.read(message, &mut out));
        same && out.iter().all(|x| is_unreadable(*x))
    }
}

/// The path with every list index replaced by `*`, as lists stand in a schema.
fn generic(path: &str) -> String {
    let part = |p: &str| {
        if !p.is_empty() && p.bytes().all(|b| b.is_ascii_digit()) {
            "*".to_string()
        } else {
            p.to_string()
        }
    };
    path.split('.').map(part).collect::<Vec<_>>().join(".")
}

fn schema_fields(
    root: &serde_json::Value,
    node: &serde_json::Value,
    path: &str,
    depth: usize,
    out: &mut Vec<FieldInfo>,
) {
    if depth > DEEPEST.min(12) {
        return;
    }
    if let Some(target) =
        node.get("$ref").and_then(|r| r.as_str()).and_then(|r| root.pointer(r.strip_prefix('#')?))
    {
        return schema_fields(root, target, path, depth + 1, out);
    }
    let join =
        |name: &str| if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
    if let Some(properties) = node.get("properties").and_then(|p| p.as_object()) {
        for (name, property) in properties {
            schema_fields(root, property, &join(name), depth + 1, out);
        }
    } else if let Some(items) = node.get("items") {
        schema_fields(root, items, &join("*"), depth + 1, out);
    } else if has_number(node.get("type")) && !path.is_empty() {
        let text = |keys: &[&str]| {
            keys.iter().find_map(|k| node.get(*k)?.as_str()).unwrap_or_default().to_string()
        };
        let doc = text(&["description", "title"]);
        let unit = text(&["unit", "units", "x-unit", "x-units"]);
        let unit = if unit.is_empty() { unit_in(&doc) } else { unit };
        out.push(FieldInfo { path: path.to_string(), unit, doc });
    }
}

/// The unit that a description says: in brackets, or as all of it. One letter alone may be anything.
fn unit_in(doc: &str) -> String {
    let bracketed = doc.rsplit_once('[').and_then(|(_, rest)| rest.split_once(']'));
    let text = bracketed.map_or(doc, |(inside, _)| inside).trim();
    let is_unit = (bracketed.is_some() || text.len() > 1) && Unit::parse(text).is_ok();
    if is_unit { text.to_string() } else { String::new() }
}

fn has_number(kind: Option<&serde_json::Value>) -> bool {
    let numeric = |s: &str| matches!(s, "number" | "integer" | "boolean");
    match kind {
        Some(serde_json::Value::String(s)) => numeric(s),
        Some(serde_json::Value::Array(list)) => list.iter().filter_map(|v| v.as_str()).any(numeric),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listed(schema: &[u8], messages: &[&[u8]]) -> Vec<FieldInfo> {
        let channel = Channel {
            topic: "/t".into(),
            message_encoding: "json".into(),
            schema_name: String::new(),
            schema_encoding: String::new(),
            schema: schema.to_vec(),
        };
        among(&channel, messages)
    }

    fn paths(messages: &[&str]) -> Vec<String> {
        let messages: Vec<&[u8]> = messages.iter().map(|m| m.as_bytes()).collect();
        listed(b"", &messages).into_iter().map(|f| f.path).collect()
    }

    #[test]
    fn fields_carry_unit_and_description_from_the_schema() {
        let schema = br#"{"type":"object","properties":{
            "p":{"type":"number","unit":"rad/s","description":"Roll rate"},
            "q":{"type":"number","description":"Pitch rate [deg/s]"}, "a":{"type":"number","description":"deg"},
            "h":{"type":"number","description":"h"}, "n":{"type":"number","description":"[rows]"},
            "list":{"type":"array","items":{"type":"number","unit":"V"}}, "label":{"type":"string"}}}"#;
        let got = listed(
            schema,
            &[br#"{"p":1,"q":2,"a":3,"h":4,"n":5,"list":[1,2],"label":"on","extra":3}"#],
        );
        let text: Vec<String> =
            got.iter().map(|f| format!("{} [{}] {}", f.path, f.unit, f.doc)).collect();
        let expected = [
            "p [rad/s] Roll rate",
            "q [deg/s] Pitch rate [deg/s]",
            "a [deg] deg",
            "h [] h",
            "n [] [rows]",
            "list.0 [V] ",
            "list.1 [V] ",
            "extra [] ",
        ];
        assert_eq!(text, expected);
        assert_eq!(listed(schema, &[]).len(), 6);
    }

    #[test]
    fn fields_of_later_messages_are_listed_as_they_first_appear() {
        let got = paths(&[
            r#"{"a":1,"list":[],"obj":{},"null":null,"s":"x","late":null}"#,
            r#"{"a":2,"list":[],"obj":{},"null":null,"s":"y","late":null}"#,
            r#"{"a":2,"list":[],"obj":{},"null":null,"s":"2.5","late":null}"#,
            r#"{"a":3,"list":[1,2],"obj":{"b":1},"null":7,"s":"y","late":{"c":1}}"#,
            r#"{"a":3,"list":[1,2,3],"end":1}"#,
        ]);
        assert_eq!(
            got,
            ["a", "null", "late", "s", "list.0", "list.1", "obj.b", "late.c", "list.2", "end"]
        );
    }

    #[test]
    fn fault_a_broken_message_adds_no_field() {
        assert_eq!(paths(&[r#"{"a":1}"#, r#"{"x":1,"#, r#"{"b":1}"#]), ["a", "b"]);
    }

    #[test]
    fn of_a_long_list_the_first_items_are_listed_and_the_others_are_one_field() {
        let items = vec!["0.5"; 1000].join(",");
        let schema =
            br#"{"properties":{"v":{"type":"array","items":{"type":"number","unit":"V"}}}}"#;
        let got = listed(schema, &[format!("{{\"v\":[{items}],\"x\":1}}").as_bytes()]);
        assert_eq!(got.len() as u64, MOST_ITEMS + 2);
        let rest = &got[MOST_ITEMS as usize];
        assert_eq!((rest.path.as_str(), rest.unit.as_str()), ("v.*", "V"));
        assert_eq!(got.last().map(|field| field.path.as_str()), Some("x"));
    }

    #[test]
    fn many_fields_and_items_are_listed_and_read_in_time() {
        // each looked up among all others this would take hours
        let keys: Vec<String> = (0..300_000).map(|k| format!("\"k{k}\":{k}")).collect();
        let message = format!("{{{}}}", keys.join(","));
        let paths: Vec<String> =
            listed(b"", &[message.as_bytes()]).into_iter().map(|field| field.path).collect();
        let mut out = vec![0.0; paths.len()];
        let layout = Layout::learn(message.as_bytes(), &paths).expect("a layout");
        assert!(layout.read(message.as_bytes(), &mut out) && out[299_999] == 299_999.0);
    }

    #[test]
    fn names_that_change_with_every_message_have_an_end() {
        let all: Vec<String> = (0..MOST_FIELDS + 50).map(|k| format!("{{\"k{k}\":1}}")).collect();
        assert_eq!(paths(&all.iter().map(String::as_str).collect::<Vec<_>>()).len(), MOST_FIELDS);
    }
}
