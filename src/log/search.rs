//! A log and where its records stop in; where the next chunk, message outside chunks or summary stands, out.

use super::bytes::Bytes;
use super::chunk::{self, Buffer, open_chunk};
use super::records::{library, op, sound};
use super::series::DAY_NS;
use super::window::{Record, Window};
use crate::error::Result;
use std::collections::BTreeSet;

/// Chunks that are tried after damage and cannot be opened; more of them are not tried.
const MOST_TRIED: usize = 64;

/// What stands behind damage: where it starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Found {
    Chunk(usize),
    Message(usize),
    Summary(usize),
}

impl Found {
    pub fn start(self) -> usize {
        match self {
            Found::Chunk(at) | Found::Message(at) | Found::Summary(at) => at,
        }
    }
}

/// What a message outside chunks is known by.
pub(super) struct Loose {
    /// It stands from here on.
    pub since: usize,
    /// It is of one of these, unless there are none.
    pub channels: BTreeSet<u16>,
    /// It is no more than a day from one of these, unless there are none, ns.
    pub near: Vec<u64>,
}

/// What is known of a log before damage in it is passed over.
pub(super) struct Search {
    /// Places of chunk records by the index, as far as chunks stand there.
    chunks: BTreeSet<usize>,
    /// Where the summary section starts.
    summary: Option<usize>,
    tries: usize,
}

impl Search {
    pub fn of(
        log: &mut Window,
        summary: Option<usize>,
        indexed: &[(usize, usize)],
    ) -> Result<Search> {
        let mut chunks = BTreeSet::new();
        for &(at, _) in indexed {
            if let Some(record) = log.record(at)?
                && is_one(log, record)?
            {
                chunks.insert(at);
            }
        }
        Ok(Search { chunks, summary, tries: MOST_TRIED })
    }

    /// Whether the index names no chunk that is there.
    pub fn knows_no_chunk(&self) -> bool {
        self.chunks.is_empty()
    }

    /// The first of what stands at or behind `from`; messages only where they are asked for.
    pub fn next(
        &mut self,
        log: &mut Window,
        from: usize,
        loose: Option<Loose>,
    ) -> Result<Option<Found>> {
        let known = self.chunks.range(from..).next().copied();
        let summary = self.summary.filter(|at| *at > from);
        let end = known.or(summary).unwrap_or(log.size());
        let message = match loose {
            Some(loose) => next_message(log, &loose, end)?,
            None => None,
        };
        let chunk = self.next_chunk(log, from, message.unwrap_or(end))?;
        let named = known.map(Found::Chunk).or(summary.map(Found::Summary));
        Ok(chunk.map(Found::Chunk).or(message.map(Found::Message)).or(named))
    }

    /// The first chunk that can be opened: at `from`, whatever its operation code, or under its own up
    /// to `end`.
    fn next_chunk(&mut self, log: &mut Window, from: usize, end: usize) -> Result<Option<usize>> {
        let mut at = Some(from).filter(|at| *at < end);
        while let Some(here) = at {
            if self.opens(log, here)? {
                return Ok(at);
            }
            at = log.find(op::CHUNK, here + 1, end)?;
        }
        Ok(None)
    }

    /// Whether a chunk record starts here and can be trusted to, because it opens.
    fn opens(&mut self, log: &mut Window, at: usize) -> Result<bool> {
        let Some(record) = log.record(at)? else { return Ok(false) };
        if self.tries == 0 || !is_one(log, record)? {
            return Ok(false);
        }
        match open_chunk(log.source(), record, &mut Buffer::default()) {
            Ok(_) => Ok(true),
            Err(closed) => {
                closed.noted()?;
                self.tries -= 1;
                Ok(false)
            }
        }
    }
}

/// The first message outside chunks that can be trusted to be one, up to `end`.
fn next_message(log: &mut Window, loose: &Loose, end: usize) -> Result<Option<usize>> {
    let mut from = loose.since;
    while let Some(at) = log.find(op::MESSAGE, from, end)? {
        if is_message(log, loose, at)? {
            return Ok(Some(at));
        }
        from = at + 1;
    }
    Ok(None)
}

/// Whether a message stands here: of a channel and a time that fit, with something sound behind it. Three
/// things that fit are no accident.
fn is_message(log: &mut Window, loose: &Loose, at: usize) -> Result<bool> {
    let Some(record) = fits(log, loose, at)? else { return Ok(false) };
    Ok(match log.record(record.end)? {
        Some(next) if next.code == op::MESSAGE => fits(log, loose, record.end)?.is_some(),
        Some(_) => starts_soundly(log, record.end)?,
        None => record.end == log.size(),
    })
}

/// The message record that starts here, where its channel and time fit.
fn fits(log: &mut Window, loose: &Loose, at: usize) -> Result<Option<Record>> {
    let Some(record) = log.record(at)?.filter(|r| r.code == op::MESSAGE) else { return Ok(None) };
    let Some((channel, time)) = stamp(log.head(record)?) else { return Ok(None) };
    let is_known = loose.channels.is_empty() || loose.channels.contains(&channel);
    let is_near = |near: &u64| near.abs_diff(time) <= DAY_NS.unsigned_abs();
    let is_of_record = loose.near.is_empty() || loose.near.iter().any(is_near);
    Ok(Some(record).filter(|_| is_known && is_of_record))
}

/// Channel and log time of a message, from the first bytes of its body.
pub(super) fn stamp(body: &[u8]) -> Option<(u16, u64)> {
    let mut b = Bytes(body);
    let (channel, _, time, _) = (b.u16()?, b.u32()?, b.u64()?, b.u64()?);
    Some((channel, time))
}

/// Where another log begins, with magic and header, from byte, to byte.
pub(super) fn next_log(log: &mut Window, from: usize, to: usize) -> Result<Option<usize>> {
    let mut at = from;
    while let Some(here) = log.find(mcap::MAGIC[0], at, to)? {
        if begins(log, here)? {
            return Ok(Some(here));
        }
        at = here + 1;
    }
    Ok(None)
}

/// Whether a log begins here.
pub(super) fn begins(log: &mut Window, at: usize) -> Result<bool> {
    if !log.bytes(at, mcap::MAGIC.len())?.starts_with(mcap::MAGIC) {
        return Ok(false);
    }
    let Some(header) = log.record(at + mcap::MAGIC.len())? else { return Ok(false) };
    Ok(log.body(header)?.is_some_and(|body| library(header.code, body).is_some()))
}

/// Whether the body of a record is laid out as that of a chunk.
pub(super) fn is_one(log: &mut Window, record: Record) -> Result<bool> {
    Ok(chunk::is_one(log.head(record)?, record.length()))
}

/// Whether a record stands at this byte that is what its code says.
pub(super) fn starts_soundly(log: &mut Window, at: usize) -> Result<bool> {
    match log.record(at)? {
        Some(record) if record.code == op::CHUNK => is_one(log, record),
        Some(record) => sound(log, record),
        None => Ok(false),
    }
}
