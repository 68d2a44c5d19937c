//! Lists of steps in; functions that loop over them out.

use super::assign::assign;
use super::encode::{Assembler, Base, Vector};
use super::list::List;
use super::literals;
use super::memory::Code;
use crate::math::simd::Width;

/// Functions that become one piece of code.
pub struct Builder {
    asm: Assembler,
    entries: Vec<usize>,
    /// The largest frame.
    frame: usize,
}

/// Bytes of a frame at most: what wants more is left to the interpreter.
const MOST: usize = 1 << 15;

impl Builder {
    /// Vectors of `width`, or single numbers. `None` where there is no code of this width: another
    /// processor, or a system on which C passes arguments otherwise.
    pub fn new(width: Width, single: bool) -> Option<Builder> {
        let vector = match width {
            _ if !cfg!(all(target_arch = "x86_64", unix)) => return None,
            Width::Plain => return None,
            _ if single => Vector::One,
            Width::Avx2 => Vector::Four,
            Width::Avx512 => Vector::Eight,
        };
        Some(Builder { asm: Assembler::new(vector), entries: Vec::new(), frame: 0 })
    }

    /// Numbers of a vector.
    pub fn vector(&self) -> usize {
        self.asm.vector as usize
    }

    /// A function that begins with `begin` and then does `list` and `next` as often as `counter`
    /// says, which is at least once.
    pub fn function(
        &mut self,
        begin: impl FnOnce(&mut Assembler),
        list: &List,
        next: impl FnOnce(&mut Assembler),
        counter: Base,
    ) {
        let asm = &mut self.asm;
        self.entries.push(asm.bytes.len());
        let frame = asm.enter();
        asm.number(Base::R12, literals::address());
        begin(asm);
        let again = asm.bytes.len();
        let rest = assign(asm, list);
        next(asm);
        asm.repeat(counter, again);
        self.frame = self.frame.max(rest.frame);
        asm.leave(frame, rest.frame);
        rest.finish(asm);
    }

    /// `None` where a function would want too large a frame, or the system gives no memory.
    pub fn finish(self) -> Option<Code> {
        if self.frame > MOST { None } else { Code::of(&self.asm.bytes, self.entries) }
    }
}
