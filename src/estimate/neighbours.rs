//! Segments with parameters of their own in; a fit in which none of them sits in a worse minimum
//! than the values of the others lead to, out.
//!
//! Friction gives the cost of a single maneuver several minima: the surface is held at other times.
//! A maneuver in a wrong one drags along what it has in common with others. So every segment is
//! estimated alone, with the common parameters held, from the medians of all segments; where that
//! lowers its cost by more than `GAIN`, all are estimated again from there. Linear in segments.

use super::densities::above_zero;
use super::sizes::{Measured, from_sizes};
use crate::least_squares::{Evaluate, Fit, Layout, Method, Part, cost, minimise};
use crate::math::median;
use rayon::prelude::*;

/// A cost lower by half is one standard deviation.
const GAIN: f64 = 0.5;
/// A segment that is better off may move the common parameters, and these other segments.
const ROUNDS: usize = 3;
/// A median of fewer is no evidence against any of them.
const FEWEST: usize = 3;

/// What is known of the parameters of a problem besides the problem.
#[derive(Debug, Clone, Default)]
pub struct Known {
    /// Those (places in the parameter vector) that are one and the same of different segments.
    pub alike: Vec<Vec<usize>>,
    /// Limits that parameters make.
    pub limits: Vec<Measured>,
    /// Densities of noise, which act by their squares.
    pub densities: Vec<usize>,
}

/// Minimises from `layout.start`.
pub fn lowest<F: Evaluate>(layout: &Layout, evaluate: &F, method: &Method, known: &Known) -> Fit {
    above_zero(layout, evaluate, method, &known.densities, |layout| {
        lowest_of_segments(layout, evaluate, method, known)
    })
}

/// With no parameters alike it is `from_sizes`.
///
/// The bottom of a minimum with kinks takes most of the time, so it is looked for last.
fn lowest_of_segments<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    method: &Method,
    Known { alike, limits, .. }: &Known,
) -> Fit {
    if alike.iter().all(|places| places.len() < FEWEST) {
        return from_sizes(layout, evaluate, method, limits);
    }
    let mut fit = from_sizes(layout, evaluate, &coarse(method), limits);
    for _ in 0..ROUNDS {
        let Some(start) = better(layout, evaluate, method, alike, &fit) else { break };
        let again = minimise(&Layout { start, ..layout.clone() }, evaluate, &coarse(method));
        if !(again.cost() < fit.cost()) {
            break;
        }
        fit = fit.then(again);
    }
    let start = fit.theta.clone();
    let fine = minimise(&Layout { start, ..layout.clone() }, evaluate, method);
    fit.then(fine)
}

/// Far enough to see which minimum it is: to a standard deviation, or to the first kink that stops
/// more than an eighth of a step.
fn coarse(method: &Method) -> Method {
    Method {
        tolerance: method.tolerance.max(1e-3),
        step_tolerance: 1.0,
        gradient_tolerance: 0.0,
        max_iterations: method.max_iterations.min(20),
        max_halvings: 3,
        turns: false,
        ..*method
    }
}

/// The parameter vector with the segments that are better off from the medians moved there; none
/// where no segment is.
fn better<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    method: &Method,
    alike: &[Vec<usize>],
    fit: &Fit,
) -> Option<Vec<f64>> {
    fit.matrix.as_ref()?;
    let mut typical = fit.theta.clone();
    for places in alike.iter().filter(|places| places.len() >= FEWEST) {
        let middle = median(&places.iter().map(|&i| fit.theta[i]).collect::<Vec<f64>>());
        places.iter().for_each(|&i| typical[i] = middle);
    }
    if typical == fit.theta {
        return None;
    }
    let moved: Vec<Option<Vec<f64>>> = (0..layout.parts.len())
        .into_par_iter()
        .map(|s| alone(layout, evaluate, method, s, (&fit.theta, &typical)))
        .collect();
    let mut theta = fit.theta.clone();
    for (part, own) in layout.parts.iter().zip(&moved) {
        if let Some(own) = own {
            theta[part.offset..part.offset + part.own].copy_from_slice(own);
        }
    }
    moved.iter().any(Option::is_some).then_some(theta)
}

