//! A channel's encoding in, the decoder for it out: the one visible list of what can be decoded.
//!
//! A new encoding is one file or folder beside `json.rs` and one line in `ENCODINGS`.

mod cdr;
mod encoding;
mod json;
mod paths;
mod protobuf;

use super::channel::Channel;

pub(super) use encoding::Gathered;
pub use encoding::{Encoding, FieldInfo, Prepared, Reader, UNREADABLE, is_damaged, is_unreadable};
pub(super) use paths::rest_of;

/// Everything that can be decoded.
const ENCODINGS: &[Encoding] = &[json::ENCODING, protobuf::ENCODING, cdr::ENCODING];

/// The decoder for a channel, if there is one.
pub fn encoding_of(channel: &Channel) -> Option<&'static Encoding> {
    ENCODINGS.iter().find(|e| {
        e.message == channel.message_encoding
            && e.schemas.contains(&channel.schema_encoding.as_str())
    })
}

/// Makes ready to read fields of a channel; none where its encoding cannot be decoded.
///
/// # Errors
/// In words: what is wrong with the schema.
pub fn prepare(channel: &Channel, paths: &[String]) -> Option<Result<Prepared, String>> {
    encoding_of(channel).map(|encoding| (encoding.prepare)(channel, paths))
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
