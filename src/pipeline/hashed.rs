//! A path in; the content key of the file's bytes, read piece by piece, out.

use crate::engine::Key;
use crate::error::{Error, Result};
use std::fs::File;
use std::path::Path;

/// The content key of a file. It is never mapped: another program that cut it short meanwhile would
/// stop this one.
///
/// # Errors
/// The file is not there or cannot be read.
pub fn hash(path: &Path) -> Result<String> {
    let failed = |e: std::io::Error| cannot("read", path, &e);
    // A pipe would be waited for: what a path leads to is asked before it is opened.
    let about = std::fs::metadata(path).map_err(failed)?;
    if !about.is_file() {
        let what = if about.is_dir() { "a folder" } else { "a pipe or a device" };
        return Err(Error::new(format!("{} is {what}, not a file", path.display())));
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path).map_err(failed)?).map_err(failed)?;
    Ok(Key::from(hasher.finalize()).0)
}

/// An error of the file system.
pub fn cannot(what: &str, path: &Path, e: &std::io::Error) -> Error {
    Error::new(format!("cannot {what} {}: {e}", path.display()))
}
