//! The Gauss-Newton iteration: a problem over segments in; the maximum-likelihood point, its normal matrix and history out.

use super::arrow::{Arrow, Factor};
use super::problem::{Block, Layout, Totals, pass};
use super::{Iteration, Stop};

/// When to stop (`Settings` documents the fields).
#[derive(Debug, Clone, Copy)]
pub struct Rule {
    pub tolerance: f64,
    pub step_tolerance: f64,
    pub max_iterations: usize,
    pub max_halvings: usize,
}

/// Where the iteration ended.
#[derive(Debug, Clone)]
pub struct Fit {
    pub theta: Vec<f64>,
    pub stop: Stop,
    pub iterations: Vec<Iteration>,
    /// Variance per noise class at `theta` (1 for a class without samples).
    pub r: Vec<f64>,
    pub ln_det: f64,
    /// Scored samples per class.
    pub count: Vec<usize>,
    /// The normal matrix at `theta` with priors; none where the model was not finite or there was no data.
    pub matrix: Option<Arrow>,
    /// Parameters that sit on a bound and would leave it if they could.
    pub held: Vec<bool>,
}

/// A step of this length, in standard deviations, is nothing: if no part of it improves the likelihood, rounding is the reason.
const NOTHING: f64 = 1e-3;

/// All that is known at one parameter vector.
struct Point {
    theta: Vec<f64>,
    totals: Totals,
    r: Vec<f64>,
    ln_det: f64,
    cost: f64,
}

impl Point {
    fn at<F>(layout: &Layout, evaluate: &F, theta: Vec<f64>) -> Option<Point>
    where
        F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
    {
        let totals = pass(layout, evaluate, &theta)?;
        let mut r = vec![1.0; layout.classes];
        let (mut cost, mut ln_det) = (0.0, 0.0);
        for (j, r) in r.iter_mut().enumerate() {
            if totals.count[j] > 0 {
                let n = totals.count[j] as f64;
                let mean = totals.square[j] / n;
                *r = mean.max(layout.floor[j]);
                ln_det += libm::log(*r);
                // attas (A4) at the best R: N/2 ln R; on the floor the sum of squares counts as well.
                cost += 0.5 * n * (libm::log(*r) + mean / *r - 1.0);
            }
        }
        for i in 0..theta.len() {
            let d = (theta[i] - layout.start[i]) / layout.prior_sd[i];
            cost += 0.5 * d * d;
        }
        cost.is_finite().then_some(Point { theta, totals, r, ln_det, cost })
    }

    /// Normal matrix and gradient, priors included.
    fn normal(&self, layout: &Layout) -> (Arrow, Vec<f64>) {
        let (mut matrix, mut gradient) = self.totals.weigh(layout, &self.r);
        for i in 0..self.theta.len() {
            let weight = layout.prior_weight(i);
            if weight > 0.0 {
                matrix.add_diagonal(i, weight);
                gradient[i] += weight * (layout.start[i] - self.theta[i]);
            }
        }
        (matrix, gradient)
    }
}

/// Minimises `J = 1/2 sum e' R^-1 e + N/2 ln|R|` (attas A4) from `layout.start`.
pub fn minimise<F>(layout: &Layout, evaluate: &F, rule: &Rule) -> Fit
where
    F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
{
    let theta = layout.start.clone();
    let Some(mut point) = Point::at(layout, evaluate, theta) else {
        return failed(layout, Stop::NotFinite);
    };
    if layout.start.is_empty() || point.totals.count.iter().all(|&n| n == 0) {
        return ended(layout, point, Vec::new(), Stop::NoData);
    }
    let mut history = vec![line(0, &point, 0.0, 0)];
    let mut stop = Stop::IterationLimit;
    for iteration in 1..=rule.max_iterations {
        let (matrix, gradient) = point.normal(layout);
        let Some(step) = bounded_step(layout, &point.theta, &matrix, &gradient) else {
            stop = Stop::Singular;
            break;
        };
        let length = matrix.quadratic(&step).max(0.0).sqrt();
        let Some((next, halvings)) = search(layout, evaluate, &point, &step, rule.max_halvings) else {
            stop = if length <= rule.step_tolerance.max(NOTHING) { Stop::Converged } else { Stop::NoImprovement };
            break;
        };
        let change = libm::expm1(next.ln_det - point.ln_det).abs();
        point = next;
        history.push(line(iteration, &point, length, halvings));
        let small = rule.step_tolerance == 0.0 || length <= rule.step_tolerance;
        // A step cut short changes little without being near the optimum, unless only rounding cut it.
        let whole = halvings == 0 || length <= NOTHING;
        if change < rule.tolerance && small && whole {
            stop = Stop::Converged;
            break;
        }
    }
    ended(layout, point, history, stop)
}

