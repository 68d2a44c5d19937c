//! An MCAP file in; where its chunks are, and its schemas and channels, out, as far as the records
//! are sound.
//!
//! Nothing is believed by its operation code alone: a chunk is what is laid out as one, a footer
//! counts only in front of the closing magic. After damage the walk goes on at the next record that
//! is sound, at the next chunk that can be opened, or at the summary.

use super::bytes::Bytes;
use super::chunk::{self, Buffer, open_chunk};
use super::records::{Definitions, Statistics, imported, op, sound};
use super::window::{Record, Window};
use crate::error::Result;
use std::collections::BTreeSet;

/// A stretch of the file that holds messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// A chunk.
    Chunk(Record),
    /// Messages outside chunks: from byte, to byte.
    Loose(usize, usize),
}

impl Part {
    pub fn start(self) -> usize {
        match self {
            Part::Chunk(Record { start, .. }) | Part::Loose(start, _) => start,
        }
    }
}

/// What a walk over records has met.
#[derive(Default)]
pub(super) struct Walk {
    pub parts: Vec<Part>,
    pub data: Definitions,
    /// Where chunk records are by the index.
    pub indexed: Vec<(usize, usize)>,
    pub statistics: Option<Statistics>,
    /// Stretches that are no records: from byte, to byte.
    pub damage: Vec<(usize, usize)>,
    /// Chunks that stand under another operation code.
    pub renamed: u64,
    /// Chunks without a checksum.
    pub unchecked: u64,
    /// The footer was reached.
    pub whole: bool,
    /// Where the walk stopped.
    pub end: usize,
    pub checksum: Option<(usize, u32)>,
    /// What the import that wrote the file met.
    pub imported: Vec<String>,
    /// What follows is read by itself.
    in_summary: bool,
    /// Where the run of sound records began.
    begun: usize,
}

/// Chunks that are tried after damage and cannot be opened; more of them are not tried.
const MOST_TRIED: usize = 64;

impl Walk {
    /// Walks top-level records from `at` until the footer or the first thing that is no record.
    pub fn records(&mut self, log: &mut Window, mut at: usize) -> Result<()> {
        self.begun = at;
        loop {
            self.end = at;
            let Some(record) = log.record(at)? else { return Ok(()) };
            let (code, next) = (record.code, record.end);
            let (is_sound, is_one) = (sound(log, record)?, is_one(log, record)?);
            if code == op::FOOTER && is_sound {
                self.whole = true;
                return Ok(());
            }
            let is_chunk = code == op::CHUNK || is_one;
            if !is_sound && !is_chunk {
                // Its length may be right all the same.
                if code == op::FOOTER || !starts_soundly(log, next)? {
                    return Ok(());
                }
                self.damage.push((at, next));
            } else if is_chunk {
                if !is_one && !starts_soundly(log, next)? {
                    return Ok(());
                }
                self.take_chunk(log, record)?;
            } else {
                self.take(log, record, at)?;
            }
            at = next;
        }
    }

    fn take_chunk(&mut self, log: &mut Window, record: Record) -> Result<()> {
        self.renamed += u64::from(record.code != op::CHUNK);
        self.unchecked += u64::from(chunk::lacks_checksum(log.head(record)?));
        self.parts.push(Part::Chunk(record));
        Ok(())
    }

