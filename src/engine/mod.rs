//! Where work runs: a function, what its items have in common and the items come in; their outputs,
//! in the order of the items, go out.
//!
//! # Design
//!
//! Work that is worth moving to another machine is a [`Function`]: a unit of a stage, the normal
//! equations of a segment. All of them stand in one list, [`crate::FUNCTIONS`]. [`map`] and
//! [`each`] hand a function and its items to an [`Engine`]:
//!
//! * [`Threads`], the default, calls the function with references and encodes nothing.
//! * An engine that moves work encodes the parameters once and every item ([`Job`]), sends them to a
//!   process that holds the same list, and there [`Served`] decodes them, calls the function and
//!   encodes the output.
//!
//! An item is small: it names its data by content key and place and does not carry them. What many
//! items read (the segments of an estimate) goes by key through [`Blobs`], and a process keeps what
//! it made of them in its [`Kept`]. Sums are taken by the caller, in the order of the items, so
//! that no result depends on the engine. Bad data is part of an output. What an engine could not do
//! (a process that was lost) is done here, by the call itself: an engine can make work slower, never
//! wrong or incomplete.

mod call;
mod code;
mod data;
mod function;
mod job;
mod serve;
mod threads;

pub use call::{Here, each, each_here, map};
pub use code::{decode, encode};
pub use data::{Blobs, Folder, Kept, Key, Said};
pub use function::{Function, Source};
pub use job::{Engine, Job};
pub use serve::{CODE, Served};
pub use threads::{Threads, threads};
