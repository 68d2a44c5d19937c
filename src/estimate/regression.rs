//! A case in; its parameters by regression on the rate and output equations (equation error), with
//! statistics of their own, out.
//!
//! Weighted least squares over all equations (weights from the residuals, Gauss-Newton for
//! parameters that enter nonlinearly, bounds, colour of the residuals as for output error) is the
//! likelihood's maximum of this problem: the same solver. Poor starts do no harm; noise of the
//! regressors biases the values towards zero (Klein & Morelli 2006, sec. 5.1), which `attenuation`
//! estimates.

use super::attenuation::shifts;
use super::case::Case;
use super::neighbours::Known;
use super::rank::NONE;
use super::regressors::{ESTIMATED, Problem};
use super::sides::{Considered, USED};
use super::solution::{Solution, solve};
use super::{Settings, Stop};
use crate::error::Result;
use crate::least_squares::{Block, Layout, each};
use crate::math::distribution::normal_cdf;

/// What became of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Regressed {
    /// Index among the rows of the estimation.
    pub row: usize,
    /// "estimated", or why it kept its start.
    pub outcome: &'static str,
    pub start: f64,
    pub value: f64,
    /// With coloured residuals allowed for, and for white ones; none where it kept its start.
    pub sd: Option<f64>,
    pub sd_white: Option<f64>,
    /// How far the noise of the regressors is expected to have moved the value; none where it kept
    /// its start.
    pub shift: Option<f64>,
}

impl Regressed {
    /// Two-sided probability of so large a `value/sd` if the parameter were zero.
    pub fn p(&self) -> Option<f64> {
        self.sd.map(|sd| 2.0 * normal_cdf(-(self.value / sd).abs()))
    }

    /// Whether the noise of the regressors is expected to have moved the value by more than its sd.
    pub fn is_moved(&self) -> bool {
        self.shift.zip(self.sd).is_some_and(|(shift, sd)| shift.abs() > sd)
    }
}

/// One equation.
#[derive(Debug, Clone, PartialEq)]
pub struct Equation {
    /// `rate of x` or the output's name.
    pub name: String,
    pub unit: String,
    /// "used", or what is missing.
    pub outcome: String,
    pub n: usize,
    pub rms: f64,
    /// Share of the left side's variance that the right side explains.
    pub r2: f64,
    pub ar_order: usize,
}

/// All equations of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct Regression {
    pub stop: Stop,
    pub condition: f64,
    pub rows: Vec<Regressed>,
    pub equations: Vec<Equation>,
    /// The values are the estimate, or the iteration starts from them; otherwise the model's starts
    /// fit better.
    pub taken: bool,
    /// The values are the estimate itself.
    pub is_estimate: bool,
}

/// The regression of a case and the parameter vector it ends at, to start from.
///
/// # Errors
/// The smoothing cannot be built.
pub fn regress(case: &Case, settings: &Settings) -> Result<(Regression, Vec<f64>)> {
    let (problem, considered) = Problem::new(case, settings)?;
    let mut layout = problem.layout_of_starts();
    let mut outcome = held_where_nowhere(&problem, &mut layout);
    let mut solution = solve(&layout, &problem, settings, &Known::default());
    for _ in 0..outcome.len() {
        let none = solution.weak.iter().find(|w| w.information <= NONE);
        let Some(&(i, _)) =
            none.and_then(|w| w.terms.iter().find(|(i, _)| outcome[*i] == ESTIMATED))
        else {
            break;
        };
        outcome[i] = "cannot be separated from others by these equations";
        hold(&mut layout, i);
        solution = solve(&layout, &problem, settings, &Known::default());
    }
    let regression = told(&problem, &layout, (&solution, &outcome), considered, false);
    Ok((regression, solution.fit.theta))
}

/// The estimate by regression: a case's equations solved as its likelihood would be.
pub(super) fn estimated(
    problem: &Problem,
    considered: Vec<Considered>,
    settings: &Settings,
) -> (Regression, Solution) {
    let mut layout = problem.layout(settings);
    let outcome = held_where_nowhere(problem, &mut layout);
    let mut solution = solve(&layout, problem, settings, &Known::default());
    for (idle, outcome) in solution.fit.idle.iter_mut().zip(&outcome) {
        *idle |= *outcome != ESTIMATED;
    }
    let regression = told(problem, &layout, (&solution, &outcome), considered, true);
    (regression, solution)
}

/// Holds what no equation has at its start; what becomes of each parameter.
fn held_where_nowhere(problem: &Problem, layout: &mut Layout) -> Vec<&'static str> {
    let outcome = problem.unreached();
    (0..outcome.len()).filter(|&i| outcome[i] != ESTIMATED).for_each(|i| hold(layout, i));
    outcome
}

fn hold(layout: &mut Layout, i: usize) {
    (layout.lower[i], layout.upper[i]) = (layout.start[i], layout.start[i]);
}

/// A solution in words and numbers.
fn told(
    problem: &Problem,
    layout: &Layout,
    (solution, outcome): (&Solution, &[&'static str]),
    considered: Vec<Considered>,
    is_estimate: bool,
) -> Regression {
    let theta = &solution.fit.theta;
    let shifts = shifts(problem, layout, solution);
    let row = |i: usize| {
        let deviation = solution.deviation(i).filter(|_| outcome[i] == ESTIMATED);
        let bound = outcome[i] == ESTIMATED && solution.fit.held[i];
        Regressed {
            row: i,
            outcome: if bound { "on a bound" } else { outcome[i] },
            start: problem.case.layout.start[i],
            value: theta[i],
            sd: deviation.map(|d| d.0),
            sd_white: deviation.map(|d| d.1),
            shift: shifts.as_ref().map(|s| s[i]).filter(|_| deviation.is_some()),
        }
    };
    let rows = (0..outcome.len()).map(row).collect();
    let equations = judge(problem, layout, solution, considered);
    Regression {
        stop: solution.fit.stop,
        condition: solution.condition,
        rows,
        equations,
        taken: is_estimate,
        is_estimate,
    }
}

/// Size and share explained of every equation.
fn judge(
    problem: &Problem,
    layout: &Layout,
    solution: &Solution,
    considered: Vec<Considered>,
) -> Vec<Equation> {
    let mut sums = vec![[0.0; 4]; problem.sides.len()];
    let take = |s: usize, blocks: Vec<Block>| {
        for block in blocks {
            for (e, l) in block
                .e
                .iter()
                .zip(&problem.segments[s].left[block.output])
                .filter(|(e, _)| e.is_finite())
            {
                let add = [1.0, e * e, *l, l * l];
                sums[block.output].iter_mut().zip(add).for_each(|(sum, v)| *sum += v);
            }
        }
    };
    each(layout, problem, &solution.fit.theta, false, |_, blocks| Some(blocks), take);
    let mut used = sums.into_iter().enumerate();
    let of = |Considered { name, unit, outcome }: Considered| {
        let found = if outcome == USED { used.next() } else { None };
        let (n, rms, r2, ar_order) = match found {
            None => (0, f64::NAN, f64::NAN, 0),
            Some((k, [n, square, sum, total])) => (
                n as usize,
                (square / n).sqrt(),
                1.0 - square / (total - sum * sum / n),
                solution.colour.get(k).map_or(0, |of| of.model.order()),
            ),
        };
        Equation { name, unit, outcome, n, rms, r2, ar_order }
    };
    considered.into_iter().map(of).collect()
}
