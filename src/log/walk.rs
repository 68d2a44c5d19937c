//! An MCAP file in; where its chunks are, and its schemas and channels, out, as far as the records
//! are sound.
//!
//! Nothing is believed by its operation code alone: a chunk is what is laid out as one, a footer
//! counts only in front of the closing magic, and ends the log only where no data follow. After damage the
//! walk goes on at the next record that is sound, at the next chunk that can be opened, at the next message
//! where there are messages outside chunks, or at the summary.

use super::bytes::Bytes;
use super::chunk;
use super::records::{Definitions, Statistics, imported, op, sound};
use super::search::{Found, Loose, Search, begins, is_one, next_log, stamp, starts_soundly};
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
    /// Where another log begins behind this one.
    pub second: Option<usize>,
    /// Where the walk stopped.
    pub end: usize,
    pub checksum: Option<(usize, u32)>,
    /// What the import that wrote the file met.
    pub imported: Vec<String>,
    /// What follows is read by itself.
    in_summary: bool,
    /// Where the run of sound records began.
    begun: usize,
    /// The record before the one where the walk stopped, if it is a message outside chunks.
    message: Option<usize>,
    /// Log times of the first and the last of those.
    times: Option<(u64, u64)>,
    /// The walk stopped at a footer with its magic, behind which the file goes on.
    ended: bool,
}

impl Walk {
    /// Walks top-level records from `at` until the footer or the first thing that is no record.
    pub fn records(&mut self, log: &mut Window, mut at: usize) -> Result<()> {
        (self.begun, self.ended, self.message) = (at, false, None);
        loop {
            self.end = at;
            let Some(record) = log.record(at)? else { return Ok(()) };
            let (code, next) = (record.code, record.end);
            let (is_sound, is_one) = (sound(log, record)?, is_one(log, record)?);
            if code == op::FOOTER && is_sound {
                return self.footer(log, next + mcap::MAGIC.len());
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
            let is_loose = code == op::MESSAGE && is_sound && !is_chunk && !self.in_summary;
            self.message = is_loose.then_some(at);
            at = next;
        }
    }

    /// At a footer, with what stands behind its magic: it is the end of the log where nothing does, or
    /// where another log does.
    fn footer(&mut self, log: &mut Window, behind: usize) -> Result<()> {
        self.second = begins(log, behind)?.then_some(behind);
        self.whole = behind == log.size() || self.second.is_some();
        self.ended = !self.whole;
        Ok(())
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
            op::MESSAGE if !self.in_summary => {
                if let Some((_, time)) = stamp(log.head(record)?) {
                    self.times = Some((self.times.map_or(time, |times| times.0), time));
                }
                match self.parts.last_mut() {
                    Some(Part::Loose(start, last)) if *start >= self.begun => *last = next,
                    _ => self.parts.push(Part::Loose(at, next)),
                }
            }
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
        walk.whole |= walk.ended;
        Ok(walk)
    }

    /// Goes on behind damage as often as it must; `summary` is where the summary section starts, if
    /// that is known, and what it defines, `indexed` are places of chunk records by its index.
    pub fn resume(
        &mut self,
        log: &mut Window,
        summary: Option<(usize, &Definitions)>,
        indexed: &[(usize, usize)],
    ) -> Result<()> {
        if self.whole {
            return Ok(());
        }
        let mut search = Search::of(log, summary.map(|s| s.0), indexed)?;
        while !self.whole {
            let loose = self.loose(summary.map(|s| s.1), search.knows_no_chunk());
            let from = self.end;
            let Some(found) = search.next(log, from, loose)? else { break };
            self.second = next_log(log, from, found.start())?;
            if self.second.is_some() {
                return Ok(());
            }
            self.go_on(log, found)?;
            if self.end == from && found.start() >= from {
                break;
            }
        }
        // data do not follow: it was the end
        self.whole |= self.ended;
        Ok(())
    }

    /// What the next message outside chunks is known by, where such messages stood before the damage, or
    /// nothing did.
    fn loose(&self, summary: Option<&Definitions>, no_chunk: bool) -> Option<Loose> {
        let is_loose = match self.parts.last() {
            Some(part) => matches!(part, Part::Loose(..)),
            None => no_chunk,
        };
        let mut channels = self.data.ids();
        channels.extend(summary.map(Definitions::ids).unwrap_or_default());
        // a message that is longer than it should be holds the next ones
        let since = self.message.map_or(self.end, |at| at + 1);
        let near = self.times.map(|(first, last)| vec![first, last]).unwrap_or_default();
        is_loose.then_some(Loose { since, channels, near })
    }

    /// Takes up what was found behind damage.
    fn go_on(&mut self, log: &mut Window, found: Found) -> Result<()> {
        let (mut from, at) = (self.end, found.start());
        if let Some(before) = self.message.filter(|_| at < from) {
            self.cut(before);
            from = before;
        }
        if at > from {
            self.damage.push((from, at));
        }
        match found {
            Found::Chunk(at) => self.chunk_at(log, at),
            Found::Message(at) => {
                self.in_summary = false;
                self.records(log, at)
            }
            Found::Summary(at) => {
                self.in_summary = true;
                self.records(log, at)
            }
        }
    }

    /// Leaves out the last message outside chunks, which stands here: others stand in it.
    fn cut(&mut self, at: usize) {
        match self.parts.last_mut() {
            Some(Part::Loose(start, _)) if *start == at => drop(self.parts.pop()),
            Some(Part::Loose(_, end)) => *end = at,
            _ => {}
        }
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
        self.in_summary = false;
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
