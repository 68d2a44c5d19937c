//! Samples at any times in, values on a uniform grid out; a gap stays a gap (NaN), nothing is
//! bridged in silence.

use crate::math::interpolate::between;

/// A uniform grid: point `i` is at `t0 + i*dt`, `0 <= i < n`; times in s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    pub t0: f64,
    pub dt: f64,
    pub n: usize,
}

impl Grid {
    /// More points than any flight has (46 hours at 100 Hz): a stamp is wrong.
    pub const MOST: usize = 1 << 24;

    /// The grid of spacing `dt` from `t0` to at most `t1` (a point within 1e-6 dt beyond `t1` still
    /// counts). Empty where `dt` is not positive or `t1 < t0`.
    pub fn covering(t0: f64, t1: f64, dt: f64) -> Grid {
        let steps = (t1 - t0) / dt;
        let n = if dt > 0.0 && steps.is_finite() && steps >= 0.0 {
            (steps + 1e-6).floor() as usize + 1
        } else {
            0
        };
        Grid { t0, dt, n }
    }

    /// Time of point `i`, s.
    pub fn time(&self, i: usize) -> f64 {
        self.t0 + i as f64 * self.dt
    }

    /// All times, s.
    pub fn times(&self) -> Vec<f64> {
        (0..self.n).map(|i| self.time(i)).collect()
    }
}

/// Linear interpolation of samples `y` at ascending times `t` (equal lengths).
///
/// A sample within 1e-6 dt of a grid point passes exactly. NaN outside the samples, next to a NaN
/// sample, and between samples more than `max_gap` seconds apart.
pub fn linear(t: &[f64], y: &[f64], grid: &Grid, max_gap: f64) -> Vec<f64> {
    walk(t, y, grid, |time, before, after| {
        let width = t[after] - t[before];
        if width > max_gap {
            return f64::NAN;
        }
        let share = (time - t[before]) / width;
        between(y[before], y[after], share)
    })
}

/// The cubic through the two samples on each side of a grid point (Lagrange): where the signal is
/// smooth its error is of fourth order in the spacing, that of [`linear`] of second, which acts like
/// a low pass. The parabola or the line through fewer where an outer sample is beyond a gap, or so
/// close to the inner one (a quarter of the interval) that their noise would make the slope. NaN as
/// in [`linear`].
pub fn cubic(t: &[f64], y: &[f64], grid: &Grid, max_gap: f64) -> Vec<f64> {
    let joined = |i: usize| !y[i].is_nan() && !y[i + 1].is_nan() && t[i + 1] - t[i] <= max_gap;
    walk(t, y, grid, |time, before, after| {
        if !joined(before) {
            return f64::NAN;
        }
        let near = (t[after] - t[before]) / 4.0;
        let useful = |i: usize| joined(i) && t[i + 1] - t[i] >= near;
        let first = if before > 0 && useful(before - 1) { before - 1 } else { before };
        let last = if after + 1 < t.len() && useful(after) { after + 1 } else { after };
        lagrange(&t[first..=last], &y[first..=last], time)
    })
}

/// The polynomial through all points, at `time`: differences from the first value, so that a
/// constant passes exactly.
fn lagrange(t: &[f64], y: &[f64], time: f64) -> f64 {
    let weight = |i: usize| {
        (0..t.len()).filter(|j| *j != i).map(|j| (time - t[j]) / (t[i] - t[j])).product::<f64>()
    };
    (1..t.len()).fold(y[0], |sum, i| sum + weight(i) * (y[i] - y[0]))
}

/// The last sample at or before each grid point. NaN as in [`linear`].
pub fn hold(t: &[f64], y: &[f64], grid: &Grid, max_gap: f64) -> Vec<f64> {
    walk(t, y, grid, |_, before, after| {
        let known = !y[after].is_nan() && t[after] - t[before] <= max_gap;
        if known { y[before] } else { f64::NAN }
    })
}

