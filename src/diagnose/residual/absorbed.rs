//! A fit in; the series that stand in for its noise, residuals and what was absorbed beside them
//! (`crate::noise::absorbed`), out.

use super::evaluation::Evaluation;
use super::whitening::Noise;
use crate::estimate::Block;
use crate::math::pool;
use crate::noise::{Absorbed, Direction, Part, Prior, Rule, Taken};
use rayon::prelude::*;

/// A fit as the noise sees it.
pub struct Fitted<'a> {
    pub at: &'a Evaluation<'a>,
    /// Places among the segments of the case.
    pub segments: &'a [usize],
    /// Shared parameters that were free.
    pub free: &'a [usize],
    /// What is no noise in the residuals, `[segment of the fit][output]`.
    pub responses: &'a [Vec<Option<Vec<f64>>>],
    /// How the noise's colour is modelled.
    pub rule: Rule,
    /// Per segment of `segments`; empty before `weighted`.
    taken: Vec<Taken>,
}

/// Residuals of one output in one segment, and series that were absorbed; not a number where a
/// sample is masked.
pub struct Series {
    pub output: usize,
    pub masked: Vec<bool>,
    /// The residuals first.
    pub columns: Vec<Vec<f64>>,
}

impl<'a> Fitted<'a> {
    pub fn new(
        at: &'a Evaluation<'a>,
        segments: &'a [usize],
        free: &'a [usize],
        responses: &'a [Vec<Option<Vec<f64>>>],
        rule: Rule,
    ) -> Fitted<'a> {
        Fitted { at, segments, free, responses, rule, taken: Vec::new() }
    }

    /// With what a fit weighted by `noise` absorbs; `None` where the model is not finite.
    pub fn weighted(self, noise: &Noise) -> Option<Fitted<'a>> {
        let parts: Vec<Part> = self.parts(noise).into_iter().collect::<Option<_>>()?;
        Some(self.with(&parts))
    }

    /// What each segment says of the fit under a noise; none where the model is not finite.
    pub fn parts(&self, noise: &Noise) -> Vec<Option<Part>> {
        (0..self.segments.len()).into_par_iter().map(|at| self.part(noise, at)).collect()
    }

    /// With what a fit absorbs of which the segments say so much.
    pub fn with(mut self, parts: &[Part]) -> Fitted<'a> {
        let priors: Vec<Prior> = self.free.iter().map(|&i| self.prior(i)).collect();
        let all = Absorbed::new(parts, &priors);
        self.taken = parts.iter().map(|part| all.of(part)).collect();
        self
    }

    fn prior(&self, i: usize) -> Prior {
        let (weight, pull) = self.at.case.layout.prior(i, self.at.theta[i]);
        Prior { weight, pull }
    }

    /// What the residuals of an output respond to in a segment of the fit.
    fn response(&self, at: usize, output: usize) -> Option<&[f64]> {
        self.responses.get(at)?.get(output)?.as_deref()
    }

    fn part(&self, noise: &Noise, at: usize) -> Option<Part> {
        let part = &self.at.case.layout.parts[self.segments[at]];
        let place = |i: &usize| {
            self.free.iter().position(|free| free == i).map_or(Direction::Held, Direction::Shared)
        };
        let own = part.offset..part.offset + part.own;
        let directions: Vec<Direction> =
            part.shared.iter().map(place).chain(own.clone().map(|_| Direction::Own)).collect();
        let priors: Vec<Prior> =
            part.shared.iter().copied().chain(own).map(|i| self.prior(i)).collect();
        let all: Vec<usize> = (0..directions.len()).collect();
        let (s, less) = (self.segments[at], |output: usize| self.response(at, output));
        let white = noise.whiten_less(s, self.at.blocks(s)?, &all, &less);
        let part = Part::new(&directions, &white, &priors);
        white.into_iter().for_each(pool::give);
        part
    }

    /// The series of one segment.
    pub fn series(&self, at: usize) -> Vec<Series> {
        let one = |block: &Block| {
            let masked: Vec<bool> = block.e.iter().map(|e| !e.is_finite()).collect();
            let mut e = block.e.clone();
            if let Some(response) = self.response(at, block.output) {
                e.iter_mut().zip(response).for_each(|(e, response)| *e -= response);
            }
            let columns = match self.taken.get(at) {
                Some(taken) => taken.series(&e, &block.g),
                None => vec![e],
            };
            Series { output: block.output, masked, columns }
        };
        self.at.blocks(self.segments[at]).unwrap_or_default().iter().map(one).collect()
    }
}
