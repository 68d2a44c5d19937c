//! The bytes of a log in; where its messages are, its channels, what it says of its size, and notes
//! of everything that is not as it should be, out.

use super::Note;
use super::bytes::Bytes;
use super::channel::Channel;
use super::chunk::{self, open_chunk, release};
use super::records::{Definitions, Statistics, op};
use super::walk::{Part, Walk};
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
    pub fn of(bytes: &[u8]) -> Option<Summary> {
        // Footer record: operation code, length 20, three numbers; then the closing magic.
        let at = bytes.len().checked_sub(29 + mcap::MAGIC.len())?;
        let mut b = Bytes(bytes.get(at..)?.strip_suffix(mcap::MAGIC)?);
        if b.u8()? != op::FOOTER || b.u64()? != 20 {
            return None;
        }
        let start = usize::try_from(b.u64()?).ok().filter(|&s| s > 0 && s < at)?;
        b.u64()?;
        // Covers everything from the start of the summary to the checksum itself; 0: not recorded.
        let checksum = match b.u32()? {
            0 => Checksum::None,
            crc if crc32fast::hash(bytes.get(start..at + 25)?) == crc => Checksum::Right,
            _ => Checksum::Wrong,
        };
        Some(Summary { walk: Walk::summary(bytes, start), start, checksum })
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

impl Layout {
    /// Walks the records of a file, over damage if there is any.
    pub fn of(bytes: &[u8]) -> Layout {
        let mut notes = Vec::new();
        let summary = Summary::of(bytes);
        let indexed = summary.as_ref().map_or(&[][..], |s| &s.walk.indexed);
        let mut walk = Walk::default();
        walk.records(bytes, mcap::MAGIC.len());
        let sound = summary.as_ref().is_some_and(Summary::is_sound);
        walk.resume(bytes, summary.as_ref().filter(|_| sound).map(|s| s.start), indexed);
        notes.extend(end(bytes, &walk, summary.as_ref()));
        let named: BTreeSet<usize> = indexed.iter().map(|i| i.0.saturating_add(9)).collect();
        let outside = |p: &&Part| matches!(p, Part::Chunk(start, _) if !named.contains(start));
        let outside = walk.parts.iter().filter(outside).count() as u64;
        let (added, lost) = walk.add_indexed(bytes, indexed);
        notes.extend(broken(&walk));
        if sound && !indexed.is_empty() {
            notes.extend(index(indexed.len(), outside, added, lost));
        }
        notes.extend(checksums(bytes, &walk, summary.as_ref()));
        let trusted = summary.as_ref().is_some_and(Summary::is_trusted);
        let statistics = summary.as_ref().filter(|_| sound).and_then(|s| s.walk.statistics.clone());
        let mut defined = std::mem::take(&mut walk.data);
        match summary {
            Some(summary) if trusted => defined.extend(summary.walk.data),
            _ => of_chunks(bytes, &walk, &mut defined),
        }
        Layout { parts: walk.parts, channels: defined.joined(), statistics, notes }
    }
}

/// Schemas and channels stand in the chunks as well.
fn of_chunks(bytes: &[u8], walk: &Walk, defined: &mut Definitions) {
    let mut buffer = Vec::new();
    for part in &walk.parts {
        let Part::Chunk(start, end) = *part else { continue };
        if let Ok(opened) = open_chunk(bytes.get(start..end).unwrap_or(&[]), &mut buffer) {
            defined.of_chunk(opened.records);
        }
        release(&mut buffer);
    }
}

/// What is wrong with the end of the file.
fn end(bytes: &[u8], walk: &Walk, summary: Option<&Summary>) -> Option<Note> {
    let lost = bytes.len() - walk.end;
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
fn checksums(bytes: &[u8], walk: &Walk, summary: Option<&Summary>) -> Vec<Note> {
    let mut notes = Vec::new();
    let chunk = |p: &Part| match *p {
        Part::Chunk(start, end) => bytes.get(start..end),
        Part::Loose(..) => None,
    };
    let chunks: Vec<&[u8]> = walk.parts.iter().filter_map(chunk).collect();
    let without = chunks.iter().filter(|body| chunk::lacks_checksum(body)).count();
    if without > 0 {
        let all = chunks.len();
        let text =
            format!("{without} of {all} chunks have no checksum: damage in them may not be seen");
        notes.push(Note::info("file", without as u64, text));
    }
    if summary.is_some_and(|s| s.checksum == Checksum::None) {
        let text = "the summary has no checksum: damage to names and schemas may not be seen";
        notes.push(Note::info("file", 1, text));
    }
    if walk.parts.iter().any(|p| matches!(p, Part::Loose(..))) {
        notes.extend(loose(bytes, walk.checksum));
    }
    notes
}

/// Messages outside chunks are covered by the checksum of the whole data section only.
fn loose(bytes: &[u8], checksum: Option<(usize, u32)>) -> Option<Note> {
    match checksum {
        Some((end, crc)) if crc != 0 => {
            let wrong = bytes.get(..end).is_some_and(|b| crc32fast::hash(b) != crc);
            let text = "the data section's checksum does not match: messages outside chunks may be damaged";
            wrong.then(|| Note::warning("file", 1, text))
        }
        _ => {
            let text = "messages outside chunks have no checksum: damage in them may not be seen";
            Some(Note::info("file", 1, text))
        }
    }
}
