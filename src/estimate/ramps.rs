//! A solution of a model with delayed inputs in; whether these run along straight lines between their
//! samples, and what that moves, out.
//!
//! A `delay()` of an input that runs on lines reads a smooth curve through its samples, as what is
//! measured is smooth. A command made of ramps is not: the curve overshoots their corners, by a part
//! of the change of slope times the spacing, and times and rates of what follows it are off. So both
//! are tried, and the data tell which leaves less.

use super::case::Case;
use super::coarse::MOVES;
use super::solution::Solution;
use super::{Settings, Stop};
use crate::dynamics::Interpolation;
use crate::least_squares::{Layout, Method, minimise};
use crate::model::Delayed;

/// So much less in log-likelihood is less. *Convention*: what chance gives one parameter once in a hundred.
const LESS: f64 = 3.3;
/// Iterations with the other reading.
const FEW: usize = 5;

/// Straight lines leave less than smooth curves.
#[derive(Debug, Clone, PartialEq)]
pub struct Ramps {
    /// Inputs that some delay reads.
    pub inputs: Vec<String>,
    /// By how much less they leave, in log-likelihood.
    pub less: f64,
    /// Parameters with the standard deviations by which they move, those that move most first.
    pub moved: Vec<(String, f64)>,
}

impl Case {
    /// What changes where delays read straight lines; none where that leaves no less.
    pub(super) fn ramps(&self, solution: &Solution, settings: &Settings) -> Option<Ramps> {
        if self.is_filtered() || solution.fit.stop != Stop::Converged {
            return None;
        }
        let delayed = |i: &usize| self.model.delays.iter().any(|d| d.of == Delayed::Input(*i));
        let on_lines = |i: &usize| {
            let kinds = self.records.iter().map(|record| record.interpolation.get(*i).copied());
            kinds.into_iter().all(|kind| kind.unwrap_or_default() == Interpolation::Linear)
        };
        let nu = self.model.inputs.len();
        let which: Vec<usize> = (0..nu).filter(delayed).filter(on_lines).collect();
        if which.is_empty() {
            return None;
        }
        let mut other = self.clone();
        for record in &mut other.records {
            record.interpolation.resize(nu, Interpolation::Linear);
            which.iter().for_each(|&i| record.interpolation[i] = Interpolation::Ramps);
        }
        let evaluate =
            |s: usize, local: &[f64], sensitivities: bool| other.evaluate(s, local, sensitivities);
        let layout = Layout { start: solution.fit.theta.clone(), ..self.layout.clone() };
        let method = Method { max_iterations: FEW, ..settings.method() };
        let less = solution.fit.cost() - minimise(&layout, &evaluate, &method).cost();
        let moved = match less > LESS {
            true => self.moved(&other, solution, settings, MOVES),
            false => return None,
        };
        let inputs = which.iter().map(|&i| self.model.inputs[i].name.clone()).collect();
        (!moved.is_empty()).then_some(Ramps { inputs, less, moved })
    }
}
