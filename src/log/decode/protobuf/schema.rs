//! The descriptors of a schema in; its messages by name, and what a field is, out.

use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet};
use std::collections::BTreeMap;

/// The messages of a schema.
pub(super) struct Schema {
    /// By full name, without a dot in front.
    messages: BTreeMap<String, MessageType>,
}

/// A message type.
pub(super) struct MessageType {
    pub fields: Vec<Field>,
}

/// A field of a message type.
pub(super) struct Field {
    pub name: String,
    pub number: u32,
    pub kind: Kind,
    pub repeated: bool,
    /// What it is where a message does not have it; none where it then is not there.
    pub absent: Option<f64>,
    pub doc: String,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Kind {
    Number(Number),
    /// By full name.
    Message(String),
    /// Texts, bytes, groups.
    Other,
}

/// How a number is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    Double,
    Float,
    /// Two's complement of 64 bits, also for smaller integers and enumerations.
    Signed,
    Unsigned,
    /// Zigzag: 0, -1, 1, -2, ...
    Zigzag,
    Bool,
    Fixed32,
    Fixed64,
    Sfixed32,
    Sfixed64,
}

impl Schema {
    /// Reads a `FileDescriptorSet`.
    ///
    /// # Errors
    /// In words: the bytes are none.
    pub fn parse(bytes: &[u8]) -> Result<Schema, String> {
        let set = FileDescriptorSet::decode(bytes)
            .map_err(|e| format!("the schema is no FileDescriptorSet: {e}"))?;
        let mut messages = BTreeMap::new();
        for file in &set.file {
            let comments = comments(file);
            for (i, message) in file.message_type.iter().enumerate() {
                let within = file.package.as_deref().unwrap_or_default();
                let place = [4, i as i32];
                let mut reader = Reading { file, comments: &comments, messages: &mut messages };
                reader.message(message, within, &place);
            }
        }
        Ok(Schema { messages })
    }

    pub fn message(&self, name: &str) -> Option<&MessageType> {
        self.messages.get(name)
    }
}

/// The comments of a file, by the place of what they are about.
fn comments(file: &FileDescriptorProto) -> BTreeMap<&[i32], String> {
    let told = file.source_code_info.iter().flat_map(|info| &info.location);
    let text = |l: &prost_types::source_code_info::Location| {
        let text = l.leading_comments.as_deref().or(l.trailing_comments.as_deref())?;
        Some(text.split_whitespace().collect::<Vec<_>>().join(" "))
    };
    told.filter_map(|l| Some((&l.path[..], text(l)?))).collect()
}

struct Reading<'a> {
    file: &'a FileDescriptorProto,
    comments: &'a BTreeMap<&'a [i32], String>,
    messages: &'a mut BTreeMap<String, MessageType>,
}

impl Reading<'_> {
    fn message(&mut self, message: &DescriptorProto, within: &str, place: &[i32]) {
        let dot = if within.is_empty() { "" } else { "." };
        let name = format!("{within}{dot}{}", message.name());
        let fields = message.field.iter().enumerate().filter_map(|(i, f)| {
            let doc = self.comments.get(&[place, &[2, i as i32]].concat()[..]);
            self.field(f, doc.cloned().unwrap_or_default())
        });
        let fields = fields.collect();
        for (i, inner) in message.nested_type.iter().enumerate() {
            self.message(inner, &name, &[place, &[3, i as i32]].concat());
        }
        self.messages.insert(name, MessageType { fields });
    }

    fn field(&self, field: &FieldDescriptorProto, doc: String) -> Option<Field> {
        let kind = match field.r#type() {
            Type::Double => Kind::Number(Number::Double),
            Type::Float => Kind::Number(Number::Float),
            Type::Int32 | Type::Int64 | Type::Enum => Kind::Number(Number::Signed),
            Type::Uint32 | Type::Uint64 => Kind::Number(Number::Unsigned),
            Type::Sint32 | Type::Sint64 => Kind::Number(Number::Zigzag),
            Type::Bool => Kind::Number(Number::Bool),
            Type::Fixed32 => Kind::Number(Number::Fixed32),
            Type::Fixed64 => Kind::Number(Number::Fixed64),
            Type::Sfixed32 => Kind::Number(Number::Sfixed32),
            Type::Sfixed64 => Kind::Number(Number::Sfixed64),
            Type::Message => Kind::Message(field.type_name().trim_start_matches('.').to_string()),
            Type::String | Type::Bytes | Type::Group => Kind::Other,
        };
        Some(Field {
            name: field.name().to_string(),
            number: u32::try_from(field.number()).ok()?,
            kind,
            repeated: field.label() == Label::Repeated,
            absent: self.absent(field),
            doc,
        })
    }

    fn absent(&self, field: &FieldDescriptorProto) -> Option<f64> {
        let presence = field.oneof_index.is_some() || field.proto3_optional();
        if self.file.syntax() == "proto3" && !presence {
            return Some(0.0);
        }
        match field.default_value.as_deref()? {
            "true" => Some(1.0),
            "false" => Some(0.0),
            number => number.parse().ok().map(crate::log::decode::encoding::finite),
        }
    }
}
