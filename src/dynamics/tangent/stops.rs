//! How states were put on their stops at a point, and the sensitivities of the stops, in; those of the
//! states out.

use super::super::left::{OF_LEFT, parabola};
use super::super::propagator::Propagator;
use super::super::rows::{Block, product};
use super::super::step::{DOWN, LEFT_DOWN, LEFT_UP, RESTS, UP};
use crate::math::simd::Width;

/// Whether any state was put on a stop, or taken along by one.
pub(super) fn is_put(how: &[u8]) -> bool {
    how.iter().any(|how| *how != 0 && *how != RESTS)
}

/// States that were put on stops at a point: how, and what stops that take them along need, their
/// sensitivities at the begin of the step and the time since then, s; `left`: those of the limits
/// at the begin and in the middle of the step, and the shares of it at which states left them.
pub(super) struct Put<'a> {
    pub(super) propagator: &'a Propagator,
    pub(super) width: Width,
    pub(super) how: &'a [u8],
    pub(super) begin: &'a [f64],
    pub(super) since: f64,
    pub(super) left: (&'a [Vec<f64>; 2], &'a [f64]),
}

impl Put<'_> {
    /// The sensitivity of a state that was put on a stop is that of the stop; of one that was taken
    /// along, x = x_0 +- R t, it is S_0 +- t dR; of one that left the stop inside the step, when
    /// its speed was R or nothing, x = b(t_1) +- R (t - t_1), where t_1 itself changes nothing; of
    /// one that met a stop at t_1 which is faster, x = x_0 -+ R t_1 +- R (t - t_1), with `gain` times
    /// what it was off the stop then, 2 R/(R + b') or R/b' where it was at rest.
    /// `block`: the Jacobian of limits that move, and the point in it; `s`: sensitivities of the states, and those of the delayed values behind them.
    pub(super) fn on_stops(
        &self,
        block: Option<(Block<'_>, usize)>,
        limits: &mut [f64],
        s: &mut [f64],
    ) {
        let propagator = self.propagator;
        let (lanes, nx) = (propagator.directions.lanes(), propagator.layout.states);
        let (mut from, mut shares) = (0, self.left.1.as_chunks::<OF_LEFT>().0.iter());
        for &to in &propagator.level_ends {
            if let Some((block, at)) = block {
                // SAFETY: the width is this machine's.
                unsafe { product(self.width, block, at, s, limits) };
            }
            for (&i, &how) in propagator.limited[from..to].iter().zip(&self.how[from..to]) {
                let row = |k: usize| k * lanes..(k + 1) * lanes;
                match how {
                    0 | RESTS => {}
                    UP | DOWN => {
                        let since = if how == UP { self.since } else { -self.since };
                        let fastest = &limits[row(2 * nx + i)];
                        let both = self.begin[row(i)].iter().zip(fastest);
                        s[row(i)].iter_mut().zip(both).for_each(|(s, (s0, r))| *s = s0 + since * r);
                    }
                    LEFT_UP | LEFT_DOWN => {
                        let Some(&[share, moved, gain]) = shares.next() else { continue };
                        let (side, sign) = if how == LEFT_UP { (0, 1.0) } else { (1, -1.0) };
                        let stop = row(2 * i + side);
                        let [before, since] =
                            [moved * share, 1.0 - share].map(|part| sign * part * self.since);
                        let ([begin, middle], [a, b, c]) = (self.left.0, parabola(share));
                        let fastest = &limits[row(2 * nx + i)];
                        for (l, s) in s[row(i)].iter_mut().enumerate() {
                            let at = stop.start + l;
                            let stop = a * begin[at] + b * middle[at] + c * limits[at];
                            let own = self.begin[i * lanes + l] - before * fastest[l];
                            let met = if gain == 0.0 { stop } else { own - gain * (own - stop) };
                            *s = met + since * fastest[l];
                        }
                    }
                    stop => {
                        let limit = &limits[row(2 * i + usize::from(stop) - 1)];
                        s[row(i)].copy_from_slice(limit);
                    }
                }
            }
            from = to;
        }
    }
}
