//! JSON messages in, the numbers at the wanted paths out, without building a value tree.
//!
//! The layout of a message (the text between its scalars) is learnt once; messages of the same
//! layout are compared with it bytewise, and only the wanted scalars are parsed. A message of
//! another layout is learnt anew.

use super::encoding::{Encoding, FieldInfo, Prepared, Reader, UNREADABLE, finite};
use crate::log::channel::Channel;
use crate::units::Unit;
use std::sync::Arc;

pub const ENCODING: Encoding =
    Encoding { message: "json", schemas: &["jsonschema", ""], fields: channel_fields, prepare };

/// Messages nested deeper than this are not read.
const DEEPEST: usize = 64;

fn prepare(_: &Channel, paths: &[String]) -> Result<Prepared, String> {
    let paths: Arc<[String]> = paths.into();
    Ok(Box::new(move || reader(paths.clone())))
}

fn reader(paths: Arc<[String]>) -> Reader {
    let mut layout: Option<Layout> = None;
    Box::new(move |message, out| {
        if layout.as_ref().is_some_and(|l| l.read(message, out)) {
            return;
        }
        layout = Layout::learn(message, &paths);
        if !layout.as_ref().is_some_and(|l| l.read(message, out)) {
            out.fill(UNREADABLE);
        }
    })
}

/// The text of a message with its scalars taken out.
struct Layout {
    /// Text before each scalar, and which path (if any) the scalar belongs to.
    slots: Vec<(Vec<u8>, Option<usize>)>,
    tail: Vec<u8>,
}

impl Layout {
    fn learn(message: &[u8], paths: &[String]) -> Option<Layout> {
        let mut slots = Vec::new();
        let mut at = 0;
        scan(message, &mut |path, start, end| {
            slots.push((message[at..start].to_vec(), paths.iter().position(|p| p == path)));
            at = end;
        })?;
        Some(Layout { slots, tail: message[at..].to_vec() })
    }

    /// False where the message is laid out differently; `out` is then undefined.
    fn read(&self, message: &[u8], out: &mut [f64]) -> bool {
        out.fill(UNREADABLE);
        let mut rest = message;
        for (text, wanted) in &self.slots {
            let Some(after) = rest.strip_prefix(text.as_slice()) else { return false };
            rest = match wanted.and_then(|i| out.get_mut(i)) {
                Some(value) => match number(after) {
                    Some((x, tail)) => {
                        *value = x;
                        tail
                    }
                    None => match skip_scalar(after) {
                        Some(tail) => tail,
                        None => return false,
                    },
                },
                None => match skip_scalar(after) {
                    Some(tail) => tail,
                    None => return false,
                },
            };
        }
        rest == self.tail.as_slice()
    }
}

/// The number at the start of `text` and what follows it. Numbers in quotes, booleans (0, 1), null
/// and NaN count as numbers.
fn number(text: &[u8]) -> Option<(f64, &[u8])> {
    match text.first()? {
        b'"' => {
            let end = 1 + text.get(1..)?.iter().position(|&b| b == b'"')?;
            let inner = text[1..end].trim_ascii();
            Some((quoted(inner)?, &text[end + 1..]))
        }
        b'n' if text.starts_with(b"null") => Some((f64::NAN, &text[4..])),
        b't' if text.starts_with(b"true") => Some((1.0, &text[4..])),
        b'f' if text.starts_with(b"false") => Some((0.0, &text[5..])),
        _ => {
            let (x, n) = fast_float2::parse_partial::<f64, _>(text).ok()?;
            Some((finite(x), text.get(n..)?))
        }
    }
}

fn quoted(inner: &[u8]) -> Option<f64> {
    if inner.is_empty() || inner.eq_ignore_ascii_case(b"null") || inner.eq_ignore_ascii_case(b"n/a")
    {
        return Some(f64::NAN);
    }
    fast_float2::parse::<f64, _>(inner).ok().map(finite)
}

/// What follows the scalar at the start of `text`; `None` where there is none (a list, an object,
/// the end).
fn skip_scalar(text: &[u8]) -> Option<&[u8]> {
    match text.first()? {
        b'"' => {
            let mut i = 1;
            while *text.get(i)? != b'"' {
                i += if text[i] == b'\\' { 2 } else { 1 };
            }
            Some(&text[i + 1..])
        }
        _ => {
            let end = text.iter().position(|&b| !IN_TOKEN[usize::from(b)]).unwrap_or(text.len());
            if end == 0 { None } else { text.get(end..) }
        }
    }
}

