//! Content hashes of files: a path comes in, the hash of its bytes goes out, remembered by size and
//! time of change.
//!
//! The memory only saves reading: it is never part of a key, and a lost or broken memory file costs
//! time, nothing else.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Entry {
    bytes: u64,
    modified_ns: u128,
    /// Number of the file on its disk, where the system has one: links may lead to another file.
    #[serde(default)]
    node: u64,
    hash: String,
    /// Met by this program: it is there.
    #[serde(skip)]
    met: bool,
}

/// Hashes of files seen, by absolute path.
#[derive(Debug, Default)]
pub struct Memo {
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    entries: BTreeMap<String, Entry>,
    /// Folders by the paths that lead to them.
    folders: HashMap<PathBuf, PathBuf>,
    /// Whether there is an entry that the memory file has not.
    grown: bool,
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
        Memo { state: Mutex::new(State { entries, ..State::default() }) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// The memory as the bytes of its file, without the files that are gone; none where the file has
    /// them.
    pub fn bytes(&self) -> Option<Vec<u8>> {
        let mut state = self.state();
        let before = state.entries.len();
        state.entries.retain(|path, entry| entry.met || Path::new(path).exists());
        let is_other = state.grown || state.entries.len() != before;
        state.grown = false;
        is_other.then(|| serde_json::to_vec(&state.entries).unwrap_or_default())
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
        let as_now = (meta.len(), modified_ns, node(&meta));
        let name = self.state().absolute(path);
        if let Some(hash) = name.as_ref().and_then(|name| self.state().known(name, as_now)) {
            return Ok(Some(hash));
        }
        let hash = super::hashed::hash(path)?;
        let settled = SystemTime::now().duration_since(modified).is_ok_and(|age| age > SETTLED);
        if let (Some(name), true) = (name, settled) {
            let (bytes, modified_ns, node) = as_now;
            let entry = Entry { bytes, modified_ns, node, hash: hash.clone(), met: true };
            let mut state = self.state();
            state.entries.insert(name, entry);
            state.grown = true;
        }
        Ok(Some(hash))
    }
}

impl State {
    /// The absolute path of a file; none where its name is no text.
    fn absolute(&mut self, path: &Path) -> Option<String> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        if !self.folders.contains_key(folder) {
            self.folders.insert(folder.to_path_buf(), folder.canonicalize().ok()?);
        }
        let path = self.folders.get(folder)?.join(path.file_name()?);
        path.to_str().map(str::to_string)
    }

    /// The hash of a file that has this size, time and number.
    fn known(&mut self, name: &str, now: (u64, u128, u64)) -> Option<String> {
        let entry = self.entries.get_mut(name)?;
        entry.met = true;
        ((entry.bytes, entry.modified_ns, entry.node) == now).then(|| entry.hash.clone())
    }
}

#[cfg(unix)]
fn node(meta: &Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::ino(meta)
}

#[cfg(not(unix))]
fn node(_: &Metadata) -> u64 {
    0
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
