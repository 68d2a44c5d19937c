//! A base and candidate effects in; rounds of screening, refits and decisions, and the verdict they
//! end with, out.

mod answering;
mod by_noise;
pub mod decide;
pub mod diagnose;
pub mod ending;
pub mod fits;
mod ground;
pub mod judged;
pub mod probe;
pub mod probes;
pub mod projected;
pub mod refit;
pub mod round;
pub mod screen;
pub mod screening;
pub mod settled;
pub mod stability;
pub mod surrogate;
pub mod tried;
pub mod turbulence;
pub mod unphysical;
pub mod unseen;
pub mod value;
pub mod variants;
pub mod verdict;
mod with_inputs;
