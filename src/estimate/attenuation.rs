//! The equations of a case and their solution in; how far noise in the measured regressors is expected
//! to have moved the estimates, out.
//!
//! Least squares takes its regressors for exact. A measured one, `x + nu`, adds to the gradient what
//! the noise has in common on both of its places: with `f(x, theta)` the right side,
//!
//! ```text
//! E[theta - truth] = -M^-1 sum (1/R) sigma^2 (d2 f / d theta d x) (d f / d x)
//! ```
//!
//! to first order, over all points and measured `x`; for `f = x' theta` that is `-(X'X)^-1 N Sigma
//! theta`, the attenuation of errors in variables (Klein & Morelli 2006, sec. 5.1; Fuller 1987, sec.
//! 1.1). `sigma` is the fast part of the signal, from its third differences at its own spacing, taken for
//! white; what interpolation to a finer grid and smoothing leave of it counts. Where the spacing is not
//! known, no shift can be told. In the rate of a state its own noise does no more harm than this: the
//! derivative filter is odd and the smoothing even, so that the two are not correlated.

use super::regressors::Problem;
use super::sides::Side;
use super::solution::Solution;
use crate::dynamics::Channel;
use crate::least_squares::{Layout, normal_matrix};
use crate::model::Program;
use crate::model::graph::Leaf;
use crate::signal::robust::{commanded_sd, noise_sd};

/// A measured quantity on the right side of an equation: its slope, and how that depends on
/// parameters.
struct Noisy {
    leaf: Leaf,
    /// Output of the program with `d f / d x`.
    slope: usize,
    /// Columns (free parameters) and outputs with `d2 f / d theta d x`.
    mixed: Vec<(usize, usize)>,
}

/// The expected shift of every parameter; none where the solution has no covariance, or where what is
/// measured was brought to the grid from nobody knows what.
pub(super) fn shifts(problem: &Problem, layout: &Layout, solution: &Solution) -> Option<Vec<f64>> {
    solution.covariance.as_ref()?;
    let theta = &solution.fit.theta;
    let mut pull = vec![0.0; theta.len()];
    for (equation, side) in problem.sides.iter().enumerate() {
        let (program, noisy) = programs(problem, side);
        for s in 0..problem.segments.len() {
            let part = &layout.parts[s];
            let place = |column: usize| match part.shared.get(column) {
                Some(&i) => i,
                None => part.offset + column - part.shared.len(),
            };
            let weight = 1.0 / solution.fit.noise.get(part.group)?.variances()[equation];
            let (parameters, _) = problem.case.place(s, &layout.local(s, theta));
            let values = problem.over(&program, s, &parameters);
            let rows = values.chunks_exact(program.outputs().max(1));
            let known = || rows.clone().zip(&problem.segments[s].left[equation]);
            for x in &noisy {
                if x.mixed.is_empty() {
                    continue;
                }
                let (sd, every) = noise(problem, s, x.leaf)?;
                let variance = sd * sd * problem.segments[s].gain_of_regressor(side, every);
                for (column, mixed) in &x.mixed {
                    let common: f64 = known()
                        .filter(|(_, left)| left.is_finite())
                        .map(|(row, _)| row[*mixed] * row[x.slope])
                        .sum();
                    pull[place(*column)] -= weight * variance * common;
                }
            }
        }
    }
    let mut matrix = normal_matrix(layout, problem, theta)?;
    for i in (0..theta.len()).filter(|&i| solution.fit.held[i]) {
        matrix.pin(&mut pull, i, 0.0);
    }
    Some(matrix.factor().ok()?.solve(&pull))
}

/// The slopes of a right side with respect to what is measured in it, and theirs with respect to
/// free parameters.
fn programs(problem: &Problem, side: &Side) -> (Program, Vec<Noisy>) {
    let model = &problem.case.model;
    let node = if side.is_rate { model.rates[side.row] } else { model.output_nodes[side.output] };
    let mut graph = model.graph.clone();
    let (mut nodes, mut noisy) = (Vec::new(), Vec::new());
    for leaf in graph.leaves(&[node]) {
        if !matches!(leaf, Leaf::State(_) | Leaf::Input(_)) {
            continue;
        }
        let derivative = graph.derivative(node, leaf);
        let slope = nodes.len();
        nodes.push(derivative);
        let mut mixed = Vec::new();
        for (column, &p) in problem.case.free().iter().enumerate() {
            let both = graph.derivative(derivative, Leaf::Parameter(p));
            if graph.constant(both) != Some(0.0) {
                mixed.push((column, nodes.len()));
                nodes.push(both);
            }
        }
        noisy.push(Noisy { leaf, slope, mixed });
    }
    (Program::lower(&graph, &nodes, &model.layout), noisy)
}

/// The sd of the fast noise of what is measured, in one segment, and how many steps of the grid lie between
/// two of its samples; none where that is not known.
fn noise(problem: &Problem, s: usize, leaf: Leaf) -> Option<(f64, usize)> {
    let (model, record) = (&problem.case.model, &problem.case.records[s]);
    let most = record.n.max(1) as f64;
    let every = |spacing: f64| (spacing / record.dt).round().clamp(1.0, most) as usize;
    match leaf {
        Leaf::State(i) => {
            let output = model.output(&model.states[i].quantity.name);
            let channel = record.channels.iter().find(|c| Some(c.output) == output);
            let of = |c: &Channel| (noise_sd(&c.z), c.every(record.dt).min(record.n.max(1)));
            Some(channel.map_or((0.0, 1), of))
        }
        Leaf::Input(j) => {
            let spacing = record.spacings.get(j).copied().unwrap_or(record.dt);
            let every = spacing.is_finite().then(|| every(spacing))?;
            let (from, width) = (record.start * model.layout.inputs, model.layout.inputs.max(1));
            // Of the points between two samples some have less noise; which ones are samples is not known.
            let from = |phase: usize| from + phase * width + j;
            let values =
                |phase: usize| record.inputs.iter().skip(from(phase)).step_by(every * width);
            let sd = |phase: usize| commanded_sd(&values(phase).copied().collect::<Vec<f64>>());
            Some(((0..every).map(sd).fold(0.0, f64::max), every))
        }
        _ => Some((0.0, 1)),
    }
}
