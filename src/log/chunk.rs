//! The body of a chunk record in; its records, decompressed and verified, out.

use super::bytes::{Bytes, parse_string};

/// No chunk of a sane recorder is larger than this; a larger size is a damaged one.
const LARGEST_CHUNK: u64 = 2 << 30;

/// Decompresses a chunk record's body and verifies size and checksum (a checksum of 0 was not
/// recorded).
pub(super) fn open_chunk<'a>(
    body: &'a [u8],
    buffer: &'a mut Vec<u8>,
) -> std::result::Result<&'a [u8], String> {
    let short = || "its header is cut off".to_string();
    let mut b = Bytes(body);
    b.u64().and_then(|_| b.u64()).ok_or_else(short)?;
    let size = b.u64().ok_or_else(short)?;
    let crc = b.u32().ok_or_else(short)?;
    let compression = parse_string(&mut b).ok_or_else(short)?;
    let packed_size = b.u64().ok_or_else(short)?;
    let packed = usize::try_from(packed_size)
        .ok()
        .and_then(|n| b.0.get(..n))
        .ok_or("its data are cut off")?;
    if size > LARGEST_CHUNK {
        return Err(format!("its size of {size} bytes is not credible"));
    }
    let size = size as usize;
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
    Ok(records)
}
