//! A recorded input in; its values without small movements out (sigma filter), with their
//! derivatives.
//!
//! Lee, J.-S.: Digital image smoothing and the sigma filter. Computer Vision, Graphics and Image
//! Processing 24 (1983): the mean of those neighbours that agree with the present value. A step
//! stays a step, noise about a level goes, and what is slow against the window stays. Here
//! neighbours fade out, so that the result is smooth in both of its parameters: `a = 1 - (s/T)^2`
//! with their distance `s` in time, Tukey's `b = (1 - (d/w)^2)^2` with their difference `d`. The
//! present value's own noise draws such a mean towards itself (by a sixth of that noise where `w`
//! is five times its sd), so the differences of a second pass are those of what the first one gave.

//!
//! Both parameters are held in most runs (an effect chooses them, and estimates how much of the noise
//! did not happen), so that the same records are filtered in the same way at every evaluation: each
//! thread keeps what it filtered last.

use crate::model::{Delay, Delayed};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

/// What the filter gives at every grid point of one input, and its derivatives with respect to `T`
/// (per s) and `w`.
pub struct Smooth(Rc<[[f64; 3]]>);

/// An input that was filtered, with `dt`, `T` and `w`, and what came out.
type Kept = (Vec<f64>, [f64; 3], Rc<[[f64; 3]]>);

/// How many a thread keeps: the surfaces of a campaign's maneuvers.
const KEPT: usize = 256;

thread_local! {
    static KEEP: RefCell<VecDeque<Kept>> = const { RefCell::new(VecDeque::new()) };
}

impl Smooth {
    /// Of grid column `column` with `stride` columns and `dt` s between points: over `reach` s
    /// before and after, for differences below `within` (in the input's unit). The input as it is
    /// where either is not positive.
    pub fn new(
        inputs: &[f64],
        (stride, column): (usize, usize),
        dt: f64,
        reach: f64,
        within: f64,
    ) -> Smooth {
        let u: Vec<f64> = inputs.iter().skip(column).step_by(stride.max(1)).copied().collect();
        if reach.is_nan() || within.is_nan() {
            return Smooth(vec![[f64::NAN; 3]; u.len()].into());
        }
        if reach <= 0.0 || within <= 0.0 {
            return Smooth(u.into_iter().map(|u| [u, 0.0, 0.0]).collect());
        }
        let by = [dt, reach, within];
        let same = |kept: &&Kept| kept.1 == by && kept.0 == u;
        let known = KEEP.with_borrow(|kept| kept.iter().find(same).map(|kept| kept.2.clone()));
        if let Some(known) = known {
            return Smooth(known);
        }
        let far = (reach / dt).min(u.len() as f64) as usize;
        let pass = |from: &[[f64; 3]]| {
            (0..u.len())
                .map(|i| at(&u, from, i, far, dt / reach, [reach, within]))
                .collect::<Vec<_>>()
        };
        let first: Vec<[f64; 3]> = u.iter().map(|u| [*u, 0.0, 0.0]).collect();
        let out: Rc<[[f64; 3]]> = pass(&pass(&first)).into();
        KEEP.with_borrow_mut(|kept| {
            kept.truncate(KEPT - 1);
            kept.push_front((u, by, out.clone()));
        });
        Smooth(out)
    }

    /// At fractional grid position `at`, and behind it its slope there, per grid step; the first and the last
    /// value hold outside.
    pub fn at(&self, at: f64) -> [f64; 4] {
        let last = self.0.len().saturating_sub(1);
        let inside = at.clamp(0.0, last as f64);
        let (i, part) = (inside.floor() as usize, inside - inside.floor());
        let [Some(a), Some(b)] = [i, i + 1].map(|i| self.0.get(i.min(last))) else {
            return [f64::NAN; 4];
        };
        let [value, by_reach, by_width] = std::array::from_fn(|k| a[k] + part * (b[k] - a[k]));
        let slope = if at == inside { b[0] - a[0] } else { 0.0 };
        [value, by_reach, by_width, slope]
    }
}

