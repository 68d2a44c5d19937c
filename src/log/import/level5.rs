//! The bytes of a MATLAB 5 MAT file in; its numeric matrices out, those in structures too.
//!
//! The format is that of "MAT-File Format" (MathWorks), level 5: a header of 128 bytes, then
//! elements of a tag (type, bytes) and data padded to 8 bytes. A variable is an element of type 14
//! that holds flags, dimensions, a name and numbers (of a structure its fields, which are variables again), or type 15 that holds such an element
//! compressed. Numbers may be stored in any smaller type than their class.

use super::values::Values;
use std::io::Read;

const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// A real matrix, column by column.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrix {
    pub name: String,
    pub rows: usize,
    pub columns: usize,
    /// `[columns][rows]`; whole numbers of 64 bits keep all their digits.
    pub values: Values,
}

/// One element: its type and its data.
struct Element<'a> {
    kind: u32,
    data: &'a [u8],
}

/// What a file has.
#[derive(Debug, Default)]
pub struct Variables {
    /// In the order of the file; those of a structure are called `structure.field`, and
    /// `structure(2).field` where there are several.
    pub matrices: Vec<Matrix>,
    /// What is no real numeric matrix: its name, and what it is.
    pub others: Vec<(String, &'static str)>,
}

/// Every variable.
///
/// # Errors
/// What is wrong with the file.
pub fn variables(bytes: &[u8]) -> Result<Variables, String> {
    if bytes.get(126..128) != Some(b"IM") {
        return Err("the file was written on a big-endian machine, which is not read".into());
    }
    let mut found = Variables::default();
    let mut rest = bytes.get(128..).unwrap_or_default();
    while !rest.is_empty() {
        let element = next(&mut rest)?;
        let inflated;
        let element = if element.kind == COMPRESSED {
            inflated = inflate(element.data)?;
            next(&mut &inflated[..])?
        } else {
            element
        };
        if element.kind == MATRIX {
            found.take(element.data, None, 0)?;
        }
    }
    Ok(found)
}

fn inflate(data: &[u8]) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    flate2::read::ZlibDecoder::new(data)
        .read_to_end(&mut out)
        .map_err(|e| format!("a compressed variable is damaged: {e}"))?;
    Ok(out)
}

fn word(bytes: &[u8], at: usize) -> Result<u32, String> {
    let four = bytes
        .get(at..at + 4)
        .and_then(|b| b.try_into().ok())
        .ok_or("the file ends inside an element: it was cut short")?;
    Ok(u32::from_le_bytes(four))
}

/// Takes the next element off `rest`. Short elements keep their data inside the tag.
fn next<'a>(rest: &mut &'a [u8]) -> Result<Element<'a>, String> {
    let tag = word(rest, 0)?;
    let short = (tag >> 16) as usize;
    let (kind, from, size, whole) = if short > 0 {
        (tag & 0xffff, 4, short, 8)
    } else {
        let size = word(rest, 4)? as usize;
        // Compressed elements are not padded.
        let padded = if tag == COMPRESSED { size } else { size.next_multiple_of(8) };
        (tag, 8, size, 8 + padded)
    };
    let data =
        rest.get(from..from + size).ok_or("the file ends inside an element: it was cut short")?;
    *rest = rest.get(whole..).unwrap_or_default();
    Ok(Element { kind, data })
}

/// Structures in structures, at most.
const DEEP: usize = 16;

impl Variables {
    /// Takes a variable, or the field of a structure that is called `name`.
    fn take(&mut self, data: &[u8], name: Option<String>, deep: usize) -> Result<(), String> {
        let mut rest = data;
        if let (true, Some(name)) = (rest.is_empty(), &name) {
            self.others.push((name.clone(), "empty"));
            return Ok(());
        }
        let flags = word(next(&mut rest)?.data, 0)?;
        let (class, complex) = (flags & 0xff, flags & 0x800 != 0);
        let sizes = sizes(next(&mut rest)?.data)?;
        let own = String::from_utf8_lossy(next(&mut rest)?.data).into_owned();
        let name = name.unwrap_or(own);
        let is_flat = sizes.len() == 2 || sizes.iter().filter(|n| **n != 1).count() <= 1;
        let what = match class {
            2 if deep < DEEP => return self.structure(rest, &name, &sizes, deep),
            6..=15 if complex => "complex numbers",
            6..=15 if !is_flat => "an array of more than two dimensions",
            6..=15 => {
                self.matrices.push(matrix(&mut rest, name, &sizes)?);
                return Ok(());
            }
            1 => "a cell array",
            2 => "a structure in too many others",
            4 => "text",
            5 => "a sparse matrix",
            _ => "an object",
        };
        self.others.push((name, what));
        Ok(())
    }

