//! A fit to the training maneuvers in; the held-out maneuvers with its derivatives out.

use super::fit::Task;
use super::stand::seen;
use crate::diagnose::residual::noise::Noise;
use crate::diagnose::subject::Places;
use crate::diagnose::thresholds::Thresholds;
use crate::estimate::{Block, Case};
use rayon::prelude::*;

/// One held-out maneuver at frozen derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct Frozen {
    pub theta: Vec<f64>,
    pub cost: f64,
    pub blocks: Vec<Block>,
}

/// The held-out maneuvers at frozen derivatives; what the training has never seen (a flight's zero shifts) moves.
pub fn frozen(case: &Case, noise: &Noise, places: &Places, theta: &[f64], thresholds: &Thresholds) -> Vec<Option<Frozen>> {
    let known = seen(case, &places.training);
    let of = |&s: &usize| {
        let free: Vec<usize> = seen(case, &[s]).into_iter().filter(|i| !known.contains(i)).collect();
        let fit = Task { case, noise, segments: &[s], free: &free, thresholds }.fit(theta.to_vec())?;
        let blocks = case.evaluate(s, &case.layout.local(s, &fit.theta), false)?;
        Some(Frozen { cost: fit.cost(), theta: fit.theta, blocks })
    };
    places.held_out.par_iter().map(of).collect()
}
