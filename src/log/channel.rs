//! What a log says of one channel: its topic, how its messages are written, its schema.

/// A channel of the file: messages of one topic in one encoding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    pub topic: String,
    /// How messages are written, for example `json`, `cdr`, `protobuf`.
    pub message_encoding: String,
    pub schema_name: String,
    /// How the schema is written, for example `jsonschema`, `ros2msg`; empty where there is none.
    pub schema_encoding: String,
    pub schema: Vec<u8>,
}
