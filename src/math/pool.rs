//! Buffers that a thread uses again and again: large ones would otherwise be returned to the system
//! and faulted in anew, pass by pass.

use super::simd::Aligned;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// Buffers kept per thread: those of a segment, and the sums of some tens of segments until all are added.
const MOST: usize = 512;

/// Numbers that they hold at most: 256 MiB.
const NUMBERS: usize = 1 << 25;

/// A buffer is not taken for less than its length over this: whoever needs that length would have to write
/// zeros to it again.
const TIMES: usize = 2;

/// Buffers by what they can hold, how many there are, and what they hold together.
struct Free {
    kept: BTreeMap<usize, Vec<Vec<f64>>>,
    count: usize,
    numbers: usize,
}

thread_local! {
    static FREE: RefCell<Free> =
        const { RefCell::new(Free { kept: BTreeMap::new(), count: 0, numbers: 0 }) };
    static ALIGNED: RefCell<Vec<Aligned>> = const { RefCell::new(Vec::new()) };
}

impl Free {
    /// The last one of those that can hold `capacity`, which there are.
    fn pop(&mut self, capacity: usize) -> Option<Vec<f64>> {
        let alike = self.kept.get_mut(&capacity)?;
        let buffer = alike.pop();
        if alike.is_empty() {
            self.kept.remove(&capacity);
        }
        self.count -= usize::from(buffer.is_some());
        self.numbers -= buffer.as_ref().map_or(0, |_| capacity);
        buffer
    }
}

/// A buffer of `n` numbers, whatever they are: the smallest that is large enough, and not far larger.
pub fn take(n: usize) -> Vec<f64> {
    let buffer = FREE.with_borrow_mut(|free| {
        let fits = free.kept.range(n..=TIMES * n.max(8)).next().map(|(capacity, _)| *capacity);
        fits.and_then(|capacity| free.pop(capacity))
    });
    match buffer {
        Some(mut buffer) => {
            buffer.resize(n, 0.0);
            buffer
        }
        // pages of the system, which are zero before they are touched
        None => vec![0.0; n],
    }
}

/// Keeps a buffer for whoever takes the next one; the smallest ones are let go first.
pub fn give(buffer: Vec<f64>) {
    let capacity = buffer.capacity();
    FREE.with_borrow_mut(|free| {
        if capacity == 0 || free.numbers + capacity > NUMBERS {
            return;
        }
        if free.count == MOST {
            let least = free.kept.keys().next().copied();
            drop(least.and_then(|least| free.pop(least)));
        }
        (free.count, free.numbers) = (free.count + 1, free.numbers + capacity);
        free.kept.entry(capacity).or_default().push(buffer);
    });
}

/// An aligned buffer whose memory was that of another one, and is kept for the next.
pub struct Lent(Aligned);

impl Lent {
    /// One of any length and content, for whoever resizes it and writes what is read.
    pub fn any() -> Lent {
        Lent(ALIGNED.with_borrow_mut(Vec::pop).unwrap_or_default())
    }

    /// So many zeros.
    pub fn zeros(len: usize) -> Lent {
        let mut lent = Lent::any();
        lent.0.zeros(len);
        lent
    }
}

impl Default for Lent {
    fn default() -> Lent {
        Lent::any()
    }
}

impl std::ops::Deref for Lent {
    type Target = Aligned;
    fn deref(&self) -> &Aligned {
        &self.0
    }
}

impl std::ops::DerefMut for Lent {
    fn deref_mut(&mut self) -> &mut Aligned {
        &mut self.0
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        let buffer = std::mem::take(&mut self.0);
        // a thread that ends has no list any more
        let _ = ALIGNED.try_with(|free| {
            let mut free = free.borrow_mut();
            if free.len() < MOST {
                free.push(buffer);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_given_back_is_taken_again() {
        let first = take(1000);
        let place = first.as_ptr();
        give(first);
        let again = take(900);
        assert_eq!((again.as_ptr(), again.len()), (place, 900));
        assert_eq!(take(10).len(), 10);
        give(again);
        // for a tenth of it another one serves
        let less = take(100);
        assert_ne!(less.as_ptr(), place);
    }
}
