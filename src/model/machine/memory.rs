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

    /// Calls function `k`, which has so many arguments or fewer, numbers or addresses.
    ///
    /// # Safety
    /// What the function reads and writes is there.
    pub unsafe fn call(&self, k: usize, arguments: [usize; 6]) {
        type Function = unsafe extern "C" fn(usize, usize, usize, usize, usize, usize);
        let [a, b, c, d, e, f] = arguments;
        // SAFETY: functions begin at the entries, and take arguments as C does where there is code.
        unsafe {
            let entry = self.memory[self.entries[k]..].as_ptr();
            std::mem::transmute::<*const u8, Function>(entry)(a, b, c, d, e, f);
        }
    }
}
