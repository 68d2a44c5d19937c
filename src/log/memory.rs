//! Sizes of chunks in; leave to take that much memory for one, as soon as there is so much, out.
//!
//! A chunk takes memory twice: as it stands in the file, and decompressed.

use std::sync::{Condvar, Mutex, MutexGuard};

const MIB: u64 = 1 << 20;

/// What chunks may take where nothing else is said, MiB.
pub const DEFAULT_MIB: u64 = 1024;

/// Memory that all threads share.
pub(super) struct Memory {
    /// The limit and what is taken of it, bytes.
    state: Mutex<(u64, u64)>,
    freed: Condvar,
}

/// The memory for the chunks of all logs that this process reads.
pub(super) static CHUNKS: Memory = Memory::of(DEFAULT_MIB * MIB);

/// Sets how much memory the chunks of all logs may take at a time, as they are read and decompressed,
/// MiB, over all threads of this process.
pub fn limit_chunks(mib: u64) {
    CHUNKS.state().0 = mib.saturating_mul(MIB);
}

/// Memory that is taken until this is dropped.
pub(super) struct Taken<'a>(&'a Memory, u64);

impl Memory {
    pub const fn of(limit: u64) -> Memory {
        Memory { state: Mutex::new((limit, 0)), freed: Condvar::new() }
    }

    fn state(&self) -> MutexGuard<'_, (u64, u64)> {
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Whether there can ever be so much.
    pub fn has_room_for(&self, bytes: u64) -> bool {
        bytes <= self.state().0
    }

    /// Waits until there is so much. Who has taken some must not ask again before it is given back.
    ///
    /// # Errors
    /// In words: there is never so much.
    pub fn take(&self, bytes: u64) -> Result<Taken<'_>, String> {
        let mut state = self.state();
        loop {
            let (limit, taken) = *state;
            if bytes > limit {
                return Err(format!(
                    "its {bytes} bytes are more than the {} MiB that [ingest] chunk_memory_mib leaves",
                    limit / MIB
                ));
            }
            if taken <= limit - bytes {
                state.1 += bytes;
                return Ok(Taken(self, bytes));
            }
            state = self.freed.wait(state).unwrap_or_else(|poisoned| poisoned.into_inner());
        }
    }
}

impl Drop for Taken<'_> {
    fn drop(&mut self) {
        let mut state = self.0.state();
        state.1 = state.1.saturating_sub(self.1);
        self.0.freed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn threads_together_never_take_more_than_the_limit() {
        let memory = Memory::of(100);
        let (now, most) = (AtomicU64::new(0), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for thread in 0..8 {
                let (memory, now, most) = (&memory, &now, &most);
                scope.spawn(move || {
                    for i in 0..200 {
                        let bytes = 20 + (thread * 7 + i) % 50;
                        let taken = memory.take(bytes).unwrap();
                        most.fetch_max(
                            now.fetch_add(bytes, Ordering::SeqCst) + bytes,
                            Ordering::SeqCst,
                        );
                        std::thread::yield_now();
                        now.fetch_sub(bytes, Ordering::SeqCst);
                        drop(taken);
                    }
                });
            }
        });
        let most = most.into_inner();
        assert!(most <= 100 && most > 40, "{most}");
        assert_eq!(memory.state().1, 0);
    }

    #[test]
    fn fault_what_is_more_than_the_limit_is_refused_at_once() {
        let memory = Memory::of(3 * MIB);
        let held = memory.take(2 * MIB).unwrap();
        let e = memory.take(4 * MIB).err().unwrap();
        assert!(e.contains("4194304 bytes are more than the 3 MiB"), "{e}");
        drop(held);
        assert!(memory.take(3 * MIB).is_ok());
    }
}
