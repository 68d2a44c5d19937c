//! Where stops were at the begin, in the middle and at the end of a step in; states that they took
//! along and left inside it, where they are at its end, out.
//!
//! Between its ends a stop moves along a parabola. What rests is left where that turns round; what
//! moves no faster than `R` is left where the stop becomes faster, or is taken back by one that comes
//! towards it and is faster. Without this a state would be where the stop is at the end of a step,
//! and be ahead of itself by a part of `R h` from there on.

use super::step::{LEFT_DOWN, LEFT_UP, RESTS, UP};
use super::values::Run;
use std::ops::Range;

/// The parabola through a stop at the begin, the middle and the end of a step, as weights of the
/// three at a share of the step.
pub(super) fn parabola(share: f64) -> [f64; 3] {
    let (s, r) = (share, 1.0 - share);
    [r * (r - s), 4.0 * s * r, s * (s - r)]
}

/// Where such a parabola is at a share of the step.
fn along(path: [f64; 3], share: f64) -> f64 {
    parabola(share).iter().zip(path).map(|(w, b)| w * b).sum()
}

/// Its slopes at both ends, per step.
fn ends([begin, middle, end]: [f64; 3]) -> [f64; 2] {
    [4.0 * middle - 3.0 * begin - end, begin - 4.0 * middle + 3.0 * end]
}

/// The share of a step at which such a parabola, which pushes upwards, meets what begins above it and
/// comes down by `down` per step, and how fast they come together there, per step.
fn met([begin, middle, end]: [f64; 3], above: f64, down: f64) -> Option<(f64, f64)> {
    let a = 2.0 * begin - 4.0 * middle + 2.0 * end;
    let b = 4.0 * middle - 3.0 * begin - end + down;
    let c = begin - above;
    if c >= 0.0 {
        return None;
    }
    let speed = (b * b - 4.0 * a * c).sqrt();
    let share = -2.0 * c / (b + speed);
    (share > 0.0 && share < 1.0 && speed > 0.0).then_some((share, speed))
}

/// A state that a stop left, at a share of the step, and where it is at the end. Where it met the
/// stop at that instant, `1` if it moved towards it before, and how the instant counts: see
/// `Put::on_stops`.
struct Left {
    share: f64,
    to: f64,
    upwards: bool,
    moved: f64,
    gain: f64,
}

/// Numbers that are kept of each.
pub(super) const OF_LEFT: usize = 3;

impl Run<'_> {
    /// States that left a stop inside the step: it became faster than they may, or it turned round
    /// and had taken along one that rests.
    pub(super) fn leave(
        &self,
        which: Range<usize>,
        x: &mut [f64],
        (begin, h): (&[f64], f64),
        how: &mut [u8],
        shares: &mut Vec<f64>,
    ) {
        let (propagator, nx) = (self.propagator, self.propagator.layout.states);
        for (&i, how) in propagator.limited[which].iter().zip(how) {
            let reach = self.bounds[2 * nx + i] * h;
            let left = match reach.is_finite() {
                true => self.outrun(i, begin[i], reach, *how),
                false if propagator.rests[i] => self.turned(i, x[i]),
                false => None,
            };
            if let Some(left) = left {
                (x[i], *how) = (left.to, if left.upwards { LEFT_UP } else { LEFT_DOWN });
                shares.extend([left.share, left.moved, left.gain]);
            }
        }
    }

    /// Where a stop of state `i` was in the step: its lower one, or the upper one with signs
    /// reversed, so that it pushes upwards.
    fn path(&self, i: usize, upwards: bool) -> [f64; 3] {
        let (row, sign) = if upwards { (2 * i, 1.0) } else { (2 * i + 1, -1.0) };
        [&self.passed[0], &self.passed[1], &self.bounds].map(|limits| sign * limits[row])
    }

    /// A state that a stop pushes which is faster than `reach` per step: it began the step on it, or
    /// met it on the way.
    fn outrun(&self, i: usize, begin: f64, reach: f64, how: u8) -> Option<Left> {
        if how == 0 || how == RESTS {
            return None;
        }
        let upwards = matches!(how, 1 | UP);
        let (path, sign) = (self.path(i, upwards), if upwards { 1.0 } else { -1.0 });
        // It began on the stop but for rounding.
        if (sign * begin - path[0]).abs() <= 1e-9 * reach {
            let [first, last] = ends(path);
            let share = (reach - first) / (last - first);
            let to = || sign * (along(path, share) + (1.0 - share) * reach);
            let leaves = first < reach && last > reach;
            return leaves.then(|| Left { share, to: to(), upwards, moved: 0.0, gain: 0.0 });
        }
        self.overtaken(i, begin, reach, true).or_else(|| self.overtaken(i, begin, reach, false))
    }

    /// A state that began beyond the other stop and comes towards this one, or rests between them,
    /// and is taken back by this one, which is faster than it.
    fn overtaken(&self, i: usize, begin: f64, reach: f64, upwards: bool) -> Option<Left> {
        let (path, sign) = (self.path(i, upwards), if upwards { 1.0 } else { -1.0 });
        let begin = sign * begin;
        let moved = f64::from(begin > -self.path(i, !upwards)[0]);
        let (share, speed) = met(path, begin, moved * reach)?;
        let to = sign * (begin + (1.0 - share - moved * share) * reach);
        let gain = (1.0 + moved) * reach / speed;
        (gain < 1.0).then_some(Left { share, to, upwards, moved, gain })
    }

    /// A state at rest, which is at `x` at the end of the step, and was taken further by a stop that
    /// turned round.
    fn turned(&self, i: usize, x: f64) -> Option<Left> {
        let of = |upwards: bool| {
            let (path, sign) = (self.path(i, upwards), if upwards { 1.0 } else { -1.0 });
            let [first, last] = ends(path);
            let share = first / (first - last);
            let to = || along(path, share);
            let further = first > 0.0 && last < 0.0 && to() > sign * x;
            let left = || Left { share, to: sign * to(), upwards, moved: 0.0, gain: 0.0 };
            further.then(left)
        };
        of(true).or_else(|| of(false))
    }
}
