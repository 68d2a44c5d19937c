//! A solved problem and one of its parameters in; the likelihood's profile along it, and the
//! interval that it gives, out.
//!
//! At every prescribed value all other parameters are estimated again. With white residuals twice
//! the rise of the cost, `2 (J(value) - J(estimate))`, is chi-square distributed with one degree of
//! freedom where the value is the truth (Wilks 1938), so the interval of level `p` is where it
//! stays below the chi-square quantile. Near the estimate it is `(value - estimate)^2 / sd_crlb^2`,
//! while coloured residuals scatter the estimate by `sd`: the rise is multiplied by
//! `(sd_crlb / sd)^2`, which makes it chi-square again to first order. Where the profile is a
//! parabola, the interval is the estimate and 1.96 sd to both sides (at 95%).

use super::Settings;
use super::solution::Solution;
use crate::least_squares::{Evaluate, Iteration, Layout, StepControl, Stop, minimise};
use crate::math::distribution::chi2_quantile;
use rayon::prelude::*;

/// One value that was looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub value: f64,
    /// Twice the rise of the cost above that of the estimate, scaled for coloured residuals.
    pub rise: f64,
}

/// Where the interval ends on one side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The limit is reached.
    Found,
    /// Not reached on the parameter's bound.
    Bound,
    /// Not reached within `REACH` standard deviations.
    Far,
    /// The other parameters could not be estimated at some value before.
    Lost,
}

/// One parameter's profile.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Index of the parameter among the rows of the estimation.
    pub row: usize,
    pub level: f64,
    /// The rise at which the interval ends.
    pub limit: f64,
    /// By value, the estimate itself among them.
    pub points: Vec<Point>,
    pub lower: Option<f64>,
    pub upper: Option<f64>,
    /// Below and above.
    pub ends: [End; 2],
}

impl Profile {
    /// How the interval ended, in words for a table.
    pub fn words(&self) -> String {
        let open = |side: &str, end: End| match end {
            End::Found => None,
            End::Bound => Some(format!("open {side}: the limit is not reached on the bound")),
            End::Far => Some(format!("open {side}: the limit is not reached within {REACH} sd")),
            End::Lost => Some(format!("open {side}: the other parameters have no estimate there")),
        };
        let words: Vec<String> = [open("below", self.ends[0]), open("above", self.ends[1])]
            .into_iter()
            .flatten()
            .collect();
        if words.is_empty() { "closed".into() } else { words.join("; ") }
    }
}

/// An end is looked for within so many standard deviations.
const REACH: f64 = 10.0;
/// Points per side at most.
const POINTS: usize = 60;
/// A fall of the cost over ten iterations that does not matter.
const SETTLED: f64 = 1e-3;
/// An upper limit is known to within this share of itself.
const WIDTH: f64 = 0.02;
/// The root of the rise is this close to its limit at an end.
const CLOSE: f64 = 1e-4;

/// Profiles of the parameters (indices) that have a standard deviation, in this order.
pub fn profiles<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    solution: &Solution,
    which: &[usize],
    settings: &Settings,
) -> Vec<Profile> {
    let sides: Vec<(usize, f64)> = which.iter().flat_map(|&i| [(i, -1.0), (i, 1.0)]).collect();
    let found: Vec<Option<Side>> = sides
        .par_iter()
        .map(|&(i, direction)| {
            let sd = solution.deviation(i)?;
            let search = Search {
                layout,
                evaluate,
                solution,
                settings,
                i,
                direction,
                sd: sd.0,
                shrink: sd.1 / sd.0,
            };
            Some(search.run())
        })
        .collect();
    let limit = chi2_quantile(settings.profile_level, 1.0);
    let join = |(&row, sides): (&usize, &[Option<Side>])| {
        let [Some(below), Some(above)] = sides else { return None };
        let here = Point { value: solution.fit.theta[row], rise: 0.0 };
        let mut points: Vec<Point> =
            below.points.iter().chain([&here]).chain(&above.points).copied().collect();
        points.sort_by(|a, b| a.value.total_cmp(&b.value));
        let (lower, upper, ends) = (below.at, above.at, [below.end, above.end]);
        Some(Profile { row, level: settings.profile_level, limit, points, lower, upper, ends })
    };
    which.iter().zip(found.chunks(2)).filter_map(join).collect()
}

