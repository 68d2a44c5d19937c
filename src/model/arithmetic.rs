//! One operation on numbers: the reference that every evaluator (interpreter at any width, native
//! code) follows to the bit.
//!
//! Sine and cosine are one polynomial of our own, because models ask for both of one argument all
//! the time and it runs over lanes; all other functions are those of `libm`, which are the same on
//! every machine. Multiply-adds are fused (rounded once) wherever the graph says so and nowhere
//! else. So results differ between machines nowhere, except in the unused bits of a NaN.

// The coefficients are written with the digits of their source.
#![allow(clippy::excessive_precision)]

use super::op::Op;

/// Largest argument, rad, for which the polynomial's reduction is exact enough; beyond it `libm`
/// takes over.
pub const REACH: f64 = 1e5;
/// Up to here, just below pi/4, the reduction leaves an argument as it is: whoever knows that may
/// leave the reduction away.
pub const SMALL: f64 = 0.785;
/// Adding this rounds a number of moderate size to a whole one, which then stands in the lowest
/// bits.
pub const ROUND: f64 = 6755399441055744.0;
pub const TWO_OVER_PI: f64 = std::f64::consts::FRAC_2_PI;
/// pi/2 in three parts of full precision each (Cody and Waite).
pub const HALF_PI: [f64; 3] =
    [std::f64::consts::FRAC_PI_2, 6.123233995736766e-17, -1.497384904859169e-33];
/// (sin(r) - r)/r^3 in powers of r^2 on |r| <= pi/4: the minimax coefficients of fdlibm.
pub const SIN: [f64; 6] = [
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
];
/// (cos(r) - 1 + r^2/2)/r^4 in powers of r^2, likewise.
pub const COS: [f64; 6] = [
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
];

/// Sine and cosine of `x`, within 1 ulp.
#[inline(always)]
pub fn sin_cos(x: f64) -> (f64, f64) {
    if x.abs() <= REACH { sin_cos_near(x) } else { (libm::sin(x), libm::cos(x)) }
}

/// The same for |x| <= `REACH`; anything else gives nonsense, but no trap.
#[inline(always)]
pub fn sin_cos_near(x: f64) -> (f64, f64) {
    // x = k pi/2 + r; the first difference is exact, the third part matters only where r is tiny
    let rounded = x.mul_add(TWO_OVER_PI, ROUND);
    let k = rounded - ROUND;
    let r = (-k).mul_add(HALF_PI[0], x);
    let r = (-k).mul_add(HALF_PI[1], r);
    let tail = (-k).mul_add(HALF_PI[2], r);
    let (sin, cos) = polynomials(r, tail);
    let (sin, cos) = (sin.to_bits(), cos.to_bits());
    // odd quadrants swap the two, the second bit is the sign
    let q = rounded.to_bits();
    let swap = (sin ^ cos) & 0u64.wrapping_sub(q & 1);
    let (sin_sign, cos_sign) = ((q << 62) & (1 << 63), (q.wrapping_add(1) << 62) & (1 << 63));
    (f64::from_bits(sin ^ swap ^ sin_sign), f64::from_bits(cos ^ swap ^ cos_sign))
}

/// The same for |x| <= `SMALL`, with the same bits.
#[inline(always)]
pub fn sin_cos_small(x: f64) -> (f64, f64) {
    // the third part of the reduction makes +0 of -0
    polynomials(x, x + 0.0)
}

/// Sine and cosine of the reduced argument `r`; `tail` is the same with the last part of the
/// reduction.
#[inline(always)]
fn polynomials(r: f64, tail: f64) -> (f64, f64) {
    let z = r * r;
    let z2 = z * z;
    let z4 = z2 * z2;
    let sum = |c: &[f64; 6]| {
        let high = c[5].mul_add(z, c[4]);
        let middle = c[3].mul_add(z, c[2]);
        let low = c[1].mul_add(z, c[0]);
        high.mul_add(z4, middle.mul_add(z2, low))
    };
    let sin = (r * z).mul_add(sum(&SIN), tail);
    let cos = z2.mul_add(sum(&COS), (-0.5f64).mul_add(z, 1.0));
    (sin, cos)
}

