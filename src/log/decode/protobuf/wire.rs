//! The bytes of a protobuf message in; keys of fields, and the numbers and stretches of bytes that
//! stand behind them, out.

use crate::log::bytes::Bytes;

/// Groups nested deeper than this are not read.
const DEEPEST: usize = 64;

/// What stands behind a field number, with the number that names it on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Form {
    Varint = 0,
    Eight = 1,
    /// A text, a message, or numbers in a row, its length in front.
    Stretch = 2,
    /// What stands up to the end of the group; nothing is read from it.
    Group = 3,
    Four = 5,
}

/// The number of the next field and the form of what follows.
#[inline]
pub(super) fn key(rest: &mut Bytes) -> Option<(u32, Form)> {
    let key = varint(rest)?;
    let number = u32::try_from(key >> 3).ok().filter(|&n| n > 0)?;
    let form = match key & 7 {
        0 => Form::Varint,
        1 => Form::Eight,
        2 => Form::Stretch,
        3 => Form::Group,
        5 => Form::Four,
        _ => return None,
    };
    Some((number, form))
}

/// A length and as many bytes.
#[inline]
pub(super) fn stretch<'a>(rest: &mut Bytes<'a>) -> Option<&'a [u8]> {
    let n = usize::try_from(varint(rest)?).ok()?;
    rest.take(n)
}

/// Passes over what stands behind a key.
pub(super) fn skip(rest: &mut Bytes, number: u32, form: Form) -> Option<()> {
    skip_within(rest, number, form, 0)
}

fn skip_within(rest: &mut Bytes, number: u32, form: Form, depth: usize) -> Option<()> {
    match form {
        Form::Varint => varint(rest).map(|_| ()),
        Form::Eight => rest.take(8).map(|_| ()),
        Form::Four => rest.take(4).map(|_| ()),
        Form::Stretch => stretch(rest).map(|_| ()),
        Form::Group if depth > DEEPEST => None,
        Form::Group => loop {
            let mut ahead = Bytes(rest.0);
            let end = varint(&mut ahead)?;
            if end & 7 == 4 {
                rest.0 = ahead.0;
                return (end >> 3 == u64::from(number)).then_some(());
            }
            let (number, form) = key(rest)?;
            skip_within(rest, number, form, depth + 1)?;
        },
    }
}

/// A number of one to ten bytes, seven bits each, the lowest first.
#[inline]
pub(super) fn varint(rest: &mut Bytes) -> Option<u64> {
    match rest.0 {
        [first, tail @ ..] if *first < 0x80 => {
            rest.0 = tail;
            Some(u64::from(*first))
        }
        _ => long_varint(rest),
    }
}

fn long_varint(rest: &mut Bytes) -> Option<u64> {
    let mut value = 0;
    for (i, &byte) in rest.0.iter().take(10).enumerate() {
        // The tenth byte has one bit.
        if i == 9 && byte > 1 {
            return None;
        }
        value |= u64::from(byte & 0x7f) << (7 * i);
        if byte < 0x80 {
            rest.0 = &rest.0[i + 1..];
            return Some(value);
        }
    }
    None
}
