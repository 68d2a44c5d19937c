//! A problem with densities of noise among its parameters in; its minimum, with those at zero that
//! nothing asks for, out.
//!
//! A density `F` acts by its square: at zero the cost has no slope along it, whether a larger one
//! would be better or not, and an iteration that came there would stay. A little above, the slope is
//! `2 F` times that along the variance `F^2`, and so has its sign. So densities are first kept above
//! a small share of their start (of one that starts at zero: above hardly anything; steps are those of
//! the variance and lead away from there at once); those that end there, pushed against it, are zero.

use crate::least_squares::{Evaluate, Fit, Layout, Method, minimise};

/// Share of its start above which a density is kept at first.
const SMALL: f64 = 1e-3;
/// Its square is nothing beside any covariance, and far from the smallest of numbers.
const NOTHING: f64 = 1e-12;

/// Minimises by `how`, with the parameters `densities` as above.
pub fn above_zero<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    method: &Method,
    densities: &[usize],
    how: impl Fn(&Layout) -> Fit,
) -> Fit {
    let least = |i: usize| (SMALL * layout.start[i].abs()).max(NOTHING);
    let open: Vec<usize> = densities
        .iter()
        .copied()
        .filter(|&i| layout.lower[i] <= 0.0 && layout.upper[i] > least(i))
        .collect();
    if open.is_empty() {
        return how(layout);
    }
    let mut above = layout.clone();
    for &i in &open {
        above.lower[i] = least(i);
        above.start[i] = above.start[i].max(least(i));
    }
    let mut fit = how(&above);
    // What the variance's score led to from zero is a start like any other: the rest of the motion was
    // without it until then, and may have gone elsewhere.
    let from_zero = open.iter().filter(|&&i| layout.start[i] == 0.0 && fit.theta[i] > least(i));
    let mut again = above.clone();
    from_zero.for_each(|&i| again.start[i] = fit.theta[i]);
    if again.start != above.start {
        let other = how(&again);
        if other.cost() < fit.cost() {
            fit = fit.then(other);
        }
    }
    let nothing: Vec<usize> =
        open.into_iter().filter(|&i| fit.held[i] && fit.theta[i] <= least(i)).collect();
    if nothing.is_empty() {
        return fit;
    }
    let mut without = Layout { start: fit.theta.clone(), ..layout.clone() };
    for &i in &nothing {
        (without.start[i], without.lower[i], without.upper[i]) = (0.0, 0.0, 0.0);
    }
    let last = minimise(&without, evaluate, method);
    fit.then(last)
}
