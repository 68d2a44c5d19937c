//! The numbers that vector code reads, each in eight lanes, so that any width finds a vector of it.

use super::encode::{Base, Place};
use crate::model::arithmetic::{COS, HALF_PI, REACH, ROUND, SIN, SMALL, TWO_OVER_PI};

/// Where they stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Literal {
    Sin = 0,
    Cos = 6,
    HalfPi = 12,
    TwoOverPi = 15,
    Round,
    MinusHalf,
    One,
    MinusOne,
    Zero,
    Reach,
    Small,
    /// All bits but the sign; the sign; the lowest bit.
    Magnitude,
    Sign,
    Lowest,
    /// So many ones, then as many zeros.
    Mask,
}

const COUNT: usize = Literal::Mask as usize + 1;

#[repr(C, align(64))]
struct Literals([[f64; 8]; COUNT]);

static LITERALS: Literals = Literals(literals());

const fn literals() -> [[f64; 8]; COUNT] {
    let mut out = [[0.0; 8]; COUNT];
    let mut k = 0;
    while k < 6 {
        (out[k], out[Literal::Cos as usize + k]) = ([SIN[k]; 8], [COS[k]; 8]);
        if k < 3 {
            out[Literal::HalfPi as usize + k] = [HALF_PI[k]; 8];
        }
        k += 1;
    }
    out[Literal::TwoOverPi as usize] = [TWO_OVER_PI; 8];
    out[Literal::Round as usize] = [ROUND; 8];
    out[Literal::MinusHalf as usize] = [-0.5; 8];
    out[Literal::One as usize] = [1.0; 8];
    out[Literal::MinusOne as usize] = [-1.0; 8];
    out[Literal::Reach as usize] = [REACH; 8];
    out[Literal::Small as usize] = [SMALL; 8];
    out[Literal::Magnitude as usize] = [f64::from_bits(!(1 << 63)); 8];
    out[Literal::Sign as usize] = [-0.0; 8];
    out[Literal::Lowest as usize] = [f64::from_bits(1); 8];
    let set = f64::from_bits(u64::MAX);
    out[Literal::Mask as usize] = [set, set, set, set, 0.0, 0.0, 0.0, 0.0];
    out
}

/// What `Base::R12` holds.
pub fn address() -> u64 {
    LITERALS.0.as_ptr() as u64
}

pub fn place(which: Literal) -> Place {
    behind(which, 0)
}

/// The `k`th one behind it.
pub fn behind(which: Literal, k: usize) -> Place {
    Place { base: Base::R12, at: 64 * (which as usize + k) as i32 }
}

/// A mask of the first `n` lanes of four.
pub fn first(n: u8) -> Place {
    let Place { base, at } = place(Literal::Mask);
    Place { base, at: at + 8 * (4 - i32::from(n)) }
}
