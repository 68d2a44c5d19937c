//! Content hashes of files: a path comes in, the hash of its bytes goes out, remembered by size and
//! time of change.
//!
//! The memory only saves reading: it is never part of a key, and a lost or broken memory file costs
//! time, nothing else.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Entry {
    bytes: u64,
    modified_ns: u128,
    hash: String,
}

/// Hashes of files seen, by absolute path.
#[derive(Debug, Default)]
pub struct Memo {
    entries: Mutex<BTreeMap<PathBuf, Entry>>,
}

/// Files changed less than this before they were hashed are not remembered: they could change again
/// within the clock's grain.
const SETTLED: Duration = Duration::from_secs(2);

impl Memo {
    /// Reads the memory file; an absent or unreadable one is an empty memory.
    pub fn read(path: &Path) -> Memo {
        let entries = std::fs::read(path)
            .ok()
            .and_then(|bytes| serde_json::from_slice(&bytes).ok())
            .unwrap_or_default();
        Memo { entries: Mutex::new(entries) }
    }

    /// The memory as the bytes of its file, without the files that are gone.
    pub fn bytes(&self) -> Vec<u8> {
        let mut entries = self.entries.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        entries.retain(|path, _| path.exists());
        serde_json::to_vec(&*entries).unwrap_or_default()
    }

    /// Hash of a file's bytes, `None` if there is no such file.
    ///
    /// # Errors
    /// The file is there and cannot be read.
    pub fn hash(&self, path: &Path) -> Result<Option<String>> {
        let unreadable =
            |e: std::io::Error| Error::new(format!("cannot read {}: {e}", path.display()));
        let meta = match std::fs::metadata(path) {
            Ok(meta) => meta,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(unreadable(e)),
        };
        let modified = meta.modified().unwrap_or(UNIX_EPOCH);
        let modified_ns = modified.duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos());
        let key = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        if let Some(entry) = self.entries.lock().unwrap_or_else(|p| p.into_inner()).get(&key)
            && (entry.bytes, entry.modified_ns) == (meta.len(), modified_ns)
        {
            return Ok(Some(entry.hash.clone()));
        }
        let hash = super::hashed::hash(path)?;
        let settled = SystemTime::now().duration_since(modified).is_ok_and(|age| age > SETTLED);
        if settled {
            let entry = Entry { bytes: meta.len(), modified_ns, hash: hash.clone() };
            self.entries.lock().unwrap_or_else(|p| p.into_inner()).insert(key, entry);
        }
        Ok(Some(hash))
    }
}

#[cfg(test)]
mod tests {
    use super::super::provenance::hash_bytes;
    use super::*;

    #[test]
    fn the_hash_follows_the_content_and_an_absent_file_has_none() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("a.mcap");
        let memo = Memo::default();
        assert_eq!(memo.hash(&path).expect("absent"), None);
        std::fs::write(&path, b"one").expect("written");
        let one = memo.hash(&path).expect("readable");
        std::fs::write(&path, b"two").expect("written");
        assert_ne!(memo.hash(&path).expect("readable"), one);
        assert_eq!(one, Some(hash_bytes(b"one")));
    }

    #[test]
    fn an_empty_file_has_a_hash() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("empty.mcap");
        std::fs::write(&path, b"").expect("written");
        assert_eq!(Memo::default().hash(&path).expect("readable"), Some(hash_bytes(b"")));
    }
}
