//! A solved case and the sd of the constants that its model assumes in; how far each constant moves
//! each estimate, out.
//!
//! The estimate is where the gradient `G' R^-1 e` (with the priors') vanishes. A constant `c` that
//! differs by `dc` changes the residuals by `-G_c dc`, with `G_c` the sensitivity of the outputs to
//! it, and so, to first order in the residuals (as in Gauss-Newton),
//!
//! ```text
//! d theta / dc = -M^-1 G' R^-1 G_c
//! ```
//!
//! with the estimation's own `M` (priors included) and rows of parameters held on a bound empty.
//! Maybeck (1979), sec. 4.11 (Schmidt's "consider" parameters), is the same for filters. Constants
//! become shared parameters of the opened model (`Model::opened`), so that one pass yields `G` and
//! `G_c` together, and the formula is the solution of the normal equations with the constant's step
//! prescribed as 1.

use super::case::{Case, propagator};
use super::choice::Chosen;
use super::extend::extended;
use super::regressors::Problem;
use super::segment::Segment;
use super::solution::Solution;
use super::{By, Settings, Stop};
use crate::error::Errors;
use crate::least_squares::{Evaluate, Layout, normal_matrix};
use crate::model::{Assumed, Model, Parameter, Scope, StartKind};
use std::sync::Arc;

/// How one assumed constant moves the estimates.
#[derive(Debug, Clone, PartialEq)]
pub struct Influence {
    pub constant: Assumed,
    /// `d theta / dc` in the order of the parameter vector, unit of the parameter over that of the
    /// constant.
    pub slopes: Vec<f64>,
}

/// The variance that two constants' errors add to the estimate `row` by being correlated: `2 s_a s_b
/// r sd_a sd_b`; none where they are not.
pub fn covariance(a: &Influence, b: &Influence, row: usize) -> Option<f64> {
    let with = &a.constant.origin.as_ref()?.with;
    let r = with.get(&b.constant.quantity.name)?;
    let share = |i: &Influence| i.slopes.get(row).map(|slope| slope * i.constant.sd);
    Some(2.0 * r * share(a)? * share(b)?)
}

/// Influences by the model and by the columns of its records: a constant that is in both is one, with one error.
pub fn together(model: Vec<Influence>, columns: Vec<Influence>) -> Vec<Influence> {
    let mut all = model;
    for other in columns {
        let is_same = |i: &&mut Influence| i.constant.quantity.name == other.constant.quantity.name;
        match all.iter_mut().find(is_same) {
            Some(one) => one.slopes.iter_mut().zip(&other.slopes).for_each(|(a, b)| *a += b),
            None => all.push(other),
        }
    }
    all
}

/// The variance that all constants add to the estimate `row`.
pub fn added(all: &[Influence], row: usize) -> f64 {
    let own = all.iter().map(|i| (i.slopes[row] * i.constant.sd).powi(2)).sum::<f64>();
    let pairs = (0..all.len()).flat_map(|a| (a + 1..all.len()).map(move |b| (a, b)));
    let joint: f64 = pairs.filter_map(|(a, b)| covariance(&all[a], &all[b], row)).sum();
    (own + joint).max(0.0)
}

/// The influences of all constants with an sd that reach an output; empty unless the estimation
/// converged. `base` is the model as it was read, `case` that with the settings' extensions;
/// `given` as for the case.
///
/// # Errors
/// None that compiling and extending the model itself would not have found.
pub fn influences(
    base: &Model,
    segments: &[&Segment],
    given: Vec<Vec<f64>>,
    case: &Case,
    solution: &Solution,
    settings: &Settings,
) -> Result<Vec<Influence>, Errors> {
    // Where parameters follow lines nobody asks for a budget: the estimates that a campaign tells
    // of are one by one.
    if solution.fit.stop != Stop::Converged
        || !case.chosen.lines.is_empty()
        || base.constants.iter().all(|c| !(c.sd > 0.0))
    {
        return Ok(Vec::new());
    }
    let opened = base.opened()?;
    let behind = base.parameters.len()..opened.parameters.len();
    let mut opened = extended(&opened, settings)?.into_owned();
    if case.model.covariance.is_some() {
        let scope = Scope::parse(&settings.noise_per);
        opened = opened.with_covariance(&case.model.scored(), &case.chosen.initial, &scope)?;
    }
    let constants = reaching(&opened, behind, &case.outputs);
    if constants.is_empty() {
        return Ok(Vec::new());
    }
    // A model that is not that of its text has no constants that could be opened.
    let Some(wider) = widened(case, &opened, &constants) else { return Ok(Vec::new()) };
    let owned: Vec<Segment> = segments.iter().map(|s| (*s).clone()).collect();
    let propagator = propagator(&opened, &wider, &owned)?;
    let (opened, wider, propagator) = (Arc::new(opened), Arc::new(wider), Arc::new(propagator));
    let opened_case = Case::new(opened.clone(), wider, propagator, segments, given, settings)
        .with_steps(&case.steps());
    let wide = &opened_case;
    let one = |&p: &usize| {
        let parameter = &opened.parameters[p];
        let of = |c: &&Assumed| c.quantity.name == parameter.quantity.name;
        Some((opened.constants.iter().find(of)?.clone(), parameter.start))
    };
    let constants: Vec<(Assumed, f64)> = constants.iter().filter_map(one).collect();
    let all = match settings.by {
        By::Motion => {
            let evaluate = |s: usize, local: &[f64], slopes: bool| wide.evaluate(s, local, slopes);
            slopes(&constants, (&wide.layout, &evaluate), case, solution)
        }
        By::EquationError => {
            let (problem, _) = Problem::new(wide, settings)?;
            let layout = problem.layout(settings);
            slopes(&constants, (&layout, &problem), case, solution)
        }
    };
    Ok(all.unwrap_or_default())
}

