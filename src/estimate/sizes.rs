//! A problem in; its minimum, with common parameters that have no effect tried from other sizes, out.
//!
//! A limit of rate or deflection, a threshold, the delay of a term that is zero: from some sizes on
//! such a parameter shows in the outputs, before there is no gradient that would lead there. The
//! iteration sets it aside while nothing shows it, and takes it up again as soon as something does.
//! What has no effect at the end is tried from other starts; where the data then are met clearly
//! better (by `GAIN`), that is the minimum. What remains is held at its start.
//!
//! The coefficients of one limit belong together: a surface over the conditions is smaller as a
//! whole. It is first started where what was measured goes to (`Measured`); then all that is without
//! effect is tried from half, twice, a quarter and four times its start. Of several that show
//! together each has to be worth it by itself: what can be put back for less than `GAIN` is.

use crate::least_squares::{Evaluate, Fit, Layout, Method, minimise};

/// A likelihood ratio of 20: a limit that only cuts off the noise of the largest samples gains less.
const GAIN: f64 = 3.0;
/// A limit shows when it is smaller, a threshold when it is larger.
const SIZES: [f64; 4] = [0.5, 2.0, 0.25, 4.0];

/// A limit against what was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Its coefficients, by place in the parameter vector.
    pub places: Vec<usize>,
    /// By how much they have to be multiplied for the limit to be where what was measured goes to.
    pub size: f64,
}

/// Minimises from `layout.start` and, for parameters that end without effect, from other sizes.
pub fn from_sizes<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    method: &Method,
    limits: &[Measured],
) -> Fit {
    let mut fit = minimise(layout, evaluate, method);
    for size in [None].into_iter().chain(SIZES.map(Some)) {
        if !fit.idle.contains(&true) {
            break;
        }
        let times = |i: usize| {
            let own = |limit: &&Measured| limit.places.contains(&i);
            let limit = limits.iter().filter(|l| l.places.iter().all(|&i| fit.idle[i])).find(own);
            size.or(limit.map(|limit| limit.size)).unwrap_or(1.0)
        };
        let resized = |i: usize| {
            let start = if fit.idle[i] { times(i) * layout.start[i] } else { fit.theta[i] };
            start.clamp(layout.lower[i], layout.upper[i])
        };
        let start: Vec<f64> = (0..fit.theta.len()).map(resized).collect();
        if start == fit.theta {
            continue;
        }
        let again = minimise(&Layout { start, ..layout.clone() }, evaluate, method);
        if again.cost() < fit.cost() - GAIN {
            let was_idle = fit.idle.clone();
            fit = put_back(layout, evaluate, method, fit.then(again), &groups(&was_idle, limits));
        }
    }
    fit
}

/// Parameters without effect that belong together: the coefficients of a limit, or one alone.
fn groups(idle: &[bool], limits: &[Measured]) -> Vec<Vec<usize>> {
    let all = |limit: &&Measured| limit.places.iter().all(|&i| idle[i]);
    let limits: Vec<Vec<usize>> = limits.iter().filter(all).map(|l| l.places.clone()).collect();
    let alone = |i: &usize| idle[*i] && limits.iter().all(|places| !places.contains(i));
    let alone: Vec<Vec<usize>> = (0..idle.len()).filter(alone).map(|i| vec![i]).collect();
    [limits, alone].concat()
}

/// The fit without those of the `groups` that it hardly needs, where several of them show.
fn put_back<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    method: &Method,
    mut fit: Fit,
    groups: &[Vec<usize>],
) -> Fit {
    let shows = |fit: &Fit, places: &[usize]| places.iter().any(|&i| !fit.idle[i]);
    for places in groups {
        if groups.iter().filter(|places| shows(&fit, places)).count() < 2 || !shows(&fit, places) {
            continue;
        }
        let mut start = fit.theta.clone();
        places.iter().for_each(|&i| start[i] = layout.start[i]);
        let without = minimise(&Layout { start, ..layout.clone() }, evaluate, method);
        if !shows(&without, places) && without.cost() < fit.cost() + GAIN {
            fit = fit.then(without);
        }
    }
    fit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::least_squares::{Block, Stop, Undetermined};

    /// `y = min(k u, limit)`, with `u` up to 1.
    fn limited(start: [f64; 2], truth: [f64; 2]) -> Fit {
        let layout = Layout::plain(2, &[0], 1, start.to_vec());
        let evaluate = move |_: usize, p: &[f64], _: bool| {
            let u = (0..80).map(|k| libm::sin(0.2 * f64::from(k)));
            let z = |u: f64| (truth[0] * u).min(truth[1]) + 0.01 * libm::sin(37.0 * u);
            let e = u.clone().map(|u| z(u) - (p[0] * u).min(p[1])).collect();
            let g = u.flat_map(|u| if p[0] * u < p[1] { [u, 0.0] } else { [0.0, 1.0] });
            Some(vec![Block::new(0, e, g.collect())])
        };
        let method = Method { undetermined: Undetermined::SetAside, ..Method::default() };
        from_sizes(&layout, &evaluate, &method, &[])
    }

    /// `y = min(u, a + b c)` at four conditions `c`.
    fn surface(a: f64, limits: &[Measured]) -> Fit {
        let layout = Layout::plain(2, &[0; 4], 1, vec![a, 0.0]);
        let evaluate = move |s: usize, p: &[f64], _: bool| {
            let c = s as f64;
            let u = (0..80).map(|k| libm::sin(0.2 * f64::from(k)));
            let z = |u: f64| u.min(0.8 - 0.1 * c) + 0.01 * libm::sin(37.0 * u);
            let e = u.clone().map(|u| z(u) - u.min(p[0] + p[1] * c)).collect();
            let g = u.flat_map(|u| if u < p[0] + p[1] * c { [0.0, 0.0] } else { [1.0, c] });
            Some(vec![Block::new(0, e, g.collect())])
        };
        let method = Method { undetermined: Undetermined::SetAside, ..Method::default() };
        from_sizes(&layout, &evaluate, &method, limits)
    }

    #[test]
    fn a_surface_is_started_where_what_was_measured_goes_to() {
        let far = surface(30.0, &[]);
        assert_eq!(far.idle, [true, true], "four times less is still too far: {:?}", far.theta);
        let limit = Measured { places: vec![0, 1], size: 0.65 / 30.0 };
        let fit = surface(30.0, &[limit]);
        assert_eq!((fit.stop, &fit.idle[..]), (Stop::Converged, &[false, false][..]));
        assert!(
            (fit.theta[0] - 0.8).abs() < 0.02 && (fit.theta[1] + 0.1).abs() < 0.02,
            "{:?}",
            fit.theta
        );
    }

    #[test]
    fn a_limit_that_no_start_reaches_is_held_and_the_rest_is_estimated() {
        let fit = limited([0.7, 3.0], [1.2, 5.0]);
        assert_eq!(
            (fit.stop, &fit.idle[..], &fit.held[..]),
            (Stop::Converged, &[false, true][..], &[false, true][..])
        );
        assert!((fit.theta[0] - 1.2).abs() < 0.01 && fit.theta[1] == 3.0, "{:?}", fit.theta);
    }

    #[test]
    fn a_limit_that_another_size_reaches_is_found() {
        let fit = limited([0.7, 3.0], [1.2, 0.9]);
        assert_eq!((fit.stop, &fit.idle[..]), (Stop::Converged, &[false, false][..]));
        assert!(
            (fit.theta[0] - 1.2).abs() < 0.02 && (fit.theta[1] - 0.9).abs() < 0.02,
            "{:?}",
            fit.theta
        );
    }
}
