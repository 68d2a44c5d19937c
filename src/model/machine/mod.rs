//! Machine code of our own (x86-64): operations in; code for AVX-512 or AVX2 out, with the bits of the
//! interpreter.
//!
//! # How code is made
//!
//! What is asked for is always one loop without branches in it: a function that does the same to
//! every group of points, to every step, to every grid point. So there is no compiler here, only:
//!
//! 1. *A list of steps* (`list`), each of which names the steps whose values it reads: reading
//!    memory, one operation, a call, writing memory. `writer` makes such steps of a program's
//!    instructions; `dynamics::sweep` makes them of the pattern of a Jacobian.
//! 2. *Registers* (`assign`, `registers`), in one walk through the list. When each value is read next is known, so
//!    the one that is read last leaves when a register is wanted (Belady). What stands in memory
//!    anyway is not kept elsewhere: it is read again, as a rule as the last operand of the
//!    instruction that wants it.
//! 3. *Bytes* (`encode`, `control`): some thirty forms of instructions, VEX or EVEX. `Vector` says
//!    whether a register holds one number, four or eight; the list does not know.
//! 4. *Memory* that may be executed (`memory`).
//!
//! `builder` puts them together: it opens a frame, loops over the list, and closes.
//!
//! | who | lanes | what |
//! |---|---|---|
//! | `Lanes` | points | a program over the register file of sixteen points: entries of Jacobians, outputs |
//! | `Chain` | one | a plain model's states through Runge-Kutta steps, four stages in a row |
//! | `Points` | one | a program at single points |
//! | `dynamics::sweep` | directions | sensitivities through Runge-Kutta steps |
//! | `dynamics::sweep_rows` | directions | rows of the outputs |
//!
//! # Bits
//!
//! Every operation is the interpreter's, in its order, multiply-adds fused where the program says so:
//! results have the same bits (but for those of a NaN), and tests hold them to it for random programs
//! and for all shipped models. Sine and cosine are the polynomial of `arithmetic` (`sine`); functions
//! without an instruction and the tables are calls of what the interpreter calls (`functions`).
//!
//! # Registers and frames
//!
//! `r12` points to the literals, `r14` to the tables; others are each function's own. A call spoils
//! all vector registers: what is wanted later waits in the frame. The frame has the three arguments
//! of a function, room for 32 registers while a rare function is called (sines of large angles), and
//! behind them the values that found no register. A list whose frame would be large, or for which
//! there is no instruction, gives no code, and the interpreter does the same work; likewise on another
//! processor, without AVX2, and where C passes arguments in other registers (Windows).

mod assign;
mod builder;
mod chain;
mod control;
pub mod encode;
mod frame;
mod functions;
mod lanes;
pub mod list;
mod literals;
mod memory;
mod points;
mod registers;
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
