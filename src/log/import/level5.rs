//! The bytes of a MATLAB 5 MAT file in; its numeric matrices out, those in structures too.
//!
//! The format is that of "MAT-File Format" (MathWorks), level 5: a header of 128 bytes, then
//! elements of a tag (type, bytes) and data padded to 8 bytes. A variable is an element of type 14
//! that holds flags, dimensions, a name and numbers (of a structure its fields, which are variables again), or type 15 that holds such an element
//! compressed. Numbers may be stored in any smaller type than their class.

use std::io::Read;

const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// A real matrix, column by column.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrix {
    pub name: String,
    pub rows: usize,
    pub columns: usize,
    /// `[columns][rows]`.
    pub values: Vec<f64>,
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

fn numbers(element: &Element) -> Result<Vec<f64>, String> {
    macro_rules! all {
        ($t:ty) => {
            element
                .data
                .as_chunks::<{ size_of::<$t>() }>()
                .0
                .iter()
                .map(|b| <$t>::from_le_bytes(*b) as f64)
                .collect()
        };
    }
    Ok(match element.kind {
        1 => all!(i8),
        2 => all!(u8),
        3 => all!(i16),
        4 => all!(u16),
        5 => all!(i32),
        6 => all!(u32),
        7 => all!(f32),
        9 => all!(f64),
        12 => all!(i64),
        13 => all!(u64),
        other => return Err(format!("numbers of type {other} are not read")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn element(kind: u32, data: &[u8]) -> Vec<u8> {
        let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
        out.extend(data);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    }

    /// A 2 x 3 matrix, stored as `kind`.
    fn variable(name: &str, kind: u32, numbers: &[u8]) -> Vec<u8> {
        let flags = element(6, &[6, 0, 0, 0, 0, 0, 0, 0]);
        let size = element(5, &[2, 0, 0, 0, 3, 0, 0, 0]);
        element(
            MATRIX,
            &[flags, size, element(1, name.as_bytes()), element(kind, numbers)].concat(),
        )
    }

    fn file(elements: &[Vec<u8>]) -> Vec<u8> {
        let mut out = b"MATLAB 5.0 MAT-file".to_vec();
        out.resize(124, b' ');
        out.extend([0, 1, b'I', b'M']);
        elements.iter().for_each(|e| out.extend(e));
        out
    }

    fn doubles() -> Vec<u8> {
        (1..=6).flat_map(|i| (f64::from(i) / 2.0).to_le_bytes()).collect()
    }

    #[test]
    fn plain_small_and_compressed_matrices_are_read() {
        let mut zip = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
        zip.write_all(&variable("packed", 9, &doubles())).unwrap();
        let zip = zip.finish().unwrap();
        let mut packed = [COMPRESSED.to_le_bytes(), (zip.len() as u32).to_le_bytes()].concat();
        packed.extend(zip);
        let bytes = file(&[
            variable("plain", 9, &doubles()),
            variable("small", 2, &[1, 2, 3, 4, 5, 250]),
            packed,
        ]);
        let [plain, small, packed] = &variables(&bytes).unwrap().matrices[..] else {
            panic!("three")
        };
        assert_eq!((plain.name.as_str(), plain.rows, plain.columns), ("plain", 2, 3));
        assert_eq!(plain.values, [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]);
        assert_eq!((small.name.as_str(), small.values[5]), ("small", 250.0));
        assert_eq!((packed.name.as_str(), &packed.values), ("packed", &plain.values));
    }

    /// A structure of `count` times these fields.
    fn structure(name: &str, count: u32, fields: &[(&str, Vec<u8>)]) -> Vec<u8> {
        let names: Vec<u8> =
            (fields.iter()).flat_map(|(name, _)| format!("{name:\0<32}").into_bytes()).collect();
        let size = [1, count].map(u32::to_le_bytes).concat();
        let mut parts = [
            element(6, &[2, 0, 0, 0, 0, 0, 0, 0]),
            element(5, &size),
            element(1, name.as_bytes()),
            [(4u32 << 16 | 5).to_le_bytes(), 32u32.to_le_bytes()].concat(),
            element(1, &names),
        ]
        .concat();
        (0..count).for_each(|_| fields.iter().for_each(|(_, bytes)| parts.extend(bytes)));
        element(MATRIX, &parts)
    }

    fn text(name: &str) -> Vec<u8> {
        let flags = element(6, &[4, 0, 0, 0, 0, 0, 0, 0]);
        let size = element(5, &[1u32, 2].map(u32::to_le_bytes).concat());
        let parts = [flags, size, element(1, name.as_bytes()), element(16, b"ab")];
        element(MATRIX, &parts.concat())
    }

    #[test]
    fn fields_of_structures_have_names_and_what_is_no_matrix_is_said() {
        let inner = structure("", 1, &[("values", variable("", 9, &doubles()))]);
        let fields = [("signals", inner), ("unit", text("")), ("none", element(MATRIX, &[]))];
        let bytes = file(&[structure("out", 1, &fields), structure("two", 2, &fields[..1])]);
        let found = variables(&bytes).unwrap();
        let names: Vec<&str> = found.matrices.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["out.signals.values", "two(1).signals.values", "two(2).signals.values"]);
        assert_eq!(found.matrices[2].values, [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]);
        let others = [("out.unit".to_string(), "text"), ("out.none".to_string(), "empty")];
        assert_eq!(found.others, others);
    }

    #[test]
    fn fault_damaged_files_are_refused_in_words() {
        let inside = [("field", variable("", 9, &doubles()))];
        let whole = file(&[structure("s", 2, &inside), variable("plain", 9, &doubles())]);
        for end in 128..whole.len() {
            let _ = variables(&whole[..end]);
        }
        assert!(variables(&whole[..whole.len() - 20]).unwrap_err().contains("ends inside"));
        for at in 128..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x55;
            let _ = variables(&bytes);
        }
    }
}
