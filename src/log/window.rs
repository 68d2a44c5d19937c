//! A log in; its records, and as much of their bodies as is asked for, out, by way of a stretch of
//! the file that is kept for the many small reads of a walk.

use super::bytes::Bytes;
use super::memory::CHUNKS;
use super::source::{STRETCH, Source};
use crate::error::Result;

/// The bytes at the start of a body that tell what it is; the head of a chunk is shorter.
pub(super) const HEAD: usize = 64;

/// A record: its operation code and where its body is, from byte, to byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Record {
    pub code: u8,
    pub start: usize,
    pub end: usize,
}

impl Record {
    /// Bytes of the body.
    pub fn length(self) -> usize {
        self.end - self.start
    }
}

/// A log and the stretch of it that is at hand.
pub(super) struct Window<'a> {
    source: &'a Source,
    start: usize,
    bytes: Vec<u8>,
}

impl<'a> Window<'a> {
    pub fn of(source: &'a Source) -> Window<'a> {
        Window { source, start: 0, bytes: Vec::new() }
    }

    /// The log that this looks at.
    pub fn source(&self) -> &'a Source {
        self.source
    }

    /// Bytes of the file.
    pub fn size(&self) -> usize {
        self.source.size()
    }

    /// `n` bytes from `at` on, or as many as the file has.
    pub fn bytes(&mut self, at: usize, n: usize) -> Result<&[u8]> {
        let n = n.min(self.size().saturating_sub(at));
        if n == 0 {
            return Ok(&[]);
        }
        if at < self.start || at + n > self.start + self.bytes.len() {
            self.fill(at, n)?;
        }
        let from = at - self.start;
        Ok(self.bytes.get(from..from + n).unwrap_or(&[]))
    }

    fn fill(&mut self, at: usize, n: usize) -> Result<()> {
        if self.bytes.len() > STRETCH {
            self.bytes = Vec::new();
        }
        self.start = at;
        self.bytes.resize(n.max(STRETCH).min(self.size() - at), 0);
        self.source.read(at, &mut self.bytes).inspect_err(|_| self.bytes.clear())
    }

    /// The record that starts at a byte; none where the file is too short for it.
    pub fn record(&mut self, at: usize) -> Result<Option<Record>> {
        let size = self.size();
        let mut head = Bytes(self.bytes(at, 9)?);
        let (Some(code), Some(length)) = (head.u8(), head.u64()) else { return Ok(None) };
        let start = at + 9;
        let end = usize::try_from(length).ok().and_then(|n| start.checked_add(n));
        Ok(end.filter(|end| *end <= size).map(|end| Record { code, start, end }))
    }

    /// The first bytes of a body.
    pub fn head(&mut self, record: Record) -> Result<&[u8]> {
        self.bytes(record.start, HEAD.min(record.length()))
    }

    /// A whole body; none where it is more than chunks may take.
    pub fn body(&mut self, record: Record) -> Result<Option<&[u8]>> {
        if !CHUNKS.has_room_for(record.length() as u64) {
            return Ok(None);
        }
        self.bytes(record.start, record.length()).map(Some)
    }

    /// Where a byte of this value stands first, from byte, to byte.
    pub fn find(&mut self, value: u8, mut from: usize, to: usize) -> Result<Option<usize>> {
        while from < to {
            if self.bytes(from, 1)?.is_empty() {
                return Ok(None);
            }
            // All that is at hand: asking for more would read the file again for every hit.
            let bytes = self.bytes.get(from - self.start..).unwrap_or(&[]);
            let bytes = bytes.get(..to - from).unwrap_or(bytes);
            match bytes.iter().position(|b| *b == value) {
                Some(i) => return Ok(Some(from + i)),
                None => from += bytes.len(),
            }
        }
        Ok(None)
    }
}
