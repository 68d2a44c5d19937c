//! Vector code of our own (x86-64): lists of operations in; machine code for AVX-512 or AVX2 out,
//! with the bits of what it stands for, operation by operation.
mod assign;
mod builder;
mod chain;
mod control;
pub mod encode;
mod functions;
mod lanes;
pub mod list;
mod literals;
mod memory;
mod points;
mod sine;
#[cfg(test)]
mod tests;
mod writer;

pub use assign::TAIL;
pub use builder::Builder;
pub use chain::Chain;
pub use lanes::{LANES, Lanes};
pub use memory::Code;
pub use points::Points;

use super::tables::Tables;