/// The bytes that numbers and words (`null`, `-1.5e+3`) are made of.
const IN_TOKEN: [bool; 256] = {
    let mut table = [false; 256];
    let mut b = 0;
    while b < 256 {
        table[b] = (b as u8).is_ascii_alphanumeric() || matches!(b as u8, b'+' | b'-' | b'.');
        b += 1;
    }
    table
};

/// Calls `visit(path, start, end)` for every scalar of a message; `None` where it is no JSON (NaN
/// and Infinity are let through).
fn scan(message: &[u8], visit: &mut dyn FnMut(&str, usize, usize)) -> Option<()> {
    let mut scanner = Scanner { text: message, at: 0, path: String::new(), visit };
    scanner.blank();
    scanner.value(0)?;
    scanner.blank();
    (scanner.at == message.len()).then_some(())
}

struct Scanner<'a, 'v> {
    text: &'a [u8],
    at: usize,
    path: String,
    visit: &'v mut dyn FnMut(&str, usize, usize),
}

impl Scanner<'_, '_> {
    fn peek(&self) -> Option<u8> {
        self.text.get(self.at).copied()
    }

    fn blank(&mut self) {
        while self.peek().is_some_and(|b| b.is_ascii_whitespace()) {
            self.at += 1;
        }
    }

    fn expect(&mut self, byte: u8) -> Option<()> {
        self.blank();
        (self.peek()? == byte).then(|| self.at += 1)
    }

    fn value(&mut self, depth: usize) -> Option<()> {
        if depth > DEEPEST {
            return None;
        }
        match self.peek()? {
            b'{' => self.items(b'}', depth, true),
            b'[' => self.items(b']', depth, false),
            _ => {
                let start = self.at;
                self.at = self.text.len() - skip_scalar(&self.text[start..])?.len();
                if !sound_scalar(&self.text[start..self.at]) {
                    return None;
                }
                (self.visit)(&self.path, start, self.at);
                Some(())
            }
        }
    }

    /// The items of an object or a list.
    fn items(&mut self, close: u8, depth: usize, object: bool) -> Option<()> {
        self.at += 1;
        self.blank();
        if self.peek()? == close {
            self.at += 1;
            return Some(());
        }
        let outer = self.path.len();
        for index in 0.. {
            self.blank();
            let name = if object { self.key()? } else { index.to_string() };
            if outer > 0 {
                self.path.push('.');
            }
            self.path.push_str(&name);
            self.blank();
            self.value(depth + 1)?;
            self.path.truncate(outer);
            self.blank();
            match self.peek()? {
                b',' => self.at += 1,
                b if b == close => {
                    self.at += 1;
                    return Some(());
                }
                _ => return None,
            }
        }
        None
    }

    fn key(&mut self) -> Option<String> {
        let start = self.at;
        if self.peek()? != b'"' {
            return None;
        }
        self.at = self.text.len() - skip_scalar(&self.text[start..])?.len();
        let name = serde_json::from_slice::<String>(&self.text[start..self.at]).ok()?;
        self.expect(b':')?;
        Some(name)
    }
}

/// Whether a token is a string, number or word that a message may hold.
fn sound_scalar(token: &[u8]) -> bool {
    match token.first() {
        Some(b'"') => std::str::from_utf8(token).is_ok(),
        _ => {
            matches!(token, b"null" | b"true" | b"false")
                || fast_float2::parse::<f64, _>(token).is_ok()
        }
    }
}

fn channel_fields(channel: &Channel, message: Option<&[u8]>) -> Vec<FieldInfo> {
    fields(&channel.schema, message)
}

