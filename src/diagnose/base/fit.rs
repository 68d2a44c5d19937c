//! A model over segments, the colour of its noise and a start in; the maximum of the likelihood of that noise out.
//!
//! With the noise's colour fixed (that of the base fit), the negative log-likelihood is half the sum of squares of the whitened
//! residuals, `J = 1/2 sum_s |W (z - y)|^2`, so that differences of `J` between models are gains in log-likelihood. Gauss and Newton's
//! steps with `W dy/dtheta`, every segment's own parameters eliminated first; a step that does not lower `J` is halved, and then damped
//! (Levenberg, Marquardt) more and more; a parameter that would leave its bounds is put on them and the rest of the step found again.

use crate::diagnose::residual::noise::Noise;
use crate::diagnose::thresholds::Thresholds;
use crate::estimate::Case;
use crate::math::products::Gram;
use rayon::prelude::*;

/// Which segments and which shared parameters take part.
pub struct Task<'a> {
    pub case: &'a Case<'a>,
    pub noise: &'a Noise,
    /// Places among the segments of the case.
    pub segments: &'a [usize],
    /// Shared parameters that move, by index into the parameter vector; those whose covariance is wanted stand last. The segments' own
    /// parameters always move.
    pub free: &'a [usize],
    pub thresholds: &'a Thresholds,
}

/// Where a fit ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    pub theta: Vec<f64>,
    /// Cost of each segment of the task.
    pub costs: Vec<f64>,
    /// What a step still promises is less than luck gives one parameter.
    pub converged: bool,
}

impl Fit {
    pub fn cost(&self) -> f64 {
        self.costs.iter().sum()
    }
}

/// What is known of the last `k` free parameters at a point.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Standard deviations; none where the data do not determine them.
    pub sd: Vec<Option<f64>>,
    /// `[k][k]`
    pub information: Vec<f64>,
    /// Share of each parameter's information that is left once all others are known to be unknown.
    pub left: Vec<f64>,
    /// Per segment: `(slope, information)` of each of them with all other shared parameters held, own ones free.
    pub by_segment: Vec<Vec<(f64, f64)>>,
}

/// Damping of a step (a share of each parameter's information) and the share of it that is taken, one after the other until `J` is lower.
const TRIES: [(f64, f64); 7] = [(0.0, 1.0), (0.0, 0.5), (0.0, 0.25), (0.01, 1.0), (0.1, 1.0), (1.0, 1.0), (10.0, 1.0)];

/// Sums of one segment: own parameters eliminated.
struct Part {
    own: usize,
    /// Place of each shared column in `Task::free`.
    to: Vec<usize>,
    gram: Gram,
}