/// The mean, over `width` seconds (one step of the grid at least) about each point, of the straight lines through the samples: what happens between
/// two points is not lost, and nothing is late. At the ends it is the mean over what is there. NaN as in [`linear`], and
/// where that has a gap in it.
pub fn mean(t: &[f64], y: &[f64], grid: &Grid, max_gap: f64, width: f64) -> Vec<f64> {
    let (Some(first), Some(last)) = (t.first(), t.last()) else { return vec![f64::NAN; grid.n] };
    let (slack, half) = (1e-6 * grid.dt, 0.5 * width.max(grid.dt));
    let mut next = 0;
    (0..grid.n)
        .map(|i| {
            let time = grid.time(i);
            if !(first - slack..=last + slack).contains(&time) {
                return f64::NAN;
            }
            let from = (time - half).max(*first);
            let to = (time + half).min(*last);
            while next + 1 < t.len() && t[next + 1] <= from {
                next += 1;
            }
            average(&t[next..], &y[next..], [from, to], max_gap)
        })
        .collect()
}

/// The mean of the straight lines through samples, of which the second one is behind `from`.
fn average(t: &[f64], y: &[f64], [from, to]: [f64; 2], max_gap: f64) -> f64 {
    let (mut sum, mut length) = (0.0, 0.0);
    for k in 0..t.len() - 1 {
        if t[k] >= to {
            break;
        }
        let (a, b, width) = (t[k].max(from), t[k + 1].min(to), t[k + 1] - t[k]);
        if width > max_gap {
            return f64::NAN;
        }
        // From the first value on: a constant passes exactly.
        let middle = (0.5 * (a + b) - t[k]) / width;
        if b > a {
            sum += (b - a) * (between(y[k], y[k + 1], middle) - y[0]);
            length += b - a;
        }
    }
    if length > 0.0 { y[0] + sum / length } else { y[0] }
}

