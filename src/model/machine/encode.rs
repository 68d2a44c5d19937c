//! Instructions in; their bytes out: the few forms that vector code needs, with AVX-512 (EVEX) or
//! AVX2 (VEX) prefixes.
//!
//! A vector instruction is `form reg, second, rm`: `reg` is written as a rule, `rm` is a register or
//! memory. Whoever calls it sees to it that a machine without AVX-512 is asked for registers below
//! 16 only, and for no number that is broadcast from memory.

/// A general register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Base {
    Rax = 0,
    Rcx = 1,
    Rdx = 2,
    Rbx = 3,
    Rsp = 4,
    Rbp = 5,
    Rsi = 6,
    Rdi = 7,
    R8 = 8,
    R9 = 9,
    R12 = 12,
    R13 = 13,
    R14 = 14,
    R15 = 15,
}

/// Memory: so many bytes behind what a register holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    pub base: Base,
    pub at: i32,
}

/// What an instruction reads last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rm {
    Register(u8),
    /// A whole vector.
    Vector(Place),
    /// One number, in all lanes (AVX-512), or by itself.
    Number(Place),
}

/// Prefix, map and number of an instruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Form {
    map: u8,
    prefix: u8,
    opcode: u8,
    /// Bit W without AVX-512.
    wide: bool,
}

const fn form(map: u8, prefix: u8, opcode: u8) -> Form {
    Form { map, prefix, opcode, wide: true }
}

pub const LOAD: Form = form(1, 1, 0x10);
pub const STORE: Form = form(1, 1, 0x11);
/// A number into the first lane; the others become zero.
pub const FIRST: Form = form(1, 3, 0x10);
pub const SPLAT: Form = Form { wide: false, ..form(2, 1, 0x19) };
pub const SQRT: Form = form(1, 1, 0x51);
pub const AND: Form = form(1, 1, 0x54);
pub const OR: Form = form(1, 1, 0x56);
pub const XOR: Form = form(1, 1, 0x57);
pub const ADD: Form = form(1, 1, 0x58);
pub const MUL: Form = form(1, 1, 0x59);
pub const SUB: Form = form(1, 1, 0x5c);
pub const MIN: Form = form(1, 1, 0x5d);
pub const DIV: Form = form(1, 1, 0x5e);
pub const MAX: Form = form(1, 1, 0x5f);
pub const COMPARE: Form = form(1, 1, 0xc2);
/// `rm` where the mask is set, else `second` (AVX-512); the same by the signs of a register.
pub const CHOOSE: Form = form(2, 1, 0x65);
const CHOOSE_BY_SIGN: Form = Form { wide: false, ..form(3, 1, 0x4b) };
/// Lanes of `rm` that the last byte names, else `second` (AVX2).
const CHOOSE_FIXED: Form = form(3, 1, 0x0d);
const STORE_MASKED: Form = Form { wide: false, ..form(2, 1, 0x2f) };
pub const ADD_WHOLE: Form = form(1, 1, 0xd4);
pub const SUB_WHOLE: Form = form(1, 1, 0xfb);
const SHIFT: Form = form(1, 1, 0x73);
const SIGNS: Form = form(1, 1, 0x50);

/// `x > y`, `x <= y` (false where one is no number).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    Greater = 0x1e,
    AtMost = 0x12,
}

/// Which two of three factors and terms are multiplied: the register that is written, the second
/// and the last are 1, 2 and 3.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sum {
    /// `1 * 3 + 2`.
    M132 = 0x98,
    /// `2 * 1 + 3`.
    M213 = 0xa8,
    /// `2 * 3 + 1`.
    M231 = 0xb8,
}

/// Signs of a fused multiply-add.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signs {
    /// `a b + c`.
    Plus = 0,
    /// `a b - c`.
    Minus = 2,
    /// `c - a b`.
    Negated = 4,
}

/// A fused multiply-add.
pub fn fused(sum: Sum, signs: Signs) -> Form {
    form(2, 1, sum as u8 + signs as u8)
}

/// A jump whose goal is filled in later.
#[derive(Debug)]
#[must_use]
pub struct Jump(usize);

/// Bytes of instructions, one after the other.
#[derive(Debug)]
pub struct Assembler {
    pub bytes: Vec<u8>,
    /// Eight numbers to a vector, and 32 registers; else four and 16.
    pub wide: bool,
}

impl Assembler {
    /// Bytes of a vector.
    pub fn vector(&self) -> i32 {
        if self.wide { 64 } else { 32 }
    }

