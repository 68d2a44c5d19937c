//! Bytes of a format in; where its pieces begin, as far as they are sound, out. With what stands in a piece
//! where, this is all that the generator of damaged inputs (`driven.rs`) knows of a format.

use crate::driven::Form;

/// Pieces of texts that a reader looks for.
const WORDS: &[&[u8]] = &[
    b"[[",
    b"]]",
    b"\"\"\"",
    b"{\"a\":",
    b"\xff\xff\xff\xff",
    b"\0\0\0\0",
    b"((((",
    b"1e999",
    b"\n",
    b",",
    b"=",
    b"nan",
    b"-",
    b"\\u",
    b"0x",
    b"^",
];
/// Numbers that sizes and counts are made of.
const NUMBERS: &[&[u8]] = &[
    b"\xff\xff\xff\xff\xff\xff\xff\xff",
    b"\0\0\0\0",
    b"\x80\x80\x80\x80\x80\x80\x80\x80\x80\x01",
];

pub const MCAP: Form = Form { pieces: mcap, kind: Some(0), size: Some((1, 8)), words: NUMBERS };
pub const ULOG: Form = Form { pieces: ulog, kind: Some(2), size: Some((0, 2)), words: NUMBERS };
pub const MAT: Form = Form { pieces: mat, kind: Some(0), size: Some((4, 4)), words: NUMBERS };
/// Messages, and the descriptors that are their schemas.
pub const PROTOBUF: Form =
    Form { pieces: protobuf, kind: Some(0), size: Some((1, 1)), words: NUMBERS };
/// ROS 2's encoding: numbers, and lists and texts behind their lengths, none with a mark of its own.
pub const CDR: Form = Form { pieces: fours, kind: None, size: Some((0, 4)), words: NUMBERS };
/// JSON, tables of text, TOML, the model language, and the schemas of ROS 2.
pub const TEXT: Form = Form { pieces: words, kind: None, size: None, words: WORDS };

/// The number in so many bytes.
fn number(bytes: &[u8], at: usize, width: usize) -> Option<usize> {
    let mut all = [0; 8];
    all[..width].copy_from_slice(bytes.get(at..at.checked_add(width)?)?);
    usize::try_from(u64::from_le_bytes(all)).ok()
}

/// Where one thing begins behind the other, until one is not there.
fn walk(from: usize, next: impl Fn(usize) -> Option<usize>) -> Vec<usize> {
    let mut starts = Vec::new();
    let mut at = from;
    while let Some(end) = next(at) {
        starts.push(at);
        at = end;
    }
    starts
}

/// Records, those in chunks without compression as well.
fn mcap(bytes: &[u8]) -> Vec<usize> {
    walk(mcap::MAGIC.len(), |at| {
        let end = (at + 9).checked_add(number(bytes, at + 1, 8)?)?;
        let is_plain = bytes[at] == 6 && number(bytes, at + 37, 4) == Some(0);
        Some(if is_plain { at + 49 } else { end })
    })
}

fn ulog(bytes: &[u8]) -> Vec<usize> {
    walk(16, |at| Some(at + 3 + number(bytes, at, 2).filter(|_| at + 2 < bytes.len())?))
}

/// Elements, those of matrices as well.
fn mat(bytes: &[u8]) -> Vec<usize> {
    walk(128, |at| {
        let (kind, size) = (number(bytes, at, 4)?, number(bytes, at + 4, 4)?);
        Some(if kind == 14 { at + 8 } else { at + 8 + size.next_multiple_of(8) })
    })
}

fn fours(bytes: &[u8]) -> Vec<usize> {
    (4..bytes.len()).step_by(4).collect()
}

/// Letters and digits together, anything else together.
fn words(bytes: &[u8]) -> Vec<usize> {
    let kind = |b: u8| (b.is_ascii_alphanumeric() || b == b'_', b.is_ascii_whitespace());
    (1..bytes.len()).filter(|&k| kind(bytes[k - 1]) != kind(bytes[k])).collect()
}

/// Fields, and the fields of what may be messages in them.
fn protobuf(bytes: &[u8]) -> Vec<usize> {
    let mut starts = Vec::new();
    fields(bytes, 0, bytes.len(), 8, &mut starts);
    starts
}

/// The number at a place, and where it ends.
fn varint(bytes: &[u8], at: usize) -> Option<(usize, usize)> {
    let last = bytes.iter().skip(at).take(9).position(|b| *b < 0x80)?;
    let value = (0..=last).rev().fold(0, |n, k| n << 7 | usize::from(bytes[at + k] & 0x7f));
    Some((value, at + last + 1))
}

/// Whether fields stand between two places, and nothing else.
fn fields(bytes: &[u8], from: usize, to: usize, depth: usize, starts: &mut Vec<usize>) -> bool {
    let mut at = from;
    while at < to {
        let Some((tag, value)) = varint(bytes, at) else { return false };
        let length = varint(bytes, value);
        let end = match (tag & 7, length) {
            (0, Some((_, end))) => Some(end),
            (1, _) => Some(value + 8),
            (2, Some((size, start))) => start.checked_add(size),
            (5, _) => Some(value + 4),
            _ => None,
        };
        let Some(end) = end.filter(|end| *end <= to) else { return false };
        starts.push(at);
        if let (2, Some((_, start)), true) = (tag & 7, length, depth > 0) {
            let known = starts.len();
            if !fields(bytes, start, end, depth - 1, starts) {
                starts.truncate(known);
            }
        }
        at = end;
    }
    true
}

#[test]
fn pieces_are_found_where_they_begin() {
    assert_eq!(words(b"a_1 = [2]\n"), [3, 4, 5, 6, 7, 8, 9]);
    assert_eq!(fours(&[0; 14]), [4, 8, 12]);
    // 1: 300; 2: { 1: 5 }; 3: eight bytes
    let message = [&b"\x08\xac\x02\x12\x02\x08\x05\x19"[..], &[0; 8]].concat();
    assert_eq!(protobuf(&message), [0, 3, 5, 7]);
    assert_eq!(protobuf(&message[..10]), [0, 3, 5]);
    let record = [&[7][..], &3u64.to_le_bytes(), b"abc"].concat();
    let log = [mcap::MAGIC, &record, &record].concat();
    assert_eq!(mcap(&log), [8, 20]);
}
