//! An MCAP file in; its chunks (every checksum verified), schemas and channels out, with a note for
//! everything that was lost.

use super::Note;
use super::bytes::Bytes;
use super::chunk::open_chunk;
use super::walk::{Part, Walk, op};
use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

/// A channel of the file: messages of one topic in one encoding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    pub topic: String,
    /// How messages are written, for example `json`, `cdr`, `protobuf`.
    pub message_encoding: String,
    pub schema_name: String,
    /// How the schema is written, for example `jsonschema`, `ros2msg`; empty where there is none.
    pub schema_encoding: String,
    pub schema: Vec<u8>,
}

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
    /// What was found wrong with the file as a whole.
    pub notes: Vec<Note>,
}

impl LogFile {
    /// Maps the file and walks its records. A damaged or cut-off file yields its intact part and
    /// notes; a file that is empty, no MCAP, or has nothing intact is an error.
    pub fn open(path: &Path) -> Result<LogFile> {
        let mut log = LogFile::map(path)?;
        log.survey()?;
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
        let Some(start) = log.summary_start().filter(|_| log.summary_is_sound()) else {
            return Ok(None);
        };
        let mut walk = Walk::default();
        walk.records(log.bytes(), start);
        Ok((walk.whole && !walk.channels.is_empty()).then(|| walk.joined()))
    }

    /// Maps a file that begins as MCAP files do.
    fn map(path: &Path) -> Result<LogFile> {
        let failed =
            |e: std::io::Error| Error::new(format!("cannot read the log {}: {e}", path.display()));
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

    fn survey(&mut self) -> Result<()> {
        let magic = mcap::MAGIC.len();
        let mut walk = Walk::default();
        walk.records(self.bytes(), magic);
        let mut trusted = walk.whole;
        if !walk.whole {
            trusted = self.resume(&mut walk);
        } else if !self.summary_is_sound() {
            self.notes.push(Note::warning(
                "file",
                1,
                "the summary's checksum does not match: channels are taken from the chunks",
            ));
            walk.schemas.clear();
            walk.channels.clear();
            trusted = false;
        }
        self.check_loose(&walk);
        self.parts = walk.parts.clone();
        if !trusted || walk.channels.is_empty() {
            self.channels_from_chunks(&mut walk);
        }
        self.channels = walk.joined();
        if self.parts.is_empty() && self.channels.is_empty() {
            return Err(Error::new(format!(
                "the log {} holds no intact chunk and no message",
                self.path.display()
            ))
            .help("the recording was cut off before its first chunk was complete"));
        }
        Ok(())
    }

    /// The walk broke off: take what the index at the end of the file (if there is one) knows
    /// beyond that point.
    fn resume(&mut self, walk: &mut Walk) -> bool {
        let stopped = walk.end;
        let lost = self.bytes().len() - stopped;
        let Some(start) = self.summary_start() else {
            let text = format!(
                "the file is cut off: its last {lost} bytes (from byte {stopped}) are no complete record; what stands before them is used"
            );
            self.notes.push(Note::warning("file", 1, text));
            return false;
        };
        let mut summary = Walk::default();
        summary.records(self.bytes(), start);
        let size = self.bytes().len();
        let mut added = 0;
        for (at, length) in summary.indexed {
            let (body, end) = (at.saturating_add(9), at.saturating_add(length).min(size));
            match walk.parts.iter_mut().find(|p| p.start() == body) {
                Some(known) => *known = Part::Chunk(body, end),
                None if body < end => {
                    walk.parts.push(Part::Chunk(body, end));
                    added += 1;
                }
                None => {}
            }
        }
        walk.parts.sort_by_key(|p| p.start());
        let text = format!(
            "damaged at byte {stopped}: read on with the index at the end of the file ({added} more chunks)"
        );
        self.notes.push(Note::warning("file", 1, text));
        walk.schemas.extend(summary.schemas);
        walk.channels.extend(summary.channels);
        self.summary_is_sound()
    }

    fn footer(&self) -> Option<(usize, u64, u32)> {
        let bytes = self.bytes();
        // Footer record: opcode, length 20, three numbers; then the closing magic.
        let at = bytes.len().checked_sub(29 + mcap::MAGIC.len())?;
        let body = bytes.get(at..)?.strip_suffix(mcap::MAGIC)?;
        let mut b = Bytes(body);
        if b.u8()? != op::FOOTER || b.u64()? != 20 {
            return None;
        }
        let start = b.u64()?;
        b.u64()?;
        Some((at, start, b.u32()?))
    }

    fn summary_start(&self) -> Option<usize> {
        let (at, start, _) = self.footer()?;
        usize::try_from(start).ok().filter(|&s| s > 0 && s < at)
    }

    /// The summary's checksum covers everything from its start to the checksum itself; 0 means "not
    /// recorded".
    fn summary_is_sound(&self) -> bool {
        match (self.footer(), self.summary_start()) {
            (Some((at, _, crc)), Some(start)) if crc != 0 => {
                self.bytes().get(start..at + 25).is_some_and(|b| crc32fast::hash(b) == crc)
            }
            _ => true,
        }
    }

    /// Messages outside chunks are covered by the checksum of the whole data section only.
    fn check_loose(&mut self, walk: &Walk) {
        let loose = walk.parts.iter().any(|p| matches!(p, Part::Loose(..)));
        if let (true, Some((end, crc))) = (loose, walk.checksum)
            && crc != 0
            && self.bytes().get(..end).is_some_and(|b| crc32fast::hash(b) != crc)
        {
            let text = "the data section's checksum does not match: messages outside chunks may be damaged";
            self.notes.push(Note::warning("file", 1, text));
        }
    }

    fn channels_from_chunks(&self, walk: &mut Walk) {
        let mut buffer = Vec::new();
        for part in 0..self.parts.len() {
            if let Ok(records) = self.records(part, &mut buffer) {
                walk.definitions(records);
            }
        }
    }

    /// The records of one part, decompressed and verified, or what is wrong with it.
    fn records<'a>(
        &'a self,
        part: usize,
        buffer: &'a mut Vec<u8>,
    ) -> std::result::Result<&'a [u8], String> {
        match self.parts.get(part) {
            None => Ok(&[]),
            Some(&Part::Loose(start, end)) => Ok(self.bytes().get(start..end).unwrap_or(&[])),
            Some(&Part::Chunk(start, end)) => {
                open_chunk(self.bytes().get(start..end).unwrap_or(&[]), buffer)
            }
        }
    }

    /// Calls `each` for every message of one part, in file order. `buffer` is scratch. A damaged
    /// chunk yields nothing but the reason.
    pub fn messages(
        &self,
        part: usize,
        buffer: &mut Vec<u8>,
        mut each: impl FnMut(Message),
    ) -> std::result::Result<(), String> {
        let mut rest = Bytes(self.records(part, buffer)?);
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
        if rest.0.is_empty() || matches!(self.parts.get(part), Some(Part::Loose(..))) {
            Ok(())
        } else {
            Err(format!("{} bytes at its end are no record", rest.0.len()))
        }
    }

    /// Where in the file a part starts, for messages to people.
    pub fn offset(&self, part: usize) -> usize {
        self.parts.get(part).map_or(0, |p| p.start())
    }
}
