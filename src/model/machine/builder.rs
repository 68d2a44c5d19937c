//! Lists of steps in; functions that loop over them out.

use super::assign::assign;
use super::encode::{Assembler, Base};
use super::list::List;
use super::literals;
use super::memory::Code;
use crate::math::simd::Width;

/// Functions that become one piece of code.
pub struct Builder {
    asm: Assembler,
    entries: Vec<usize>,
}

impl Builder {
    /// `None` where there is no code of this width: another processor, or a system on which C passes
    /// arguments otherwise.
    pub fn new(width: Width) -> Option<Builder> {
        let wide = match width {
            _ if !cfg!(all(target_arch = "x86_64", unix)) => return None,
            Width::Avx512 => true,
            Width::Avx2 => false,
            Width::Plain => return None,
        };
        Some(Builder { asm: Assembler { bytes: Vec::new(), wide }, entries: Vec::new() })
    }

    /// Numbers of a vector.
    pub fn vector(&self) -> usize {
        self.asm.vector() as usize / 8
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
        asm.leave(frame, rest.frame);
        rest.finish(asm);
    }

    pub fn finish(self) -> Option<Code> {
        Code::of(&self.asm.bytes, self.entries)
    }
}
