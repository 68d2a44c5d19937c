//! A fit in; what the data say about its last free parameters, together and maneuver by maneuver,
//! out.

use super::training::Task;
use crate::diagnose::residual::evaluation::Evaluation;
use crate::estimate::Block;
use crate::least_squares::give_back;
use crate::math::pool;
use crate::math::products::{DEPENDENT, Gram, dot};
use rayon::prelude::*;

/// What is known of the last `k` free parameters at a point.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Standard deviations; none where the data do not determine them.
    pub sd: Vec<Option<f64>>,
    /// `[k][k]`
    pub information: Vec<f64>,
    /// Share of each parameter's information that is left once all others are known to be unknown.
    pub left: Vec<f64>,
    /// Per segment: `(slope, information)` of each of them with all other shared parameters held,
    /// own ones free.
    pub by_segment: Vec<Vec<(f64, f64)>>,
}

/// White columns of one segment.
pub struct Columns {
    /// Its own parameters', then those of the free shared ones that it sees.
    pub columns: Vec<Vec<f64>>,
    /// Place of each shared one in `Task::free`.
    pub to: Vec<usize>,
    pub residuals: Vec<f64>,
}

/// Sums of one segment: own parameters eliminated, then shared ones, then the residuals.
pub struct Part {
    pub own: usize,
    /// Place of each shared column in `Task::free`; of the residuals, how many are free.
    pub to: Vec<usize>,
    pub gram: Gram,
    /// Half the squares of its white residuals.
    pub cost: f64,
}

