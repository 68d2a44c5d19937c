//! The bytes of MAT files in; the matrices that must come out, and what must be said of damage.

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
    element(MATRIX, &[flags, size, element(1, name.as_bytes()), element(kind, numbers)].concat())
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
    let [plain, small, packed] = &variables(&bytes).unwrap().matrices[..] else { panic!("three") };
    assert_eq!((plain.name.as_str(), plain.rows, plain.columns), ("plain", 2, 3));
    assert_eq!(plain.values, Values::Numbers(vec![0.5, 1.0, 1.5, 2.0, 2.5, 3.0]));
    assert_eq!(small.name, "small");
    assert_eq!(small.values, Values::Numbers(vec![1.0, 2.0, 3.0, 4.0, 5.0, 250.0]));
    assert_eq!((packed.name.as_str(), &packed.values), ("packed", &plain.values));
}

#[test]
fn whole_numbers_of_64_bits_keep_all_their_digits() {
    let first = 1_700_000_000_123_456_789i64;
    let signed: Vec<u8> = (0..6).flat_map(|k| (first - k).to_le_bytes()).collect();
    let unsigned: Vec<u8> = (0..6).flat_map(|k| (u64::MAX - k).to_le_bytes()).collect();
    let bytes = file(&[variable("t", 12, &signed), variable("n", 13, &unsigned)]);
    let [t, n] = &variables(&bytes).unwrap().matrices[..] else { panic!("two") };
    let whole = |of: fn(i128) -> i128| Values::Whole((0..6).map(|k| Some(of(k))).collect());
    assert_eq!(t.values, whole(|k| 1_700_000_000_123_456_789 - k));
    assert_eq!(n.values, whole(|k| i128::from(u64::MAX) - k));
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
    assert_eq!(found.matrices[2].values, Values::Numbers(vec![0.5, 1.0, 1.5, 2.0, 2.5, 3.0]));
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
