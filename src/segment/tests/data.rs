//! Public flight records that are not part of the repository: found beside it, or the test says
//! that it is skipped.

use std::path::PathBuf;

/// The folder of the records: `KOEHLER_DATA`, or `shared/data` in a parent folder. `None` (with a
/// printed reason) where there is none.
pub fn folder() -> Option<PathBuf> {
    let named = std::env::var_os("KOEHLER_DATA").map(PathBuf::from);
    let here = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let beside = here.ancestors().map(|a| a.join("shared/data")).find(|p| p.is_dir());
    let found = named.or(beside).filter(|p| p.is_dir());
    if found.is_none() {
        println!(
            "skipped: no flight records (set KOEHLER_DATA, or put shared/data beside the repository)"
        );
    }
    found
}

/// Two columns (counted from 0) of a table of numbers in text.
pub fn text_columns(file: &str, columns: (usize, usize)) -> Option<(Vec<f64>, Vec<f64>)> {
    let text = std::fs::read_to_string(folder()?.join(file)).unwrap();
    let rows = text
        .lines()
        .map(|l| l.split_whitespace().map(|v| v.parse().unwrap()).collect::<Vec<f64>>());
    Some(rows.filter(|r| !r.is_empty()).map(|r| (r[columns.0], r[columns.1])).unzip())
}

/// All columns of the one uncompressed matrix of doubles in a MATLAB 5 file.
pub fn mat_columns(file: &str) -> Option<Vec<Vec<f64>>> {
    let bytes = std::fs::read(folder()?.join(file)).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    // header 128, matrix tag 8, array flags 16, dimensions tag 8
    let (rows, columns) = (word(160), word(164));
    let name = word(172);
    let data = 176 + name.div_ceil(8) * 8;
    assert_eq!(
        (word(128), word(data), word(data + 4)),
        (14, 9, rows * columns * 8),
        "a matrix of doubles"
    );
    let value = |k: usize| {
        f64::from_le_bytes(bytes[data + 8 + 8 * k..data + 16 + 8 * k].try_into().unwrap())
    };
    Some((0..columns).map(|c| (0..rows).map(|r| value(c * rows + r)).collect()).collect())
}
