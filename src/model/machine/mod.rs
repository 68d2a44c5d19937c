//! Vector code of our own (x86-64): lists of operations in; machine code for AVX-512 or AVX2 out,
//! with the bits of what it stands for, operation by operation.
mod assign;
mod builder;
pub mod encode;
mod functions;
mod lanes;
pub mod list;
mod literals;
mod memory;
mod sine;
#[cfg(test)]
mod tests;

pub use assign::TAIL;
pub use builder::Builder;
pub use lanes::{LANES, Lanes};
pub use memory::Code;

use super::tables::Tables;
