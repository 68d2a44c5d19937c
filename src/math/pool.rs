//! Buffers that a thread uses again and again: large ones would otherwise be returned to the system
//! and faulted in anew, pass by pass.

use super::simd::Aligned;
use std::cell::RefCell;

/// Buffers kept per thread.
const MOST: usize = 128;

thread_local! {
    static FREE: RefCell<Vec<Vec<f64>>> = const { RefCell::new(Vec::new()) };
    static ALIGNED: RefCell<Vec<Aligned>> = const { RefCell::new(Vec::new()) };
}

/// A buffer of `n` numbers, whatever they are: the smallest that is large enough.
pub fn take(n: usize) -> Vec<f64> {
    let mut buffer = FREE.with_borrow_mut(|free| {
        let fits = (0..free.len())
            .filter(|&i| free[i].capacity() >= n)
            .min_by_key(|&i| free[i].capacity());
        fits.map(|i| free.swap_remove(i))
    });
    match &mut buffer {
        Some(buffer) => buffer.resize(n, 0.0),
        // pages of the system, which are zero before they are touched
        None => return vec![0.0; n],
    }
    buffer.unwrap_or_default()
}

/// Keeps a buffer for whoever takes the next one; the smallest ones are let go first.
pub fn give(buffer: Vec<f64>) {
    FREE.with_borrow_mut(|free| {
        if free.len() < MOST {
            free.push(buffer);
        } else if let Some(least) = free.iter_mut().min_by_key(|kept| kept.capacity())
            && least.capacity() < buffer.capacity()
        {
            *least = buffer;
        }
    });
}

/// An aligned buffer of no length, with the memory of the last one that was given back.
pub fn take_aligned() -> Aligned {
    ALIGNED.with_borrow_mut(Vec::pop).unwrap_or_default()
}

/// Keeps the memory of an aligned buffer.
pub fn give_aligned(buffer: Aligned) {
    ALIGNED.with_borrow_mut(|free| {
        if free.len() < MOST {
            free.push(buffer);
        }
    });
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
    }
}
