//! Finished instructions in; memory that may be executed, out.

use memmap2::{Mmap, MmapMut};

/// Machine code, which lives as long as this.
#[derive(Debug)]
pub struct Code {
    memory: Mmap,
    entries: Vec<usize>,
}

impl Code {
    /// `entries`: where functions begin. `None` where the system gives no such memory.
    pub fn of(bytes: &[u8], entries: Vec<usize>) -> Option<Code> {
        let mut memory = MmapMut::map_anon(bytes.len().max(1)).ok()?;
        memory[..bytes.len()].copy_from_slice(bytes);
        let inside = entries.iter().all(|&entry| entry < bytes.len());
        inside.then_some(Code { memory: memory.make_exec().ok()?, entries })
    }

    /// Where function `k` begins.
    pub fn entry(&self, k: usize) -> *const u8 {
        self.memory[self.entries[k]..].as_ptr()
    }
}
