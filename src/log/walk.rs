//! The bytes of an MCAP file in; where its chunks are, and its schemas and channels, out, as far as
//! the records are sound.
//!
//! Nothing is believed by its operation code alone: a chunk is what is laid out as one, a footer
//! counts only in front of the closing magic. After damage the walk goes on at the next record that
//! is sound, at the next chunk that can be opened, or at the summary.

use super::bytes::Bytes;
use super::chunk::{self, open_chunk};
use super::records::{Definitions, Statistics, op, sound};
use std::collections::BTreeSet;

/// A stretch of the file that holds messages: from byte, to byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// The body of a chunk record.
    Chunk(usize, usize),
    /// Messages outside chunks.
    Loose(usize, usize),
}

impl Part {
    pub fn start(self) -> usize {
        match self {
            Part::Chunk(start, _) | Part::Loose(start, _) => start,
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
    /// The footer was reached.
    pub whole: bool,
    /// Where the walk stopped.
    pub end: usize,
    pub checksum: Option<(usize, u32)>,
    /// What follows is read by itself.
    in_summary: bool,
    /// Where the run of sound records began.
    begun: usize,
}

/// Chunks that are tried after damage and cannot be opened; more of them are not tried.
const MOST_TRIED: usize = 64;

impl Walk {
    /// Walks top-level records from `at` until the footer or the first thing that is no record.
    pub fn records(&mut self, bytes: &[u8], mut at: usize) {
        self.begun = at;
        loop {
            self.end = at;
            let mut rest = Bytes(bytes.get(at..).unwrap_or(&[]));
            let Some((code, body)) = rest.record() else { return };
            let next = bytes.len() - rest.0.len();
            if code == op::FOOTER && sound(code, body, rest.0) {
                self.whole = true;
                return;
            }
            let is_chunk = code == op::CHUNK || chunk::is_one(body);
            if !sound(code, body, rest.0) && !is_chunk {
                // Its length may be right all the same.
                if code == op::FOOTER || !starts_soundly(rest.0) {
                    return;
                }
                self.damage.push((at, next));
            } else if is_chunk {
                if !chunk::is_one(body) && !starts_soundly(rest.0) {
                    return;
                }
                self.renamed += u64::from(code != op::CHUNK);
                self.parts.push(Part::Chunk(next - body.len(), next));
            } else {
                self.take(code, body, at, next);
            }
            at = next;
        }
    }

    fn take(&mut self, code: u8, body: &[u8], at: usize, next: usize) {
        match code {
            op::MESSAGE if !self.in_summary => match self.parts.last_mut() {
                Some(Part::Loose(start, last)) if *start >= self.begun => *last = next,
                _ => self.parts.push(Part::Loose(at, next)),
            },
            op::SCHEMA | op::CHANNEL if !self.in_summary => self.data.define(code, body),
            op::CHUNK_INDEX => self.index(body),
            op::STATISTICS => self.statistics = Statistics::parse(body),
            op::DATA_END => {
                self.in_summary = true;
                self.checksum = Bytes(body).u32().map(|crc| (at, crc));
            }
            _ => {}
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

    /// Walks the summary section.
    pub fn summary(bytes: &[u8], start: usize) -> Walk {
        let mut walk = Walk::default();
        walk.records(bytes, start);
        walk
    }

    /// Goes on behind damage as often as it must; `summary` is where the summary section starts, if
    /// that is known, `indexed` are places of chunk records by its index.
    pub fn resume(&mut self, bytes: &[u8], summary: Option<usize>, indexed: &[(usize, usize)]) {
        let mut tries = MOST_TRIED;
        let chunks = |(at, _): &(usize, usize)| opens(bytes, *at, true, &mut 0).then_some(*at);
        let known: BTreeSet<usize> =
            if self.whole { BTreeSet::new() } else { indexed.iter().filter_map(chunks).collect() };
        while !self.whole {
            let from = self.end;
            let known = known.range(from..).next().copied();
            let end = known.or(summary).unwrap_or(bytes.len());
            let like = |at: &usize| *at == from || bytes.get(*at) == Some(&op::CHUNK);
            let found =
                (from..end).filter(like).find(|&at| opens(bytes, at, false, &mut tries)).or(known);
            let Some(at) = found.or(summary.filter(|s| *s > from)) else { return };
            if at > from {
                self.damage.push((from, at));
            }
            match found {
                Some(at) => self.chunk_at(bytes, at),
                None => {
                    self.in_summary = true;
                    self.records(bytes, at);
                }
            }
            if self.end == from {
                return;
            }
        }
    }

    /// Takes up a chunk, whatever its operation code, and goes on behind it.
    fn chunk_at(&mut self, bytes: &[u8], at: usize) {
        let Some((code, body)) = Bytes(bytes.get(at..).unwrap_or(&[])).record() else { return };
        let start = at + 9;
        self.renamed += u64::from(code != op::CHUNK);
        self.parts.push(Part::Chunk(start, start + body.len()));
        self.records(bytes, start + body.len());
    }

    /// Takes up the chunks of the index that the walk has not met; how many there were, and how many
    /// the index names that are no chunks.
    pub fn add_indexed(&mut self, bytes: &[u8], indexed: &[(usize, usize)]) -> (u64, u64) {
        let (mut added, mut lost) = (0, 0);
        let mut met: BTreeSet<usize> = self.parts.iter().map(|p| p.start()).collect();
        for &(at, length) in indexed {
            let (start, end) = (at.saturating_add(9), at.saturating_add(length));
            if !met.insert(start) {
                continue;
            }
            match bytes.get(start..end).filter(|body| chunk::is_one(body)) {
                Some(_) => {
                    self.parts.push(Part::Chunk(start, end));
                    added += 1;
                }
                None => lost += 1,
            }
        }
        self.parts.sort_by_key(|p| p.start());
        (added, lost)
    }
}

/// Whether a chunk record starts here and can be trusted to: by the index, or because it opens.
fn opens(bytes: &[u8], at: usize, known: bool, tries: &mut usize) -> bool {
    let Some((_, body)) = Bytes(bytes.get(at..).unwrap_or(&[])).record() else { return false };
    if !chunk::is_one(body) {
        return false;
    }
    if known {
        return true;
    }
    if *tries == 0 {
        return false;
    }
    let opened = open_chunk(body, &mut Vec::new()).is_ok();
    *tries -= usize::from(!opened);
    opened
}

/// Whether a record stands at the start of these bytes that is what its code says.
fn starts_soundly(bytes: &[u8]) -> bool {
    let mut rest = Bytes(bytes);
    rest.record().is_some_and(|(code, body)| {
        if code == op::CHUNK { chunk::is_one(body) } else { sound(code, body, rest.0) }
    })
}
