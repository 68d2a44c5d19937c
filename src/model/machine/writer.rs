//! Instructions of a program in; steps that do the same, operation by operation, out.

use std::collections::HashMap;

use super::encode::{ADD, AND, DIV, Form, MAX, MIN, MUL, Place, SUB, Signs, XOR};
use super::functions::function;
use super::list::{List, Step, Value};
use super::literals::{self, Literal};
use crate::model::instruction::{Code, Instruction};
use crate::model::op::Op;

/// Steps, and what they have of each register.
pub struct Writer<'p> {
    pub list: List,
    pub values: HashMap<u32, Value>,
    /// Where a register stands that no instruction has written.
    pub place: &'p dyn Fn(u32) -> Place,
}

impl<'p> Writer<'p> {
    pub fn new(place: &'p dyn Fn(u32) -> Place) -> Self {
        Writer { list: List::default(), values: HashMap::new(), place }
    }

    /// What a register holds.
    pub fn get(&mut self, register: u32) -> Value {
        let (list, place) = (&mut self.list, self.place);
        *self.values.entry(register).or_insert_with(|| list.push(Step::Vector(place(register))))
    }

    fn literal(&mut self, which: Literal) -> Value {
        self.list.push(Step::Vector(literals::place(which)))
    }

    /// `None` if there is nothing that does it.
    pub fn instruction(&mut self, i: &Instruction) -> Option<()> {
        let value = match i.code {
            Code::SinCos | Code::Op(Op::Sin | Op::Cos) => {
                let x = self.get(i.a);
                let sin = self.list.push(Step::Sine(x));
                let cos = self.list.push(Step::Cosine);
                if i.code == Code::SinCos {
                    self.values.insert(i.b, cos);
                }
                if i.code == Code::Op(Op::Cos) { cos } else { sin }
            }
            Code::Op(op) => self.operation(op, i)?,
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