/// The own parameters of segment `s` estimated from their `typical` values, where that is better
/// than what they are at `theta`.
fn alone<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    method: &Method,
    s: usize,
    (theta, typical): (&[f64], &[f64]),
) -> Option<Vec<f64>> {
    let part = &layout.parts[s];
    let places: Vec<usize> =
        part.shared.iter().copied().chain(part.offset..part.offset + part.own).collect();
    let of = |all: &[f64]| places.iter().map(|&i| all[i]).collect::<Vec<f64>>();
    let (here, shared) = (of(theta), part.shared.len());
    // What is common is held: both of its bounds are one value.
    let within = |bound: &[f64]| [&here[..shared], &of(bound)[shared..]].concat();
    let one = Layout {
        shared,
        parts: vec![Part {
            shared: (0..shared).collect(),
            offset: shared,
            group: 0,
            ..part.clone()
        }],
        start: of(typical),
        lower: within(&layout.lower),
        upper: within(&layout.upper),
        centre: of(&layout.centre),
        prior_sd: of(&layout.prior_sd),
        squares: (0..places.len())
            .filter(|&k| layout.squares.binary_search(&places[k]).is_ok())
            .collect(),
        noise: crate::least_squares::Structure { groups: 1, ..layout.noise.clone() },
    };
    let evaluate =
        |_: usize, local: &[f64], sensitivities: bool| evaluate.blocks(s, local, sensitivities);
    let before = cost(&one, &evaluate, &here)?;
    let found = minimise(&one, &evaluate, &coarse(method));
    (found.cost() < before - GAIN).then(|| found.theta[shared..].to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::least_squares::{Block, Stop};

    type Blocks = Option<Vec<Block>>;

    /// `y = s (a + 1.5 sin 2a) t`: in `a`, a segment's own, several minima; `s` is common.
    fn problem(wells: &[f64]) -> (Layout, impl Fn(usize, &[f64], bool) -> Blocks) {
        let of = |a: f64| (a + 1.5 * libm::sin(2.0 * a), 1.0 + 3.0 * libm::cos(2.0 * a));
        let wells = wells.to_vec();
        let layout = Layout::plain(
            1,
            &vec![1; wells.len()],
            1,
            [&[1.1], &vec![0.4; wells.len()][..]].concat(),
        );
        let evaluate = move |s: usize, p: &[f64], _: bool| {
            let t = (0..50).map(|k| 0.02 * f64::from(k) + 0.1);
            let (f, df) = of(p[1]);
            let noise = |t: f64| 0.01 * libm::sin(31.0 * t + s as f64);
            let e = t.clone().map(|t| of(wells[s]).0 * t + noise(t) - p[0] * f * t).collect();
            Some(vec![Block::new(0, e, t.flat_map(|t| [f * t, p[0] * df * t]).collect())])
        };
        (layout, evaluate)
    }

    fn alike(n: usize) -> Known {
        Known { alike: vec![(1..=n).collect()], limits: Vec::new(), densities: Vec::new() }
    }

    #[test]
    fn a_segment_in_a_wrong_minimum_gets_out_of_it() {
        let (mut layout, evaluate) = problem(&[0.10, 0.12, 0.14, 0.11, 0.13]);
        // A prior fixes the scale, as the noise does in practice.
        layout.prior_sd[0] = 1e-3;
        layout.centre[0] = 1.0;
        layout.start[3] = 2.9;
        let method = Method::default();
        let plain = minimise(&layout, &evaluate, &method);
        assert!(
            (plain.theta[3] - 0.14).abs() > 0.5,
            "the test would not notice: {:?}",
            plain.theta
        );
        let fit = lowest(&layout, &evaluate, &method, &alike(5));
        assert_eq!(fit.stop, Stop::Converged);
        for (a, wanted) in fit.theta[1..].iter().zip([0.10, 0.12, 0.14, 0.11, 0.13]) {
            assert!((a - wanted).abs() < 0.02, "{:?}", fit.theta);
        }
        assert!(fit.iterations.windows(2).all(|two| two[0].iteration < two[1].iteration));
    }

    #[test]
    fn where_all_are_well_nothing_changes() {
        let (layout, evaluate) = problem(&[0.30, 0.35, 0.40]);
        let method = Method::default();
        let plain = minimise(&layout, &evaluate, &method);
        let fit = lowest(&layout, &evaluate, &method, &alike(3));
        let near = fit.theta.iter().zip(&plain.theta).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near, "{:?} {:?}", fit.theta, plain.theta);
    }
}
