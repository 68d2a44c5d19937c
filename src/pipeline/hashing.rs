//! A table comes in; its bytes go to where they are written, and their hash goes out, or why they could
//! not be written.

use super::hashed::cannot;
use crate::engine::Key;
use crate::error::Result;
use crate::table::Table;
use std::io::{self, Write};
use std::path::Path;

/// Writes a table piece by piece into `to`, which becomes the file `path`, and returns the hash of its
/// bytes.
///
/// # Errors
/// The table, or the file, which is named then, cannot be written.
pub fn write_table(table: &Table, to: impl Write + Send, path: &Path) -> Result<String> {
    let mut hashing = Hashing { to, hasher: blake3::Hasher::new(), refused: None };
    let written = table.write_parquet(&mut hashing);
    match hashing.refused {
        Some(e) => Err(cannot("write", path, &e)),
        None => written.map(|()| Key::from(hashing.hasher.finalize()).0),
    }
}

/// Hands bytes on, and hashes them on their way.
struct Hashing<W> {
    to: W,
    hasher: blake3::Hasher,
    /// Why bytes could not be written: who writes a table says it in words of a library.
    refused: Option<io::Error>,
}

impl<W> Hashing<W> {
    /// Keeps the reason of a failure; what is handed on has its kind.
    fn kept<T>(&mut self, result: io::Result<T>) -> io::Result<T> {
        result.map_err(|e| {
            let kind = e.kind();
            // That is tried again.
            if kind != io::ErrorKind::Interrupted {
                self.refused = Some(e);
            }
            kind.into()
        })
    }
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.to.write(bytes);
        let written = self.kept(written)?;
        self.hasher.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.to.flush();
        self.kept(flushed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::provenance::hash_bytes;

    struct Full;

    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(io::Error::other("no room"))
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn fault_a_disk_that_is_full_is_told_with_the_file_and_in_no_words_of_a_library() {
        let table = Table::empty("estimates").expect("a table");
        let path = Path::new("out/estimates/part-0.parquet");
        let e = write_table(&table, Full, path).expect_err("refused").to_string();
        assert_eq!(e, "cannot write out/estimates/part-0.parquet: no room");
        let mut bytes = Vec::new();
        let hash = write_table(&table, &mut bytes, path).expect("written");
        assert_eq!(hash, hash_bytes(&bytes));
    }
}