/// The longest of `step`, `step/2`, `step/4` ... that is finite and does not raise the cost.
fn search<F>(layout: &Layout, evaluate: &F, point: &Point, step: &[f64], max_halvings: usize) -> Option<(Point, usize)>
where
    F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
{
    let mut length = 1.0;
    for halvings in 0..=max_halvings {
        let trial = (0..step.len()).map(|i| (point.theta[i] + length * step[i]).clamp(layout.lower[i], layout.upper[i])).collect();
        match Point::at(layout, evaluate, trial) {
            Some(next) if next.cost <= point.cost => return Some((next, halvings)),
            _ => length *= 0.5,
        }
    }
    None
}

/// The Gauss-Newton step inside the bounds: components that would cross a bound end on it, the others are solved for given that
/// (an active set, found afresh in every iteration, so that a parameter leaves its bound when the data pull it off).
/// `None` where the matrix is singular.
fn bounded_step(layout: &Layout, theta: &[f64], matrix: &Arrow, gradient: &[f64]) -> Option<Vec<f64>> {
    let mut pins: Vec<Option<f64>> = vec![None; theta.len()];
    loop {
        let mut rhs = gradient.to_vec();
        let step = pinned(matrix, &mut rhs, &pins)?.solve(&rhs);
        let mut crossed = false;
        for i in 0..theta.len() {
            let to = theta[i] + step[i];
            if pins[i].is_none() && (to < layout.lower[i] || to > layout.upper[i]) {
                pins[i] = Some(to.clamp(layout.lower[i], layout.upper[i]) - theta[i]);
                crossed = true;
            }
        }
        if !crossed {
            return step.iter().all(|d| d.is_finite()).then_some(step);
        }
    }
}

fn pinned(matrix: &Arrow, rhs: &mut [f64], pins: &[Option<f64>]) -> Option<Factor> {
    if pins.iter().all(Option::is_none) {
        return matrix.factor();
    }
    let mut matrix = matrix.clone();
    for (i, pin) in pins.iter().enumerate() {
        if let Some(value) = pin {
            matrix.pin(rhs, i, *value);
        }
    }
    matrix.factor()
}

fn line(iteration: usize, point: &Point, step: f64, halvings: usize) -> Iteration {
    Iteration { iteration, cost: point.cost, det_r: libm::exp(point.ln_det), step, halvings }
}

fn failed(layout: &Layout, stop: Stop) -> Fit {
    Fit {
        theta: layout.start.clone(),
        stop,
        iterations: Vec::new(),
        r: vec![f64::NAN; layout.classes],
        ln_det: f64::NAN,
        count: vec![0; layout.classes],
        matrix: None,
        held: vec![false; layout.start.len()],
    }
}

fn ended(layout: &Layout, point: Point, iterations: Vec<Iteration>, stop: Stop) -> Fit {
    let (matrix, gradient) = point.normal(layout);
    let held = (0..point.theta.len())
        .map(|i| {
            let (x, g) = (point.theta[i], gradient[i]);
            (x <= layout.lower[i] && g <= 0.0) || (x >= layout.upper[i] && g >= 0.0)
        })
        .collect();
    let matrix = (stop != Stop::NoData).then_some(matrix);
    let Point { theta, totals, r, ln_det, .. } = point;
    Fit { theta, stop, iterations, r, ln_det, count: totals.count, matrix, held }
}