/// One operation. Tables are not numbers and are handled by the evaluator.
#[inline]
pub fn apply(op: Op, a: f64, b: f64, c: f64) -> f64 {
    match op {
        Op::Add => a + b,
        Op::Sub => a - b,
        Op::Mul => a * b,
        Op::Div => a / b,
        Op::Neg => -a,
        Op::Fma => a.mul_add(b, c),
        Op::Fms => a.mul_add(b, -c),
        Op::Fnma => (-a).mul_add(b, c),
        Op::Sqrt => a.sqrt(),
        Op::Sin => sin_cos(a).0,
        Op::Cos => sin_cos(a).1,
        Op::Tan => libm::tan(a),
        Op::Asin => libm::asin(a),
        Op::Acos => libm::acos(a),
        Op::Atan => libm::atan(a),
        Op::Atan2 => libm::atan2(a, b),
        Op::Exp => libm::exp(a),
        Op::Log => libm::log(a),
        Op::Tanh => libm::tanh(a),
        Op::Abs => a.abs(),
        Op::Sign => {
            if a > 0.0 {
                1.0
            } else if a < 0.0 {
                -1.0
            } else {
                0.0
            }
        }
        Op::Pow => libm::pow(a, b),
        Op::Min => {
            if b > a {
                a
            } else {
                b
            }
        }
        Op::Max => {
            if a > b {
                a
            } else {
                b
            }
        }
        Op::Select => {
            if a > 0.0 {
                b
            } else {
                c
            }
        }
        Op::Table | Op::TableSlope | Op::Table2 | Op::Table2SlopeX | Op::Table2SlopeY => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Distance in units of the last place of the reference.
    fn ulps(a: f64, reference: f64) -> f64 {
        let next = f64::from_bits(reference.abs().to_bits() + 1);
        (a - reference).abs() / (next - reference.abs())
    }

    #[test]
    fn sine_and_cosine_agree_with_libm() {
        let mut worst: f64 = 0.0;
        let mut check = |x: f64| {
            let (s, c) = sin_cos(x);
            worst = worst.max(ulps(s, libm::sin(x))).max(ulps(c, libm::cos(x)));
        };
        for i in 0..400_000 {
            let x = (f64::from(i) - 200_000.0) * 1.3e-4;
            check(x);
            check(x * 3.8e3);
            check(x * 1e-9);
        }
        // next to the zeros of both
        for k in -60_000..60_000 {
            let x = f64::from(k) * std::f64::consts::FRAC_PI_2;
            check(x);
            check(f64::from_bits(x.to_bits().wrapping_add(1)));
        }
        println!("largest deviation from libm: {worst} ulp");
        assert!(worst <= 1.5, "{worst} ulp");
    }

    #[test]
    fn without_the_reduction_small_arguments_have_the_same_bits() {
        let all = (-100_000..=100_000)
            .map(|i| f64::from(i) * (SMALL / 1e5))
            .chain([0.0, -0.0, 1e-300, -5e-324, SMALL, -SMALL]);
        for x in all {
            let ([s, c], [t, d]) =
                (<[f64; 2]>::from(sin_cos_small(x)), <[f64; 2]>::from(sin_cos_near(x)));
            assert_eq!((s.to_bits(), c.to_bits()), (t.to_bits(), d.to_bits()), "{x:e}");
        }
    }

    #[test]
    fn beyond_its_reach_the_polynomial_is_not_used() {
        for x in [1.0001e5, -3e9, 1e300, f64::INFINITY, f64::NAN] {
            let (s, c) = sin_cos(x);
            assert_eq!(
                (s.to_bits(), c.to_bits()),
                (libm::sin(x).to_bits(), libm::cos(x).to_bits()),
                "{x}"
            );
        }
        assert_eq!(sin_cos(0.0), (0.0, 1.0));
    }
}
