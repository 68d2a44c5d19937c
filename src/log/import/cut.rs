//! The bytes of a file in; what its end lacks, where it was cut short so that nothing of it can be read, out.

use super::mat;
use super::parquet;

/// Bytes of the head of a MAT file of version 5.
const MAT_HEAD: usize = 128;

/// What is wrong with a file that is empty, or begins as one of a known kind and has no end.
pub fn what_is_missing(bytes: &[u8]) -> Option<&'static str> {
    let is_short = |name: &[u8], whole: usize| bytes.starts_with(name) && bytes.len() < whole;
    let is_blank = || bytes.iter().all(u8::is_ascii_whitespace);
    if bytes.is_empty() {
        Some("the file is empty")
    } else if is_blank() {
        Some("the file holds nothing but blanks")
    } else if bytes.starts_with(parquet::MAGIC) && !parquet::is_parquet(bytes) {
        Some("it begins as a Parquet file and does not end as one: it was cut short")
    } else if is_short(mat::MAGIC, MAT_HEAD) {
        Some("it begins as a MAT file and ends inside its header: it was cut short")
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_file_without_an_end_is_named_as_what_it_was() {
        for (bytes, wanted) in [
            (&b""[..], "empty"),
            (b"\n \r\n", "blanks"),
            (b"PAR1\x15\x04", "Parquet file and does not end"),
            (b"MATLAB 5.0 MAT-file, Platform", "MAT file and ends inside its header"),
        ] {
            let what = what_is_missing(bytes).expect(wanted);
            assert!(what.contains(wanted), "{what}");
        }
        assert_eq!(what_is_missing(b"PAR1...PAR1"), None);
        assert_eq!(what_is_missing(b"t,v\n"), None);
        assert_eq!(what_is_missing(&[&b"MATLAB 5.0 MAT-file"[..], &[0; 200]].concat()), None);
    }
}