/// The case's choice for the opened model, whose parameters have other indices, with the constants
/// as further shared parameters; none where it lacks one of the case's parameters.
fn widened(case: &Case, opened: &Model, constants: &[usize]) -> Option<Chosen> {
    let (model, chosen) = (&case.model, &case.chosen);
    let place = |p: &Parameter| opened.parameter(&p.quantity.name);
    let there: Vec<usize> = model.parameters.iter().map(place).collect::<Option<_>>()?;
    let moved = |of: &[usize]| of.iter().map(|&p| there[p]).collect::<Vec<usize>>();
    let mut parameters = opened.parameter_starts();
    let mut scopes = vec![Scope::Campaign; parameters.len()];
    for (p, &to) in there.iter().enumerate() {
        parameters[to] = chosen.parameters[p];
        scopes[to] = chosen.scopes[p].clone();
    }
    let shared = [moved(&chosen.shared), constants.to_vec()].concat();
    Some(Chosen {
        shared,
        own: moved(&chosen.own),
        initial: chosen.initial.clone(),
        parameters,
        scopes,
        lines: Vec::new(),
    })
}

/// Indices of the opened constants that the chosen outputs, or what they follow from, depend on.
fn reaching(opened: &Model, behind: std::ops::Range<usize>, outputs: &[usize]) -> Vec<usize> {
    let start =
        |kind: StartKind| if let StartKind::Expression(node) = kind { Some(node) } else { None };
    let mut nodes: Vec<_> =
        outputs.iter().filter_map(|&o| opened.output_nodes.get(o)).copied().collect();
    nodes.extend(&opened.rates);
    nodes.extend(opened.delays.iter().map(|d| d.tau));
    nodes.extend(opened.states.iter().flat_map(|s| [start(s.start), s.min, s.max]).flatten());
    let leaves = opened.graph.leaves(&nodes);
    behind.filter(|&p| leaves.contains(&crate::model::graph::Leaf::Parameter(p))).collect()
}

/// The slopes by constants that are the last shared parameters of a problem, at these values.
pub(super) fn slopes<F: Evaluate>(
    constants: &[(Assumed, f64)],
    (layout, evaluate): (&Layout, &F),
    case: &Case,
    solution: &Solution,
) -> Option<Vec<Influence>> {
    let (nc, k) = (case.layout.shared, constants.len());
    let theta = &solution.fit.theta;
    let mut at: Vec<f64> = theta[..nc].to_vec();
    at.extend(constants.iter().map(|(_, value)| value));
    at.extend(&theta[nc..]);
    let matrix = normal_matrix(layout, evaluate, &at)?;
    let shifted = |i: usize| if i < nc { i } else { i + k };
    let mut all = Vec::with_capacity(k);
    for (j, (constant, _)) in constants.iter().enumerate() {
        let mut matrix = matrix.clone();
        let mut rhs = vec![0.0; at.len()];
        for other in 0..k {
            matrix.pin(&mut rhs, nc + other, if other == j { 1.0 } else { 0.0 });
        }
        for i in (0..theta.len()).filter(|&i| solution.fit.held[i]) {
            matrix.pin(&mut rhs, shifted(i), 0.0);
        }
        let step = matrix.factor().ok()?.solve(&rhs);
        let slopes: Vec<f64> = (0..theta.len()).map(|i| step[shifted(i)]).collect();
        if slopes.iter().any(|s| *s != 0.0) {
            all.push(Influence { constant: constant.clone(), slopes });
        }
    }
    Some(all)
}
