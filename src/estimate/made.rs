//! A solved case, and how assumed constants change the columns that its records are of, in; how far each of
//! those constants moves each estimate, out.
//!
//! What drives a model, or what it is held against, may itself have been made by a model (the angle of attack
//! of the tail, an aerodynamic coefficient), with constants that are assumed. One that differs by `dc` changes
//! the residuals by `(de/dc) dc`, which is what `budget` has as `-G_c dc`; so here too
//!
//! ```text
//! d theta / dc = M^-1 G' R^-1 de/dc
//! ```
//!
//! `de/dc` is a difference: the residuals at the estimate with the columns as they are made with a slightly larger
//! constant, less those that were fitted, over what it is larger by.

use super::budget::{Influence, slopes};
use super::case::Case;
use super::extend::prepare;
use super::regressors::Problem;
use super::segment::Segment;
use super::solution::Solution;
use super::usable::starts;
use super::{By, Settings, Stop};
use crate::error::Errors;
use crate::least_squares::{Block, Evaluate, Layout};
use crate::model::{Assumed, Model};

/// The influences of the constants that columns of the records were made with; empty unless the estimation
/// converged. `used`: the segments of the case among `all`.
///
/// # Errors
/// None that the case itself would not have met.
pub fn influences(
    base: &Model,
    (all, used): (&[Segment], &[usize]),
    case: &Case,
    solution: &Solution,
    settings: &Settings,
) -> Result<Vec<Influence>, Errors> {
    let mut constants: Vec<(Assumed, f64)> = Vec::new();
    for made in used.iter().flat_map(|&s| &all[s].made) {
        let is_known = |c: &(Assumed, f64)| c.0.quantity.name == made.constant.quantity.name;
        if !constants.iter().any(is_known) {
            constants.push((made.constant.clone(), made.by));
        }
    }
    let converged = solution.fit.stop == Stop::Converged && case.chosen.lines.is_empty();
    if constants.is_empty() || !converged {
        return Ok(Vec::new());
    }
    let mut cases = Vec::with_capacity(constants.len());
    for (constant, _) in &constants {
        let moved: Vec<Segment> = all.iter().map(|s| s.remade(&constant.quantity.name)).collect();
        let (_, segments) = prepare(base, &moved, settings)?;
        let given = starts(&case.model, &case.propagator, &segments, &case.chosen, settings)?;
        let given: Vec<Vec<f64>> =
            used.iter().filter_map(|&s| given[s].as_ref().ok().cloned()).collect();
        if given.len() < used.len() {
            return Ok(Vec::new());
        }
        let these: Vec<&Segment> = used.iter().map(|&s| &segments[s]).collect();
        let (model, chosen) = (case.model.clone(), case.chosen.clone());
        let moved = Case::new(model, chosen, case.propagator.clone(), &these, given, settings);
        cases.push(moved.with_steps(&case.steps()));
    }
    let values: Vec<(Assumed, f64)> = constants.iter().map(|(c, _)| (c.clone(), 0.0)).collect();
    let by: Vec<f64> = constants.iter().map(|(_, by)| *by).collect();
    let found = match settings.by {
        By::Motion => {
            let base = |s: usize, local: &[f64], slopes: bool| case.evaluate(s, local, slopes);
            let moved: Vec<_> = cases
                .iter()
                .map(|case| {
                    move |s: usize, local: &[f64], slopes: bool| case.evaluate(s, local, slopes)
                })
                .collect();
            let wide = Wide { layout: &case.layout, base: &base, moved: &moved, by: &by };
            slopes(&values, (&wide.layout.widened(by.len()), &wide), case, solution)
        }
        By::EquationError => {
            let (base, _) = Problem::new(case, settings)?;
            let layout = base.layout(settings);
            let moved: Vec<Problem> = cases
                .iter()
                .map(|case| Ok(Problem::new(case, settings)?.0))
                .collect::<Result<_, Errors>>()?;
            let wide = Wide { layout: &layout, base: &base, moved: &moved, by: &by };
            slopes(&values, (&wide.layout.widened(by.len()), &wide), case, solution)
        }
    };
    Ok(found.unwrap_or_default())
}

/// A problem with a further shared parameter for each constant, of which it has residuals elsewhere.
struct Wide<'a, B, M> {
    layout: &'a Layout,
    base: &'a B,
    moved: &'a [M],
    by: &'a [f64],
}

impl<B: Evaluate, M: Evaluate> Evaluate for Wide<'_, B, M> {
    fn blocks(&self, s: usize, local: &[f64], sensitivities: bool) -> Option<Vec<Block>> {
        let (shared, k) = (self.layout.parts[s].shared.len(), self.by.len());
        let own = [&local[..shared], &local[shared + k..]].concat();
        let blocks = self.base.blocks(s, &own, sensitivities)?;
        if !sensitivities {
            return Some(blocks);
        }
        let moved: Vec<Vec<Block>> =
            self.moved.iter().map(|one| one.blocks(s, &own, false)).collect::<Option<_>>()?;
        let wider = |(b, block): (usize, Block)| {
            let nd = own.len();
            let mut g = Vec::with_capacity(block.e.len() * (nd + k));
            for (row, e) in block.e.iter().enumerate() {
                let known = block.g.get(row * nd..(row + 1) * nd).unwrap_or_default();
                g.extend_from_slice(&known[..shared.min(known.len())]);
                // y moves by what e does not
                g.extend(moved.iter().zip(self.by).map(|(of, by)| (e - of[b].e[row]) / by));
                g.extend_from_slice(&known[shared.min(known.len())..]);
            }
            Block { g, ..block }
        };
        Some(blocks.into_iter().enumerate().map(wider).collect())
    }
}
