//! A solution of a case whose states start at measured samples in; what the noise of these samples adds to
//! the covariance, out.
//!
//! A state that starts "measured" and is not estimated begins at one sample, `x0 + v`. Where that moves the
//! outputs by `y_v v`, it moves the estimates by
//!
//! `d theta = -M^-1 S' R^-1 y_v v`:
//!
//! a decay whose start is a little off is fitted by another damping. As `v` is known to have the variance of
//! the output's noise, and is another one in every segment, the covariance is larger by `M^-1 Q M^-1`,
//! `Q = sum (S' R^-1 y_v) r (S' R^-1 y_v)'` (Maybeck 1979, sec. 4.11: parameters that are considered).
//!
//! What `v` leaves in the residuals of its own segment, `d v` with `d = y_v - S M^-1 S' R^-1 y_v`, looks like
//! coloured noise and would count twice: the colour is that of the residuals without it, `v` estimated from
//! them and from its variance. Outputs count as independent here. Where all segments start at one sample its
//! part stays in the colour, and the sd are on the safe side.

use super::case::Case;
use super::colour::{Source, coloured};
use super::solution::{NoisyStarts, Solution};
use super::{InitialFrom, Settings};
use crate::least_squares::{Arrow, Block, Factor};
use crate::math::dense;
use crate::math::products::dot;
use rayon::prelude::*;

/// An sd that becomes larger by this factor is told: the start, estimated, would tell more.
const LARGER: f64 = 1.25;

/// What noise of the starts does in one segment.
struct Moved {
    /// `S' R^-1 y_v sd` for each start value, in the order of the segment's directions.
    pulls: Vec<Vec<f64>>,
    /// What the starts left in the residuals, by channel.
    left: Vec<Vec<f64>>,
}

impl Case {
    /// Adds what noise of the starts does to the covariance of a solution.
    pub(super) fn with_noise_of_starts(
        &self,
        mut solution: Solution,
        settings: &Settings,
    ) -> Solution {
        let given = self.propagator.given();
        let is_sample = |k: &usize| !self.chosen.initial.contains(&given[*k]);
        let places: Vec<usize> = (0..given.len()).filter(is_sample).collect();
        if self.is_filtered() || places.is_empty() || solution.covariance.is_none() {
            return solution;
        }
        if let Some((before, after)) = self.noisier_starts(&solution, &places, settings) {
            let states = places.iter().map(|&k| self.model.states[given[k]].quantity.name.clone());
            let larger = self.larger(&before, &after);
            solution.noisy_starts =
                (!larger.is_empty()).then(|| NoisyStarts { states: states.collect(), larger });
            solution.covariance = Some(after);
        }
        solution
    }

    /// The covariance without noise of the starts, and with it.
    fn noisier_starts(
        &self,
        solution: &Solution,
        places: &[usize],
        settings: &Settings,
    ) -> Option<(Arrow, Arrow)> {
        let Solution { fit, .. } = solution;
        let mut matrix = fit.matrix.clone()?;
        let mut sum = vec![0.0; fit.theta.len()];
        for (i, _) in fit.held.iter().enumerate().filter(|(_, held)| **held) {
            matrix.pin(&mut sum, i, 0.0);
        }
        let factor = matrix.factor().ok()?;
        let moved = |s: usize| self.moved_by_starts(s, places, solution, &factor);
        let moved: Vec<Moved> =
            (0..self.records.len()).into_par_iter().map(moved).collect::<Option<_>>()?;
        let (before, added) = match settings.initial_from {
            InitialFrom::Own => {
                let mut q = matrix.empty();
                for (s, of) in moved.iter().enumerate() {
                    of.pulls.iter().for_each(|pull| self.add_square(&mut q, s, pull));
                }
                let evaluate = |s: usize, local: &[f64], sensitivities: bool| {
                    let mut blocks = self.evaluate(s, local, sensitivities)?;
                    for (block, left) in blocks.iter_mut().zip(&moved[s].left) {
                        block.e.iter_mut().zip(left).for_each(|(e, left)| *e -= left);
                    }
                    Some(blocks)
                };
                let source = Source::new(&self.layout, &evaluate, &fit.theta);
                let rule = (settings.colour(), true);
                let colour = coloured(&source, &matrix, &fit.held, &fit.noise, rule)?;
                (colour.covariance, factor.sandwich(&q))
            }
            InitialFrom::First => {
                let mut all = matrix.empty();
                for k in 0..places.len() {
                    sum.fill(0.0);
                    for (s, of) in moved.iter().enumerate() {
                        self.indices(s).zip(&of.pulls[k]).for_each(|(i, pull)| sum[i] += pull);
                    }
                    all.add_outer(&factor.solve(&sum));
                }
                (solution.covariance.clone()?, all)
            }
        };
        let mut after = before.clone();
        after.add(&added);
        Some((before, after))
    }

    /// Parameters whose sd are larger, each with the largest factor.
    fn larger(&self, before: &Arrow, after: &Arrow) -> Vec<(String, f64)> {
        let mut larger: Vec<(String, f64)> = Vec::new();
        for (i, unknown) in self.unknowns.iter().enumerate() {
            let (Some(before), Some(after)) = (before.variance(i), after.variance(i)) else {
                continue;
            };
            let by = (after / before).sqrt();
            if !(by > LARGER && by.is_finite()) {
                continue;
            }
            match larger.iter_mut().find(|(name, _)| *name == unknown.name) {
                Some((_, most)) => *most = most.max(by),
                None => larger.push((unknown.name.clone(), by)),
            }
        }
        larger.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        larger
    }

