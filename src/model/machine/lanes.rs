//! A program in; machine code that runs it over lanes of points, register file in and out, with the
//! interpreter's bits.

use std::collections::HashMap;

use super::builder::Builder;
use super::encode::{
    ADD, AND, Assembler, Base, DIV, Form, MAX, MIN, MUL, Place, SUB, Signs, XOR,
};
use super::functions::function;
use super::list::{List, Step, Value};
use super::literals::{self, Literal};
use super::memory::Code;
use crate::math::simd::Width;
use crate::model::instruction::{Code as Does, Instruction};
use crate::model::op::Op;
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
        let (mut builder, list) = (Builder::new(width)?, list(program)?);
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

/// What the code does, and what it has of each register.
struct Writer {
    list: List,
    values: HashMap<u32, Value>,
}

/// The body for the lanes that `Base::Rbx` points to.
fn list(program: &Program) -> Option<List> {
    let mut writer = Writer { list: List::default(), values: HashMap::new() };
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

impl Writer {
    fn get(&mut self, register: u32) -> Value {
        let list = &mut self.list;
        *self.values.entry(register).or_insert_with(|| list.push(Step::Vector(place(register))))
    }

    fn literal(&mut self, which: Literal) -> Value {
        self.list.push(Step::Vector(literals::place(which)))
    }

    fn instruction(&mut self, i: &Instruction) -> Option<()> {
        let value = match i.code {
            Does::SinCos | Does::Op(Op::Sin | Op::Cos) => {
                let x = self.get(i.a);
                let sin = self.list.push(Step::Sine(x));
                let cos = self.list.push(Step::Cosine);
                if i.code == Does::SinCos {
                    self.values.insert(i.b, cos);
                }
                if i.code == Does::Op(Op::Cos) { cos } else { sin }
            }
            Does::Op(op) => self.operation(op, i)?,
        };
        self.values.insert(i.to, value);
        Some(())
    }

    fn operation(&mut self, op: Op, i: &Instruction) -> Option<Value> {
        let [a, b, c] = [i.a, i.b, i.c].map(|register| self.get(register));
        let two = |form: Form| Step::Two(form, a, b);
        let step = match op {
            Op::Add => two(ADD),
            Op::Sub => two(SUB),
            Op::Mul => two(MUL),
            Op::Div => two(DIV),
            Op::Min => two(MIN),
            Op::Max => two(MAX),
            Op::Neg => Step::Two(XOR, a, self.literal(Literal::Sign)),
            Op::Abs => Step::Two(AND, a, self.literal(Literal::Magnitude)),
            Op::Fma => Step::Fused(Signs::Plus, [a, b, c]),
            Op::Fms => Step::Fused(Signs::Minus, [a, b, c]),
            Op::Fnma => Step::Fused(Signs::Negated, [a, b, c]),
            Op::Sqrt => Step::Root(a),
            Op::Select => {
                let zero = self.literal(Literal::Zero);
                Step::Choose { x: a, y: zero, yes: b, no: c }
            }
            Op::Sign => {
                let [zero, one, minus] = [Literal::Zero, Literal::One, Literal::MinusOne]
                    .map(|which| self.literal(which));
                let below = Step::Choose { x: zero, y: a, yes: minus, no: zero };
                let no = self.list.push(below);
                Step::Choose { x: a, y: zero, yes: one, no }
            }
            op => Step::Call(function(op)?, [a, b, c]),
        };
        Some(self.list.push(step))
    }
}
