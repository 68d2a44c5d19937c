//! A file that is mapped in; numbers that stand in it, as a slice, out.

use memmap2::Mmap;
use std::ops::Deref;
use std::sync::Arc;

/// Bytes of a number.
pub const EACH: usize = size_of::<f64>();

/// Numbers in a file, as they stood in memory.
#[derive(Debug, Clone)]
pub struct Filed {
    map: Arc<Mmap>,
    /// The first of them, and how many they are.
    from: usize,
    count: usize,
}

impl Filed {
    /// `count` numbers from the number `from` of the map on, whose first byte is that of a number.
    pub fn of(map: Arc<Mmap>, from: usize, count: usize) -> Filed {
        Filed { map, from, count }
    }
}

impl Deref for Filed {
    type Target = [f64];
    fn deref(&self) -> &[f64] {
        let bytes = &self.map[self.from * EACH..(self.from + self.count) * EACH];
        debug_assert_eq!(bytes.as_ptr().align_offset(EACH), 0);
        // SAFETY: the bytes are those of `count` numbers; maps begin on a page, or a whole number of
        // numbers behind it, and any bits are a number.
        unsafe { std::slice::from_raw_parts(bytes.as_ptr().cast(), self.count) }
    }
}
