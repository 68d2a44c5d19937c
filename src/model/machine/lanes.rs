//! A program in; machine code that runs it over lanes of points, register file in and out, with the
//! interpreter's bits.

use std::collections::HashMap;

use super::builder::Builder;
use super::encode::{Assembler, Base, Place};
use super::list::{List, Step};
use super::memory::Code;
use super::writer::Writer;
use crate::math::simd::Width;
use crate::model::program::Program;
use crate::model::tables::Tables;

/// Points side by side in a register file.
pub const LANES: usize = 16;

/// The body of a program as machine code.
#[derive(Debug)]
pub struct Lanes {
    code: Code,
    registers: usize,
}

impl Lanes {
    /// Vectors of `width`, which this machine has. `None` where there is no code of it, or for an operation.
    pub fn compile(program: &Program, width: Width) -> Option<Lanes> {
        let (mut builder, list) = (Builder::new(width, false)?, list(program)?);
        let vector = builder.vector();
        let begin = |asm: &mut Assembler| {
            asm.copy(Base::Rbx, Base::Rdi);
            asm.copy(Base::R14, Base::Rsi);
            asm.number(Base::R13, (LANES / vector) as u64);
        };
        let next = |asm: &mut Assembler| asm.add(Base::Rbx, 8 * vector as i32);
        builder.function(begin, &list, next, Base::R13);
        Some(Lanes { code: builder.finish()?, registers: program.file_len() })
    }

    /// As `Program::run`.
    pub fn run(&self, file: &mut [[f64; LANES]], tables: &Tables) {
        assert!(file.len() >= self.registers, "a register file of another program");
        let file = file.as_mut_ptr() as usize;
        // SAFETY: the code reads and writes registers below `registers`, and reads tables.
        unsafe { self.code.call(0, [file, std::ptr::from_ref(tables) as usize, 0, 0, 0, 0]) }
    }
}

/// The body for the lanes that `Base::Rbx` points to.
fn list(program: &Program) -> Option<List> {
    let mut writer = Writer::new(&place);
    let mut last = HashMap::new();
    for (at, i) in program.body().iter().enumerate() {
        i.written().for_each(|register| {
            last.insert(register, at);
        });
    }
    let outputs: Vec<u32> = (0..program.outputs()).map(|k| program.register(k) as u32).collect();
    for (at, i) in program.body().iter().enumerate() {
        writer.instruction(i)?;
        for register in i.written().filter(|r| last.get(r) == Some(&at) && outputs.contains(r)) {
            let value = writer.get(register);
            writer.list.push(Step::Store(value, place(register)));
        }
    }
    Some(writer.list)
}

/// Where a register stands.
fn place(register: u32) -> Place {
    Place { base: Base::Rbx, at: (register as usize * 8 * LANES) as i32 }
}
