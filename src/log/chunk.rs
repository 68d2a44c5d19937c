//! The body of a chunk record in; its records, decompressed and verified, out.

use super::bytes::{Bytes, parse_string};
use super::memory::{CHUNKS, Taken};

/// A buffer that has become larger is given back after use.
const KEPT: usize = 16 << 20;

/// The records of a chunk, and the memory that they take.
pub(super) struct Opened<'a> {
    pub records: &'a [u8],
    _taken: Option<Taken<'a>>,
}

/// Gives back a buffer that is large.
pub(super) fn release(buffer: &mut Vec<u8>) {
    if buffer.capacity() > KEPT {
        *buffer = Vec::new();
    }
}

/// The head of a chunk and the bytes behind it.
struct Head<'a> {
    size: u64,
    crc: u32,
    compression: &'a str,
    packed_size: u64,
    rest: &'a [u8],
}

fn head(body: &[u8]) -> Option<Head<'_>> {
    let mut b = Bytes(body);
    // First and last log time.
    b.take(16)?;
    let (size, crc) = (b.u64()?, b.u32()?);
    let compression = parse_string(&mut b)?;
    let packed_size = b.u64()?;
    Some(Head { size, crc, compression, packed_size, rest: b.0 })
}

/// Whether a body is laid out as that of a chunk: its lengths agree, its compression is known.
pub(super) fn is_one(body: &[u8]) -> bool {
    head(body).is_some_and(|h| {
        h.packed_size == h.rest.len() as u64 && matches!(h.compression, "" | "zstd" | "lz4")
    })
}

/// Whether damage in a chunk cannot be seen, because its checksum was not recorded.
pub(super) fn lacks_checksum(body: &[u8]) -> bool {
    head(body).is_some_and(|h| h.crc == 0 && h.size > 0)
}

/// Decompresses a chunk record's body and verifies size and checksum (a checksum of 0 was not
/// recorded).
pub(super) fn open_chunk<'a>(
    body: &'a [u8],
    buffer: &'a mut Vec<u8>,
) -> std::result::Result<Opened<'a>, String> {
    let Head { size, crc, compression, packed_size, rest } =
        head(body).ok_or("its header is cut off")?;
    let packed = usize::try_from(packed_size)
        .ok()
        .and_then(|n| rest.get(..n))
        .ok_or("its data are cut off")?;
    let taken = if compression.is_empty() { None } else { Some(CHUNKS.take(size)?) };
    let size =
        usize::try_from(size).map_err(|_| format!("its size of {size} bytes is not credible"))?;
    let records: &[u8] = match compression {
        "" => packed,
        "zstd" => {
            buffer.clear();
            buffer.reserve(size);
            zstd::bulk::Decompressor::new()
                .and_then(|mut d| d.decompress_to_buffer(packed, buffer))
                .map_err(|e| e.to_string())?;
            buffer
        }
        "lz4" => {
            use std::io::Read;
            buffer.clear();
            let stream = lz4::Decoder::new(packed).map_err(|e| e.to_string())?;
            stream.take(size as u64 + 1).read_to_end(buffer).map_err(|e| e.to_string())?;
            buffer
        }
        other => return Err(format!("its compression {other:?} is unknown")),
    };
    if records.len() != size {
        return Err(format!("it holds {} bytes where {size} were announced", records.len()));
    }
    if crc != 0 && crc32fast::hash(records) != crc {
        return Err("its checksum does not match".into());
    }
    Ok(Opened { records, _taken: taken })
}
