//! A job and its items in; rows of a table that travels to workers, and what comes back in its
//! place, out.

use bytes::Bytes;
use koehler::engine::{Blobs, Folder, Key, decode, encode};
use koehler::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Outputs up to so many bytes go back in their row; larger ones through the shared folder.
const SMALL: usize = 16 << 10;

/// The parameters of a job, by the name of their bytes in a folder that all processes see.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Parameters {
    pub folder: PathBuf,
    pub key: Key,
}

/// What comes back for an item.
#[derive(Debug, Serialize, Deserialize)]
pub struct Answer {
    /// What the function said in words while it worked.
    pub said: Vec<String>,
    /// Why the item could not be done there, or what came of it.
    pub output: std::result::Result<Output, String>,
}

#[derive(Debug, Serialize, Deserialize)]
pub enum Output {
    /// A small one.
    Here(Bytes),
    /// The name of its bytes in the shared folder.
    There(Key),
}

impl Output {
    /// Puts the bytes into the folder where they are too many for a row.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn of(bytes: Vec<u8>, folder: &Folder) -> Result<Output> {
        match bytes.len() <= SMALL {
            true => Ok(Output::Here(bytes.into())),
            false => Ok(Output::There(folder.put(&bytes)?)),
        }
    }

    /// The bytes.
    ///
    /// # Errors
    /// They are not there, or others.
    pub fn bytes(self, folder: &Folder) -> Result<Bytes> {
        let key = match self {
            Output::Here(bytes) => return Ok(bytes),
            Output::There(key) => key,
        };
        let bytes = whole(folder, &key)?;
        Ok(bytes.into())
    }
}

/// The bytes of a key, which have to be those it names.
///
/// # Errors
/// They are not there, or others.
pub fn whole(folder: &Folder, key: &Key) -> Result<Vec<u8>> {
    // A key is a file's name: nothing else of it may reach the file system.
    if key.0.is_empty() || !key.0.bytes().all(|b| b.is_ascii_hexdigit()) {
        return Err(Error::new(format!("{:?} is no content key", key.0)));
    }
    let bytes = folder.get(key)?;
    match Key::of(&bytes) == *key {
        true => Ok(bytes),
        false => Err(Error::new(format!("{} of the shared folder was changed", key.0))),
    }
}

/// The name of a function on its way.
pub fn function(name: &str, version: u32) -> String {
    format!("{name}@{version}")
}

impl Answer {
    /// As bytes; what cannot be encoded is said.
    pub fn encoded(&self) -> Vec<u8> {
        let failed = |e: Error| Answer { said: Vec::new(), output: Err(e.to_string()) };
        encode(self).or_else(|e| encode(&failed(e))).unwrap_or_default()
    }

    /// From bytes.
    ///
    /// # Errors
    /// They are no answer.
    pub fn decoded(bytes: &[u8]) -> Result<Answer> {
        decode(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_outputs_stay_in_the_row_and_changed_ones_are_noticed() {
        let temporary = tempfile::tempdir().expect("a folder");
        let folder = Folder(temporary.path().to_path_buf());
        let small = Output::of(vec![1; SMALL], &folder).expect("taken");
        assert!(matches!(small, Output::Here(_)));
        let large = Output::of(vec![2; SMALL + 1], &folder).expect("written");
        let Output::There(key) = &large else { panic!("not in the folder") };
        let path = temporary.path().join(&key.0);
        assert_eq!(std::fs::read(&path).expect("there").len(), SMALL + 1);
        std::fs::write(&path, "other").expect("written");
        assert!(large.bytes(&folder).is_err());
        assert!(whole(&folder, &Key("../secret".into())).is_err());
    }
}
