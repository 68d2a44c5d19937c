//! Where the body of a chunk record is in; its records, decompressed and verified, out.

use super::bytes::{Bytes, parse_string};
use super::memory::{CHUNKS, Taken};
use super::source::Source;
use super::window::{HEAD, Record};
use crate::error::Error;
use std::io::Read;
use zstd::bulk::Decompressor;

/// A buffer that has become larger is given back after use.
const KEPT: usize = 16 << 20;

/// Scratch for chunks, one after the other: as they stand in the file, and decompressed.
#[derive(Default)]
pub struct Buffer {
    packed: Vec<u8>,
    records: Vec<u8>,
    /// Made for the first chunk that needs it: its tables are large to ask for every time.
    zstd: Option<Decompressor<'static>>,
}

impl Buffer {
    /// Gives back what is large.
    pub(super) fn release(&mut self) {
        for bytes in [&mut self.packed, &mut self.records] {
            if bytes.capacity() > KEPT {
                *bytes = Vec::new();
            }
        }
    }
}

/// The records of a chunk, and the memory that they take.
pub(super) struct Opened<'a> {
    pub records: &'a [u8],
    _taken: Taken<'static>,
}

/// Why a chunk cannot be opened.
pub(super) enum Closed {
    /// It is damaged, or too large; in words.
    Damaged(String),
    /// The file cannot be read.
    Unread(Error),
}

impl Closed {
    /// Damage as something to be noted, anything else as an error.
    pub fn noted(self) -> Result<Option<String>, Error> {
        match self {
            Closed::Damaged(why) => Ok(Some(why)),
            Closed::Unread(e) => Err(e),
        }
    }
}

impl From<String> for Closed {
    fn from(why: String) -> Closed {
        Closed::Damaged(why)
    }
}

impl From<&str> for Closed {
    fn from(why: &str) -> Closed {
        Closed::Damaged(why.to_string())
    }
}

impl From<Error> for Closed {
    fn from(e: Error) -> Closed {
        Closed::Unread(e)
    }
}

/// The head of a chunk.
struct Head<'a> {
    size: u64,
    crc: u32,
    compression: &'a str,
    packed_size: u64,
    /// Its own bytes.
    length: usize,
}

/// The head at the start of a body.
fn head(bytes: &[u8]) -> Option<Head<'_>> {
    let mut b = Bytes(bytes);
    // First and last log time.
    b.take(16)?;
    let (size, crc) = (b.u64()?, b.u32()?);
    let compression = parse_string(&mut b)?;
    let packed_size = b.u64()?;
    Some(Head { size, crc, compression, packed_size, length: bytes.len() - b.0.len() })
}

/// Whether a body of this length, which begins with these bytes, is laid out as that of a chunk: its
/// lengths agree, its compression is known.
pub(super) fn is_one(bytes: &[u8], length: usize) -> bool {
    head(bytes).is_some_and(|h| {
        h.packed_size == (length - h.length) as u64 && matches!(h.compression, "" | "zstd" | "lz4")
    })
}

/// Whether damage in a chunk, which begins with these bytes, cannot be seen, because its checksum
/// was not recorded.
pub(super) fn lacks_checksum(bytes: &[u8]) -> bool {
    head(bytes).is_some_and(|h| h.crc == 0 && h.size > 0)
}

/// Reads a chunk record's body, decompresses it and verifies size and checksum (a checksum of 0 was
/// not recorded).
pub(super) fn open_chunk<'b>(
    log: &Source,
    chunk: Record,
    buffer: &'b mut Buffer,
) -> Result<Opened<'b>, Closed> {
    let mut first = [0; HEAD];
    let first = &mut first[..HEAD.min(chunk.length())];
    log.read(chunk.start, first)?;
    let Head { size, crc, compression, packed_size, length } =
        head(first).ok_or("its header is damaged")?;
    let start = chunk.start + length;
    let packed_length = usize::try_from(packed_size)
        .ok()
        .filter(|n| *n <= chunk.end - start)
        .ok_or("its data are cut off")?;
    let unpacked = if compression.is_empty() { 0 } else { size };
    let taken = CHUNKS.take(packed_size.saturating_add(unpacked))?;
    let size =
        usize::try_from(size).map_err(|_| format!("its size of {size} bytes is not credible"))?;
    let Buffer { packed, records, zstd } = buffer;
    packed.resize(packed_length, 0);
    log.read(start, packed)?;
    let records: &[u8] = match compression {
        "" => packed,
        "zstd" => {
            unpack_zstd(packed, size, records, zstd).map_err(|e| e.to_string())?;
            records
        }
        "lz4" => {
            let stream = lz4::Decoder::new(&packed[..]);
            stream.and_then(|s| unpack(s, size, records)).map_err(|e| e.to_string())?;
            records
        }
        other => return Err(format!("its compression {other:?} is unknown").into()),
    };
    if records.len() != size {
        return Err(format!("it holds {} bytes where {size} were announced", records.len()).into());
    }
    if crc != 0 && crc32fast::hash(records) != crc {
        return Err("its checksum does not match".into());
    }
    Ok(Opened { records, _taken: taken })
}

/// A chunk that says it is larger than so many times its data is not believed.
const DENSE: usize = 64;
/// What such a chunk may keep of what went before, as a power of two, bytes.
const WINDOW_LOG: u32 = 24;

/// Decompresses in one go where the announced size is credible.
fn unpack_zstd(
    packed: &[u8],
    size: usize,
    records: &mut Vec<u8>,
    zstd: &mut Option<Decompressor<'static>>,
) -> std::io::Result<()> {
    if size / DENSE > packed.len() {
        let mut stream = zstd::stream::Decoder::with_buffer(packed)?;
        stream.window_log_max(WINDOW_LOG)?;
        return unpack(stream, size, records);
    }
    records.clear();
    records.reserve_exact(size);
    let zstd = match zstd {
        Some(made) => made,
        None => zstd.insert(Decompressor::new()?),
    };
    zstd.decompress_to_buffer(packed, records).map(drop)
}

/// Takes what comes, and one byte more than was announced: memory grows with what is there.
fn unpack(stream: impl Read, size: usize, records: &mut Vec<u8>) -> std::io::Result<()> {
    records.clear();
    stream.take(size as u64 + 1).read_to_end(records).map(drop)
}
