//! Instructions in; their bytes out: the few forms that vector code needs, with AVX-512 (EVEX) or
//! AVX2 (VEX) prefixes, the latter also for one number at a time.
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
    Rsi = 6,
    Rdi = 7,
    R8 = 8,
    R9 = 9,
    R12 = 12,
    R13 = 13,
    R14 = 14,
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
    /// Added to the number where there is one number at a time, with the prefix of those; all bits
    /// of a register else.
    single: Option<u8>,
}

/// Prefix of instructions for one number.
const SINGLE: u8 = 3;

const fn form(map: u8, prefix: u8, opcode: u8) -> Form {
    Form { map, prefix, opcode, wide: true, single: None }
}

/// The same for numbers, as many as there are.
const fn numbers(map: u8, opcode: u8, single: u8) -> Form {
    Form { single: Some(single), ..form(map, 1, opcode) }
}

pub const LOAD: Form = numbers(1, 0x10, 0);
pub const STORE: Form = numbers(1, 0x11, 0);
/// A number into the first lane; the others become zero.
pub const FIRST: Form = form(1, SINGLE, 0x10);
pub const SPLAT: Form = Form { wide: false, ..form(2, 1, 0x19) };
pub const SQRT: Form = numbers(1, 0x51, 0);
pub const AND: Form = form(1, 1, 0x54);
pub const XOR: Form = form(1, 1, 0x57);
pub const ADD: Form = numbers(1, 0x58, 0);
pub const MUL: Form = numbers(1, 0x59, 0);
pub const SUB: Form = numbers(1, 0x5c, 0);
pub const MIN: Form = numbers(1, 0x5d, 0);
pub const DIV: Form = numbers(1, 0x5e, 0);
pub const MAX: Form = numbers(1, 0x5f, 0);
pub const COMPARE: Form = numbers(1, 0xc2, 0);
/// `rm` where the mask is set, else `second` (AVX-512); the same by the signs of a register.
pub const CHOOSE: Form = form(2, 1, 0x65);
pub const CHOOSE_BY_SIGN: Form = Form { wide: false, ..form(3, 1, 0x4b) };
/// Lanes of `rm` that the last byte names, else `second` (AVX2).
pub const CHOOSE_FIXED: Form = form(3, 1, 0x0d);
pub const STORE_MASKED: Form = Form { wide: false, ..form(2, 1, 0x2f) };
pub const ADD_WHOLE: Form = form(1, 1, 0xd4);
pub const SUB_WHOLE: Form = form(1, 1, 0xfb);
pub const SHIFT: Form = form(1, 1, 0x73);
pub const SIGNS: Form = form(1, 1, 0x50);

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
    numbers(2, sum as u8 + signs as u8, 1)
}

/// Numbers of a vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Vector {
    One = 1,
    Four = 4,
    /// With 32 registers, masks, and numbers that are broadcast from memory.
    Eight = 8,
}

/// Bytes of instructions, one after the other.
#[derive(Debug)]
pub struct Assembler {
    pub bytes: Vec<u8>,
    pub vector: Vector,
}

impl Assembler {
    pub fn new(vector: Vector) -> Assembler {
        Assembler { bytes: Vec::new(), vector }
    }

    pub fn wide(&self) -> bool {
        self.vector == Vector::Eight
    }

    pub(super) fn put(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// `form reg, second, rm`; without a second register that is 0.
    pub fn op(&mut self, form: Form, reg: u8, second: u8, rm: Rm) {
        self.masked(form, reg, second, rm, 0, false);
    }

    /// The same for lanes that mask `k` names (all if that is 0); others become zero or stay.
    pub fn masked(&mut self, form: Form, reg: u8, second: u8, rm: Rm, k: u8, zero: bool) {
        let form = self.fitting(form, rm);
        let numbered = match rm {
            Rm::Register(r) => (r >> 3 & 1, r >> 4),
            Rm::Vector(place) | Rm::Number(place) => (place.base as u8 >> 3, 0),
        };
        let single = form == FIRST || form == SPLAT;
        let number = matches!(rm, Rm::Number(_));
        if self.wide() {
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
            self.vex(form, reg, second, numbered.0, self.vector == Vector::Four && form != FIRST);
        }
        let scale = match (self.wide(), number) {
            (false, _) => 1,
            (true, true) => 8,
            (true, false) => 64,
        };
        self.modrm(reg, rm, scale);
    }

    /// The form of an instruction for so many numbers.
    fn fitting(&self, form: Form, rm: Rm) -> Form {
        match (self.vector, form.single) {
            (Vector::One, _) if form == SPLAT => FIRST,
            // a register is copied as a whole
            (Vector::One, Some(_)) if form == LOAD && matches!(rm, Rm::Register(_)) => form,
            (Vector::One, Some(more)) => Form {
                prefix: if form.map == 1 { SINGLE } else { 1 },
                opcode: form.opcode + more,
                ..form
            },
            _ => form,
        }
    }

    fn vex(&mut self, form: Form, reg: u8, second: u8, b: u8, long: bool) {
        self.put(&[
            0xc4,
            (!reg >> 3 & 1) << 7 | 1 << 6 | (!b & 1) << 5 | form.map,
            u8::from(form.wide) << 7 | (!second & 15) << 3 | u8::from(long) << 2 | form.prefix,
            form.opcode,
        ]);
    }

    pub(super) fn modrm(&mut self, reg: u8, rm: Rm, scale: i32) {
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

    /// All lanes zero.
    pub fn zero(&mut self, to: u8) {
        if to < 16 {
            self.vex(XOR, to, to, to >> 3, false);
            self.put(&[0xc0 | (to & 7) << 3 | to & 7]);
        } else {
            self.op(XOR, to, to, Rm::Register(to));
        }
    }
}
