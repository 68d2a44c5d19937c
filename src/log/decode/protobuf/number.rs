//! Bytes of a message and a kind of number in; the numbers that stand there out.

use super::schema::Number;
use super::wire::{self, Form};
use crate::log::bytes::Bytes;
use crate::log::decode::encoding::finite;
use crate::log::decode::paths::{self, Numbers};

/// The number at a place of a list: goes to its slot, if anybody wants it.
#[inline]
fn set(place: usize, wanted: &[(usize, usize)], value: f64, out: &mut [f64]) {
    if let Some(x) = wanted.iter().find(|w| w.0 == place).and_then(|w| out.get_mut(w.1)) {
        *x = value;
    }
}

impl Number {
    /// None where such a number is not written so.
    #[inline(always)]
    pub fn read(self, form: Form, rest: &mut Bytes) -> Option<f64> {
        let x = match (self, form) {
            (Number::Double, Form::Eight) => f64::from_bits(rest.u64()?),
            (Number::Float, Form::Four) => f64::from(f32::from_bits(rest.u32()?)),
            (Number::Signed, Form::Varint) => wire::varint(rest)? as i64 as f64,
            (Number::Unsigned, Form::Varint) => wire::varint(rest)? as f64,
            (Number::Zigzag, Form::Varint) => {
                let n = wire::varint(rest)?;
                ((n >> 1) as i64 ^ -((n & 1) as i64)) as f64
            }
            (Number::Bool, Form::Varint) => f64::from(u8::from(wire::varint(rest)? != 0)),
            (Number::Fixed32, Form::Four) => f64::from(rest.u32()?),
            (Number::Sfixed32, Form::Four) => f64::from(rest.u32()? as i32),
            (Number::Fixed64, Form::Eight) => rest.u64()? as f64,
            (Number::Sfixed64, Form::Eight) => rest.u64()? as i64 as f64,
            _ => return None,
        };
        Some(finite(x))
    }

    /// The same, and what a whole number is above it.
    pub fn read_whole(self, form: Form, rest: &mut Bytes) -> Option<(f64, f64)> {
        let whole = match (self, form) {
            (Number::Signed, Form::Varint) => i128::from(wire::varint(rest)? as i64),
            (Number::Unsigned, Form::Varint) => i128::from(wire::varint(rest)?),
            (Number::Zigzag, Form::Varint) => {
                let n = wire::varint(rest)?;
                i128::from((n >> 1) as i64 ^ -((n & 1) as i64))
            }
            (Number::Fixed64, Form::Eight) => i128::from(rest.u64()?),
            (Number::Sfixed64, Form::Eight) => i128::from(rest.u64()? as i64),
            _ => return Some((self.read(form, rest)?, 0.0)),
        };
        Some((whole as f64, paths::rest(whole)))
    }

    pub fn form(self) -> Form {
        match self.size() {
            Some(8) => Form::Eight,
            Some(_) => Form::Four,
            None => Form::Varint,
        }
    }

    /// Bytes of one, where all are of the same size.
    pub fn size(self) -> Option<usize> {
        match self {
            Number::Double | Number::Fixed64 | Number::Sfixed64 => Some(8),
            Number::Float | Number::Fixed32 | Number::Sfixed32 => Some(4),
            Number::Signed | Number::Unsigned | Number::Zigzag | Number::Bool => None,
        }
    }

    /// The next number of a list.
    #[inline]
    pub fn next(
        self,
        form: Form,
        rest: &mut Bytes,
        count: &mut usize,
        wanted: &Numbers,
        out: &mut [f64],
    ) -> Option<()> {
        let value = if wanted.above.is_empty() {
            self.read(form, rest)?
        } else {
            let (value, above) = self.read_whole(form, rest)?;
            set(*count, &wanted.above, above, out);
            value
        };
        set(*count, &wanted.at, value, out);
        *count += 1;
        Some(())
    }

    /// Numbers in a row.
    pub fn packed(
        self,
        packed: &[u8],
        count: &mut usize,
        wanted: &Numbers,
        out: &mut [f64],
    ) -> Option<()> {
        let mut rest = Bytes(packed);
        let Some(size) = self.size() else {
            while !rest.0.is_empty() {
                self.next(Form::Varint, &mut rest, count, wanted, out)?;
            }
            return Some(());
        };
        if !packed.len().is_multiple_of(size) {
            return None;
        }
        let (n, form) = (packed.len() / size, self.form());
        let inside = |place: usize| place.checked_sub(*count).filter(|&i| i < n);
        for &(place, slot) in &wanted.at {
            let Some(i) = inside(place) else { continue };
            *out.get_mut(slot)? = self.read(form, &mut Bytes(packed.get(i * size..)?))?;
        }
        for &(place, slot) in &wanted.above {
            let Some(i) = inside(place) else { continue };
            *out.get_mut(slot)? = self.read_whole(form, &mut Bytes(packed.get(i * size..)?))?.1;
        }
        *count += n;
        Some(())
    }
}
