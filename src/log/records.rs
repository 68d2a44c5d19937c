//! MCAP records in; whether they are what they say, schemas, channels and
//! statistics out.

use super::bytes::{Bytes, parse_string};
use super::channel::Channel;
use super::window::{Record, Window};
use crate::error::Result;
use std::collections::{BTreeMap, BTreeSet};

/// Operation codes of records.
pub(super) mod op {
    pub const HEADER: u8 = 0x01;
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const MESSAGE_INDEX: u8 = 0x07;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const STATISTICS: u8 = 0x0B;
    pub const METADATA: u8 = 0x0C;
    pub const SUMMARY_OFFSET: u8 = 0x0E;
    pub const DATA_END: u8 = 0x0F;
}

/// Whether a record (but for a chunk) is laid out as its code says.
pub(super) fn sound(log: &mut Window, record: Record) -> Result<bool> {
    let length = record.length();
    Ok(match record.code {
        op::FOOTER => {
            length == 20 && log.bytes(record.end, mcap::MAGIC.len())?.starts_with(mcap::MAGIC)
        }
        op::SCHEMA | op::CHANNEL => {
            let of = |body: &[u8]| {
                schema(record.code, body).is_some() || channel(record.code, body).is_some()
            };
            log.body(record)?.is_some_and(of)
        }
        op::MESSAGE => length >= 22,
        op::MESSAGE_INDEX => {
            let mut b = Bytes(log.head(record)?);
            b.u16().and_then(|_| b.u32()).is_some_and(|n| n as usize == length - 6)
        }
        op::DATA_END => length == 4,
        // 0 and the reserved codes are no records; codes from 0x80 are anybody's own.
        op::HEADER..=op::SUMMARY_OFFSET => record.code != op::CHUNK,
        code => code >= 0x80,
    })
}

/// Schemas and channels, by id.
#[derive(Default)]
pub(super) struct Definitions {
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, Defined>,
}

/// Name, encoding and text of a schema.
type Schema = (String, String, Vec<u8>);

/// A channel as its record has it.
struct Defined {
    schema: u16,
    topic: String,
    encoding: String,
}

/// Id and content of a schema record. The lengths in it are held against its own before anything is
/// copied: one that lies takes no memory.
fn schema(code: u8, body: &[u8]) -> Option<(u16, Schema)> {
    let mut b = Bytes(body);
    let id = b.u16().filter(|_| code == op::SCHEMA)?;
    let (name, encoding) = (parse_string(&mut b)?, parse_string(&mut b)?);
    let length = b.u32()? as usize;
    Some((id, (name.into(), encoding.into(), b.take(length)?.to_vec())))
}

/// Likewise of a channel record.
fn channel(code: u8, body: &[u8]) -> Option<(u16, Defined)> {
    let mut b = Bytes(body);
    let id = b.u16().filter(|_| code == op::CHANNEL)?;
    let schema = b.u16()?;
    let (topic, encoding) = (parse_string(&mut b)?, parse_string(&mut b)?);
    let length = b.u32()? as usize;
    let mut metadata = Bytes(b.take(length)?);
    while !metadata.0.is_empty() {
        // A name and a value.
        parse_string(&mut metadata)?;
        parse_string(&mut metadata)?;
    }
    Some((id, Defined { schema, topic: topic.into(), encoding: encoding.into() }))
}

/// The program that a header record names.
pub(super) fn library(code: u8, body: &[u8]) -> Option<&str> {
    let mut b = Bytes(body);
    let _profile = parse_string(&mut b).filter(|_| code == op::HEADER)?;
    parse_string(&mut b)
}

/// The name of the metadata record in which an import says what it met: values are its notes.
pub(super) const IMPORTED: &str = "koehler import";

/// The notes of an import that a metadata record holds; none of others.
pub(super) fn imported(body: &[u8]) -> Vec<String> {
    let mut b = Bytes(body);
    if parse_string(&mut b) != Some(IMPORTED) {
        return Vec::new();
    }
    let Some(length) = b.u32() else { return Vec::new() };
    let mut pairs = Bytes(b.take(length as usize).unwrap_or(&[]));
    let mut notes = Vec::new();
    while let (Some(_), Some(note)) = (parse_string(&mut pairs), parse_string(&mut pairs)) {
        notes.push(note.to_string());
    }
    notes
}

impl Definitions {
    /// Takes up a record if it is one of a schema or a channel.
    pub fn define(&mut self, code: u8, body: &[u8]) {
        self.schemas.extend(schema(code, body));
        self.channels.extend(channel(code, body));
    }

    /// Takes up the schemas and channels among the records of a chunk.
    pub fn of_chunk(&mut self, records: &[u8]) {
        let mut rest = Bytes(records);
        while let Some((code, body)) = rest.record() {
            if code == op::SCHEMA || code == op::CHANNEL {
                self.define(code, body);
            }
        }
    }

    /// Takes up others; theirs count where both have one.
    pub fn extend(&mut self, others: Definitions) {
        self.schemas.extend(others.schemas);
        self.channels.extend(others.channels);
    }

    /// Ids of the channels.
    pub fn ids(&self) -> BTreeSet<u16> {
        self.channels.keys().copied().collect()
    }

    pub fn is_empty(&self) -> bool {
        self.channels.is_empty()
    }

    /// The channels with their schemas, by id.
    pub fn joined(&self) -> BTreeMap<u16, Channel> {
        let join = |c: &Defined| {
            let (schema_name, schema_encoding, schema) =
                self.schemas.get(&c.schema).cloned().unwrap_or_default();
            Channel {
                topic: c.topic.clone(),
                message_encoding: c.encoding.clone(),
                schema_name,
                schema_encoding,
                schema,
            }
        };
        self.channels.iter().map(|(&id, c)| (id, join(c))).collect()
    }
}

/// What a log says of its own size.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Statistics {
    /// Messages by channel id.
    pub messages: BTreeMap<u16, u64>,
}

/// Bytes of a statistics record before the counts by channel, and of one of these.
const STATISTICS_HEAD: usize = 46;
const STATISTICS_COUNT: usize = 10;

impl Statistics {
    /// Those of a record whose length is that of its counts, of which there are some: such a record is none
    /// by accident.
    pub fn surely(body: &[u8]) -> Option<Statistics> {
        let statistics = Statistics::parse(body)?;
        let length = STATISTICS_HEAD + STATISTICS_COUNT * statistics.messages.len();
        (!statistics.messages.is_empty() && body.len() == length).then_some(statistics)
    }

    pub fn parse(body: &[u8]) -> Option<Statistics> {
        let mut b = Bytes(body);
        let total = b.u64()?;
        // Counts of schemas, channels, attachments, metadata and chunks, first and last log time.
        b.take(2 + 4 * 4 + 2 * 8)?;
        let length = usize::try_from(b.u32()?).ok()?;
        let mut counts = Bytes(b.take(length)?);
        let mut messages = BTreeMap::new();
        while let (Some(channel), Some(n)) = (counts.u16(), counts.u64()) {
            messages.insert(channel, n);
        }
        // A recorder need not count by channel.
        let sum = messages.values().try_fold(0u64, |sum, n| sum.checked_add(*n));
        (sum == Some(total)).then_some(Statistics { messages })
    }
}