    /// The fields of a structure, or of an array of such: after its name the length of a field's name,
    /// the names, and the fields of each in turn.
    fn structure(
        &mut self,
        mut rest: &[u8],
        name: &str,
        sizes: &[usize],
        deep: usize,
    ) -> Result<(), String> {
        let long = word(next(&mut rest)?.data, 0)? as usize;
        let names = next(&mut rest)?.data.chunks(long.max(1)).map(|field| {
            let end = field.iter().position(|b| *b == 0).unwrap_or(field.len());
            String::from_utf8_lossy(field.get(..end).unwrap_or_default()).into_owned()
        });
        let names: Vec<String> = names.collect();
        let count = sizes.iter().try_fold(1, |all: usize, n| all.checked_mul(*n));
        let mut at = 0;
        while !names.is_empty() && count.is_none_or(|count| at < count) {
            at += 1;
            for field in &names {
                let which = if count == Some(1) { String::new() } else { format!("({at})") };
                let element = next(&mut rest)?;
                if element.kind != MATRIX {
                    return Err(format!("field {field} of {name} is no variable"));
                }
                self.take(element.data, Some(format!("{name}{which}.{field}")), deep + 1)?;
            }
        }
        Ok(())
    }
}

/// The sizes of a variable.
fn sizes(data: &[u8]) -> Result<Vec<usize>, String> {
    (0..data.len() / 4).map(|i| Ok(word(data, 4 * i)? as usize)).collect()
}

/// A real matrix; an array of more dimensions, of which one is not 1, is a vector.
fn matrix(rest: &mut &[u8], name: String, sizes: &[usize]) -> Result<Matrix, String> {
    let of = |sizes: &[usize]| sizes.iter().try_fold(1, |all: usize, n| all.checked_mul(*n));
    let (rows, columns) = match *sizes {
        [rows, columns] => (rows, columns),
        _ => (of(sizes).unwrap_or(usize::MAX), 1),
    };
    let values = numbers(&next(rest)?)?;
    if Some(values.len()) != of(sizes) {
        return Err(format!(
            "matrix {name} says {rows} x {columns} and holds {} numbers",
            values.len()
        ));
    }
    Ok(Matrix { name, rows, columns, values })
}

fn numbers(element: &Element) -> Result<Values, String> {
    macro_rules! each {
        ($t:ty, $as:expr) => {
            element
                .data
                .as_chunks::<{ size_of::<$t>() }>()
                .0
                .iter()
                .map(|b| $as(<$t>::from_le_bytes(*b)))
                .collect()
        };
    }
    Ok(match element.kind {
        1 => Values::Numbers(each!(i8, f64::from)),
        2 => Values::Numbers(each!(u8, f64::from)),
        3 => Values::Numbers(each!(i16, f64::from)),
        4 => Values::Numbers(each!(u16, f64::from)),
        5 => Values::Numbers(each!(i32, f64::from)),
        6 => Values::Numbers(each!(u32, f64::from)),
        7 => Values::Numbers(each!(f32, f64::from)),
        9 => Values::Numbers(each!(f64, f64::from)),
        12 => Values::Whole(each!(i64, |n| Some(i128::from(n)))),
        13 => Values::Whole(each!(u64, |n| Some(i128::from(n)))),
        other => return Err(format!("numbers of type {other} are not read")),
    })
}

#[cfg(test)]
#[path = "level5_tests.rs"]
mod tests;