/// The value of a parameter on its lower bound, zero, at which the likelihood has fallen so far that
/// a larger one is as unlikely as the level says: one-sided. Looked for from `first` on; none where
/// it is not reached, or the other parameters have no estimate.
pub fn upper_limit<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    solution: &Solution,
    (i, first): (usize, f64),
    settings: &Settings,
) -> Option<Profile> {
    let limit = chi2_quantile(2.0 * settings.profile_level - 1.0, 1.0);
    let (direction, sd, shrink) = (1.0, f64::NAN, 1.0);
    let search = Search { layout, evaluate, solution, settings, i, direction, sd, shrink };
    let mut warm = solution.fit.theta.clone();
    let mut points = vec![Point { value: solution.fit.theta[i], rise: 0.0 }];
    let (mut low, mut high, mut value) = (0.0, f64::INFINITY, first);
    // The rise goes by the fourth power of a small density.
    while (high.is_infinite() || high - low > WIDTH * high) && points.len() < POINTS {
        let (rise, theta) = search.at(value, &warm)?;
        points.push(Point { value, rise });
        if rise < limit {
            (low, warm) = (value, theta);
        } else {
            high = value;
        }
        value = if high.is_finite() { 0.5 * (low + high) } else { 2.0 * value };
    }
    points.sort_by(|a, b| a.value.total_cmp(&b.value));
    let ends = [End::Bound, if high.is_finite() { End::Found } else { End::Far }];
    let upper = high.is_finite().then_some(0.5 * (low + high));
    Some(Profile { row: i, level: settings.profile_level, limit, points, lower: None, upper, ends })
}

struct Side {
    points: Vec<Point>,
    at: Option<f64>,
    end: End,
}

/// The search along one direction.
struct Search<'a, F> {
    layout: &'a Layout,
    evaluate: &'a F,
    solution: &'a Solution,
    settings: &'a Settings,
    i: usize,
    /// -1 or 1.
    direction: f64,
    sd: f64,
    /// `sd_crlb / sd`.
    shrink: f64,
}

impl<F: Evaluate> Search<'_, F> {
    /// The root of the scaled rise grows like the distance in sd: it is brought to the root of the
    /// limit by regula falsi, with a bisection where that moves only one end.
    fn run(&self) -> Side {
        let wanted = chi2_quantile(self.settings.profile_level, 1.0).sqrt();
        let centre = self.solution.fit.theta[self.i];
        let bound = if self.direction < 0.0 {
            self.layout.lower[self.i]
        } else {
            self.layout.upper[self.i]
        };
        let far = centre + self.direction * REACH * self.sd;
        let last = if (bound - centre).abs() < (far - centre).abs() { bound } else { far };
        let mut side = Side { points: Vec::new(), at: None, end: End::Lost };
        let (mut inner, mut outer) = ((centre, 0.0), None);
        let mut warm = self.solution.fit.theta.clone();
        let mut value = centre + self.direction * wanted * self.sd;
        let mut same_side: i32 = 0;
        for _ in 0..POINTS {
            value = if (value - centre).abs() > (last - centre).abs() { last } else { value };
            let Some((rise, theta)) = self.at(value, &warm) else { return side };
            side.points.push(Point { value, rise });
            let root = rise.max(0.0).sqrt();
            if (root - wanted).abs() <= CLOSE * wanted {
                (side.at, side.end) = (Some(value), End::Found);
                return side;
            }
            if root < wanted {
                same_side = if same_side < 0 { same_side - 1 } else { -1 };
                (inner, warm) = ((value, root), theta);
            } else {
                same_side = if same_side > 0 { same_side + 1 } else { 1 };
                outer = Some((value, root));
            }
            value = match outer {
                None if value == last => {
                    side.end = if last == bound { End::Bound } else { End::Far };
                    return side;
                }
                None => centre + (value - centre) * (wanted / root).clamp(1.1, 2.0),
                Some((above, _)) if (above - inner.0).abs() <= 1e-6 * self.sd => {
                    // A jump of the cost: the limit lies within it.
                    (side.at, side.end) = (Some(above), End::Found);
                    return side;
                }
                Some((above, _)) if same_side.abs() > 2 => 0.5 * (inner.0 + above),
                Some((above, high)) => {
                    inner.0 + (wanted - inner.1) / (high - inner.1) * (above - inner.0)
                }
            };
        }
        side
    }

    /// The scaled rise at a prescribed value, and the other parameters there.
    fn at(&self, value: f64, warm: &[f64]) -> Option<(f64, Vec<f64>)> {
        let mut layout = self.layout.clone();
        layout.start = warm.to_vec();
        (layout.start[self.i], layout.lower[self.i], layout.upper[self.i]) = (value, value, value);
        let mut method = self.settings.method();
        let mut fit = minimise(&layout, self.evaluate, &method);
        if matches!(fit.stop, Stop::NoImprovement | Stop::IterationLimit) {
            // A kink of the cost (a threshold on a sample) stops a step that is only shortened; a
            // damped one may get past it.
            layout.start = fit.theta.clone();
            method.control = StepControl::LevenbergMarquardt;
            fit = minimise(&layout, self.evaluate, &method);
        }
        let last = |iterations: &[Iteration]| iterations.last().map(|i| i.cost);
        let rise = 2.0 * (last(&fit.iterations)? - last(&self.solution.fit.iterations)?);
        let ended =
            matches!(fit.stop, Stop::Converged | Stop::NoImprovement) || settled(&fit.iterations);
        (ended && rise.is_finite()).then_some((rise * self.shrink * self.shrink, fit.theta))
    }
}

/// The cost hardly falls any more, though steps do not shrink: as good as its minimum, for a rise.
fn settled(iterations: &[Iteration]) -> bool {
    let [.., before, _, _, _, _, _, _, _, _, last] = iterations else { return false };
    before.cost - last.cost < SETTLED
}
