//! A parameter vector in; residuals, cost, normal equations and the step inside the bounds there, out.

use super::arrow::{Arrow, Factor};
use super::covariance::{Covariance, Scatter};
use super::layout::Layout;
use super::method::{Method, Undetermined};
use super::problem::{Evaluate, pass, scatter, weighed};
use super::sums::Totals;
use crate::math::products::dot;

/// What decides whether a step is taken.
pub struct Trial {
    pub theta: Vec<f64>,
    pub noise: Vec<Covariance>,
    pub ln_det: f64,
    pub cost: f64,
    /// The sums per output, where one pass yielded them together with the residuals.
    totals: Option<Totals>,
}

/// Whether a trial point is likely to be taken: then one pass for residuals and sensitivities
/// together is best, where there can be one; a point that is likely to be refused is tried without
/// sensitivities.
#[derive(Clone, Copy, PartialEq)]
pub enum Chance {
    Good,
    Poor,
}

/// All that is known at one parameter vector.
pub struct Point {
    pub theta: Vec<f64>,
    pub noise: Vec<Covariance>,
    pub ln_det: f64,
    pub cost: f64,
    /// Normal matrix and gradient (downhill), priors included.
    pub matrix: Arrow,
    pub gradient: Vec<f64>,
}

impl Trial {
    pub fn at<F: Evaluate>(
        layout: &Layout,
        evaluate: &F,
        theta: Vec<f64>,
        chance: Chance,
    ) -> Option<Trial> {
        let (groups, totals) = if layout.noise.is_simple() && chance == Chance::Good {
            pass(layout, evaluate, &theta).map(|(groups, totals)| (groups, Some(totals)))?
        } else {
            (scatter(layout, evaluate, &theta)?, None)
        };
        let noise: Vec<Covariance> =
            groups.iter().map(|s: &Scatter| s.covariance(&layout.noise)).collect::<Option<_>>()?;
        let mut cost: f64 = noise.iter().map(|r| r.cost).sum();
        for i in 0..theta.len() {
            let d = (theta[i] - layout.centre[i]) / layout.prior_sd[i];
            cost += 0.5 * d * d;
        }
        let ln_det = mean_ln_det(&noise);
        cost.is_finite().then_some(Trial { theta, noise, ln_det, cost, totals })
    }

    /// With the normal equations; `None` where a sensitivity is not finite.
    pub fn complete<F: Evaluate>(self, layout: &Layout, evaluate: &F) -> Option<Point> {
        let Trial { theta, noise, ln_det, cost, totals } = self;
        let (mut matrix, mut gradient) = match (totals, &noise[..]) {
            (Some(totals), [r]) => {
                let weights: Vec<f64> = r.variances().iter().map(|r| 1.0 / r).collect();
                totals.weigh(layout, &weights)
            }
            _ => weighed(layout, evaluate, &theta, &noise)?.weigh(layout, &[1.0]),
        };
        for i in 0..theta.len() {
            let (weight, pull) = layout.prior(i, theta[i]);
            if weight > 0.0 {
                matrix.add_diagonal(i, weight);
                gradient[i] += pull;
            }
        }
        Some(Point { theta, noise, ln_det, cost, matrix, gradient })
    }
}

fn mean_ln_det(noise: &[Covariance]) -> f64 {
    let [first, rest @ ..] = noise else { return 0.0 };
    if rest.is_empty() {
        return first.ln_det;
    }
    let samples = |r: &Covariance| r.count.iter().sum::<usize>() as f64;
    noise.iter().map(|r| samples(r) * r.ln_det).sum::<f64>()
        / noise.iter().map(samples).sum::<f64>().max(1.0)
}

impl Point {
    pub fn at<F: Evaluate>(layout: &Layout, evaluate: &F, theta: Vec<f64>) -> Option<Point> {
        Trial::at(layout, evaluate, theta, Chance::Good)?.complete(layout, evaluate)
    }

    /// The whole step from here inside the bounds; `held` stays where it is.
    pub fn step(&self, layout: &Layout, method: &Method, held: Option<usize>) -> Option<Vec<f64>> {
        bounded_step(layout, &self.theta, (&self.matrix, &self.gradient), held, method.undetermined)
    }

    /// Length of a step in standard deviations: `sqrt(d' M d)`.
    pub fn length(&self, step: &[f64]) -> f64 {
        self.matrix.quadratic(step).max(0.0).sqrt()
    }

