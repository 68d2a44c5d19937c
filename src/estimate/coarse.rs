//! A solution in; the parameters that finer integration steps would move, out.
//!
//! Where a state meets its limit or leaves it inside a step the method is of first order, and the
//! motion is off by a part of that step. Steps four times finer show by how much that moves the
//! estimates: one step of the iteration from the solution, with the residuals that they leave.

use super::case::Case;
use super::solution::Solution;
use super::{Settings, Stop};
use crate::least_squares::{Layout, Method, minimise};

/// So many times finer.
const FINER: usize = 4;
/// A parameter is moved by more than so many of its standard deviations.
pub(super) const MOVES: f64 = 1.0;

/// What steps so many times finer would do: by how many standard deviations which parameters move,
/// those that move most first.
#[derive(Debug, Clone, PartialEq)]
pub struct Coarse {
    pub finer: usize,
    pub moved: Vec<(String, f64)>,
}

impl Case {
    /// What finer steps would move; none of a model without limits, or where nothing moves much.
    pub(super) fn coarse(&self, solution: &Solution, settings: &Settings) -> Option<Coarse> {
        let limited = self.model.states.iter().any(|s| s.min.is_some() || s.max.is_some());
        if !limited || self.is_filtered() || solution.fit.stop != Stop::Converged {
            return None;
        }
        let mut finer = self.clone();
        for (s, record) in finer.records.iter_mut().enumerate() {
            let steps = match record.substeps {
                0 => self.substeps(s, &solution.fit.theta),
                steps => steps,
            };
            record.substeps = FINER * steps;
        }
        let moved = self.moved(&finer, solution, settings, MOVES);
        (!moved.is_empty()).then_some(Coarse { finer: FINER, moved })
    }

    /// The parameters that one step of the iteration moves where the problem is another one, from the
    /// solution of this one, by more than `least` of their standard deviations: by how many, those that
    /// move most first.
    pub(super) fn moved(
        &self,
        other: &Case,
        solution: &Solution,
        settings: &Settings,
        least: f64,
    ) -> Vec<(String, f64)> {
        let steps = self.steps_to(other, solution, settings);
        let by = |i: usize| (self.unknowns[i].name.clone(), steps[i].abs());
        let mut moved: Vec<(String, f64)> =
            (0..steps.len()).filter(|&i| steps[i].abs() > least).map(by).collect();
        moved.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        moved
    }

    /// The same of every unknown, with signs; NaN of one without standard deviation.
    pub(super) fn steps_to(
        &self,
        other: &Case,
        solution: &Solution,
        settings: &Settings,
    ) -> Vec<f64> {
        let evaluate =
            |s: usize, local: &[f64], sensitivities: bool| other.evaluate(s, local, sensitivities);
        let layout = Layout { start: solution.fit.theta.clone(), ..self.layout.clone() };
        let method = Method { max_iterations: 1, ..settings.method() };
        let theta = minimise(&layout, &evaluate, &method).theta;
        let step = |i: usize| {
            let (sd, _) = solution.deviation(i)?;
            Some((theta.get(i)? - solution.fit.theta[i]) / sd)
        };
        (0..self.unknowns.len()).map(|i| step(i).unwrap_or(f64::NAN)).collect()
    }
}