/// For each delay of a model that is a `smooth()`: the filter of its input, with the values that
/// `tau` tells of the delays. `inputs`: the grid of a record, `stride` in a row, `dt` s apart.
pub fn smoothed(
    delays: &[Delay],
    inputs: &[f64],
    stride: usize,
    dt: f64,
    tau: impl Fn(usize) -> f64,
) -> Vec<Option<Smooth>> {
    let one = |(k, delay): (usize, &Delay)| match delay.of {
        Delayed::Smooth(j) => Some(Smooth::new(inputs, (stride, j), dt, tau(k), tau(k + 1))),
        _ => None,
    };
    delays.iter().enumerate().map(one).collect()
}

/// The filter at point `i`: of points up to `far` away, which are `step` apart as a share of
/// `reach`; `by` tells their differences.
fn at(
    u: &[f64],
    by: &[[f64; 3]],
    i: usize,
    far: usize,
    step: f64,
    [reach, within]: [f64; 2],
) -> [f64; 3] {
    let from = i.saturating_sub(far);
    let near = from..(i + far + 1).min(u.len());
    // Sums of weights and of weights times values: of the filter, of its derivatives by reach and
    // by width.
    let (mut sum, mut first) = ([0.0; 3], [0.0; 3]);
    for j in near {
        let s = (j as f64 - i as f64) * step;
        let r = (by[j][0] - by[i][0]) / within;
        if r.abs() < 1.0 {
            let (a, b) = (1.0 - s * s, 1.0 - r * r);
            let change =
                |k: usize, own: f64| -4.0 * a * b * r * ((by[j][k] - by[i][k]) / within - own);
            let weights =
                [a * b * b, 2.0 * s * s / reach * b * b + change(1, 0.0), change(2, r / within)];
            for (k, weight) in weights.into_iter().enumerate() {
                sum[k] += weight;
                first[k] += weight * (u[j] - u[i]);
            }
        }
    }
    let moved = first[0] / sum[0];
    let slope = |k: usize| (first[k] - moved * sum[k]) / sum[0];
    [u[i] + moved, slope(1), slope(2)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// A step of 1 at the middle, in noise of sd 0.01.
    fn step(n: usize) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(7);
        let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
        (0..n).map(|k| if 2 * k < n { 0.0 } else { 1.0 } + 0.01 * noise()).collect()
    }

    #[test]
    fn noise_about_a_level_goes_and_a_step_stays() {
        let u = step(400);
        let smooth = Smooth::new(&u, (1, 0), 0.02, 1.0, 0.1);
        let worst = (0..400)
            .map(|k| (smooth.at(k as f64)[0] - if k < 200 { 0.0 } else { 1.0 }).abs())
            .fold(0.0, f64::max);
        assert!(worst < 0.01, "{worst}: one sd of the noise, which has passed 2.5 of them");
        assert_eq!(smooth.at(-3.0)[..3], smooth.at(0.0)[..3]);
        assert_eq!(Smooth::new(&u, (1, 0), 0.02, 0.0, 0.1).at(7.0)[0], u[7]);
        // A reach beyond the record is all of it.
        assert!((Smooth::new(&u, (1, 0), 0.02, f64::INFINITY, 0.1).at(7.0)[0]).abs() < 0.005);
        // What is slow stays: a parabola within the window, but for the curvature over it.
        let slow: Vec<f64> = (0..400).map(|k| 1e-8 * f64::from(k * k)).collect();
        let left = Smooth::new(&slow, (1, 0), 0.02, 0.2, 0.1).at(200.0)[0] - slow[200];
        assert!(left.abs() < 1e-8 * 100.0, "{left}");
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let u = step(120);
        let of = |reach: f64, within: f64| Smooth::new(&u, (1, 0), 0.02, reach, within);
        for (reach, within) in [(0.37, 0.05), (0.83, 0.021), (0.51, 3.0)] {
            let exact = of(reach, within);
            let h = 1e-6;
            let by = [
                [of(reach + h, within), of(reach - h, within)],
                [of(reach, within + h), of(reach, within - h)],
            ];
            for k in 0..119 {
                let at = f64::from(k) + 0.3;
                for (i, [high, low]) in by.iter().enumerate() {
                    let slope = (high.at(at)[0] - low.at(at)[0]) / (2.0 * h);
                    assert!(
                        (exact.at(at)[i + 1] - slope).abs() < 1e-5,
                        "{reach} {within} {k} {i}: {} {slope}",
                        exact.at(at)[i + 1]
                    );
                }
            }
        }
    }
}