    fn put(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// `form reg, second, rm`; without a second register that is 0.
    pub fn op(&mut self, form: Form, reg: u8, second: u8, rm: Rm) {
        self.masked(form, reg, second, rm, 0, false);
    }

    /// The same for lanes that mask `k` names (all if that is 0); others become zero or stay.
    pub fn masked(&mut self, form: Form, reg: u8, second: u8, rm: Rm, k: u8, zero: bool) {
        let numbered = match rm {
            Rm::Register(r) => (r >> 3 & 1, r >> 4),
            Rm::Vector(place) | Rm::Number(place) => (place.base as u8 >> 3, 0),
        };
        let single = form == FIRST || form == SPLAT;
        let number = matches!(rm, Rm::Number(_));
        if self.wide {
            let inverted = |bit: u8, at: u8| (!bit & 1) << at;
            let length = if form == FIRST { 0 } else { 2 };
            self.put(&[
                0x62,
                inverted(reg >> 3, 7)
                    | inverted(numbered.1, 6)
                    | inverted(numbered.0, 5)
                    | inverted(reg >> 4, 4)
                    | form.map,
                0x80 | (!second & 15) << 3 | 4 | form.prefix,
                u8::from(zero) << 7
                    | length << 5
                    | u8::from(number && !single) << 4
                    | inverted(second >> 4, 3)
                    | k,
                form.opcode,
            ]);
        } else {
            self.vex(form, reg, second, numbered.0, form != FIRST);
        }
        let scale = match (self.wide, number) {
            (false, _) => 1,
            (true, true) => 8,
            (true, false) => 64,
        };
        self.modrm(reg, rm, scale);
    }

    fn vex(&mut self, form: Form, reg: u8, second: u8, b: u8, long: bool) {
        self.put(&[
            0xc4,
            (!reg >> 3 & 1) << 7 | 1 << 6 | (!b & 1) << 5 | form.map,
            u8::from(form.wide) << 7 | (!second & 15) << 3 | u8::from(long) << 2 | form.prefix,
            form.opcode,
        ]);
    }

    fn modrm(&mut self, reg: u8, rm: Rm, scale: i32) {
        let reg = (reg & 7) << 3;
        let Place { base, at } = match rm {
            Rm::Register(r) => return self.put(&[0xc0 | reg | r & 7]),
            Rm::Vector(place) | Rm::Number(place) => place,
        };
        let low = base as u8 & 7;
        let short = i8::try_from(at / scale).ok().filter(|_| at % scale == 0);
        self.put(&[if short.is_some() { 0x40 } else { 0x80 } | reg | low]);
        if low == 4 {
            self.put(&[0x24]);
        }
        match short {
            Some(at) => self.put(&at.to_le_bytes()),
            None => self.put(&at.to_le_bytes()),
        }
    }

    /// `to = yes where x > y, else no`; `mask` is a register that may be spoilt.
    pub fn choose(&mut self, [to, yes, no]: [u8; 3], x: u8, y: Rm, mask: u8) {
        self.compare(x, y, Order::Greater, mask);
        if self.wide {
            self.masked(CHOOSE, to, no, Rm::Register(yes), 1, false);
        } else {
            self.op(CHOOSE_BY_SIGN, to, no, Rm::Register(yes));
            self.put(&[mask << 4]);
        }
    }

    /// Into mask 1, or into the register `mask`.
    fn compare(&mut self, x: u8, y: Rm, order: Order, mask: u8) {
        self.op(COMPARE, if self.wide { 1 } else { mask }, x, y);
        self.put(&[order as u8]);
    }

    /// Compares; the jump is taken unless it is true in all lanes. `mask` may be spoilt.
    pub fn unless(&mut self, x: u8, y: Rm, order: Order, mask: u8) -> Jump {
        self.compare(x, y, order, mask);
        if self.wide {
            self.put(&[0xc5, 0xf9, 0x98, 0xc9]); // kortestb k1, k1: carry if all are set
        } else {
            self.op(SIGNS, 0, 0, Rm::Register(mask));
            self.put(&[0x83, 0xf8, 0x0f]); // cmp eax, 15
        }
        self.unless_again()
    }

    /// The same jump again: no vector instruction changes what it depends on.
    pub fn unless_again(&mut self) -> Jump {
        self.put(&[0x0f, if self.wide { 0x83 } else { 0x85 }, 0, 0, 0, 0]);
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

    /// All lanes zero.
    pub fn zero(&mut self, to: u8) {
        if to < 16 {
            self.vex(XOR, to, to, to >> 3, false);
            self.put(&[0xc0 | (to & 7) << 3 | to & 7]);
        } else {
            self.op(XOR, to, to, Rm::Register(to));
        }
    }

    /// `op r64, r/m64` with a REX prefix.
    fn whole(&mut self, opcode: u8, reg: u8, rm: u8) {
        self.put(&[0x48 | (reg >> 3) << 2 | rm >> 3, opcode]);
    }

    /// `to = from`.
    pub fn copy(&mut self, to: Base, from: Base) {
        self.whole(0x89, from as u8, to as u8);
        self.put(&[0xc0 | (from as u8 & 7) << 3 | to as u8 & 7]);
    }

    pub fn add(&mut self, to: Base, number: i32) {
        self.whole(0x81, 0, to as u8);
        self.put(&[0xc0 | to as u8 & 7]);
        self.put(&number.to_le_bytes());
    }

    /// `to += from`.
    pub fn add_register(&mut self, to: Base, from: Base) {
        self.whole(0x01, from as u8, to as u8);
        self.put(&[0xc0 | (from as u8 & 7) << 3 | to as u8 & 7]);
    }

    /// `to = from + at`.
    pub fn address(&mut self, to: Base, Place { base, at }: Place) {
        self.whole(0x8d, to as u8, base as u8);
        self.modrm(to as u8, Rm::Vector(Place { base, at }), 1);
    }

    pub fn number(&mut self, to: Base, number: u64) {
        self.put(&[0x48 | to as u8 >> 3, 0xb8 | to as u8 & 7]);
        self.put(&number.to_le_bytes());
    }

    /// `to` from memory.
    pub fn fetch(&mut self, to: Base, from: Place) {
        self.whole(0x8b, to as u8, from.base as u8);
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

/// A frame whose size is not known yet.
#[derive(Debug)]
#[must_use]
pub struct Frame(usize);
