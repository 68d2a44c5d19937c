//! A channel in; the types of its messages out, whichever language their definition is written in.

use super::types::Types;
use super::{ros2idl, ros2msg};
use crate::log::channel::Channel;

/// # Errors
/// In words: what is wrong with the definition.
pub(super) fn types(channel: &Channel) -> Result<Types, String> {
    let text = std::str::from_utf8(&channel.schema)
        .map_err(|e| format!("byte {} of the schema is no text", e.valid_up_to()))?;
    if channel.schema_encoding == "ros2idl" {
        let root = channel.schema_name.replace('/', "::");
        return Types::link(&ros2idl::parse(text)?, &root);
    }
    let declared = ros2msg::parse(text, &channel.schema_name)?;
    Types::link(&declared, &ros2msg::short(&channel.schema_name))
}
