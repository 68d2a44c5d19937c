//! A fit to the training maneuvers in; the held-out maneuvers with its derivatives out.

use super::stand::seen;
use super::training::Task;
use crate::diagnose::residual::whitening::Noise;
use crate::diagnose::subject::Places;
use crate::diagnose::thresholds::Thresholds;
use crate::estimate::{Block, Case};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// One held-out maneuver at frozen derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct Frozen {
    pub theta: Vec<f64>,
    /// Half the squares of the white residuals; the cost has the deviations from priors besides.
    pub squares: f64,
    pub cost: f64,
    pub blocks: Vec<Block>,
}

/// The parameters as segment place `s` has them: those of the training, unless it is held out.
pub fn theta_at(places: &Places, frozen: &[Option<Frozen>], trained: &[f64], s: usize) -> Vec<f64> {
    let place = places.held_out.iter().position(|&h| h == s);
    let own = place.and_then(|p| frozen[p].as_ref());
    own.map_or_else(|| trained.to_vec(), |f| f.theta.clone())
}

/// The held-out maneuvers at frozen derivatives; what the training has never seen (a flight's zero
/// shifts) moves, unless an effect brought it: that stays at its null, because nothing of an effect
/// is fitted to a maneuver that is held out.
pub fn frozen(
    case: &Case,
    noise: &Noise,
    places: &Places,
    theta: &[f64],
    (nulls, thresholds): (&BTreeMap<String, Option<f64>>, &Thresholds),
) -> Vec<Option<Frozen>> {
    let known = seen(case, &places.training);
    let brought = |i: &usize| nulls.get(&case.unknowns[*i].name);
    let mut theta = theta.to_vec();
    for i in (0..case.layout.shared).filter(|i| !known.contains(i)) {
        brought(&i).copied().flatten().into_iter().for_each(|null| theta[i] = null);
    }
    let of = |&s: &usize| {
        let free: Vec<usize> = seen(case, &[s])
            .into_iter()
            .filter(|i| !known.contains(i) && brought(i).is_none())
            .collect();
        let fit =
            Task { case, noise, segments: &[s], free: &free, thresholds }.fit(theta.to_vec())?;
        let blocks = case.evaluate(s, &case.layout.local(s, &fit.theta), false)?;
        Some(Frozen { squares: fit.costs.iter().sum(), cost: fit.cost(), theta: fit.theta, blocks })
    };
    places.held_out.par_iter().map(of).collect()
}
