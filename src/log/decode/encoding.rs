//! What an encoding is: a channel and paths of fields in, readers of its messages out.

use crate::log::channel::Channel;
use serde::Serialize;
use std::collections::BTreeSet;

/// How messages of one encoding are read.
pub struct Encoding {
    /// The channel's message encoding, as MCAP's registry spells it.
    pub message: &'static str,
    /// The schema encodings that go with it; an empty string is a channel without schema.
    pub schemas: &'static [&'static str],
    /// The numeric fields of a topic, from its channel's schema and some of its messages (of which there may be
    /// none), each field once, as they first come: lists differ in length, and a message without a schema need
    /// not have every field. The places of lists are numbers, or `*` where their length is not known.
    pub fields: fn(&Channel, messages: &[&[u8]]) -> Vec<FieldInfo>,
    /// Makes ready to read the fields at the given paths (no path twice).
    ///
    /// # Errors
    /// In words: what is wrong with the schema.
    pub prepare: fn(&Channel, paths: &[String]) -> Result<Prepared, String>,
}

/// Makes readers, one for each stretch of messages that is read by itself.
pub type Prepared = Box<dyn Fn() -> Reader + Send + Sync>;

/// Reads one message: one value per path. Every value is overwritten: a number, NaN where the
/// message says so (NaN, infinite, null), or `UNREADABLE` where the message has no such field or no
/// number there. A message that is not what its schema says is `DAMAGED` as a whole.
pub type Reader = Box<dyn FnMut(&[u8], &mut [f64])>;

/// Of a longer list only so many items are listed one by one as fields; every one can be read.
pub(super) const MOST_ITEMS: u64 = 64;

/// No more fields of one topic are listed; every one can be read.
pub(super) const MOST_FIELDS: usize = 10_000;

/// Marks a value that a sound message does not have: a NaN with a payload of its own, never the result
/// of a computation.
pub const UNREADABLE: f64 = f64::from_bits(0x7ff8_0000_6b6f_6865);

/// Marks every value of a message that is damaged.
pub const DAMAGED: f64 = f64::from_bits(0x7ff8_0000_6b6f_6866);

/// Whether a value is one of both marks.
pub fn is_unreadable(value: f64) -> bool {
    value.to_bits() == UNREADABLE.to_bits() || is_damaged(value)
}

/// Whether a value is the mark of a damaged message.
pub fn is_damaged(value: f64) -> bool {
    value.to_bits() == DAMAGED.to_bits()
}

/// The value itself, or NaN where it is infinite.
pub(super) fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { f64::NAN }
}

/// A field of a topic, with what its schema says about it (empty where it says nothing).
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct FieldInfo {
    pub path: String,
    pub unit: String,
    pub doc: String,
}

/// Fields in the order in which they first came, each once.
#[derive(Default)]
pub(in crate::log) struct Gathered {
    pub fields: Vec<FieldInfo>,
    taken: BTreeSet<(String, String)>,
}

impl Gathered {
    /// Adds those that are new. One that is there in another unit is told of; behind the first ones
    /// there is only room up to the limit: names may change from message to message without end.
    pub fn add(&mut self, more: Vec<FieldInfo>) {
        let first = self.fields.is_empty();
        for field in more {
            let room = first || self.fields.len() < MOST_FIELDS;
            if room && self.taken.insert((field.path.clone(), field.unit.clone())) {
                self.fields.push(field);
            }
        }
    }
}
