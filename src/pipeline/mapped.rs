//! A path in; the bytes of the file, mapped, out.

use crate::error::{Error, Result};
use std::fs::File;
use std::ops::Deref;
use std::path::Path;

/// The bytes of a file, mapped; an empty file is empty bytes.
pub enum Bytes {
    Mapped(memmap2::Mmap),
    Empty,
}

impl Deref for Bytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        match self {
            Bytes::Mapped(map) => map,
            Bytes::Empty => &[],
        }
    }
}

/// Maps a file for reading.
///
/// # Errors
/// The file is not there or cannot be read.
pub fn map(path: &Path) -> Result<Bytes> {
    // A pipe would be waited for: what a path leads to is asked before it is opened.
    let meta = std::fs::metadata(path).map_err(|e| cannot("read", path, &e))?;
    if !meta.is_file() {
        let what = if meta.is_dir() { "a folder" } else { "a pipe or a device" };
        return Err(Error::new(format!("{} is {what}, not a file", path.display())));
    }
    let file = File::open(path).map_err(|e| cannot("read", path, &e))?;
    if meta.len() == 0 {
        return Ok(Bytes::Empty);
    }
    // SAFETY: the map is only read. Another program that cuts the file short meanwhile can stop
    // this one, as with any mapped log.
    unsafe { memmap2::Mmap::map(&file) }.map(Bytes::Mapped).map_err(|e| cannot("read", path, &e))
}

/// An error of the file system.
pub fn cannot(what: &str, path: &Path, e: &std::io::Error) -> Error {
    Error::new(format!("cannot {what} {}: {e}", path.display()))
}
