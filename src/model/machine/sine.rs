//! Sine and cosine over lanes, operation by operation as in `arithmetic`: small angles straight on;
//! the reduction of others, and angles out of its reach, behind the end of the function.

use super::control::{Jump, Order};
use super::encode::{
    ADD, ADD_WHOLE, AND, Assembler, LOAD, MUL, Rm, STORE, SUB, SUB_WHOLE, Signs, Sum, XOR, fused,
};
use super::frame::{argument, call, saved};
use super::functions::sines;
use super::literals::{self, Literal};

/// Which registers are used; the spare ones are spoilt.
#[derive(Debug, Clone, Copy)]
pub struct Registers {
    pub x: u8,
    pub sin: u8,
    pub cos: u8,
    pub spare: [u8; 8],
}

/// One of them, of which the rare parts are still to be written.
#[derive(Debug)]
pub struct Sine {
    registers: Registers,
    /// Registers that a function must not spoil.
    live: Vec<u8>,
    /// Away from angles that are not all small, and back.
    large: Jump,
    reduced: usize,
    /// Away to the quadrants, and back.
    turned: Jump,
    end: usize,
}

fn literal(which: Literal) -> Rm {
    Rm::Vector(literals::place(which))
}

/// `reg = second * reg + last`.
fn sum(asm: &mut Assembler, reg: u8, second: u8, last: Rm) {
    asm.op(fused(Sum::M213, Signs::Plus), reg, second, last);
}

/// Six coefficients in powers of z into `to`.
fn polynomial(asm: &mut Assembler, to: u8, first: Literal, [z, z2, z4, t, u]: [u8; 5]) {
    let coefficient = |k| Rm::Vector(literals::behind(first, k));
    for (reg, high) in [(to, 5), (t, 3), (u, 1)] {
        asm.op(LOAD, reg, 0, coefficient(high));
        sum(asm, reg, z, coefficient(high - 1));
    }
    sum(asm, t, z2, Rm::Register(u));
    sum(asm, to, z4, Rm::Register(t));
}

impl Sine {
    pub fn begin(asm: &mut Assembler, registers: Registers, live: Vec<u8>) -> Sine {
        let Registers { x, sin, cos, spare: [r, tail, _, z, z2, z4, t, u] } = registers;
        asm.op(AND, t, x, literal(Literal::Magnitude));
        let large = asm.unless(t, literal(Literal::Small), Order::AtMost, u);
        asm.op(LOAD, r, 0, Rm::Register(x));
        asm.op(ADD, tail, x, literal(Literal::Zero));
        let reduced = asm.bytes.len();
        asm.op(MUL, z, r, Rm::Register(r));
        asm.op(MUL, z2, z, Rm::Register(z));
        asm.op(MUL, z4, z2, Rm::Register(z2));
        polynomial(asm, sin, Literal::Sin, [z, z2, z4, t, u]);
        polynomial(asm, cos, Literal::Cos, [z, z2, z4, t, u]);
        asm.op(MUL, r, r, Rm::Register(z));
        sum(asm, sin, r, Rm::Register(tail));
        asm.op(LOAD, t, 0, literal(Literal::MinusHalf));
        sum(asm, t, z, literal(Literal::One));
        sum(asm, cos, z2, Rm::Register(t));
        let turned = asm.unless_again();
        Sine { registers, live, large, reduced, turned, end: asm.bytes.len() }
    }

    pub fn finish(self, asm: &mut Assembler) {
        let here = asm.bytes.len();
        asm.lands(self.large, here);
        let far = reduce(asm, self.registers);
        // so that the second jump is taken as well
        asm.bytes.extend([0x48, 0x85, 0xe4]); // test rsp, rsp
        let back = asm.jump();
        asm.lands(back, self.reduced);

        let here = asm.bytes.len();
        asm.lands(self.turned, here);
        turn(asm, self.registers);
        let back = asm.jump();
        asm.lands(back, self.end);

        let here = asm.bytes.len();
        asm.lands(far, here);
        asm.op(STORE, self.registers.x, 0, Rm::Vector(argument(0)));
        self.live.iter().for_each(|&r| asm.op(STORE, r, 0, Rm::Vector(saved(r))));
        call(asm, sines);
        self.live.iter().for_each(|&r| asm.op(LOAD, r, 0, Rm::Vector(saved(r))));
        asm.op(LOAD, self.registers.sin, 0, Rm::Vector(argument(0)));
        asm.op(LOAD, self.registers.cos, 0, Rm::Vector(argument(1)));
        let back = asm.jump();
        asm.lands(back, self.end);
    }
}

/// `x = k pi/2 + r`; away where that is out of reach.
fn reduce(asm: &mut Assembler, registers: Registers) -> Jump {
    let Registers { x, spare: [r, tail, q, z, _, _, t, k], .. } = registers;
    let far = asm.unless(t, literal(Literal::Reach), Order::AtMost, k);
    asm.op(LOAD, q, 0, literal(Literal::TwoOverPi));
    sum(asm, q, x, literal(Literal::Round));
    asm.op(SUB, k, q, literal(Literal::Round));
    for (to, part, from) in [(z, 0, x), (r, 1, z), (tail, 2, r)] {
        asm.op(LOAD, to, 0, Rm::Vector(literals::behind(Literal::HalfPi, part)));
        asm.op(fused(Sum::M213, Signs::Negated), to, k, Rm::Register(from));
    }
    far
}

/// Odd quadrants swap the two, the second bit is the sign.
fn turn(asm: &mut Assembler, registers: Registers) {
    let Registers { sin, cos, spare: [_, _, q, swap, _, _, t, u], .. } = registers;
    asm.op(AND, t, q, literal(Literal::Lowest));
    asm.zero(u);
    asm.op(SUB_WHOLE, u, u, Rm::Register(t));
    asm.op(XOR, swap, sin, Rm::Register(cos));
    asm.op(AND, swap, swap, Rm::Register(u));
    asm.shift(t, q, 62);
    asm.op(AND, t, t, literal(Literal::Sign));
    asm.op(ADD_WHOLE, q, q, literal(Literal::Lowest));
    asm.shift(u, q, 62);
    asm.op(AND, u, u, literal(Literal::Sign));
    for (to, sign) in [(sin, t), (cos, u)] {
        asm.op(XOR, to, to, Rm::Register(swap));
        asm.op(XOR, to, to, Rm::Register(sign));
    }
}
