//! The frame of a function: what stands where in it, and calls that find their arguments there.
//!
//! The three arguments of a function come first, then room for all registers while a rare function
//! is called, then the values that found no register.

use super::encode::{Assembler, Base, Place, Vector};
use super::list::Function;

const SAVED: i32 = 3 * 64;
const KEPT: i32 = SAVED + 32 * 64;

/// Where argument `k` of a function stands.
pub fn argument(k: i32) -> Place {
    Place { base: Base::Rsp, at: 64 * k }
}

/// Where register `r` waits while a function is called.
pub fn saved(r: u8) -> Place {
    Place { base: Base::Rsp, at: SAVED + 64 * i32::from(r) }
}

/// Where a value is kept.
pub fn kept(slot: u32, vector: Vector) -> Place {
    Place { base: Base::Rsp, at: KEPT + 8 * (slot * vector as u32) as i32 }
}

/// Calls `function` over the arguments that stand in the frame.
pub fn call(asm: &mut Assembler, function: Function) {
    const SPOILT: [Base; 4] = [Base::Rsi, Base::Rcx, Base::R8, Base::R9];
    asm.copy(Base::Rdi, Base::Rsp);
    SPOILT.into_iter().for_each(|base| asm.push(base));
    asm.copy(Base::Rsi, Base::R14);
    asm.number(Base::Rdx, asm.vector as u64);
    asm.call(function as *const u8);
    SPOILT.into_iter().rev().for_each(|base| asm.pop(base));
}
