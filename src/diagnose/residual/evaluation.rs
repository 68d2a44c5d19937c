//! A case and a parameter vector in; residuals and sensitivities of its segments there, each run
//! once, out: what many ask of one point.

use crate::estimate::{Block, Case};
use crate::least_squares::give_back;
use rayon::prelude::*;

/// Segments at one parameter vector.
pub struct Evaluation<'a> {
    pub case: &'a Case,
    pub theta: &'a [f64],
    /// By place among the segments of the case; none of those that were not asked for, and where
    /// the model is not finite.
    blocks: Vec<Option<Vec<Block>>>,
}

impl<'a> Evaluation<'a> {
    /// Runs these segments (places).
    pub fn new(case: &'a Case, theta: &'a [f64], segments: &[usize]) -> Evaluation<'a> {
        let run = |s: usize| {
            let asked = segments.contains(&s);
            asked.then(|| case.evaluate(s, &case.layout.local(s, theta), true)).flatten()
        };
        let blocks = (0..case.records.len()).into_par_iter().map(run).collect();
        Evaluation { case, theta, blocks }
    }

    /// Residuals and sensitivities of a segment.
    pub fn blocks(&self, s: usize) -> Option<&[Block]> {
        self.blocks.get(s)?.as_deref()
    }
}

impl Drop for Evaluation<'_> {
    fn drop(&mut self) {
        std::mem::take(&mut self.blocks).into_iter().flatten().for_each(give_back);
    }
}
