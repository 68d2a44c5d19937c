//! A job comes in; its items are done by the threads of this process, by reference.

use super::job::{Engine, Job};
use rayon::prelude::*;

/// The threads of this process (those of the pool that the caller is in).
#[derive(Debug, Clone, Copy, Default)]
pub struct Threads;

impl Engine for Threads {
    fn run(&self, job: &dyn Job) {
        (0..job.count()).into_par_iter().for_each(|i| job.here(i));
    }
}

/// How many items are done at a time.
pub fn threads() -> usize {
    rayon::current_num_threads()
}
