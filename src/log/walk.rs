//! The bytes of an MCAP file in; where its chunks are, and its schemas and channels, out, as far as
//! the records are sound.

use super::bytes::Bytes;
use super::file::Channel;
use std::collections::BTreeMap;

/// A stretch of the file that holds messages: from byte, to byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// The body of a chunk record.
    Chunk(usize, usize),
    /// Messages outside chunks.
    Loose(usize, usize),
}

/// Operation codes of records.
pub(super) mod op {
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const DATA_END: u8 = 0x0F;
}

/// What a walk over records has met.
#[derive(Default)]
pub(super) struct Walk {
    pub parts: Vec<Part>,
    pub schemas: BTreeMap<u16, (String, String, Vec<u8>)>,
    pub channels: BTreeMap<u16, mcap::records::Channel>,
    pub indexed: Vec<(usize, usize)>,
    /// The footer was reached.
    pub whole: bool,
    /// Where the walk stopped.
    pub end: usize,
    pub checksum: Option<(usize, u32)>,
}

impl Part {
    pub fn start(self) -> usize {
        match self {
            Part::Chunk(start, _) | Part::Loose(start, _) => start,
        }
    }
}

impl Walk {
    /// Walks top-level records from `at` until the footer or the first thing that is no complete
    /// record.
    pub fn records(&mut self, bytes: &[u8], mut at: usize) {
        let mut in_data = true;
        loop {
            self.end = at;
            let mut rest = Bytes(bytes.get(at..).unwrap_or(&[]));
            let Some((code, body)) = rest.record() else { return };
            let next = bytes.len() - rest.0.len();
            match code {
                op::CHUNK => self.parts.push(Part::Chunk(next - body.len(), next)),
                op::MESSAGE if in_data => self.loose(at, next),
                op::SCHEMA | op::CHANNEL => self.define(code, body),
                op::CHUNK_INDEX => self.index(body),
                op::DATA_END => {
                    in_data = false;
                    self.checksum = Bytes(body).u32().map(|crc| (at, crc));
                }
                op::FOOTER => {
                    self.whole = true;
                    return;
                }
                // 0 and the reserved codes are no records; codes from 0x80 are anybody's own.
                0 | 0x10..0x80 => return,
                _ => {}
            }
            at = next;
        }
    }

    fn loose(&mut self, start: usize, end: usize) {
        match self.parts.last_mut() {
            Some(Part::Loose(_, last)) => *last = end,
            _ => self.parts.push(Part::Loose(start, end)),
        }
    }

    fn index(&mut self, body: &[u8]) {
        let mut b = Bytes(body);
        if let (Some(_), Some(_), Some(at), Some(length)) = (b.u64(), b.u64(), b.u64(), b.u64()) {
            self.indexed.push((
                usize::try_from(at).unwrap_or(usize::MAX),
                usize::try_from(length).unwrap_or(usize::MAX),
            ));
        }
    }

    /// Takes up the schemas and channels among the records of a chunk.
    pub fn definitions(&mut self, records: &[u8]) {
        let mut rest = Bytes(records);
        while let Some((code, body)) = rest.record() {
            if code == op::SCHEMA || code == op::CHANNEL {
                self.define(code, body);
            }
        }
    }

    fn define(&mut self, code: u8, body: &[u8]) {
        match mcap::parse_record(code, body) {
            Ok(mcap::records::Record::Schema { header, data }) => {
                self.schemas.insert(header.id, (header.name, header.encoding, data.into_owned()));
            }
            Ok(mcap::records::Record::Channel(channel)) => {
                self.channels.insert(channel.id, channel);
            }
            _ => {}
        }
    }

    /// The channels with their schemas, by id.
    pub fn joined(&self) -> BTreeMap<u16, Channel> {
        let join = |c: &mcap::records::Channel| {
            let (schema_name, schema_encoding, schema) =
                self.schemas.get(&c.schema_id).cloned().unwrap_or_default();
            Channel {
                topic: c.topic.clone(),
                message_encoding: c.message_encoding.clone(),
                schema_name,
                schema_encoding,
                schema,
            }
        };
        self.channels.iter().map(|(&id, c)| (id, join(c))).collect()
    }
}