    /// By how much a step lowers the cost if that is a parabola: `d' g - 1/2 d' M d`.
    pub fn promise(&self, step: &[f64]) -> f64 {
        dot(step, &self.gradient) - 0.5 * self.matrix.quadratic(step).max(0.0)
    }

    /// Parameters on a bound that the gradient pushes against it.
    pub fn held(&self, layout: &Layout) -> Vec<bool> {
        let at = |i: usize| {
            let (x, g) = (self.theta[i], self.gradient[i]);
            (x <= layout.lower[i] && g <= 0.0) || (x >= layout.upper[i] && g >= 0.0)
        };
        (0..self.theta.len()).map(at).collect()
    }

    /// The steepest slope over the free parameters, each measured by its own information:
    /// `max |g_i| / sqrt(M_ii)`.
    pub fn slope(&self, layout: &Layout) -> f64 {
        let held = self.held(layout);
        let diagonal = self.matrix.diagonal();
        let each = (0..held.len()).filter(|&i| !held[i] && diagonal[i] > 0.0);
        each.map(|i| self.gradient[i].abs() / diagonal[i].sqrt()).fold(0.0, f64::max)
    }
}

/// The cost at `theta`; `None` where the model is not finite.
pub fn cost<F: Evaluate>(layout: &Layout, evaluate: &F, theta: &[f64]) -> Option<f64> {
    Trial::at(layout, evaluate, theta.to_vec(), Chance::Poor).map(|trial| trial.cost)
}

/// The normal matrix at `theta` with priors, weighted with the `R` of the residuals there; `None`
/// where the model is not finite.
pub fn normal_matrix<F: Evaluate>(layout: &Layout, evaluate: &F, theta: &[f64]) -> Option<Arrow> {
    Point::at(layout, evaluate, theta.to_vec()).map(|point| point.matrix)
}

/// The same with the gradient (downhill).
pub fn normal_equations<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    theta: &[f64],
) -> Option<(Arrow, Vec<f64>)> {
    let Point { matrix, gradient, .. } = Point::at(layout, evaluate, theta.to_vec())?;
    Some((matrix, gradient))
}

/// The normal matrix with the whole Gauss-Newton step from there.
pub fn stepped<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    theta: &[f64],
    method: &Method,
) -> Option<(Arrow, Vec<f64>)> {
    let point = Point::at(layout, evaluate, theta.to_vec())?;
    let step = point.step(layout, method, None)?;
    Some((point.matrix, step))
}

/// The Gauss-Newton step inside the bounds: components that would cross a bound end on it, the
/// others are solved for given that (an active set, found afresh in every iteration, so that a
/// parameter leaves its bound when the data pull it off). `held` stays where it is. A parameter
/// that depends on those before it stays as well, or there is no step at all.
pub fn bounded_step(
    layout: &Layout,
    theta: &[f64],
    (matrix, gradient): (&Arrow, &[f64]),
    held: Option<usize>,
    undetermined: Undetermined,
) -> Option<Vec<f64>> {
    // Where both bounds are one value there is nothing to solve for, nor need the data determine
    // anything.
    let prescribed =
        |i: usize| (layout.lower[i] == layout.upper[i]).then(|| layout.lower[i] - theta[i]);
    let mut pins: Vec<Option<f64>> = (0..theta.len()).map(prescribed).collect();
    held.into_iter().for_each(|i| pins[i] = Some(0.0));
    if undetermined == Undetermined::SetAside {
        let idle = idle(layout, matrix);
        pins.iter_mut().zip(idle).filter(|(_, idle)| *idle).for_each(|(pin, _)| *pin = Some(0.0));
    }
    loop {
        let mut rhs = gradient.to_vec();
        let step = match pinned(matrix, &mut rhs, &pins) {
            Ok(factor) => factor.solve(&rhs),
            Err(i) if undetermined == Undetermined::Held && pins[i].is_none() => {
                pins[i] = Some(0.0);
                continue;
            }
            Err(_) => return None,
        };
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

/// Parameters common to all segments without information: neither residuals nor a prior notice
/// them. (What only some segments have in common costs those segments.)
pub fn idle(layout: &Layout, matrix: &Arrow) -> Vec<bool> {
    let is_idle = |i: usize| {
        i < layout.shared
            && matrix.cc[i * matrix.shared + i] == 0.0
            && layout.lower[i] < layout.upper[i]
            && layout.parts.iter().all(|part| part.shared.contains(&i))
    };
    (0..layout.start.len()).map(is_idle).collect()
}

fn pinned(matrix: &Arrow, rhs: &mut [f64], pins: &[Option<f64>]) -> Result<Factor, usize> {
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
