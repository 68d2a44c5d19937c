//! A model over segments, the colour of its noise and a start in; the maximum of the likelihood of
//! that noise out.
//!
//! With the noise's colour fixed (that of the base fit), the negative log-likelihood is half the
//! sum of squares of the whitened residuals, `J = 1/2 sum_s |W (z - y)|^2`, so that differences of
//! `J` between models are gains in log-likelihood: a problem of least squares
//! (`crate::least_squares`) whose `R` is one, over some of the segments and of the shared
//! parameters.

use crate::diagnose::residual::whitening::Noise;
use crate::diagnose::thresholds::Thresholds;
use crate::estimate::Case;
use crate::least_squares::{
    Block, Evaluate, Iteration, Layout, Method, Part, Stop, Structure, Undetermined, brought,
    give_back, minimise,
};
use crate::math::pool;
use crate::math::turned::rows_of;
use rayon::prelude::*;

/// Which segments and which shared parameters take part.
pub struct Task<'a> {
    pub case: &'a Case,
    pub noise: &'a Noise,
    /// Places among the segments of the case.
    pub segments: &'a [usize],
    /// Shared parameters that move, by index into the parameter vector; those whose covariance is
    /// wanted stand last. The segments' own parameters always move.
    pub free: &'a [usize],
    pub thresholds: &'a Thresholds,
}

/// Where a fit ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    pub theta: Vec<f64>,
    /// Half the squares of each segment's white residuals.
    pub costs: Vec<f64>,
    /// Half the squared deviations from priors, in their standard deviations.
    pub prior: f64,
    /// What a step still promises is less than chance gives one parameter; or, where kinks cut steps short, what
    /// the last ones brought.
    pub converged: bool,
}

impl Trained {
    pub fn cost(&self) -> f64 {
        self.costs.iter().sum::<f64>() + self.prior
    }
}

