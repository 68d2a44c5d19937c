//! A base at its fit in; how large the gap is, where it is, and what the additions did to it, out.

pub mod before_after;
pub mod coefficient;
pub mod comparison;
pub mod driven;
pub mod evidence;
pub mod gaps;
pub mod left;
pub mod looks;
pub mod relation;
pub mod varying;
