//! A solution in; the parameters whose standard deviations are too small because what is left of several
//! outputs goes together, out.
//!
//! A gust moves all outputs. The covariance of the estimates takes what is left of each output for itself,
//! with its colour; with `z_o(t) = M^-1 g_o'(t) e_o(t)/r_o` the pull of output `o` on the parameters, it is
//! `sum_o var(sum_t z_o)`, and should be `var(sum_t sum_o z_o)`. Both are estimated from the residuals, without
//! a model of them, by products of neighbouring times up to a few seconds (Newey & West, Econometrica 55,
//! 1987), so that what the fit has taken away is missing in both. The root of their ratio is by how much a
//! standard deviation is too small; it is told where it is more than chance.

use super::Stop;
use super::case::Case;
use super::solution::Solution;
use crate::least_squares::{Block, Factor};
use rayon::prelude::*;

/// Products of times that are no further apart than this, s, and than this share of a segment.
const APART: f64 = 5.0;
const SHARE: f64 = 0.2;
/// In so many steps.
const LAGS: usize = 20;
/// Standard deviations that are larger by less than this are not told. *Convention*, as for noise of starts.
const LARGER: f64 = 1.25;
/// And by less than so many standard deviations of chance.
const CHANCE: f64 = 5.0;

/// Sums over segments.
struct Sums {
    /// Variance of the pull on each common parameter, of all outputs together and of each for itself.
    together: Vec<f64>,
    apart: Vec<f64>,
    /// Steps of time.
    steps: usize,
}

impl Case {
    /// Common parameters with the factor by which their standard deviations are too small, the largest first.
    pub(super) fn together(&self, solution: &Solution) -> Vec<(String, f64)> {
        let asked = !self.is_filtered() && self.outputs.len() > 1 && self.layout.shared > 0;
        if !asked || self.layout.noise.full || solution.fit.stop != Stop::Converged {
            return Vec::new();
        }
        self.larger_together(solution).unwrap_or_default()
    }

    fn larger_together(&self, solution: &Solution) -> Option<Vec<(String, f64)>> {
        let mut matrix = solution.fit.matrix.clone()?;
        let mut nothing = vec![0.0; solution.fit.theta.len()];
        for (i, _) in solution.fit.held.iter().enumerate().filter(|(_, held)| **held) {
            matrix.pin(&mut nothing, i, 0.0);
        }
        let factor = matrix.factor().ok()?;
        let of = |s: usize| self.pulls(s, solution, &factor);
        let all: Vec<Option<Sums>> = (0..self.records.len()).into_par_iter().map(of).collect();
        let nc = self.layout.shared;
        let (mut together, mut apart, mut steps) = (vec![0.0; nc], vec![0.0; nc], 0);
        for sums in all.into_iter().flatten() {
            together.iter_mut().zip(&sums.together).for_each(|(a, b)| *a += b);
            apart.iter_mut().zip(&sums.apart).for_each(|(a, b)| *a += b);
            steps += sums.steps;
        }
        // Relative variance of sums of products with weights that fall to zero over `LAGS` (Priestley 1981, sec. 6.2).
        let chance = (4.0 / 3.0 * LAGS as f64 / steps.max(1) as f64).sqrt();
        let least = f64::max(LARGER * LARGER, 1.0 + CHANCE * chance);
        let larger = |i: usize| {
            let ratio = together[i] / apart[i];
            let is_known = solution.deviation(i).is_some() && ratio.is_finite();
            (is_known && ratio > least).then(|| (self.unknowns[i].name.clone(), ratio.sqrt()))
        };
        let mut all: Vec<(String, f64)> = (0..nc).filter_map(larger).collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        Some(all)
    }

    fn pulls(&self, s: usize, solution: &Solution, factor: &Factor) -> Option<Sums> {
        let (part, record) = (&self.layout.parts[s], &self.records[s]);
        if part.directions() == 0 {
            return None;
        }
        let blocks = self.evaluate(s, &self.layout.local(s, &solution.fit.theta), true)?;
        let variances = solution.fit.noise.get(part.group)?.variances();
        let span = record.dt * record.n as f64;
        let step = APART.min(SHARE * span) / LAGS as f64;
        let steps = (span / step).ceil() as usize + 1;
        let (nd, nc) = (part.directions(), self.layout.shared);
        let held: Vec<bool> = self.indices(s).map(|i| solution.fit.held[i]).collect();
        let mut sums = Sums { together: vec![0.0; nc], apart: vec![0.0; nc], steps };
        let mut all = vec![0.0; steps * nc];
        for (block, channel) in blocks.iter().zip(&record.channels) {
            let at = |t: f64| (((t - record.t0) / step).max(0.0) as usize).min(steps - 1);
            let pulls = pulled(block, &channel.t, at, (steps, nd, &held));
            let mut solved = vec![0.0; steps * nc];
            for (pull, solved) in pulls.chunks_exact(nd).zip(solved.chunks_exact_mut(nc)) {
                let (common, own) = pull.split_at(part.shared.len());
                let mut shared = vec![0.0; nc];
                part.shared.iter().zip(common).for_each(|(&i, x)| shared[i] = *x);
                let (moved, _) = factor.solve_in(s, &shared, own);
                let weight = 1.0 / variances[block.output];
                solved.iter_mut().zip(moved).for_each(|(to, x)| *to = weight * x);
            }
            all.iter_mut().zip(&solved).for_each(|(a, b)| *a += b);
            add_variances(&mut sums.apart, &solved);
        }
        add_variances(&mut sums.together, &all);
        Some(sums)
    }
}

/// Sums of `g' e` within each step of time, `[step][direction]`; 0 in directions that are held.
fn pulled(
    block: &Block,
    t: &[f64],
    at: impl Fn(f64) -> usize,
    (steps, nd, held): (usize, usize, &[bool]),
) -> Vec<f64> {
    let mut pulls = vec![0.0; steps * nd];
    for ((e, g), t) in block.e.iter().zip(block.g.chunks_exact(nd.max(1))).zip(t) {
        if !e.is_finite() {
            continue;
        }
        let to = &mut pulls[at(*t) * nd..][..nd];
        for ((to, g), _) in to.iter_mut().zip(g).zip(held).filter(|(_, held)| !**held) {
            *to += g * e;
        }
    }
    pulls
}

/// Adds the variance of the sum of each column of `x`, `[step][column]`, by products of steps up to `LAGS` apart,
/// with weights that fall to zero there.
fn add_variances(to: &mut [f64], x: &[f64]) {
    let n = to.len();
    for lag in 0..=LAGS {
        let weight = match lag {
            0 => 1.0,
            lag => 2.0 * (1.0 - lag as f64 / (LAGS + 1) as f64),
        };
        for (a, b) in x.chunks_exact(n).zip(x.chunks_exact(n).skip(lag)) {
            to.iter_mut().zip(a.iter().zip(b)).for_each(|(to, (a, b))| *to += weight * a * b);
        }
    }
}