impl Task<'_> {
    /// Improves `theta`; `None` where the model is not finite at the start.
    pub fn fit(&self, theta: Vec<f64>) -> Option<Trained> {
        let layout = self.layout(&theta);
        let found = minimise(&layout, &self.white(&theta), &self.method());
        if found.stop == Stop::NotFinite {
            return None;
        }
        let pull =
            |(i, x): (usize, &f64)| 0.5 * layout.prior_weight(i) * (x - layout.centre[i]).powi(2);
        let prior = found.theta.iter().enumerate().map(pull).sum();
        let theta = self.whole(&layout, &found.theta, theta);
        // Nothing to fit has been fitted.
        let nothing = layout.start.is_empty() || found.stop == Stop::NoData;
        let converged =
            nothing || found.promise < self.promise() || self.is_at_rest(&found.iterations);
        Some(Trained { costs: self.costs(&theta)?, prior, theta, converged })
    }

    fn method(&self) -> Method {
        Method {
            tolerance: f64::INFINITY,
            // A step of length d promises d^2/2.
            step_tolerance: (2.0 * self.thresholds.least_promise).sqrt(),
            gradient_tolerance: 0.0,
            max_iterations: self.thresholds.iterations,
            // Hundreds of candidates are fitted: one that needs shorter steps is on a kink, and
            // shorter ones bring less than is promised.
            max_halvings: 5,
            // Not where parts stick or stop: behind a row of short steps there lies more (a hidden friction of
            // the Citation gained 448 where 483 is to be had).
            creep: if self.case.model.moving.is_empty() { self.thresholds.creep } else { 0.0 },
            spares_last: true,
            undetermined: Undetermined::Held,
            turns: false,
            ..Method::default()
        }
    }

    /// The parameters that move: those of `free`, in their order, then the own ones of every
    /// segment.
    fn layout(&self, theta: &[f64]) -> Layout {
        let all = &self.case.layout;
        let mut from = self.free.to_vec();
        let mut parts = Vec::with_capacity(self.segments.len());
        for &s in self.segments {
            let part = &all.parts[s];
            let shared =
                (0..self.free.len()).filter(|&k| part.shared.contains(&self.free[k])).collect();
            parts.push(Part {
                shared,
                offset: from.len(),
                own: part.own,
                group: 0,
                instants: Vec::new(),
            });
            from.extend(part.offset..part.offset + part.own);
        }
        let pick = |values: &[f64]| from.iter().map(|&i| values[i]).collect();
        Layout {
            shared: self.free.len(),
            parts,
            start: pick(theta),
            lower: pick(&all.lower),
            upper: pick(&all.upper),
            centre: pick(&all.centre),
            prior_sd: pick(&all.prior_sd),
            squares: Vec::new(),
            noise: Structure { outputs: 1, groups: 1, full: false, floor: vec![0.0], known: true },
        }
    }

    /// `theta` with what moved.
    fn whole(&self, layout: &Layout, moved: &[f64], mut theta: Vec<f64>) -> Vec<f64> {
        self.free.iter().zip(moved).for_each(|(&i, value)| theta[i] = *value);
        for (&s, part) in self.segments.iter().zip(&layout.parts) {
            let to = self.case.layout.parts[s].offset;
            theta[to..to + part.own].copy_from_slice(&moved[part.offset..part.offset + part.own]);
        }
        theta
    }

    /// White residuals of the segments, and sensitivities to what moves; what does not stays as in
    /// `theta`.
    fn white(&self, theta: &[f64]) -> impl Evaluate {
        let fixed: Vec<Vec<f64>> =
            self.segments.iter().map(|&s| self.case.layout.local(s, theta)).collect();
        // Per segment, the places of its moving parameters among its directions.
        let place = |&s: &usize| {
            let part = &self.case.layout.parts[s];
            let shared = self.free.iter().filter_map(|i| part.shared.iter().position(|of| of == i));
            shared.chain(part.shared.len()..part.directions()).collect()
        };
        let places: Vec<Vec<usize>> = self.segments.iter().map(place).collect();
        move |k: usize, local: &[f64], sensitivities: bool| {
            let mut all = fixed[k].clone();
            places[k].iter().zip(local).for_each(|(&place, value)| all[place] = *value);
            let s = self.segments[k];
            // Where nothing else moves, nothing else is propagated.
            let own = 0..places[k].len();
            let alone = own.len() == self.case.layout.parts[s].own;
            let (blocks, wanted) = match (sensitivities, alone) {
                (false, _) => (self.case.evaluate(s, &all, false)?, Vec::new()),
                (true, true) => (self.case.evaluate_own(s, &all)?, own.collect()),
                (true, false) => (self.case.evaluate(s, &all, true)?, places[k].clone()),
            };
            let known = self.noise.whiten_rows(s, &blocks, &wanted);
            let columns = if known.is_some() { &[] } else { &wanted[..] };
            let mut columns = self.noise.whiten(s, &blocks, columns);
            give_back(blocks);
            let e = columns.pop().filter(|e| e.iter().all(|e| e.is_finite()))?;
            let rows = known.unwrap_or_else(|| rows_of(&columns));
            columns.into_iter().for_each(pool::give);
            Some(vec![Block::new(0, e, rows)])
        }
    }

    /// What may still be promised where a fit has converged. Where a model has kinks, steps of many
    /// parameters promise more than is to be had.
    fn promise(&self) -> f64 {
        self.thresholds.promise.max(self.thresholds.promise_per_parameter * self.free.len() as f64)
    }

    /// Whether kinks cut the last steps short, and all of them together brought less than one may still promise:
    /// across a kink (friction, play) a parabola promises what is not there.
    fn is_at_rest(&self, history: &[Iteration]) -> bool {
        brought(history, self.thresholds.rest, |i| i.halvings > 0)
            .is_some_and(|gain| gain < self.promise())
    }

    /// Cost of all segments at `theta`, with what priors add.
    pub fn whole_cost(&self, theta: &[f64]) -> Option<f64> {
        Some(self.costs(theta)?.iter().sum::<f64>() + self.prior(theta))
    }

    /// Half the squared deviations of what moves from priors, in their standard deviations.
    pub fn prior(&self, theta: &[f64]) -> f64 {
        let layout = self.layout(theta);
        let pull =
            |(i, x): (usize, &f64)| 0.5 * layout.prior_weight(i) * (x - layout.centre[i]).powi(2);
        layout.start.iter().enumerate().map(pull).sum()
    }

    /// Costs of the segments at `theta`.
    pub fn costs(&self, theta: &[f64]) -> Option<Vec<f64>> {
        let of = |&s: &usize| {
            let blocks = self.case.evaluate(s, &self.case.layout.local(s, theta), false)?;
            Some(self.noise.cost(s, &blocks)).filter(|cost| cost.is_finite())
        };
        self.segments.par_iter().map(of).collect()
    }
}
