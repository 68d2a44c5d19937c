//! An MCAP file in; its chunks (every checksum verified), schemas and channels out, with a note for
//! everything that was lost.

use super::Note;
use super::bytes::Bytes;
use super::channel::Channel;
use super::chunk::{open_chunk, release};
use super::counts::Counts;
use super::layout::{Layout, Summary};
use super::records::{Statistics, op};
use super::walk::Part;
use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

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
    let log = LogFile::map(path)?;
    let mut bytes = Bytes(log.bytes().get(mcap::MAGIC.len()..).unwrap_or(&[]));
    let mut header = || {
        let (code, length) = (bytes.u8()?, bytes.u64()?);
        let body = bytes.0.get(..usize::try_from(length).ok()?)?;
        match mcap::parse_record(code, body).ok()? {
            mcap::records::Record::Header(header) => Some(header.library),
            _ => None,
        }
    };
    Ok(header())
}

/// A mapped log file and where its parts are. The file must not be changed by others while it is
/// open.
pub struct LogFile {
    map: Option<memmap2::Mmap>,
    pub path: PathBuf,
    /// By channel id.
    pub channels: BTreeMap<u16, Channel>,
    /// Bodies of the chunk records, in file order, and at last (if any) the stretch of messages
    /// outside chunks.
    parts: Vec<Part>,
    /// What the log says of its size.
    statistics: Option<Statistics>,
    /// What was found wrong with the file as a whole.
    pub notes: Vec<Note>,
}

impl LogFile {
    /// Maps the file and walks its records. A damaged or cut-off file yields its intact part and
    /// notes; a file that is empty, no MCAP, or has nothing intact is an error.
    pub fn open(path: &Path) -> Result<LogFile> {
        let mut log = LogFile::map(path)?;
        let Layout { parts, channels, statistics, notes } = Layout::of(log.bytes());
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
        let log = LogFile::map(path)?;
        Ok(Summary::of(log.bytes()).filter(Summary::is_trusted).map(|s| s.walk.data.joined()))
    }

    /// Maps a file that begins as MCAP files do.
    fn map(path: &Path) -> Result<LogFile> {
        let failed =
            |e: std::io::Error| Error::new(format!("cannot read the log {}: {e}", path.display()));
        // A pipe would be waited for: what a path leads to is asked before it is opened.
        let about = std::fs::metadata(path).map_err(failed)?;
        if !about.is_file() {
            let what = if about.is_dir() { "a folder" } else { "a pipe or a device, no file" };
            return Err(Error::new(format!("the log {} is {what}", path.display()))
                .help("take it out of the campaign, or name a file"));
        }
        let file = File::open(path).map_err(failed)?;
        let size = file.metadata().map_err(failed)?.len();
        if size == 0 {
            return Err(Error::new(format!("the log {} is empty (0 bytes)", path.display()))
                .help("the recorder did not write anything: copy the file again, or take it out of the campaign"));
        }
        // The mapping is only read, and the file is documented to stay as it is while it is open.
        let map = unsafe { memmap2::Mmap::map(&file) }.map_err(failed)?;
        let log = LogFile {
            map: Some(map),
            path: path.to_path_buf(),
            channels: BTreeMap::new(),
            parts: Vec::new(),
            statistics: None,
            notes: Vec::new(),
        };
        if !log.bytes().starts_with(mcap::MAGIC) {
            return Err(Error::new(format!(
                "{} is not an MCAP file (its first 8 bytes are not the MCAP magic)",
                path.display()
            ))
            .help("`koehler import` brings columns of text into MCAP"));
        }
        Ok(log)
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

    fn bytes(&self) -> &[u8] {
        self.map.as_deref().unwrap_or(&[])
    }

    /// Calls `each` for every message of one part, in file order. `buffer` is scratch. A damaged
    /// chunk yields nothing but the reason.
    pub fn messages(
        &self,
        part: usize,
        buffer: &mut Vec<u8>,
        mut each: impl FnMut(Message),
    ) -> std::result::Result<(), String> {
        let bytes = |start, end| self.bytes().get(start..end).unwrap_or(&[]);
        let read = match self.parts.get(part) {
            None => Ok(()),
            Some(&Part::Loose(start, end)) => {
                each_message(bytes(start, end), &mut each);
                Ok(())
            }
            Some(&Part::Chunk(start, end)) => {
                open_chunk(bytes(start, end), buffer).and_then(|opened| {
                    match each_message(opened.records, &mut each) {
                        0 => Ok(()),
                        left => Err(format!("{left} bytes at its end are no record")),
                    }
                })
            }
        };
        release(buffer);
        read
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

/// Calls `each` for every message among records; how many bytes at the end are no record.
fn each_message(records: &[u8], each: &mut impl FnMut(Message)) -> usize {
    let mut rest = Bytes(records);
    while let Some((code, body)) = rest.record() {
        let mut b = Bytes(body);
        if code != op::MESSAGE {
            continue;
        }
        if let (Some(channel), Some(_), Some(log_time), Some(publish_time)) =
            (b.u16(), b.u32(), b.u64(), b.u64())
        {
            each(Message { channel, log_time, publish_time, data: b.0 });
        }
    }
    rest.0.len()
}
