//! A log in; where its messages are, its channels, what it says of its size, and notes
//! of everything that is not as it should be, out.

use super::Note;
use super::bytes::Bytes;
use super::channel::Channel;
use super::chunk::{Buffer, open_chunk};
use super::records::{Definitions, Statistics, op};
use super::source::Source;
use super::walk::{Part, Walk};
use super::window::{Record, Window};
use crate::error::Result;
use std::collections::{BTreeMap, BTreeSet};

/// What is where in a log.
pub(super) struct Layout {
    /// In file order.
    pub parts: Vec<Part>,
    /// By channel id.
    pub channels: BTreeMap<u16, Channel>,
    pub statistics: Option<Statistics>,
    pub notes: Vec<Note>,
}

/// The summary section, with the footer behind it.
pub(super) struct Summary {
    pub walk: Walk,
    start: usize,
    checksum: Checksum,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Checksum {
    None,
    Right,
    Wrong,
}

impl Summary {
    /// None where the file has no footer at its end, or one that tells of no summary.
    pub fn of(log: &mut Window) -> Result<Option<Summary>> {
        // Footer record: operation code, length 20, three numbers; then the closing magic.
        let Some(at) = log.size().checked_sub(29 + mcap::MAGIC.len()) else { return Ok(None) };
        let Some((start, crc)) = footer(log.bytes(at, 29 + mcap::MAGIC.len())?) else {
            return Ok(None);
        };
        if start == 0 || start >= at {
            return Ok(None);
        }
        // Covers everything from the start of the summary to the checksum itself; 0: not recorded.
        let checksum = match crc {
            0 => Checksum::None,
            crc if log.source().checksum(start, at + 25)? == crc => Checksum::Right,
            _ => Checksum::Wrong,
        };
        Ok(Some(Summary { walk: Walk::summary(log, start)?, start, checksum }))
    }

    /// Whether it is as it was written, as far as can be seen, and names channels.
    pub fn is_trusted(&self) -> bool {
        self.is_sound() && !self.walk.data.is_empty()
    }

    fn is_sound(&self) -> bool {
        let intact = self.walk.whole && self.walk.damage.is_empty();
        intact && self.checksum != Checksum::Wrong
    }
}

/// Where the summary starts and its checksum, from a footer with the closing magic.
fn footer(bytes: &[u8]) -> Option<(usize, u32)> {
    let mut b = Bytes(bytes.strip_suffix(mcap::MAGIC)?);
    let (code, length) = (b.u8()?, b.u64()?);
    let (start, _) = (usize::try_from(b.u64()?).ok()?, b.u64()?);
    let crc = b.u32()?;
    (code == op::FOOTER && length == 20).then_some((start, crc))
}

impl Layout {
    /// Walks the records of a file, over damage if there is any.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn of(source: &Source) -> Result<Layout> {
        let log = &mut Window::of(source);
        let mut notes = Vec::new();
        let summary = Summary::of(log)?;
        let indexed = summary.as_ref().map_or(&[][..], |s| &s.walk.indexed);
        let mut walk = Walk::default();
        walk.records(log, mcap::MAGIC.len())?;
        let sound = summary.as_ref().is_some_and(Summary::is_sound);
        walk.resume(log, summary.as_ref().filter(|_| sound).map(|s| s.start), indexed)?;
        notes.extend(end(log.size(), &walk, summary.as_ref()));
        let named: BTreeSet<usize> = indexed.iter().map(|i| i.0.saturating_add(9)).collect();
        let outside = |p: &&Part| matches!(p, Part::Chunk(chunk) if !named.contains(&chunk.start));
        let outside = walk.parts.iter().filter(outside).count() as u64;
        let (added, lost) = walk.add_indexed(log, indexed)?;
        notes.extend(broken(&walk));
        if sound && !indexed.is_empty() {
            notes.extend(index(indexed.len(), outside, added, lost));
        }
        notes.extend(checksums(source, &walk, summary.as_ref())?);
        let met = walk.imported.drain(..).map(|text| format!("at its import: {text}"));
        notes.extend(met.map(|text| Note::warning("file", 1, text)));
        let trusted = summary.as_ref().is_some_and(Summary::is_trusted);
        let statistics = summary.as_ref().filter(|_| sound).and_then(|s| s.walk.statistics.clone());
        let mut defined = std::mem::take(&mut walk.data);
        match summary {
            Some(summary) if trusted => defined.extend(summary.walk.data),
            _ => of_chunks(source, walk.chunks(), &mut defined)?,
        }
        Ok(Layout { parts: walk.parts, channels: defined.joined(), statistics, notes })
    }
}

