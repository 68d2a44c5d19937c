//! A log in; where its messages are, its channels, what it says of its size, and notes
//! of everything that is not as it should be, out.

use super::Note;
use super::channel::Channel;
use super::chunk::{Buffer, open_chunk};
use super::records::{Definitions, Statistics, op};
use super::source::Source;
use super::summary::{Checksum, FARTHEST, FOOTER, Summary};
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

impl Layout {
    /// Walks the records of a file, over damage if there is any.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn of(source: &Source) -> Result<Layout> {
        let log = &mut Window::of(source);
        let mut notes = Vec::new();
        let mut walk = Walk::default();
        walk.records(log, mcap::MAGIC.len())?;
        let mut summary = Summary::ending(log, ending(log.size(), &walk))?;
        let known = summary.as_ref().filter(|s| s.is_sound()).map(|s| (s.start, &s.walk.data));
        walk.resume(log, known, summary.as_ref().map_or(&[], |s| &s.walk.indexed))?;
        let end = ending(log.size(), &walk);
        if end < log.size() {
            summary = Summary::ending(log, end)?;
        }
        let indexed = summary.as_ref().map_or(&[][..], |s| &s.walk.indexed);
        let sound = summary.as_ref().is_some_and(Summary::is_sound);
        let statistics = match summary.as_ref().filter(|_| sound) {
            Some(summary) => summary.walk.statistics.clone(),
            None => counted(log, &walk, end)?,
        };
        notes.extend(at_end(end, &walk, summary.as_ref()));
        notes.extend(behind(log, &walk, end)?);
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
        let is_lost = !walk.whole || summary.as_ref().is_some_and(|s| !s.is_sound());
        let trusted = summary.as_ref().is_some_and(Summary::is_trusted);
        let mut defined = std::mem::take(&mut walk.data);
        match summary {
            Some(summary) if trusted => defined.extend(summary.walk.data),
            _ => of_chunks(source, walk.chunks(), &mut defined)?,
        }
        let channels = defined.joined();
        // what is not of a sound summary counts where its channels are those that are there
        let known = |s: &Statistics| s.messages.keys().all(|id| channels.contains_key(id));
        let fits = |s: &Statistics| sound || (!s.messages.is_empty() && known(s));
        let statistics = statistics.filter(fits);
        notes.extend(statistics.is_none().then(|| uncounted(is_lost)));
        Ok(Layout { parts: walk.parts, channels, statistics, notes })
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

/// Where the log ends.
fn ending(size: usize, walk: &Walk) -> usize {
    match walk.second {
        Some(second) => second,
        None if walk.whole => (walk.end + FOOTER).min(size),
        None => size,
    }
}

/// What a log counts itself, where its summary is not sound: the record may be, wherever it stands.
fn counted(log: &mut Window, walk: &Walk, end: usize) -> Result<Option<Statistics>> {
    let mut from = end.saturating_sub(FARTHEST);
    while let Some(here) = log.find(op::STATISTICS, from, end)? {
        from = here + 1;
        let Some(record) = log.record(here)?.filter(|r| r.length() <= MOST_COUNTED) else {
            continue;
        };
        if let Some(found) = log.body(record)?.and_then(Statistics::surely) {
            return Ok(Some(found));
        }
    }
    Ok(walk.statistics.clone())
}

/// Bytes of a statistics record with counts of every channel that there may be.
const MOST_COUNTED: usize = 1 << 20;

/// What is wrong with the end of the log.
fn at_end(end: usize, walk: &Walk, summary: Option<&Summary>) -> Option<Note> {
    let lost = end - walk.end.min(end);
    let text = match summary {
        Some(s) if s.checksum == Checksum::Wrong => {
            "the summary's checksum does not match: channels are taken from the chunks".to_string()
        }
        Some(s) if !s.is_sound() => {
            "the summary is damaged: channels are taken from the chunks".to_string()
        }
        Some(s) if s.is_moved => format!(
            "the summary stands at byte {}, not where the footer says: bytes in front of it were lost or added",
            s.start
        ),
        None if !walk.whole => format!(
            "the file is cut off: its last {lost} bytes (from byte {}) are no complete record; what stands before them is used",
            walk.end
        ),
        _ => return None,
    };
    Some(Note::warning("file", 1, text))
}

/// A log that has lost its own count of its messages, or never had one by channel. The text is the same for all
/// logs, so that those of a campaign are one line with their number.
fn uncounted(is_lost: bool) -> Note {
    let what = match is_lost {
        true => "the log's own count of its messages is lost",
        false => "the log has no count of its messages by channel",
    };
    let text = format!("{what}: whether all that were recorded are there cannot be told");
    Note::warning("file", 1, text)
}

/// What stands behind the end of the log. Another log is more than a warning: what was recorded in it is
/// not there.
fn behind(log: &mut Window, walk: &Walk, end: usize) -> Result<Option<Note>> {
    let bytes = log.size() - end;
    let Some(second) = walk.second else {
        let text = format!("{bytes} bytes behind the end of the log are not read");
        return Ok((bytes > 0).then(|| Note::warning("file", 1, text)));
    };
    let mut other = Walk::default();
    other.records(log, second + mcap::MAGIC.len())?;
    let messages = other.statistics.map_or(0, |s| s.messages.values().sum::<u64>());
    let of = match (messages, other.parts.len()) {
        (0, chunks) => format!("{chunks} chunks, as far as it is sound"),
        (messages, _) => format!("{messages} messages"),
    };
    let text = format!(
        "another log begins at byte {second}, behind the first: its {bytes} bytes ({of}) are not read; make a file of each (`tail -c +{}` gives the second)",
        second + 1
    );
    Ok(Some(Note::missing("file", messages.max(1), text)))
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

/// What is to be done about checksums that are not there.
const UNSEEN: &str = "may not be seen; have the recorder write checksums (CRC)";

/// Checksums that are not there or do not match. That damage cannot be seen is a warning: a log without them
/// looks as sound as one with them.
fn checksums(log: &Source, walk: &Walk, summary: Option<&Summary>) -> Result<Vec<Note>> {
    let mut notes = Vec::new();
    if walk.unchecked > 0 {
        let (without, all) = (walk.unchecked, walk.chunks().count());
        let text = format!("{without} of {all} chunks have no checksum: damage in them {UNSEEN}");
        notes.push(Note::warning("file", without, text));
    }
    if summary.is_some_and(|s| s.checksum == Checksum::None) {
        let text = format!("the summary has no checksum: damage to names and schemas {UNSEEN}");
        notes.push(Note::warning("file", 1, text));
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
            let text = format!("messages outside chunks have no checksum: damage in them {UNSEEN}");
            Some(Note::warning("file", 1, text))
        }
    })
}