/// Visits the grid with the samples on both sides of each point; exact hits and the outside are
/// settled here.
fn walk(t: &[f64], y: &[f64], grid: &Grid, between: impl Fn(f64, usize, usize) -> f64) -> Vec<f64> {
    assert_eq!(t.len(), y.len(), "one value per time");
    let slack = 1e-6 * grid.dt;
    let mut next = 0;
    (0..grid.n)
        .map(|i| {
            let time = grid.time(i);
            while next < t.len() && t[next] < time - slack {
                next += 1;
            }
            match next {
                k if k == t.len() => f64::NAN,
                k if t[k] <= time + slack => y[k],
                0 => f64::NAN,
                k => between(time, k - 1, k),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid { t0: 0.0, dt: 0.1, n: 11 };

    #[test]
    fn a_sample_on_the_grid_passes_exactly() {
        let y: Vec<f64> = (0..11).map(|i| (i as f64 * 1.7).sin() / 3.0).collect();
        assert_eq!(linear(&GRID.times(), &y, &GRID, 1.0), y);
        let shifted: Vec<f64> = GRID.times().iter().map(|t| t + 5e-8).collect();
        assert_eq!(linear(&shifted, &y, &GRID, 1.0), y);
    }

    #[test]
    fn a_straight_line_is_kept_between_irregular_samples() {
        let t = [-0.03, 0.08, 0.22, 0.31, 0.49, 0.66, 0.81, 0.9, 1.04];
        let y: Vec<f64> = t.iter().map(|t| 2.0 - 3.0 * t).collect();
        for (i, v) in linear(&t, &y, &GRID, 0.2).iter().enumerate() {
            assert!((v - (2.0 - 0.3 * i as f64)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_cubic_is_kept_between_irregular_samples() {
        let t = [-0.03, 0.08, 0.22, 0.31, 0.49, 0.66, 0.81, 0.9, 1.04];
        let of = |t: f64| 1.0 + t * (2.0 + t * (-3.0 + t * 4.0));
        let y: Vec<f64> = t.iter().map(|t| of(*t)).collect();
        let found = cubic(&t, &y, &GRID, 0.2);
        // the first and the last interval have the parabola of three samples
        (1..10).for_each(|i| assert!((found[i] - of(GRID.time(i))).abs() < 1e-12, "{i}"));
        assert!([0, 10].iter().all(|&i| (found[i] - of(GRID.time(i))).abs() < 2e-2));
        assert_eq!(cubic(&t, &[0.1; 9], &GRID, 0.2), [0.1; 11]);
    }

    #[test]
    fn a_sine_suffers_less_from_a_cubic_than_from_lines() {
        let t: Vec<f64> = (0..210).map(|i| -0.0025 + f64::from(i) * 0.005).collect();
        let y: Vec<f64> = t.iter().map(|t| (50.0 * t).sin()).collect();
        // From the second interval on: the first has the parabola of three samples.
        let grid = Grid { t0: 0.01, dt: 0.01, n: 99 };
        let off = |found: Vec<f64>| {
            let errors = found.iter().zip(grid.times()).map(|(v, t)| (v - (50.0 * t).sin()).abs());
            errors.fold(0.0, f64::max)
        };
        // (w T)^2/8 and 3 (w T)^4/128 in mid-interval
        assert!((off(linear(&t, &y, &grid, 0.1)) / 7.8e-3 - 1.0).abs() < 0.1);
        let cubic = off(cubic(&t, &y, &grid, 0.1));
        assert!((0.5..1.1).contains(&(cubic / 9.2e-5)), "{cubic}");
    }

    #[test]
    fn what_is_held_changes_at_samples_alone() {
        let t = [0.05, 0.149, 0.31, 0.52, 1.1];
        let v = hold(&t, &[1.0, 2.0, 3.0, 4.0, 5.0], &GRID, 0.3);
        assert_eq!(v[1..6], [1.0, 2.0, 2.0, 3.0, 3.0]);
        assert!(v[6..].iter().all(|v| v.is_nan()) && v[0].is_nan());
    }

    #[test]
    fn a_mean_over_the_step_keeps_the_time_of_an_edge() {
        // A step at 0.43: of the step of the grid about 0.4 (0.35 to 0.45) a fifth is behind it.
        let (t, y) = ([0.0, 0.43, 0.43 + 1e-9, 1.0], [0.0, 0.0, 1.0, 1.0]);
        let found = mean(&t, &y, &GRID, 1.0, 0.0);
        for (i, value) in found.iter().enumerate() {
            let wanted = [0.0, 0.2, 1.0][(i >= 4) as usize + (i > 4) as usize];
            assert!((value - wanted).abs() < 1e-6, "{i}: {value}");
        }
        // The sum over the grid is that over time, wherever the edge is.
        for edge in [0.31, 0.36, 0.409, 0.45, 0.4999] {
            let t = [0.0, edge, edge + 1e-9, 1.0];
            let sum: f64 = mean(&t, &y, &GRID, 1.0, 0.0)[..10].iter().sum::<f64>() * GRID.dt;
            assert!((sum - (0.95 - edge)).abs() < 1e-6, "{edge}: {sum}");
        }
        let straight = |t: f64| 2.0 - 3.0 * t;
        let t = [-0.2, 0.07, 0.33, 0.71, 1.3];
        for (i, value) in mean(&t, &t.map(straight), &GRID, 1.0, 0.0).iter().enumerate() {
            assert!((value - straight(GRID.time(i))).abs() < 1e-12, "{i}");
        }
        assert_eq!(mean(&t, &[0.1; 5], &GRID, 1.0, 0.0), [0.1; 11]);
        let wide = mean(&[0.0, 0.5, 0.5 + 1e-9, 1.0], &y, &GRID, 1.0, 0.4);
        assert!(
            (wide[5] - 0.5).abs() < 1e-6 && (wide[4] - 0.25).abs() < 1e-6 && wide[2] == 0.0,
            "{wide:?}"
        );
        assert!(mean(&[], &[], &GRID, 1.0, 0.0).iter().all(|v| v.is_nan()));
        let gap = mean(&[0.0, 0.1, 0.6, 0.7], &[1.0, 1.0, 2.0, 2.0], &GRID, 0.2, 0.0);
        let known: Vec<usize> = (0..11).filter(|&i| !gap[i].is_nan()).collect();
        assert_eq!(known, [0, 7]);
    }

    #[test]
    fn gaps_ends_and_nan_are_never_bridged() {
        for how in [linear, cubic, hold] {
            let t = [0.05, 0.15, 0.65, 0.75, 0.85];
            let v = how(&t, &[1.0, 1.0, 1.0, f64::NAN, 1.0], &GRID, 0.3);
            let known: Vec<usize> = (0..11).filter(|&i| !v[i].is_nan()).collect();
            assert_eq!(known, [1]);
        }
        assert!(linear(&[], &[], &GRID, 1.0).iter().all(|v| v.is_nan()));
    }

    #[test]
    fn a_grid_covers_its_interval() {
        assert_eq!(Grid::covering(1.0, 2.0, 0.1).n, 11);
        assert_eq!(Grid::covering(1.0, 1.95, 0.1).n, 10);
        assert_eq!(Grid::covering(1.0, 1.0, 0.1).n, 1);
        assert_eq!((Grid::covering(1.0, 0.0, 0.1).n, Grid::covering(0.0, 1.0, 0.0).n), (0, 0));
    }
}
