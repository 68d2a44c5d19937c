//! The rates at a stage in; where they lead, and their weighed sum, every number rounded once, out.

use crate::math::simd::{Eight, Width, by_width};

/// What the stages of a Runge-Kutta step do with rates, on this machine.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lead(Width);

impl Lead {
    pub(crate) fn new() -> Lead {
        Lead(Width::detect())
    }

    /// `sum += weight rate`, and `to = x + ahead rate` of as many states as `to` has.
    pub(crate) fn stage(
        self,
        rates: &[f64],
        [weight, ahead]: [f64; 2],
        x: &[f64],
        sum: &mut [f64],
        to: &mut [f64],
    ) {
        // SAFETY: the width is this machine's.
        unsafe {
            weighed(self.0, rates, weight, sum);
            to.copy_from_slice(&x[..to.len()]);
            weighed(self.0, rates, ahead, to);
        }
    }

    /// `x += h/6 sum`.
    pub(crate) fn end(self, sum: &[f64], h: f64, x: &mut [f64]) {
        // SAFETY: as above.
        unsafe { weighed(self.0, sum, h / 6.0, x) }
    }
}

by_width! {
    fn weighed(rates: &[f64], weight: f64, sum: &mut [f64]) = weighed_body
}

/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn weighed_body<V: Eight>(rates: &[f64], weight: f64, sum: &mut [f64]) {
    let ((rates, last), (sum, rest)) = (rates.as_chunks::<8>(), sum.as_chunks_mut::<8>());
    for (rates, sum) in rates.iter().zip(sum) {
        // SAFETY: the caller's promise; both are eight numbers.
        unsafe {
            let to = sum.as_mut_ptr();
            V::splat(weight).fma(V::load(rates.as_ptr()), V::load(to)).store(to);
        }
    }
    rest.iter_mut().zip(last).for_each(|(sum, rate)| *sum = weight.mul_add(*rate, *sum));
}