    fn moved_by_starts(
        &self,
        s: usize,
        places: &[usize],
        solution: &Solution,
        factor: &Factor,
    ) -> Option<Moved> {
        let local = self.layout.local(s, &solution.fit.theta);
        let blocks = self.evaluate(s, &local, true)?;
        let part = &self.layout.parts[s];
        let variances = solution.fit.noise.get(part.group)?.variances();
        let (mut pulls, mut rests) = (Vec::new(), Vec::new());
        for &place in places {
            let state = self.propagator.given()[place];
            let output = self.model.output(&self.model.states[state].quantity.name)?;
            let sd = variances[self.outputs.iter().position(|o| *o == output)?].sqrt();
            let (up, down) =
                (self.started(s, &local, (place, sd))?, self.started(s, &local, (place, -sd))?);
            // Residuals are measured less modelled.
            let by_start = |(up, down): (&Block, &Block)| -> Vec<f64> {
                up.e.iter().zip(&down.e).map(|(up, down)| 0.5 * (down - up)).collect()
            };
            let by_start: Vec<Vec<f64>> = up.iter().zip(&down).map(by_start).collect();
            let mut pull = vec![0.0; part.directions()];
            for (block, y) in blocks.iter().zip(&by_start) {
                let w = 1.0 / variances[block.output];
                let rows = block.g.chunks_exact(part.directions().max(1));
                for (y, row) in y.iter().zip(rows).filter(|(y, _)| y.is_finite()) {
                    pull.iter_mut().zip(row).for_each(|(pull, g)| *pull += w * g * y);
                }
            }
            let held = &solution.fit.held;
            self.indices(s).zip(&mut pull).filter(|(i, _)| held[*i]).for_each(|(_, x)| *x = 0.0);
            rests.push(self.rest(s, &blocks, &by_start, (&pull, factor)));
            pulls.push(pull);
        }
        let left = estimated(&blocks, &rests, &variances)?;
        Some(Moved { pulls, left })
    }

    /// What a start does to the outputs of its segment when the parameters follow it.
    fn rest(
        &self,
        s: usize,
        blocks: &[Block],
        by_start: &[Vec<f64>],
        (pull, factor): (&[f64], &Factor),
    ) -> Vec<Vec<f64>> {
        let part = &self.layout.parts[s];
        let mut shared = vec![0.0; self.layout.shared];
        let (common, own) = pull.split_at(part.shared.len());
        part.shared.iter().zip(common).for_each(|(&i, x)| shared[i] = *x);
        let (shared, own) = factor.solve_in(s, &shared, own);
        let step: Vec<f64> = part.shared.iter().map(|&i| shared[i]).chain(own).collect();
        let of = |(block, y): (&Block, &Vec<f64>)| {
            let rows = block.g.chunks_exact(part.directions().max(1));
            y.iter().zip(rows).map(|(y, row)| y - dot(row, &step)).collect()
        };
        blocks.iter().zip(by_start).map(of).collect()
    }

    /// Places in the parameter vector of a segment's directions.
    pub(super) fn indices(&self, s: usize) -> impl Iterator<Item = usize> {
        let part = &self.layout.parts[s];
        part.shared.iter().copied().chain(part.offset..part.offset + part.own)
    }

    /// Adds the square of a gradient in segment `s`, in the order of its directions.
    fn add_square(&self, q: &mut Arrow, s: usize, pull: &[f64]) {
        let (nc, shared) = (q.shared, &self.layout.parts[s].shared);
        let (common, own) = pull.split_at(shared.len());
        for (&i, a) in shared.iter().zip(common) {
            shared.iter().zip(common).for_each(|(&j, b)| q.cc[i * nc + j] += a * b);
        }
        let rows = &mut q.own[s];
        let (n, m) = (rows.n, rows.columns.len());
        for (i, a) in own.iter().enumerate() {
            own.iter().enumerate().for_each(|(j, b)| rows.ss[i * n + j] += a * b);
            for (column, b) in shared.iter().zip(common) {
                if let Some(j) = rows.columns.iter().position(|c| c == column) {
                    rows.sc[i * m + j] += a * b;
                }
            }
        }
    }
}

/// What the starts left in the residuals: each `v` estimated from them, its variance one.
fn estimated(
    blocks: &[Block],
    rests: &[Vec<Vec<f64>>],
    variances: &[f64],
) -> Option<Vec<Vec<f64>>> {
    let n = rests.len();
    let (mut matrix, mut v) = (vec![0.0; n * n], vec![0.0; n]);
    let product = |a: &dyn Fn(usize) -> Vec<f64>, b: &[Vec<f64>]| -> f64 {
        let of = |(k, block): (usize, &Block)| {
            let pairs = a(k).into_iter().zip(&b[k]).map(|(a, b)| a * b).filter(|x| x.is_finite());
            pairs.sum::<f64>() / variances[block.output]
        };
        blocks.iter().enumerate().map(of).sum()
    };
    for i in 0..n {
        for j in 0..n {
            matrix[i * n + j] = product(&|k| rests[i][k].clone(), &rests[j]);
        }
        matrix[i * n + i] += 1.0;
        v[i] = product(&|k| blocks[k].e.clone(), &rests[i]);
    }
    let v = dense::solve(&matrix, n, &v)?;
    let left = |k: usize| -> Vec<f64> {
        let of = |at: usize| rests.iter().zip(&v).map(|(rest, v)| rest[k][at] * v).sum();
        (0..blocks[k].e.len()).map(of).collect()
    };
    // Residuals are measured less modelled: a start that is too high leaves less.
    Some((0..blocks.len()).map(left).collect())
}
