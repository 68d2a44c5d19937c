//! One step of a compiled program.

use super::op::Op;

/// What an instruction does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Code {
    Op(Op),
    /// Sine of `a` to `to`, cosine to `b`.
    SinCos,
}

/// `to = code(a, b, c)`: numbers of registers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instruction {
    pub code: Code,
    pub to: u32,
    pub a: u32,
    pub b: u32,
    pub c: u32,
}

impl Instruction {
    /// The registers that it writes.
    pub fn written(&self) -> impl Iterator<Item = u32> {
        [Some(self.to), (self.code == Code::SinCos).then_some(self.b)].into_iter().flatten()
    }
}