impl Task<'_> {
    /// Improves `theta`; `None` where the model is not finite at the start.
    pub fn fit(&self, mut theta: Vec<f64>) -> Option<Fit> {
        let mut costs = self.costs(&theta)?;
        let least = self.thresholds.least_promise;
        for _ in 0..self.thresholds.iterations {
            let Some(slopes) = self.slopes(&theta) else { break };
            let Some((_, promise)) = self.step(&theta, &slopes, 0.0) else { break };
            if promise < least {
                return Some(Fit { theta, costs, converged: true });
            }
            let before: f64 = costs.iter().sum::<f64>() + self.prior(&theta);
            let better = TRIES.iter().find_map(|&(damping, share)| {
                let (step, _) = self.step(&theta, &slopes, damping)?;
                let trial = self.moved(&theta, &step, share);
                let costs = self.costs(&trial)?;
                (costs.iter().sum::<f64>() + self.prior(&trial) < before).then_some((trial, costs))
            });
            let Some(better) = better else { break };
            let gained = costs.iter().sum::<f64>() - better.1.iter().sum::<f64>();
            (theta, costs) = better;
            // It creeps: what is promised is not to be had.
            if gained < least {
                break;
            }
        }
        let last = self.slopes(&theta).and_then(|slopes| self.step(&theta, &slopes, 0.0));
        let converged = last.is_some_and(|(_, promise)| promise < self.promise());
        Some(Fit { theta, costs, converged })
    }

    /// What may still be promised where a fit has converged. Where a model has kinks, steps of many parameters promise more than is to be had.
    fn promise(&self) -> f64 {
        self.thresholds.promise.max(self.thresholds.promise_per_parameter * self.free.len() as f64)
    }

    /// Costs of the segments at `theta`.
    pub fn costs(&self, theta: &[f64]) -> Option<Vec<f64>> {
        let of = |&s: &usize| {
            let blocks = self.case.evaluate(s, &self.case.layout.local(s, theta), false)?;
            Some(self.noise.cost(s, &blocks)).filter(|cost| cost.is_finite())
        };
        self.segments.par_iter().map(of).collect()
    }

    /// Half the squared deviations from priors.
    fn prior(&self, theta: &[f64]) -> f64 {
        let layout = &self.case.layout;
        let of = |&i: &usize| 0.5 * layout.prior_weight(i) * (theta[i] - layout.centre[i]) * (theta[i] - layout.centre[i]);
        self.free.iter().map(of).sum()
    }

    fn moved(&self, theta: &[f64], step: &[f64], share: f64) -> Vec<f64> {
        let layout = &self.case.layout;
        (0..theta.len()).map(|i| (theta[i] + share * step[i]).clamp(layout.lower[i], layout.upper[i])).collect()
    }

    fn parts(&self, theta: &[f64]) -> Option<Vec<Part>> {
        self.segments.par_iter().map(|&s| self.part(s, theta)).collect()
    }

    fn part(&self, s: usize, theta: &[f64]) -> Option<Part> {
        let layout = &self.case.layout;
        let blocks = self.case.evaluate(s, &layout.local(s, theta), true)?;
        let mut white = self.noise.whiten(s, &blocks);
        let part = &layout.parts[s];
        let (mut columns, mut to) = (Vec::new(), Vec::new());
        columns.extend(white.drain(part.shared.len()..part.directions()));
        for (place, index) in self.free.iter().enumerate() {
            if let Some(at) = part.shared.iter().position(|i| i == index) {
                columns.push(std::mem::take(&mut white[at]));
                to.push(place);
            }
        }
        columns.extend(white.pop());
        to.push(self.free.len());
        let mut gram = Gram::of(&columns);
        gram.eliminate(0, part.own);
        gram.scale.iter().all(|v| v.is_finite()).then_some(Part { own: part.own, to, gram })
    }

    /// All segments together, priors included: free shared parameters, then the residuals.
    fn together(&self, parts: &[Part], theta: &[f64]) -> Gram {
        let (n, layout) = (self.free.len(), &self.case.layout);
        let mut all = Gram::zero(n + 1);
        parts.iter().for_each(|part| all.add(&part.gram, part.own, &part.to));
        for (place, &i) in self.free.iter().enumerate() {
            let weight = layout.prior_weight(i);
            all.sums[place * (n + 1) + place] += weight;
            all.scale[place] += weight;
            all.sums[place * (n + 1) + n] += weight * (layout.centre[i] - theta[i]);
        }
        all
    }

    /// What a step is made from: sums of every segment, and of all together.
    fn slopes(&self, theta: &[f64]) -> Option<(Vec<Part>, Gram)> {
        let parts = self.parts(theta)?;
        let all = self.together(&parts, theta);
        Some((parts, all))
    }

    /// The step from `theta`, shared parameters damped, and how much it promises to lower the cost (undamped).
    fn step(&self, theta: &[f64], (parts, all): &(Vec<Part>, Gram), damping: f64) -> Option<(Vec<f64>, f64)> {
        let (n, layout) = (self.free.len(), &self.case.layout);
        let mut all = all.clone();
        (0..n).for_each(|k| all.sums[k * (n + 1) + k] += damping * all.scale[k]);
        let mut pinned: Vec<Option<f64>> = vec![None; n];
        let shared = loop {
            let x = solve_pinned(&all, &pinned);
            let outside = (0..n).filter(|&k| pinned[k].is_none()).find_map(|k| {
                let (i, to) = (self.free[k], theta[self.free[k]] + x[k]);
                let bound = to.clamp(layout.lower[i], layout.upper[i]);
                (bound != to).then_some((k, bound - theta[i]))
            });
            match outside {
                Some((k, d)) => pinned[k] = Some(d),
                None => break x,
            }
        };
        let mut step = vec![0.0; theta.len()];
        self.free.iter().zip(&shared).for_each(|(&i, x)| step[i] = *x);
        let mut promise = 0.0;
        for (&s, part) in self.segments.iter().zip(parts) {
            let m = part.gram.n;
            let mut x = vec![0.0; m];
            part.to[..part.to.len() - 1].iter().enumerate().for_each(|(k, &place)| x[part.own + k] = shared[place]);
            part.gram.solve(0, part.own, m - 1, &mut x);
            let offset = layout.parts[s].offset;
            step[offset..offset + part.own].copy_from_slice(&x[..part.own]);
            // What eliminating the own parameters takes off the sum of squares.
            promise += 0.5 * (part.gram.scale[m - 1] - part.gram.at(m - 1, m - 1));
        }
        for i in 0..n {
            promise += shared[i] * all.at(i, n);
            promise -= 0.5 * (0..n).map(|j| shared[i] * all.at(i, j) * shared[j]).sum::<f64>();
        }
        step.iter().all(|v| v.is_finite()).then_some((step, promise))
    }

    /// What the data say about the last `k` free parameters at `theta`.
    pub fn spread(&self, theta: &[f64], k: usize) -> Option<Spread> {
        let parts = self.parts(theta)?;
        let n = self.free.len();
        let mut all = self.together(&parts, theta);
        all.eliminate(0, n - k);
        let wanted: Vec<usize> = (n - k..n).collect();
        let information = all.block(&wanted);
        let mut rest = all.rest(n - k);
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
            sd[i] = (left[i] > crate::math::products::DEPENDENT).then(|| 1.0 / information.sqrt());
        }
        rest.eliminate(0, k);
        let by_segment = parts.iter().map(|part| wanted.iter().map(|&place| local(part, place)).collect()).collect();
        Some(Spread { sd, information, left, by_segment })
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

/// The step of least cost with some of its components given.
fn solve_pinned(all: &Gram, pinned: &[Option<f64>]) -> Vec<f64> {
    let n = pinned.len();
    let mut gram = all.clone();
    for (i, d) in pinned.iter().enumerate() {
        let Some(d) = d else { continue };
        for j in 0..n {
            gram.sums[j * (n + 1) + n] -= d * all.at(i, j);
        }
    }
    for i in (0..n).filter(|&i| pinned[i].is_some()) {
        for j in 0..n + 1 {
            gram.sums[i.min(j) * (n + 1) + i.max(j)] = 0.0;
        }
    }
    gram.eliminate(0, n);
    let mut x = vec![0.0; n + 1];
    gram.solve(0, n, n, &mut x);
    (0..n).map(|i| pinned[i].unwrap_or(x[i])).collect()
}
