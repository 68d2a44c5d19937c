//! The allocator as the system has it, in; one that gives large blocks back as soon as they are free, out.

/// Blocks from this size on are mapped, and given back when they are free, bytes.
#[cfg(target_env = "gnu")]
const LARGE: libc::c_int = 1 << 20;

/// Has large blocks mapped one by one. The C library of GNU takes larger and larger ones from its heap once
/// some have been free (up to 32 MB), and the heap of a long flight is full of holes of the size of a column:
/// two hours at 100 Hz took 1.19 GB where 0.82 are in use.
pub fn give_back() {
    #[cfg(target_env = "gnu")]
    // SAFETY: it sets a number of the allocator, before other threads begin.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE);
    }
}
