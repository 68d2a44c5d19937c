//! A schema and one message in; its numeric fields out.

use super::schema::{Field, Kind, Number, Schema};
use super::wire::{self, Form};
use crate::log::bytes::Bytes;
use crate::log::channel::Channel;
use crate::log::decode::encoding::{FieldInfo, Gathered, MOST_FIELDS, MOST_ITEMS};
use crate::log::decode::paths::joined;
use std::collections::BTreeMap;

/// Messages nested deeper than this are not listed.
const DEEPEST: usize = 16;

/// The fields in the order of the schema. The messages say how long its lists are, the longest of each; without
/// one their places are `*`, as are those behind the first `MOST_ITEMS`.
pub(super) fn among(channel: &Channel, messages: &[&[u8]]) -> Vec<FieldInfo> {
    let Ok(schema) = Schema::parse(&channel.schema) else { return Vec::new() };
    let listed = |message: Option<&[u8]>| {
        let mut lister = Lister { schema: &schema, open: Vec::new(), visits: 0, out: Vec::new() };
        lister.message(&channel.schema_name, message, "");
        lister.out
    };
    if messages.is_empty() {
        return listed(None);
    }
    let mut all = Gathered::default();
    messages.iter().for_each(|message| all.add(listed(Some(message))));
    all.fields
}

struct Lister<'a> {
    schema: &'a Schema,
    /// Types that the present place lies in.
    open: Vec<&'a str>,
    /// Messages that were looked at.
    visits: usize,
    out: Vec<FieldInfo>,
}

impl<'a> Lister<'a> {
    fn message(&mut self, name: &'a str, message: Option<&[u8]>, path: &str) {
        // A type inside itself is listed as far as the message goes.
        let again = message.is_none() && self.open.contains(&name);
        self.visits += 1;
        if again || self.open.len() >= DEEPEST || self.visits > MOST_FIELDS {
            return;
        }
        let Some(of) = self.schema.message(name) else { return };
        let values = message.and_then(values);
        self.open.push(name);
        for field in &of.fields {
            let own = values.as_ref().map(|v| v.get(&field.number).map_or(&[][..], Vec::as_slice));
            let path = joined(path, &field.name);
            match &field.kind {
                Kind::Number(number) => self.number(field, *number, own, &path),
                Kind::Message(inner) => self.inner(field, inner, own, &path),
                Kind::Other => {}
            }
        }
        self.open.pop();
    }

    fn number(&mut self, field: &Field, number: Number, own: Option<&[Value]>, path: &str) {
        if !field.repeated {
            return self.push(path.to_string(), field);
        }
        let count = own.map(|own| own.iter().map(|v| items(number, v)).sum::<u64>());
        for i in 0..count.unwrap_or(0).min(MOST_ITEMS) {
            self.push(joined(path, &i.to_string()), field);
        }
        if count.is_none_or(|n| n > MOST_ITEMS) {
            self.push(joined(path, "*"), field);
        }
    }

    fn inner(&mut self, field: &Field, name: &'a str, own: Option<&[Value]>, path: &str) {
        if !field.repeated {
            let last = own.and_then(|own| *own.last()?);
            return self.message(name, last, path);
        }
        let own = own.map(|own| own.iter().flatten().collect::<Vec<_>>());
        for (i, item) in own.iter().flatten().take(MOST_ITEMS as usize).enumerate() {
            self.message(name, Some(item), &joined(path, &i.to_string()));
        }
        if own.is_none_or(|own| own.len() as u64 > MOST_ITEMS) {
            self.message(name, None, &joined(path, "*"));
        }
    }

    fn push(&mut self, path: String, field: &Field) {
        if self.out.len() < MOST_FIELDS {
            let doc = field.doc.clone();
            self.out.push(FieldInfo { path, unit: String::new(), doc });
        }
    }
}

/// What stands behind a field number: a stretch of bytes, or something else.
type Value<'a> = Option<&'a [u8]>;

/// What a message has, by field number; none where the bytes are no message.
fn values(message: &[u8]) -> Option<BTreeMap<u32, Vec<Value<'_>>>> {
    let mut rest = Bytes(message);
    let mut values: BTreeMap<u32, Vec<Value>> = BTreeMap::new();
    while !rest.0.is_empty() {
        let (number, form) = wire::key(&mut rest)?;
        let value = match form {
            Form::Stretch => Some(wire::stretch(&mut rest)?),
            _ => {
                wire::skip(&mut rest, number, form)?;
                None
            }
        };
        values.entry(number).or_default().push(value);
    }
    Some(values)
}

/// How many numbers a value holds.
fn items(number: Number, value: &Value) -> u64 {
    match (value, number.size()) {
        (Some(packed), Some(size)) => (packed.len() / size) as u64,
        (Some(packed), None) => packed.iter().filter(|b| **b < 0x80).count() as u64,
        (None, _) => 1,
    }
}
