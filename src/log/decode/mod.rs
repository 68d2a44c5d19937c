//! A channel's encoding in, the decoder for it out: the one visible list of what can be decoded.
//!
//! A new encoding is one file beside `json.rs` and one line in `ENCODINGS`.

pub mod json;

use super::file::Channel;

/// Everything that can be decoded.
pub const ENCODINGS: &[Encoding] = &[json::ENCODING];

/// How messages of one encoding are read.
pub struct Encoding {
    /// The channel's message encoding, as MCAP's registry spells it.
    pub message: &'static str,
    /// The schema encodings that go with it; an empty string is a channel without schema.
    pub schemas: &'static [&'static str],
    /// The numeric fields of a topic, from its schema and one of its messages (either may be
    /// missing).
    pub fields: fn(schema: &[u8], message: Option<&[u8]>) -> Vec<FieldInfo>,
    /// A reader of the fields at the given paths (no path twice).
    pub reader: fn(schema: &[u8], paths: &[String]) -> Result<Reader, String>,
}

/// Reads one message: one value per path. Every value is overwritten: a number, NaN where the
/// message says so (NaN, infinite, null), or `UNREADABLE` where the message has no such field or no
/// number there.
pub type Reader = Box<dyn FnMut(&[u8], &mut [f64])>;

/// Marks a value that could not be read: a NaN with a payload of its own, never the result of a
/// computation.
pub const UNREADABLE: f64 = f64::from_bits(0x7ff8_0000_6b6f_6865);

/// Whether a value is the `UNREADABLE` mark.
pub fn is_unreadable(value: f64) -> bool {
    value.to_bits() == UNREADABLE.to_bits()
}

/// A field of a topic, with what its schema says about it (empty where it says nothing).
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FieldInfo {
    pub path: String,
    pub unit: String,
    pub doc: String,
}

/// The decoder for a channel, if there is one.
pub fn encoding_of(channel: &Channel) -> Option<&'static Encoding> {
    ENCODINGS.iter().find(|e| {
        e.message == channel.message_encoding
            && e.schemas.contains(&channel.schema_encoding.as_str())
    })
}

/// What can be decoded, in words.
pub fn supported() -> String {
    let one = |e: &Encoding| {
        let schemas: Vec<&str> =
            e.schemas.iter().map(|s| if s.is_empty() { "none" } else { s }).collect();
        format!("{} (schema {})", e.message, schemas.join(" or "))
    };
    ENCODINGS.iter().map(one).collect::<Vec<_>>().join(", ")
}