/// Fields from the schema, in its order, then those that only the message has. Texts that hold no
/// number are left out.
fn fields(schema: &[u8], message: Option<&[u8]>) -> Vec<FieldInfo> {
    let mut told = Vec::new();
    if let Ok(schema) = serde_json::from_slice::<serde_json::Value>(schema) {
        schema_fields(&schema, &schema, "", 0, &mut told);
    }
    let Some(message) = message else { return told };
    let mut seen: Vec<FieldInfo> = Vec::new();
    let _ = scan(message, &mut |path, start, _| {
        if number(&message[start..]).is_some() {
            let known = told.iter().find(|f| f.path == path || generic(path) == f.path);
            let (unit, doc) = known.map(|f| (f.unit.clone(), f.doc.clone())).unwrap_or_default();
            seen.push(FieldInfo { path: path.to_string(), unit, doc });
        }
    });
    if seen.is_empty() { told } else { seen }
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

    fn read_all(messages: &[&str], paths: &[&str]) -> Vec<Vec<String>> {
        let paths: Arc<[String]> = paths.iter().map(|p| p.to_string()).collect();
        let mut read = reader(paths.clone());
        let word = |x: &f64| {
            if crate::log::decode::is_unreadable(*x) {
                "unreadable".to_string()
            } else {
                x.to_string()
            }
        };
        let one = |m: &&str| {
            let mut out = vec![0.0; paths.len()];
            read(m.as_bytes(), &mut out);
            out.iter().map(word).collect()
        };
        messages.iter().map(one).collect()
    }

    #[test]
    fn nested_paths_lists_and_changing_layouts() {
        let got = read_all(
            &[
                r#"{"a":{"b":1.5,"c":[10,20]},"s":"x"}"#,
                r#"{"a":{"b":-2e-3,"c":[11,21]},"s":"a \"longer\" text"}"#,
                r#"{"s":"y", "a":{"c":[12],"b":7}}"#,
                r#"{"a":{"b":3,"c":[13,23]},"s":"x"}"#,
                r#"{"a.b":4}"#,
            ],
            &["a.b", "a.c.1"],
        );
        assert_eq!(
            got,
            [
                ["1.5", "20"],
                ["-0.002", "21"],
                ["7", "unreadable"],
                ["3", "23"],
                ["4", "unreadable"]
            ]
        );
    }

    #[test]
    fn every_way_recorders_write_nan() {
        let got = read_all(
            &[
                r#"{"a":1}"#,
                r#"{"a":null}"#,
                r#"{"a":NaN}"#,
                r#"{"a":-Infinity}"#,
                r#"{"a":"nan"}"#,
                r#"{"a":"2.5"}"#,
                r#"{"a":1e999}"#,
                r#"{"a":true}"#,
            ],
            &["a"],
        );
        assert_eq!(got, [["1"], ["NaN"], ["NaN"], ["NaN"], ["NaN"], ["2.5"], ["NaN"], ["1"]]);
    }

    #[test]
    fn broken_messages_are_unreadable_and_the_next_one_is_read() {
        let deep = "[".repeat(100_000);
        let broken = [
            "{",
            r#"{"a":}"#,
            r#"{"a":1"#,
            r#"{"a":1}x"#,
            r#"{"a":"off"}"#,
            r#"{"a":{}}"#,
            r#"{"a":1.2.3}"#,
            "",
            "\"",
            "{\"a\":\"\\",
            &deep,
        ];
        for b in broken {
            assert_eq!(
                read_all(&[r#"{"a":5}"#, b, r#"{"a":6}"#], &["a"]),
                [["5"], ["unreadable"], ["6"]],
                "{b:.20}"
            );
        }
    }

    #[test]
    fn fields_carry_unit_and_description_from_the_schema() {
        let schema = br#"{"type":"object","properties":{
            "p":{"type":"number","unit":"rad/s","description":"Roll rate"},
            "q":{"type":"number","description":"Pitch rate [deg/s]"}, "a":{"type":"number","description":"deg"},
            "h":{"type":"number","description":"h"}, "n":{"type":"number","description":"[rows]"},
            "list":{"type":"array","items":{"type":"number","unit":"V"}}, "label":{"type":"string"}}}"#;
        let got = fields(
            schema,
            Some(br#"{"p":1,"q":2,"a":3,"h":4,"n":5,"list":[1,2],"label":"on","extra":3}"#),
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
        assert_eq!(fields(schema, None).len(), 6);
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_read_without_panic(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..60)) {
            let mut read = reader(["a".to_string()].into());
            let mut out = [0.0];
            read(br#"{"a":1,"b":"x"}"#, &mut out);
            read(&bytes, &mut out);
            let mut near = br#"{"a":1,"b":"x"}"#.to_vec();
            near.splice(5..6, bytes);
            read(&near, &mut out);
            proptest::prop_assert!(!out[0].is_infinite());
        }

        #[test]
        fn numbers_are_read_to_the_last_bit(x in proptest::num::f64::NORMAL, y in proptest::num::f64::NORMAL) {
            let mut read = reader(["a".to_string(), "b".to_string()].into());
            let mut out = [0.0; 2];
            read(br#"{"a":1,"b":2}"#, &mut out);
            read(format!("{{\"a\":{x:e},\"b\":{y}}}").as_bytes(), &mut out);
            proptest::prop_assert_eq!(out, [x, y]);
        }
    }
}