/// Schemas and channels stand in the chunks as well.
fn of_chunks(
    log: &Source,
    chunks: impl Iterator<Item = Record>,
    defined: &mut Definitions,
) -> Result<()> {
    let mut buffer = Buffer::default();
    for chunk in chunks {
        match open_chunk(log, chunk, &mut buffer) {
            Ok(opened) => defined.of_chunk(opened.records),
            Err(closed) => drop(closed.noted()?),
        }
        buffer.release();
    }
    Ok(())
}

/// What is wrong with the end of the file.
fn end(size: usize, walk: &Walk, summary: Option<&Summary>) -> Option<Note> {
    let lost = size - walk.end;
    let text = match summary {
        Some(s) if s.checksum == Checksum::Wrong => {
            "the summary's checksum does not match: channels are taken from the chunks".to_string()
        }
        Some(s) if !s.is_sound() => {
            "the summary is damaged: channels are taken from the chunks".to_string()
        }
        None if !walk.whole => format!(
            "the file is cut off: its last {lost} bytes (from byte {}) are no complete record; what stands before them is used",
            walk.end
        ),
        // Footer and magic take 37 bytes.
        None if lost > 37 => {
            format!("{} bytes behind the end of the log are not read", lost - 37)
        }
        _ => return None,
    };
    Some(Note::warning("file", 1, text))
}

/// Stretches that are no records.
fn broken(walk: &Walk) -> Vec<Note> {
    let mut notes = Vec::new();
    if let Some((from, to)) = walk.damage.first() {
        let text = format!(
            "{} stretches of the file are no records, the first from byte {from} to {to}: read on behind them",
            walk.damage.len()
        );
        notes.push(Note::warning("file", walk.damage.len() as u64, text));
    }
    if walk.renamed > 0 {
        let text = format!(
            "{} chunks stand under the code of another record; they are read",
            walk.renamed
        );
        notes.push(Note::warning("file", walk.renamed, text));
    }
    notes
}

/// The chunks that were found, against the index at the end of the file.
fn index(named: usize, outside: u64, added: u64, lost: u64) -> Vec<Note> {
    let texts = [
        (lost, format!("{lost} of {named} chunks that the index names are not there")),
        (added, format!("{added} of {named} chunks are found by the index alone; they are read")),
        (outside, format!("{outside} chunks are not in the index; they are read")),
    ];
    texts
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, text)| Note::warning("file", count, text))
        .collect()
}

/// Checksums that are not there or do not match.
fn checksums(log: &Source, walk: &Walk, summary: Option<&Summary>) -> Result<Vec<Note>> {
    let mut notes = Vec::new();
    if walk.unchecked > 0 {
        let (without, all) = (walk.unchecked, walk.chunks().count());
        let text =
            format!("{without} of {all} chunks have no checksum: damage in them may not be seen");
        notes.push(Note::info("file", without, text));
    }
    if summary.is_some_and(|s| s.checksum == Checksum::None) {
        let text = "the summary has no checksum: damage to names and schemas may not be seen";
        notes.push(Note::info("file", 1, text));
    }
    if walk.parts.iter().any(|p| matches!(p, Part::Loose(..))) {
        notes.extend(loose(log, walk.checksum)?);
    }
    Ok(notes)
}

/// Messages outside chunks are covered by the checksum of the whole data section only.
fn loose(log: &Source, checksum: Option<(usize, u32)>) -> Result<Option<Note>> {
    Ok(match checksum {
        Some((end, crc)) if crc != 0 => {
            let wrong = log.checksum(0, end)? != crc;
            let text = "the data section's checksum does not match: messages outside chunks may be damaged";
            wrong.then(|| Note::warning("file", 1, text))
        }
        _ => {
            let text = "messages outside chunks have no checksum: damage in them may not be seen";
            Some(Note::info("file", 1, text))
        }
    })
}
