//! What a function is, and what it finds where it runs: parameters and an item in, an output out.

use super::data::{Blobs, Kept, Key, Said};
use super::job::Engine;
use crate::error::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Work that can be done anywhere.
pub trait Function: 'static {
    /// Its name in the list of functions.
    const NAME: &'static str;
    /// Raised when parameters, items or outputs change their meaning: processes of different
    /// versions do not work together.
    const VERSION: u32;
    /// What all items have in common, as the caller has it.
    type Parameters<'a>: Sync;
    /// One piece of work: small, its data named.
    type Item: Serialize + DeserializeOwned + Sync;
    /// What comes of it.
    type Output: Serialize + DeserializeOwned + Send + Sync;

    /// Does one item.
    ///
    /// # Errors
    /// What `source` should have is not there: the work could not be done here. What is wrong with
    /// the data is part of the output.
    fn run(
        parameters: &Self::Parameters<'_>,
        item: &Self::Item,
        source: &Source,
    ) -> Result<Self::Output>;

    /// The parameters as bytes; what many calls have in common is put into `blobs`.
    ///
    /// # Errors
    /// The blobs cannot be written.
    fn pack(parameters: &Self::Parameters<'_>, blobs: &dyn Blobs) -> Result<Vec<u8>>;

    /// Makes the parameters from these bytes and lends them to `to`.
    ///
    /// # Errors
    /// They are no parameters of this function, or what they name is not there.
    fn lend(
        bytes: &[u8],
        source: &Source,
        to: &mut dyn FnMut(&Self::Parameters<'_>) -> Result<()>,
    ) -> Result<()>;
}

/// What a function finds where it runs.
pub struct Source<'a> {
    /// What this process keeps.
    pub kept: &'a Kept,
    /// For work that a function hands on.
    pub engine: &'a dyn Engine,
    /// Data that parameters name by key; none where they are passed by reference.
    pub blobs: Option<&'a dyn Blobs>,
    /// Tells whoever watches.
    pub tell: &'a (dyn Fn(Said) + Sync),
}

impl Source<'_> {
    /// The bytes of a key.
    ///
    /// # Errors
    /// They are not there.
    pub fn blob(&self, key: &Key) -> Result<Vec<u8>> {
        let none = || Error::new(format!("there are no data of key {} here", key.0));
        self.blobs.ok_or_else(none)?.get(key)
    }
}
