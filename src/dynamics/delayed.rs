//! Past values as they were read, and sensitivities at past steps, in; those of the delayed values out.

use super::history::Past;
use super::propagator::Propagator;
use super::remembered::Remembered;
use super::rows::{Block, LANES, product};
use super::values::Run;
use crate::math::simd::Width;
use crate::model::{Delay, Delayed};

/// The state that a delay reads.
pub(super) fn state(delay: &Delay) -> Option<usize> {
    match delay.of {
        Delayed::State(i) => Some(i),
        _ => None,
    }
}

/// The time derivative of a delayed value.
pub(super) fn slope(run: &Run, delay: &Delay, past: &Past) -> f64 {
    match delay.of {
        Delayed::State(i) => run.past_value(i, past, &past.slope),
        Delayed::Input(_) => past.slope[0],
        _ => 0.0,
    }
}

/// Sensitivities of the delayed values, behind those of the states in `s`:
/// `dX(t - tau) = S(t - tau) - X'(t - tau) dtau`. `taus`: the Jacobian of the delay times, and the
/// point; `remembered`: sensitivities at past steps.
pub(super) fn delayed(
    propagator: &Propagator,
    width: Width,
    run: &Run,
    pasts: &[Past],
    (taus, point): (Block, usize),
    s: &mut [f64],
    remembered: &mut Remembered,
) {
    let (nx, lanes) = (propagator.layout.states, propagator.directions.lanes());
    let (s, out) = s.split_at_mut(nx * lanes);
    // SAFETY: the width is this machine's; delay times do not depend on delayed values.
    unsafe { product(width, taus, point % LANES, s, out) };
    for (k, (delay, past)) in propagator.delays.iter().zip(pasts).enumerate() {
        let (row, next) = out[k * lanes..].split_at_mut(lanes);
        if let Delayed::Smooth(_) = delay.of {
            // d smooth = by_reach dT + by_width dw - smooth' dtau; the row of w stands behind that of T, and that
            // of tau behind it.
            row.iter_mut()
                .zip(&next[..lanes])
                .for_each(|(by, dw)| *by = past.slope[0] * *by + past.slope[1] * dw);
            if Delayed::ago(k, |k| propagator.delays.get(k).map(|d| d.of)).is_some() {
                let ago = &next[lanes..2 * lanes];
                row.iter_mut().zip(ago).for_each(|(by, dtau)| *by -= past.slope[2] * dtau);
            }
            continue;
        }
        remembered.late(state(delay), past, slope(run, delay, past), row);
    }
}
