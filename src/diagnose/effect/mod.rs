//! Effect files and a base model in; candidates (what the model may lack, each one a compiled model
//! of its own) out.
//!
//! `file` reads effect files, `context` holds what is known besides the model, `roles` finds what
//! of the model the files speak of, `bind` makes each combination a `candidate`, `added` is a
//! parameter of it, `block` writes the lines that it adds to a model's text, `fill` puts names into
//! placeholders. See `docs/effects.md`.

mod added;
mod bind;
mod block;
mod candidate;
mod context;
pub mod file;
mod fill;
pub mod roles;
#[cfg(test)]
mod tests;

pub use added::{Added, Check};
pub use bind::{Wanted, candidates, candidates_of, useless};
pub use candidate::{Candidate, Offer, Skipped, effect_of};
pub use context::Context;
pub use file::{Effect, Family, load, parse};
