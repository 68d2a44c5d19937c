//! An MCAP file in; its chunks (every checksum verified), schemas and channels out, with a note for
//! everything that was lost.

use super::Note;
use super::bytes::Bytes;
use super::channel::Channel;
use super::chunk::{Buffer, Closed, open_chunk};
use super::counts::Counts;
use super::layout::Layout;
use super::records::{Statistics, op};
use super::source::Source;
use super::summary::Summary;
use super::walk::Part;
use super::window::Window;
use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// One message of an intact chunk.
#[derive(Debug, Clone, Copy)]
pub struct Message<'a> {
    pub channel: u16,
    /// When the recorder received it, ns.
    pub log_time: u64,
    /// When the sender sent it, ns.
    pub publish_time: u64,
    pub data: &'a [u8],
}

/// What the header of a log names as the program that wrote it; none where there is no sound header.
/// Reads nothing else of the file.
///
/// # Errors
/// The file cannot be read, is empty or is no MCAP.
pub fn writer(path: &Path) -> Result<Option<String>> {
    let log = LogFile::begin(path)?;
    let mut window = Window::of(&log.source);
    let Some(record) = window.record(mcap::MAGIC.len())? else { return Ok(None) };
    let Some(body) = window.body(record)? else { return Ok(None) };
    Ok(super::records::library(record.code, body).map(str::to_string))
}

/// A log file and where its parts are. Where another program changes it while it is open, what
/// cannot be read any more is an error, and what reads differently is damage.
pub struct LogFile {
    source: Source,
    pub path: PathBuf,
    /// By channel id.
    pub channels: BTreeMap<u16, Channel>,
    /// The chunks, in file order, and at last (if any) the stretch of messages
    /// outside chunks.
    parts: Vec<Part>,
    /// What the log says of its size.
    statistics: Option<Statistics>,
    /// What was found wrong with the file as a whole.
    pub notes: Vec<Note>,
    /// Messages of channels that it does not name, once they were counted.
    unnamed: OnceLock<u64>,
}

impl LogFile {
    /// Opens the file and walks its records. A damaged or cut-off file yields its intact part and
    /// notes; a file that is empty, no MCAP, or has nothing intact is an error.
    pub fn open(path: &Path) -> Result<LogFile> {
        let mut log = LogFile::begin(path)?;
        let Layout { parts, channels, statistics, notes } = Layout::of(&log.source)?;
        if parts.is_empty() && channels.is_empty() {
            return Err(Error::new(format!(
                "the log {} holds no intact chunk and no message",
                path.display()
            ))
            .help("the recording was cut off before its first chunk was complete"));
        }
        (log.parts, log.channels, log.statistics, log.notes) = (parts, channels, statistics, notes);
        Ok(log)
    }

    /// The channels that the summary section at the end of a log names, with their schemas, by id;
    /// none where the log has no summary, one that names no channel, or a damaged one. Reads
    /// nothing else of the file.
    ///
    /// # Errors
    /// The file cannot be read, is empty or is no MCAP.
    pub fn summary(path: &Path) -> Result<Option<BTreeMap<u16, Channel>>> {
        let log = LogFile::begin(path)?;
        let summary = Summary::ending(&mut Window::of(&log.source), log.source.size())?;
        Ok(summary.filter(Summary::is_trusted).map(|s| s.walk.data.joined()))
    }

    /// Opens a file that begins as MCAP files do.
    fn begin(path: &Path) -> Result<LogFile> {
        let source = Source::open(path)?;
        if !Window::of(&source).bytes(0, mcap::MAGIC.len())?.starts_with(mcap::MAGIC) {
            return Err(Error::new(format!(
                "{} is not an MCAP file (its first 8 bytes are not the MCAP magic)",
                path.display()
            ))
            .help("`koehler import` brings columns of text into MCAP"));
        }
        Ok(LogFile {
            source,
            path: path.to_path_buf(),
            channels: BTreeMap::new(),
            parts: Vec::new(),
            statistics: None,
            notes: Vec::new(),
            unnamed: OnceLock::new(),
        })
    }

