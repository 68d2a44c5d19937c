//! A program of rates in; machine code that takes states through Runge-Kutta steps, number by number,
//! with the interpreter's bits (`dynamics::propagate` says which), out.

use super::builder::Builder;
use super::encode::{Assembler, Base};
use super::list::{List, Step, Value};
use super::memory::Code;
use super::points::number;
use super::writer::Writer;
use crate::math::simd::Width;
use crate::model::program::Program;
use crate::model::tables::Tables;

/// Rates as machine code, the four stages of a step one after the other.
#[derive(Debug)]
pub struct Chain {
    code: Code,
    width: usize,
    registers: usize,
    states: usize,
}

impl Chain {
    /// The outputs of `program` are the rates of the states, the first registers; those below
    /// `width` are read from a point, all others from the prepared register file. `None` where there
    /// is no code, or for an operation.
    pub fn compile(program: &Program, width: usize, vectors: Width) -> Option<Chain> {
        let (mut builder, list) = (Builder::new(vectors, true)?, step(program, width)?);
        // file, points, steps, states, tables, weights
        let begin = |asm: &mut Assembler| {
            asm.copy(Base::Rbx, Base::Rdi);
            asm.copy(Base::R13, Base::Rdx);
            asm.copy(Base::R14, Base::R8);
        };
        let next = |asm: &mut Assembler| asm.add(Base::Rsi, 4 * 8 * width as i32);
        builder.function(begin, &list, next, Base::R13);
        let (registers, states) = (program.file_len(), program.outputs());
        Some(Chain { code: builder.finish()?, width, registers, states })
    }

    /// Takes the states `x` through steps: `points` holds four rows of the width per step, whose
    /// states are filled in. `weights`: per stage the weight of its rates and how far they lead to
    /// the next stage, then what the weighed sum is multiplied by.
    pub fn march(
        &self,
        file: &[[f64; 1]],
        points: &mut [f64],
        x: &mut [f64],
        weights: &[f64; 9],
        tables: &Tables,
    ) {
        let steps = points.len() / (4 * self.width);
        assert!(file.len() >= self.registers, "a register file of another program");
        assert!(x.len() == self.states, "one rate per state");
        let arguments = [
            file.as_ptr() as usize,
            points.as_mut_ptr() as usize,
            steps,
            x.as_mut_ptr() as usize,
            std::ptr::from_ref(tables) as usize,
            weights.as_ptr() as usize,
        ];
        if steps > 0 {
            // SAFETY: the code reads registers below `registers`, four rows per step and the
            // weights, and writes states there and in `x`.
            unsafe { self.code.call(0, arguments) }
        }
    }
}

/// One step.
fn step(program: &Program, width: usize) -> Option<List> {
    let mut list = List::default();
    let n = program.outputs();
    let leaf = |list: &mut List, base, at| list.push(Step::Vector(number(base, at)));
    let start: Vec<Value> = (0..n).map(|k| leaf(&mut list, Base::Rcx, k)).collect();
    let zero = list.push(Step::Zero);
    let (mut at, mut sums) = (start.clone(), vec![zero; n]);
    for stage in 0..4 {
        let row = stage * width;
        let place = |register: u32| match register as usize {
            register if register < width => number(Base::Rsi, row + register),
            register => number(Base::Rbx, register),
        };
        let mut writer = Writer { list, ..Writer::new(&place) };
        for (k, &x) in at.iter().enumerate() {
            writer.values.insert(k as u32, x);
            writer.list.push(Step::Store(x, number(Base::Rsi, row + k)));
        }
        program.body().iter().try_for_each(|i| writer.instruction(i))?;
        let rates: Vec<Value> = (0..n).map(|k| writer.get(program.register(k) as u32)).collect();
        list = writer.list;
        let [weight, ahead] = [0, 1].map(|k| leaf(&mut list, Base::R9, 2 * stage + k));
        for (k, rate) in rates.into_iter().enumerate() {
            if stage < 3 {
                at[k] = list.fused(ahead, rate, start[k]);
            }
            sums[k] = list.fused(weight, rate, sums[k]);
        }
    }
    let h6 = leaf(&mut list, Base::R9, 8);
    for k in 0..n {
        let x = list.fused(h6, sums[k], start[k]);
        list.push(Step::Store(x, number(Base::Rcx, k)));
    }
    Some(list)
}
