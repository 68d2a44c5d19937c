//! Content keys in; the data that they name, as bytes that all processes see, or as what a process
//! made of them and kept, out.

use crate::error::{Error, Result};
use crate::table::Unfinished;
use serde::{Deserialize, Serialize};
use std::any::Any;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};

/// What data are asked for by: the hash of the bytes they are made from (BLAKE3, first 128 bits,
/// hexadecimal), and where two things may be made from the same bytes, their place before it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Key(pub String);

impl Key {
    /// The key of these bytes.
    pub fn of(bytes: &[u8]) -> Key {
        Key::from(blake3::hash(bytes))
    }
}

impl From<blake3::Hash> for Key {
    fn from(hash: blake3::Hash) -> Key {
        Key(hash.to_hex()[..32].to_string())
    }
}

/// Bytes by content key, where all processes of an engine find them.
pub trait Blobs: Send + Sync {
    /// Puts bytes there and returns their key.
    ///
    /// # Errors
    /// They cannot be written.
    fn put(&self, bytes: &[u8]) -> Result<Key>;
    /// The bytes of a key.
    ///
    /// # Errors
    /// They are not there.
    fn get(&self, key: &Key) -> Result<Vec<u8>>;
}

/// Blobs as files of a folder that all processes see, for as long as a run lasts.
#[derive(Debug, Clone)]
pub struct Folder(pub PathBuf);

impl Blobs for Folder {
    fn put(&self, bytes: &[u8]) -> Result<Key> {
        let key = Key::of(bytes);
        let path = self.0.join(&key.0);
        if !path.is_file() {
            let mut file = Unfinished::beside(&path)?;
            file.0
                .write_all(bytes)
                .map_err(|e| Error::new(format!("cannot write {}: {e}", path.display())))?;
            file.pass_on(&path)?;
        }
        Ok(key)
    }

    fn get(&self, key: &Key) -> Result<Vec<u8>> {
        let path = self.0.join(&key.0);
        std::fs::read(&path).map_err(|e| Error::new(format!("cannot read {}: {e}", path.display())))
    }
}

/// What a function says while it works.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Said {
    /// So many steps of so many are done.
    Step(usize, usize),
    /// What it is doing, in words.
    Words(String),
}

/// One thing that is kept.
struct Entry {
    /// When it was last used, counted in uses.
    used: u64,
    bytes: usize,
    value: Arc<dyn Any + Send + Sync>,
}

#[derive(Default)]
struct Entries {
    /// All uses so far.
    uses: u64,
    /// Memory of all entries.
    bytes: usize,
    by_key: BTreeMap<Key, Entry>,
}

impl Entries {
    fn remove(&mut self, key: &Key) {
        self.bytes -= self.by_key.remove(key).map_or(0, |entry| entry.bytes);
    }
}

/// What a process made of data, by their key.
#[derive(Default)]
pub struct Kept {
    entries: Mutex<Entries>,
    /// At most so many bytes, of what has a size; none without a limit.
    limit: Option<usize>,
}

/// A value is large from this part of all that may be kept.
const LARGE: usize = 4;

impl Kept {
    /// Forgets what was used longest ago once all take more than `bytes`.
    pub fn at_most(bytes: usize) -> Kept {
        Kept { limit: Some(bytes), ..Kept::default() }
    }

    fn lock(&self) -> MutexGuard<'_, Entries> {
        self.entries.lock().unwrap_or_else(|p| p.into_inner())
    }

    /// What is kept under a key, or is made now. It has no size: no limit counts it.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn get<T: Send + Sync + 'static>(
        &self,
        key: &Key,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<Arc<T>> {
        self.get_sized(key, make, |_| 0)
    }

    /// The same for something that takes `bytes` of memory.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn get_sized<T: Send + Sync + 'static>(
        &self,
        key: &Key,
        make: impl FnOnce() -> Result<T>,
        bytes: impl FnOnce(&T) -> usize,
    ) -> Result<Arc<T>> {
        if let Some(found) = self.find(key) {
            return Ok(found);
        }
        let made = Arc::new(make()?);
        self.put(key.clone(), made.clone(), bytes(&made));
        Ok(made)
    }

    fn find<T: Send + Sync + 'static>(&self, key: &Key) -> Option<Arc<T>> {
        let entries = &mut *self.lock();
        entries.uses += 1;
        let entry = entries.by_key.get_mut(key)?;
        entry.used = entries.uses;
        entry.value.clone().downcast().ok()
    }

    /// Keeps a value of so many bytes under a key. One that would push out most others is not kept.
    pub fn put<T: Send + Sync + 'static>(&self, key: Key, value: Arc<T>, bytes: usize) {
        if self.limit.is_some_and(|limit| bytes > limit / LARGE) {
            return;
        }
        let entries = &mut *self.lock();
        entries.uses += 1;
        entries.remove(&key);
        entries.bytes += bytes;
        entries.by_key.insert(key, Entry { used: entries.uses, bytes, value });
        while self.limit.is_some_and(|limit| entries.bytes > limit) {
            let sized = entries.by_key.iter().filter(|(_, entry)| entry.bytes > 0);
            let Some((oldest, _)) = sized.min_by_key(|(_, entry)| entry.used) else { break };
            let oldest = oldest.clone();
            entries.remove(&oldest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_used_longest_ago_is_forgotten() {
        let kept = Kept::at_most(4);
        let key = |n: u8| Key::of(&[n]);
        (0..4).for_each(|n| kept.put(key(n), Arc::new(n), 1));
        assert_eq!(kept.get(&key(0), || Ok(9u8)).ok().as_deref(), Some(&0));
        kept.put(key(4), Arc::new(4u8), 1);
        assert_eq!(kept.get(&key(1), || Ok(9u8)).ok().as_deref(), Some(&9));
    }

    #[test]
    fn what_would_push_out_most_others_is_not_kept() {
        let kept = Kept::at_most(8);
        let (small, large) = (Key::of(b"small"), Key::of(b"large"));
        kept.put(small.clone(), Arc::new(1u8), 2);
        kept.put(large.clone(), Arc::new(2u8), 3);
        assert_eq!(kept.get(&small, || Ok(9u8)).ok().as_deref(), Some(&1));
        assert_eq!(kept.get(&large, || Ok(9u8)).ok().as_deref(), Some(&9));
    }
}