    /// The file's name, as it appears in messages to people.
    pub fn name(&self) -> String {
        self.path
            .file_name()
            .map_or_else(|| self.path.display().to_string(), |n| n.to_string_lossy().into_owned())
    }

    /// Number of parts (chunks, and the messages outside chunks together as one).
    pub fn parts(&self) -> usize {
        self.parts.len()
    }

    /// Calls `each` for every message of one part, in file order. `buffer` is scratch. A damaged
    /// chunk yields nothing but the reason, which is returned.
    ///
    /// # Errors
    /// The part cannot be read any more.
    pub fn messages(
        &self,
        part: usize,
        buffer: &mut Buffer,
        mut each: impl FnMut(Message),
    ) -> Result<Option<String>> {
        let read = match self.parts.get(part) {
            None => Ok(()),
            Some(&Part::Loose(start, end)) => self.loose(start, end, &mut each),
            Some(&Part::Chunk(chunk)) => open_chunk(&self.source, chunk, buffer)
                .and_then(|opened| each_message(opened.records, &mut each)),
        };
        buffer.release();
        read.map_or_else(Closed::noted, |()| Ok(None))
    }

    /// Calls `each` for every message outside chunks in a stretch of the file.
    fn loose(
        &self,
        start: usize,
        end: usize,
        each: &mut impl FnMut(Message),
    ) -> std::result::Result<(), Closed> {
        let (mut log, mut at, mut large) = (Window::of(&self.source), start, 0u64);
        while at < end
            && let Some(record) = log.record(at)?
        {
            if record.code == op::MESSAGE {
                match log.body(record)? {
                    Some(body) => message(body, each),
                    None => large += 1,
                }
            }
            at = record.end;
        }
        match large {
            0 => Ok(()),
            n => Err(format!(
                "{n} messages outside chunks are larger than [ingest] chunk_memory_mib"
            )
            .into()),
        }
    }

    /// How many messages are of channels that the log does not name: by its own count, where that tells of
    /// channels; else the log is read, once.
    ///
    /// # Errors
    /// The log cannot be read any more.
    pub fn unnamed(&self) -> Result<u64> {
        if let Some(told) = self.statistics.as_ref().filter(|s| !s.messages.is_empty()) {
            let unnamed = told.messages.iter().filter(|(id, _)| !self.channels.contains_key(id));
            return Ok(unnamed.map(|(_, count)| count).sum());
        }
        if let Some(count) = self.unnamed.get() {
            return Ok(*count);
        }
        let (mut buffer, mut count) = (Buffer::default(), 0);
        for part in 0..self.parts() {
            self.messages(part, &mut buffer, |m| {
                count += u64::from(!self.channels.contains_key(&m.channel));
            })?;
        }
        Ok(*self.unnamed.get_or_init(|| count))
    }

    /// Says where the messages that were read are not as many as the log counts.
    pub fn counted(&self, read: &Counts) -> Vec<Note> {
        read.against(self.statistics.as_ref(), &self.channels)
    }

    /// Where in the file a part starts, for messages to people.
    pub fn offset(&self, part: usize) -> usize {
        self.parts.get(part).map_or(0, |p| p.start())
    }
}

/// Calls `each` for every message among the records of a chunk.
fn each_message(records: &[u8], each: &mut impl FnMut(Message)) -> std::result::Result<(), Closed> {
    let mut rest = Bytes(records);
    while let Some((code, body)) = rest.record() {
        if code == op::MESSAGE {
            message(body, each);
        }
    }
    match rest.0.len() {
        0 => Ok(()),
        left => Err(format!("{left} bytes at its end are no record").into()),
    }
}

/// Calls `each` for the message of a record.
fn message(body: &[u8], each: &mut impl FnMut(Message)) {
    let mut b = Bytes(body);
    if let (Some(channel), Some(_), Some(log_time), Some(publish_time)) =
        (b.u16(), b.u32(), b.u64(), b.u64())
    {
        each(Message { channel, log_time, publish_time, data: b.0 });
    }
}
