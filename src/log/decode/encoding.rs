//! What an encoding is: a channel and paths of fields in, readers of its messages out.

use crate::log::channel::Channel;
use serde::Serialize;

/// How messages of one encoding are read.
pub struct Encoding {
    /// The channel's message encoding, as MCAP's registry spells it.
    pub message: &'static str,
    /// The schema encodings that go with it; an empty string is a channel without schema.
    pub schemas: &'static [&'static str],
    /// The numeric fields of a topic, from its channel's schema and one of its messages (which may
    /// be missing). The places of lists are numbers, or `*` where their length is not known.
    pub fields: fn(&Channel, message: Option<&[u8]>) -> Vec<FieldInfo>,
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
/// number there. A message that is not what its schema says is `UNREADABLE` as a whole.
pub type Reader = Box<dyn FnMut(&[u8], &mut [f64])>;

/// Of a longer list only so many items are listed one by one as fields; every one can be read.
pub(super) const MOST_ITEMS: u64 = 64;

/// No more fields of one topic are listed; every one can be read.
pub(super) const MOST_FIELDS: usize = 10_000;

/// Marks a value that could not be read: a NaN with a payload of its own, never the result of a
/// computation.
pub const UNREADABLE: f64 = f64::from_bits(0x7ff8_0000_6b6f_6865);

/// Whether a value is the `UNREADABLE` mark.
pub fn is_unreadable(value: f64) -> bool {
    value.to_bits() == UNREADABLE.to_bits()
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
