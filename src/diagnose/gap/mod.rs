//! A base at its fit in; how large the gap is, where it is, and what the additions did to it, out.

pub mod closing;
pub mod closure;
pub mod coefficient;
pub mod driven;
pub mod gaps;
pub mod looks;
pub mod relation;
