//! The bytes of a MATLAB 5 MAT file in; its numeric matrices out.
//!
//! The format is that of "MAT-File Format" (MathWorks), level 5: a header of 128 bytes, then
//! elements of a tag (type, bytes) and data padded to 8 bytes. A variable is an element of type 14
//! that holds flags, dimensions, a name and numbers, or type 15 that holds such an element
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

/// Every real numeric matrix, in the order of the file.
///
/// # Errors
/// What is wrong with the file.
pub fn variables(bytes: &[u8]) -> Result<Vec<Matrix>, String> {
    if bytes.get(126..128) != Some(b"IM") {
        return Err("the file was written on a big-endian machine, which is not read".into());
    }
    let mut found: Vec<Matrix> = Vec::new();
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
            found.extend(matrix(element.data)?);
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
        .ok_or("the file ends inside an element")?;
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
    let data = rest.get(from..from + size).ok_or("the file ends inside an element")?;
    *rest = rest.get(whole..).unwrap_or_default();
    Ok(Element { kind, data })
}

/// A real numeric two-dimensional matrix; none for anything else (text, structures, complex
/// numbers).
fn matrix(data: &[u8]) -> Result<Option<Matrix>, String> {
    let mut rest = data;
    let flags = word(next(&mut rest)?.data, 0)?;
    let (class, complex) = (flags & 0xff, flags & 0x800 != 0);
    let dimensions = next(&mut rest)?;
    let name = next(&mut rest)?;
    if !(6..=15).contains(&class) || complex || dimensions.data.len() != 8 {
        return Ok(None);
    }
    let (rows, columns) = (word(dimensions.data, 0)? as usize, word(dimensions.data, 4)? as usize);
    let name = String::from_utf8_lossy(name.data).into_owned();
    let values = numbers(&next(&mut rest)?)?;
    if Some(values.len()) != rows.checked_mul(columns) {
        return Err(format!(
            "matrix {name} says {rows} x {columns} and holds {} numbers",
            values.len()
        ));
    }
    Ok(Some(Matrix { name, rows, columns, values }))
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
        let [plain, small, packed] = &variables(&bytes).unwrap()[..] else { panic!("three") };
        assert_eq!((plain.name.as_str(), plain.rows, plain.columns), ("plain", 2, 3));
        assert_eq!(plain.values, [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]);
        assert_eq!((small.name.as_str(), small.values[5]), ("small", 250.0));
        assert_eq!((packed.name.as_str(), &packed.values), ("packed", &plain.values));
    }

    #[test]
    fn fault_damaged_files_are_refused_in_words() {
        let whole = file(&[variable("plain", 9, &doubles())]);
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
