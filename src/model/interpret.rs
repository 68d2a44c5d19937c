//! The interpreter: a list of operations run over lanes of `W` independent evaluations, with the
//! vectors this machine has.

use super::arithmetic::{REACH, SMALL, apply, sin_cos_near, sin_cos_small};
use super::graph::Op;
use super::instruction::{Code, Instruction};
use super::tables::Tables;
use crate::math::simd::Width;

/// Runs `list` on the registers at `file`.
///
/// # Safety
/// `file` points to more registers than any instruction names; the machine has `width`.
#[inline]
pub unsafe fn execute<const W: usize>(
    width: Width,
    list: &[Instruction],
    file: *mut [f64; W],
    tables: &Tables,
) {
    // SAFETY: handed on.
    unsafe {
        match width {
            #[cfg(target_arch = "x86_64")]
            Width::Avx512 if W >= 8 => avx512(list, file, tables),
            #[cfg(target_arch = "x86_64")]
            Width::Avx512 | Width::Avx2 => avx2(list, file, tables),
            _ => plain(list, file, tables),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,fma,bmi2")]
unsafe fn avx512<const W: usize>(list: &[Instruction], file: *mut [f64; W], tables: &Tables) {
    // SAFETY: handed on.
    unsafe { plain(list, file, tables) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi2")]
unsafe fn avx2<const W: usize>(list: &[Instruction], file: *mut [f64; W], tables: &Tables) {
    // SAFETY: handed on.
    unsafe { plain(list, file, tables) }
}

/// # Safety
/// As `execute`.
#[inline(always)]
unsafe fn plain<const W: usize>(list: &[Instruction], file: *mut [f64; W], tables: &Tables) {
    for i in list {
        // SAFETY of both: all register numbers are inside the file, and no result is borrowed while
        // another is written.
        let get = |register: u32| unsafe { &*file.add(register as usize) };
        // every operation writes its own result: a common one would go through memory
        let put = |register: u32, out: [f64; W]| unsafe { *file.add(register as usize) = out };
        macro_rules! lanes {
            (|$a:ident| $e:expr) => {{
                let a = get(i.a);
                put(
                    i.to,
                    std::array::from_fn(|l| {
                        let $a = a[l];
                        $e
                    }),
                );
            }};
            (|$a:ident, $b:ident| $e:expr) => {{
                let (a, b) = (get(i.a), get(i.b));
                put(
                    i.to,
                    std::array::from_fn(|l| {
                        let ($a, $b) = (a[l], b[l]);
                        $e
                    }),
                );
            }};
            (|$a:ident, $b:ident, $c:ident| $e:expr) => {{
                let (a, b, c) = (get(i.a), get(i.b), get(i.c));
                put(
                    i.to,
                    std::array::from_fn(|l| {
                        let ($a, $b, $c) = (a[l], b[l], c[l]);
                        $e
                    }),
                );
            }};
        }
        match i.code {
            Code::Op(Op::Add) => lanes!(|a, b| a + b),
            Code::Op(Op::Sub) => lanes!(|a, b| a - b),
            Code::Op(Op::Mul) => lanes!(|a, b| a * b),
            Code::Op(Op::Fma) => lanes!(|a, b, c| a.mul_add(b, c)),
            Code::Op(Op::Fms) => lanes!(|a, b, c| a.mul_add(b, -c)),
            Code::Op(Op::Fnma) => lanes!(|a, b, c| (-a).mul_add(b, c)),
            Code::Op(Op::Div) => lanes!(|a, b| a / b),
            Code::Op(Op::Neg) => lanes!(|a| -a),
            Code::Op(Op::Sqrt) => lanes!(|a| a.sqrt()),
            Code::Op(Op::Select) => lanes!(|a, b, c| if a > 0.0 { b } else { c }),
            Code::Op(Op::Min) => lanes!(|a, b| if b > a { a } else { b }),
            Code::Op(Op::Max) => lanes!(|a, b| if a > b { a } else { b }),
            Code::SinCos => {
                let (sin, cos) = sin_cos_lanes(get(i.a));
                put(i.to, sin);
                put(i.b, cos);
            }
            Code::Op(Op::Sin) => put(i.to, sin_cos_lanes(get(i.a)).0),
            Code::Op(Op::Cos) => put(i.to, sin_cos_lanes(get(i.a)).1),
            Code::Op(op @ (Op::Table | Op::TableSlope)) => {
                lanes!(|a, b| tables.one(b, a, op == Op::TableSlope))
            }
            Code::Op(op @ (Op::Table2 | Op::Table2SlopeX | Op::Table2SlopeY)) => {
                let part =
                    usize::from(op == Op::Table2SlopeX) + 2 * usize::from(op == Op::Table2SlopeY);
                lanes!(|a, b, c| tables.two(c, a, b)[part]);
            }
            Code::Op(op) => lanes!(|a, b, c| apply(op, a, b, c)),
        }
    }
}

#[inline(always)]
fn sin_cos_lanes<const W: usize>(x: &[f64; W]) -> ([f64; W], [f64; W]) {
    let (mut sin, mut cos, mut small) = ([0.0; W], [0.0; W], true);
    // angles of flight are small as a rule
    for x in x {
        small &= x.abs() <= SMALL;
    }
    if small {
        for l in 0..W {
            (sin[l], cos[l]) = sin_cos_small(x[l]);
        }
        return (sin, cos);
    }
    let mut near = true;
    for l in 0..W {
        (sin[l], cos[l]) = sin_cos_near(x[l]);
        near &= x[l].abs() <= REACH;
    }
    if !near {
        for l in (0..W).filter(|&l| !(x[l].abs() <= REACH)) {
            (sin[l], cos[l]) = (libm::sin(x[l]), libm::cos(x[l]));
        }
    }
    (sin, cos)
}