    fn take(&mut self, log: &mut Window, record: Record, at: usize) -> Result<()> {
        let (code, next) = (record.code, record.end);
        match code {
            op::MESSAGE if !self.in_summary => match self.parts.last_mut() {
                Some(Part::Loose(start, last)) if *start >= self.begun => *last = next,
                _ => self.parts.push(Part::Loose(at, next)),
            },
            op::SCHEMA | op::CHANNEL if !self.in_summary => {
                self.data.define(code, log.body(record)?.unwrap_or(&[]));
            }
            op::METADATA => self.imported.extend(imported(log.body(record)?.unwrap_or(&[]))),
            op::CHUNK_INDEX => self.index(log.head(record)?),
            op::STATISTICS => self.statistics = log.body(record)?.and_then(Statistics::parse),
            op::DATA_END => {
                self.in_summary = true;
                self.checksum = Bytes(log.head(record)?).u32().map(|crc| (at, crc));
            }
            _ => {}
        }
        Ok(())
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

    /// Walks the summary section.
    pub fn summary(log: &mut Window, start: usize) -> Result<Walk> {
        let mut walk = Walk::default();
        walk.records(log, start)?;
        Ok(walk)
    }

    /// Goes on behind damage as often as it must; `summary` is where the summary section starts, if
    /// that is known, `indexed` are places of chunk records by its index.
    pub fn resume(
        &mut self,
        log: &mut Window,
        summary: Option<usize>,
        indexed: &[(usize, usize)],
    ) -> Result<()> {
        let mut tries = MOST_TRIED;
        let known = if self.whole { BTreeSet::new() } else { chunks(log, indexed)? };
        while !self.whole {
            let from = self.end;
            let known = known.range(from..).next().copied();
            let end = known.or(summary).unwrap_or(log.size());
            let found = next_chunk(log, from, end, &mut tries)?.or(known);
            let Some(at) = found.or(summary.filter(|s| *s > from)) else { return Ok(()) };
            if at > from {
                self.damage.push((from, at));
            }
            match found {
                Some(at) => self.chunk_at(log, at)?,
                None => {
                    self.in_summary = true;
                    self.records(log, at)?;
                }
            }
            if self.end == from {
                return Ok(());
            }
        }
        Ok(())
    }

    /// The chunks among the parts.
    pub fn chunks(&self) -> impl Iterator<Item = Record> + '_ {
        self.parts.iter().filter_map(|part| match *part {
            Part::Chunk(chunk) => Some(chunk),
            Part::Loose(..) => None,
        })
    }

    /// Takes up a chunk, whatever its operation code, and goes on behind it.
    fn chunk_at(&mut self, log: &mut Window, at: usize) -> Result<()> {
        let Some(record) = log.record(at)? else { return Ok(()) };
        self.take_chunk(log, record)?;
        self.records(log, record.end)
    }

    /// Takes up the chunks of the index that the walk has not met; how many there were, and how many
    /// the index names that are no chunks.
    pub fn add_indexed(
        &mut self,
        log: &mut Window,
        indexed: &[(usize, usize)],
    ) -> Result<(u64, u64)> {
        let (mut added, mut lost) = (0, 0);
        let mut met: BTreeSet<usize> = self.parts.iter().map(|p| p.start()).collect();
        for &(at, length) in indexed {
            let (start, end) = (at.saturating_add(9), at.saturating_add(length));
            if !met.insert(start) {
                continue;
            }
            let record = Record { code: op::CHUNK, start, end };
            if start <= end && end <= log.size() && is_one(log, record)? {
                self.take_chunk(log, record)?;
                added += 1;
            } else {
                lost += 1;
            }
        }
        self.parts.sort_by_key(|p| p.start());
        Ok((added, lost))
    }
}

/// Which places of the index are those of chunks.
fn chunks(log: &mut Window, indexed: &[(usize, usize)]) -> Result<BTreeSet<usize>> {
    let mut known = BTreeSet::new();
    for &(at, _) in indexed {
        if let Some(record) = log.record(at)?
            && is_one(log, record)?
        {
            known.insert(at);
        }
    }
    Ok(known)
}

/// The first chunk that can be opened: at `from`, whatever its operation code, or under its own up
/// to `end`.
fn next_chunk(
    log: &mut Window,
    from: usize,
    end: usize,
    tries: &mut usize,
) -> Result<Option<usize>> {
    let mut at = Some(from).filter(|at| *at < end);
    while let Some(here) = at {
        if opens(log, here, tries)? {
            return Ok(at);
        }
        at = log.find(op::CHUNK, here + 1, end)?;
    }
    Ok(None)
}

/// Whether a chunk record starts here and can be trusted to, because it opens.
fn opens(log: &mut Window, at: usize, tries: &mut usize) -> Result<bool> {
    let Some(record) = log.record(at)? else { return Ok(false) };
    if *tries == 0 || !is_one(log, record)? {
        return Ok(false);
    }
    match open_chunk(log.source(), record, &mut Buffer::default()) {
        Ok(_) => Ok(true),
        Err(closed) => {
            closed.noted()?;
            *tries -= 1;
            Ok(false)
        }
    }
}

fn is_one(log: &mut Window, record: Record) -> Result<bool> {
    Ok(chunk::is_one(log.head(record)?, record.length()))
}

/// Whether a record stands at this byte that is what its code says.
fn starts_soundly(log: &mut Window, at: usize) -> Result<bool> {
    match log.record(at)? {
        Some(record) if record.code == op::CHUNK => is_one(log, record),
        Some(record) => sound(log, record),
        None => Ok(false),
    }
}
