//! A parsed TOML tree in; the file, line and column of every key, and of places inside string
//! values, out.

use std::collections::BTreeMap;
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{Error, Place};

/// A configuration text and the span of every value in it, by dotted key path:
/// `segment.inputs.0.channel`.
///
/// Keys of the file stand in a path as they are, without quotes; list items count from 0.
#[derive(Debug, Clone, Default)]
pub struct Doc {
    file: String,
    text: String,
    spans: BTreeMap<String, Spans>,
}

#[derive(Debug, Clone)]
struct Spans {
    key: Range<usize>,
    value: Range<usize>,
}

impl Doc {
    pub(super) fn new(file: &str, text: &str, tree: &DeTable) -> Self {
        let mut doc = Doc { file: file.into(), text: text.into(), spans: BTreeMap::new() };
        doc.add_table("", tree);
        doc
    }

    fn add_table(&mut self, path: &str, table: &DeTable) {
        for (key, value) in table.iter() {
            self.add(&join(path, key.get_ref()), key.span(), value);
        }
    }

    fn add(&mut self, path: &str, key: Range<usize>, value: &Spanned<DeValue>) {
        self.spans.insert(path.into(), Spans { key, value: value.span() });
        match value.get_ref() {
            DeValue::Table(table) => self.add_table(path, table),
            DeValue::Array(items) => {
                for (i, item) in items.iter().enumerate() {
                    self.add(&join(path, &i.to_string()), item.span(), item);
                }
            }
            _ => {}
        }
    }

    /// The file's name as messages carry it.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// The whole text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Whether the file holds a value at `path`.
    pub fn has(&self, path: &str) -> bool {
        self.spans.contains_key(path)
    }

    /// The text with other values in the place of these, which stay where they are; none where the file has no
    /// such value.
    pub fn with_values(&self, values: &[(String, String)]) -> Option<String> {
        let span = |(path, value): &(String, String)| {
            Some((self.spans.get(path)?.value.clone(), value.clone()))
        };
        let mut spans: Vec<(Range<usize>, String)> =
            values.iter().map(span).collect::<Option<_>>()?;
        spans.sort_by_key(|(span, _)| span.start);
        let mut text = self.text.clone();
        for (span, value) in spans.into_iter().rev() {
            text.get(span.clone())?;
            text.replace_range(span, &value);
        }
        Some(text)
    }

    /// Where the value of `path` stands (a table: its header or `{`); without such a key, where its
    /// nearest parent stands.
    pub fn place(&self, path: &str) -> Place {
        self.at(self.nearest(path).map_or(0, |s| s.value.start))
    }

    /// Where the key itself stands, left of the `=`.
    pub fn key_place(&self, path: &str) -> Place {
        self.at(self.nearest(path).map_or(0, |s| s.key.start))
    }

    /// Where byte `offset` of the string value of `path` stands in the file, escapes and line
    /// breaks accounted for; for a value that is no string, the place of the value.
    pub fn place_in(&self, path: &str, offset: usize) -> Place {
        let Some(spans) = self.spans.get(path) else { return self.place(path) };
        let raw = self.text.get(spans.value.clone()).unwrap_or("");
        self.at(spans.value.start + raw_offset(raw, offset))
    }

    /// An error at the value of `path`.
    pub fn error(&self, path: &str, what: impl Into<String>) -> Error {
        Error::at(self.place(path), what)
    }

    /// The place of byte `offset` of the file.
    pub(super) fn at(&self, offset: usize) -> Place {
        Place::in_text(&self.file, &self.text, offset)
    }

    fn nearest(&self, path: &str) -> Option<&Spans> {
        let mut path = path;
        loop {
            if let Some(spans) = self.spans.get(path) {
                return Some(spans);
            }
            path = path.rsplit_once('.')?.0;
        }
    }
}

pub(super) fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_string() } else { format!("{path}.{key}") }
}

/// The offset in the raw TOML string literal (with its quotes) of byte `offset` of the string that
/// it stands for.
fn raw_offset(raw: &str, offset: usize) -> usize {
    let Some(quote) = raw.chars().next().filter(|c| *c == '"' || *c == '\'') else { return 0 };
    let long = raw.len() >= 6 && raw.starts_with(&String::from(quote).repeat(3));
    let mut at = if long { 3 } else { 1 };
    if long {
        // TOML 1.1, "String": a newline right after the opening delimiter is trimmed.
        at += newline(&raw[at..]);
    }
    let mut done = 0;
    while at < raw.len() {
        let (taken, made) = unit(&raw[at..], quote == '"', long);
        if done >= offset && made > 0 {
            break;
        }
        at += taken;
        done += made;
    }
    at.min(raw.len().saturating_sub(1))
}

/// Bytes of raw text taken, and bytes of string made, by the next character or escape.
fn unit(raw: &str, basic: bool, long: bool) -> (usize, usize) {
    let mut chars = raw.chars();
    let first = chars.next().map_or(1, char::len_utf8);
    if !basic || !raw.starts_with('\\') {
        return (first, first);
    }
    let hex = |digits: usize| {
        let code = raw
            .get(2..2 + digits)
            .and_then(|d| u32::from_str_radix(d, 16).ok())
            .and_then(char::from_u32);
        (2 + digits, code.map_or(1, char::len_utf8))
    };
    match chars.next() {
        Some('x') => hex(2),
        Some('u') => hex(4),
        Some('U') => hex(8),
        // A backslash at the end of a line joins it to the next text: everything blank up to there
        // is trimmed.
        Some(c) if long && c.is_whitespace() => (raw.len() - raw[1..].trim_start().len(), 0),
        Some(c) => (1 + c.len_utf8(), 1),
        None => (1, 1),
    }
}

fn newline(text: &str) -> usize {
    if text.starts_with("\r\n") { 2 } else { usize::from(text.starts_with('\n')) }
}
