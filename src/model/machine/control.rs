//! What is more than one form of `encode`: choices, jumps, general registers, calls and frames.

use super::encode::{
    Assembler, Base, CHOOSE, CHOOSE_BY_SIGN, CHOOSE_FIXED, COMPARE, Place, Rm, SHIFT, SIGNS, SPLAT,
    STORE_MASKED,
};

/// `x > y`, `x <= y` (false where one is no number).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    Greater = 0x1e,
    AtMost = 0x12,
}

/// A jump whose goal is filled in later.
#[derive(Debug)]
#[must_use]
pub struct Jump(usize);

/// A frame whose size is not known yet.
#[derive(Debug)]
#[must_use]
pub struct Frame(usize);

impl Assembler {
    /// `to = yes where x > y, else no`; `mask` is a register that may be spoilt.
    pub fn choose(&mut self, [to, yes, no]: [u8; 3], x: u8, y: Rm, mask: u8) {
        self.compare(x, y, Order::Greater, mask);
        if self.wide() {
            self.masked(CHOOSE, to, no, Rm::Register(yes), 1, false);
        } else {
            self.op(CHOOSE_BY_SIGN, to, no, Rm::Register(yes));
            self.put(&[mask << 4]);
        }
    }

    /// Into mask 1, or into the register `mask`.
    fn compare(&mut self, x: u8, y: Rm, order: Order, mask: u8) {
        self.op(COMPARE, if self.wide() { 1 } else { mask }, x, y);
        self.put(&[order as u8]);
    }

    /// Compares; the jump is taken unless it is true in all lanes. `mask` may be spoilt.
    pub fn unless(&mut self, x: u8, y: Rm, order: Order, mask: u8) -> Jump {
        self.compare(x, y, order, mask);
        if self.wide() {
            self.put(&[0xc5, 0xf9, 0x98, 0xc9]); // kortestb k1, k1: carry if all are set
        } else {
            let all = (1 << self.vector as u8) - 1;
            self.op(SIGNS, 0, 0, Rm::Register(mask));
            self.put(&[0x83, 0xe0, all, 0x83, 0xf8, all]); // and eax, all; cmp eax, all
        }
        self.unless_again()
    }

    /// The same jump again: no vector instruction changes what it depends on.
    pub fn unless_again(&mut self) -> Jump {
        self.put(&[0x0f, if self.wide() { 0x83 } else { 0x85 }, 0, 0, 0, 0]);
        Jump(self.bytes.len())
    }

    pub fn jump(&mut self) -> Jump {
        self.put(&[0xe9, 0, 0, 0, 0]);
        Jump(self.bytes.len())
    }

    /// The jump leads to `goal`.
    pub fn lands(&mut self, jump: Jump, goal: usize) {
        let distance = goal as i64 - jump.0 as i64;
        self.bytes[jump.0 - 4..jump.0].copy_from_slice(&(distance as i32).to_le_bytes());
    }

    /// `to = from << count`, whole numbers.
    pub fn shift(&mut self, to: u8, from: u8, count: u8) {
        // the register that is written stands where others have their second one
        self.op(SHIFT, 6, to, Rm::Register(from));
        self.put(&[count]);
    }

    /// Mask `k` has the bits of `bits` (AVX-512).
    pub fn mask(&mut self, k: u8, bits: u8) {
        self.put(&[0xb8, bits, 0, 0, 0, 0xc5, 0xf9, 0x92, 0xc0 | k << 3]); // mov eax; kmovb
    }

    /// The number at `place` into lane `lane` of `to`, whose other lanes are `before`'s (AVX2;
    /// `spare` may be spoilt).
    pub fn insert(&mut self, to: u8, before: u8, lane: u8, place: Place, spare: u8) {
        self.op(SPLAT, spare, 0, Rm::Number(place));
        self.op(CHOOSE_FIXED, to, before, Rm::Register(spare));
        self.put(&[1 << lane]);
    }

    /// The lanes of `from` that are set in `mask` (AVX2).
    pub fn store_masked(&mut self, from: u8, mask: u8, place: Place) {
        self.op(STORE_MASKED, from, mask, Rm::Vector(place));
    }

    /// `opcode` for two whole registers.
    fn whole(&mut self, opcode: u8, reg: u8, rm: Base) {
        let rm = rm as u8;
        self.put(&[0x48 | (reg >> 3) << 2 | rm >> 3, opcode, 0xc0 | (reg & 7) << 3 | rm & 7]);
    }

    /// `to = from`.
    pub fn copy(&mut self, to: Base, from: Base) {
        self.whole(0x89, from as u8, to);
    }

    pub fn add(&mut self, to: Base, number: i32) {
        self.whole(0x81, 0, to);
        self.put(&number.to_le_bytes());
    }

    /// `to += from`.
    pub fn add_register(&mut self, to: Base, from: Base) {
        self.whole(0x01, from as u8, to);
    }

    pub fn number(&mut self, to: Base, number: u64) {
        self.put(&[0x48 | to as u8 >> 3, 0xb8 | to as u8 & 7]);
        self.put(&number.to_le_bytes());
    }

    /// `to` from memory.
    pub fn fetch(&mut self, to: Base, from: Place) {
        self.put(&[0x48 | (to as u8 >> 3) << 2 | from.base as u8 >> 3, 0x8b]);
        self.modrm(to as u8, Rm::Vector(from), 1);
    }

    /// Counts `counter` down and goes on at `again` unless it is zero.
    pub fn repeat(&mut self, counter: Base, again: usize) {
        self.add(counter, -1);
        self.put(&[0x0f, 0x85, 0, 0, 0, 0]);
        self.lands(Jump(self.bytes.len()), again);
    }

    /// Calls `function`, with the vectors' upper halves clean, as others expect them.
    pub fn call(&mut self, function: *const u8) {
        self.number(Base::Rax, function as u64);
        self.put(&[0xc5, 0xf8, 0x77, 0xff, 0xd0]);
    }

    pub fn push(&mut self, base: Base) {
        self.put(&[0x40 | base as u8 >> 3, 0x50 | base as u8 & 7]);
    }

    pub fn pop(&mut self, base: Base) {
        self.put(&[0x40 | base as u8 >> 3, 0x58 | base as u8 & 7]);
    }

    /// Opens a function with a frame of so many bytes, filled in by `frame` later.
    pub fn enter(&mut self) -> Frame {
        // push rbp, rbx, r12, r13, r14; then rbp = rsp
        self.put(&[0x55, 0x53, 0x41, 0x54, 0x41, 0x55, 0x41, 0x56, 0x48, 0x89, 0xe5]);
        self.add(Base::Rsp, 0);
        let frame = Frame(self.bytes.len());
        self.put(&[0x48, 0x83, 0xe4, 0xc0]); // and rsp, -64
        frame
    }

    pub fn leave(&mut self, frame: Frame, size: usize) {
        self.bytes[frame.0 - 4..frame.0].copy_from_slice(&(-(size as i32)).to_le_bytes());
        // rsp = rbp; pop r14, r13, r12, rbx, rbp
        self.put(&[0xc5, 0xf8, 0x77, 0x48, 0x89, 0xec]);
        self.put(&[0x41, 0x5e, 0x41, 0x5d, 0x41, 0x5c, 0x5b, 0x5d, 0xc3]);
    }
}