impl Task<'_> {
    /// What the data say about the last `k` free parameters at `theta`.
    pub fn spread(&self, theta: &[f64], k: usize) -> Option<Spread> {
        let parts = self.parts(theta)?;
        let n = self.free.len();
        let mut all = self.together(&parts, theta);
        all.eliminate(0, n - k);
        let wanted: Vec<usize> = (n - k..n).collect();
        let information = all.block(&wanted);
        let rest = all.rest(n - k);
        let mut sd = vec![None; k];
        let mut left = vec![0.0; k];
        for i in 0..k {
            // The one in question is brought to the end.
            let order: Vec<usize> = (0..k).filter(|j| *j != i).chain([i]).collect();
            let mut one = Gram::zero(k);
            for (a, &from) in order.iter().enumerate() {
                one.scale[a] = rest.scale[from];
                (a..k).for_each(|b| one.sums[a * k + b] = rest.at(from, order[b]));
            }
            one.eliminate(0, k - 1);
            let information = one.at(k - 1, k - 1);
            left[i] = if rest.scale[i] > 0.0 { information / rest.scale[i] } else { 0.0 };
            sd[i] = (left[i] > DEPENDENT).then(|| 1.0 / information.sqrt());
        }
        let by_segment = parts
            .iter()
            .map(|part| wanted.iter().map(|&place| local(part, place)).collect())
            .collect();
        Some(Spread { sd, information, left, by_segment })
    }

    /// One Gauss-Newton step from where the segments were evaluated, bounds kept: shared parameters and
    /// those of the segments; and the whole cost where it begins. None where the model is not finite.
    pub fn stepped(&self, at: &Evaluation) -> Option<(Vec<f64>, f64)> {
        let (theta, n, layout) = (at.theta, self.free.len(), &self.case.layout);
        let part = |&s: &usize| self.part_of(s, theta, at.blocks(s)?);
        let parts: Vec<Part> = self.segments.par_iter().map(part).collect::<Option<_>>()?;
        let mut all = self.together(&parts, theta);
        all.eliminate(0, n);
        let mut shared = vec![0.0; n + 1];
        all.solve(0, n, n, &mut shared);
        let mut moved = theta.to_vec();
        self.free.iter().zip(&shared).for_each(|(&i, step)| moved[i] += step);
        for (part, &s) in parts.iter().zip(self.segments) {
            let mut step = vec![0.0; part.gram.n];
            let known = part.own..part.gram.n - 1;
            step[known].iter_mut().zip(&part.to).for_each(|(x, &to)| *x = shared[to]);
            part.gram.solve(0, part.own, part.gram.n - 1, &mut step);
            let offset = layout.parts[s].offset;
            moved[offset..offset + part.own].iter_mut().zip(&step).for_each(|(x, d)| *x += d);
        }
        let bounds = layout.lower.iter().zip(&layout.upper);
        moved.iter_mut().zip(bounds).for_each(|(x, (low, high))| *x = x.clamp(*low, *high));
        let cost = parts.iter().map(|part| part.cost).sum::<f64>() + self.prior(theta);
        Some((moved, cost))
    }

    /// One Gauss-Newton step of the shared parameters from `theta`, bounds not asked.
    pub fn shared_step(&self, theta: &[f64]) -> Option<Vec<f64>> {
        let n = self.free.len();
        let mut all = self.together(&self.parts(theta)?, theta);
        all.eliminate(0, n);
        let mut step = vec![0.0; n + 1];
        all.solve(0, n, n, &mut step);
        Some(step[..n].to_vec())
    }

    /// Sums of every segment; none where the model is not finite.
    pub fn parts(&self, theta: &[f64]) -> Option<Vec<Part>> {
        self.segments.par_iter().map(|&s| self.part(s, theta)).collect()
    }

    pub fn part(&self, s: usize, theta: &[f64]) -> Option<Part> {
        let blocks = self.case.evaluate(s, &self.case.layout.local(s, theta), true)?;
        let part = self.part_of(s, theta, &blocks);
        give_back(blocks);
        part
    }

    fn part_of(&self, s: usize, theta: &[f64], blocks: &[Block]) -> Option<Part> {
        let Columns { mut columns, mut to, residuals } = self.white_columns(s, blocks)?;
        let cost = 0.5 * dot(&residuals, &residuals);
        columns.push(residuals);
        to.push(self.free.len());
        let gram = self.products(s, theta, &columns);
        columns.into_iter().for_each(pool::give);
        let own = self.case.layout.parts[s].own;
        gram.scale.iter().all(|v| v.is_finite()).then_some(Part { own, to, gram, cost })
    }

    /// White sensitivities and residuals of segment `s`; none where the model is not finite.
    pub fn columns(&self, s: usize, theta: &[f64]) -> Option<Columns> {
        let blocks = self.case.evaluate(s, &self.case.layout.local(s, theta), true)?;
        let columns = self.white_columns(s, &blocks);
        give_back(blocks);
        columns
    }

    fn white_columns(&self, s: usize, blocks: &[Block]) -> Option<Columns> {
        let part = &self.case.layout.parts[s];
        let mut wanted: Vec<usize> = (part.shared.len()..part.directions()).collect();
        let mut to = Vec::new();
        for (place, index) in self.free.iter().enumerate() {
            if let Some(at) = part.shared.iter().position(|i| i == index) {
                wanted.push(at);
                to.push(place);
            }
        }
        let mut columns = self.noise.whiten(s, blocks, &wanted);
        let residuals = columns.pop()?;
        Some(Columns { columns, to, residuals })
    }

    /// Products of columns that begin with the own ones of segment `s`, these eliminated.
    pub fn products(&self, s: usize, theta: &[f64], columns: &[Vec<f64>]) -> Gram {
        let layout = &self.case.layout;
        let part = &layout.parts[s];
        let mut gram = Gram::of(columns);
        (0..part.own)
            .for_each(|k| gram.pull(k, layout.prior(part.offset + k, theta[part.offset + k])));
        gram.eliminate(0, part.own);
        gram
    }

    /// All segments together, priors included: free shared parameters, then the residuals.
    pub fn together(&self, parts: &[Part], theta: &[f64]) -> Gram {
        let (n, layout) = (self.free.len(), &self.case.layout);
        let mut all = Gram::zero(n + 1);
        parts.iter().for_each(|part| all.add(&part.gram, part.own, &part.to));
        for (place, &i) in self.free.iter().enumerate() {
            all.pull(place, layout.prior(i, theta[i]));
        }
        all
    }
}

/// Slope and information of one free parameter in one segment.
fn local(part: &Part, place: usize) -> (f64, f64) {
    let m = part.gram.n;
    match part.to[..part.to.len() - 1].iter().position(|&to| to == place) {
        Some(k) => (part.gram.at(part.own + k, m - 1), part.gram.at(part.own + k, part.own + k)),
        None => (0.0, 0.0),
    }
}
