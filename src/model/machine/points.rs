//! A program in; machine code of its outputs at points, number by number, with the interpreter's bits,
//! out.

use super::builder::Builder;
use super::encode::{Assembler, Base, Place};
use super::list::{List, Step};
use super::memory::Code;
use super::writer::Writer;
use crate::math::simd::Width;
use crate::model::program::Program;
use crate::model::tables::Tables;

/// A program as machine code, point by point.
#[derive(Debug)]
pub struct Points {
    code: Code,
    width: usize,
    registers: usize,
    outputs: usize,
}

/// Number `at` behind `base`.
pub fn number(base: Base, at: usize) -> Place {
    Place { base, at: 8 * at as i32 }
}

impl Points {
    /// Registers below `width` are read from a point, all others from the prepared register file.
    /// `None` where there is no code, or for an operation.
    pub fn compile(program: &Program, width: usize, vectors: Width) -> Option<Points> {
        let (mut builder, list) = (Builder::new(vectors, true)?, point(program, width)?);
        let outputs = program.outputs();
        // file, points, how many, out, tables
        let begin = |asm: &mut Assembler| {
            asm.copy(Base::Rbx, Base::Rdi);
            asm.copy(Base::R13, Base::Rdx);
            asm.copy(Base::R14, Base::R8);
        };
        let next = |asm: &mut Assembler| {
            asm.add(Base::Rsi, 8 * width as i32);
            asm.add(Base::Rcx, 8 * outputs as i32);
        };
        builder.function(begin, &list, next, Base::R13);
        Some(Points { code: builder.finish()?, width, registers: program.file_len(), outputs })
    }

    /// All outputs at all `points` (rows of the width) into rows of `out`. `file`: the program's
    /// own registers, prepared.
    pub fn run(&self, file: &[[f64; 1]], points: &[f64], out: &mut [f64], tables: &Tables) {
        let n = points.len().checked_div(self.width).unwrap_or(1);
        assert!(file.len() >= self.registers, "a register file of another program");
        assert!(out.len() >= n * self.outputs, "no room for the outputs");
        let arguments = [
            file.as_ptr() as usize,
            points.as_ptr() as usize,
            n,
            out.as_mut_ptr() as usize,
            std::ptr::from_ref(tables) as usize,
            0,
        ];
        if n > 0 {
            // SAFETY: the code reads registers below `registers` and the `n` points, and writes `n`
            // rows of `outputs`.
            unsafe { self.code.call(0, arguments) }
        }
    }
}

/// One point.
fn point(program: &Program, width: usize) -> Option<List> {
    let place = |register: u32| match register as usize {
        register if register < width => number(Base::Rsi, register),
        register => number(Base::Rbx, register),
    };
    let mut writer = Writer::new(&place);
    program.body().iter().try_for_each(|i| writer.instruction(i))?;
    for k in 0..program.outputs() {
        let value = writer.get(program.register(k) as u32);
        writer.list.push(Step::Store(value, number(Base::Rcx, k)));
    }
    Some(writer.list)
}
