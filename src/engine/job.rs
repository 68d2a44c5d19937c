//! A function and its items, as an engine sees them: bytes of items in, bytes of outputs out, or
//! both by reference.

use super::data::{Blobs, Said};
use crate::error::Result;

/// Does the items of jobs, in any order, anywhere.
pub trait Engine: Sync {
    /// Does the items of a job: here (`job.here(i)`), or elsewhere (`job.done(i, output)`). Items
    /// that it leaves are done here afterwards.
    fn run(&self, job: &dyn Job);

    /// How many items it does at a time, where that is not the number of threads here.
    fn wide(&self) -> Option<usize> {
        None
    }
}

/// A function and its items, as an engine sees them: items have the numbers `0..count()`, and a
/// method panics for any other.
pub trait Job: Sync {
    /// Name of the function.
    fn name(&self) -> &'static str;
    /// Its version.
    fn version(&self) -> u32;
    /// Number of items.
    fn count(&self) -> usize;
    /// Does item `i` here, by reference, unless it is done already. Work that it divides goes to the
    /// thread pool that the calling thread is in.
    fn here(&self, i: usize);
    /// The parameters as bytes.
    ///
    /// # Errors
    /// The blobs cannot be written.
    fn parameters(&self, blobs: &dyn Blobs) -> Result<Vec<u8>>;
    /// Item `i` as bytes.
    ///
    /// # Errors
    /// It cannot be encoded.
    fn item(&self, i: usize) -> Result<Vec<u8>>;
    /// What item `i` says while it is done elsewhere.
    fn said(&self, i: usize, said: Said);
    /// Takes the output of item `i`.
    ///
    /// # Errors
    /// The bytes are no output of this function.
    fn done(&self, i: usize, output: &[u8]) -> Result<()>;
}
