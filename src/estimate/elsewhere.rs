//! A solution in; the same, or a better one that another start leads to, with what became of that
//! start, out.
//!
//! An iteration ends in the minimum that its start lies above, and a trajectory that is far off has
//! minima that mean nothing. What costs little is compared before a minimum is believed: the values
//! that regression on the equations gives, which integrates nothing and so has one minimum alone, for
//! the parameters that it determines; or those of the model, where the iteration started from a
//! regression. The cost is evaluated there, and a few iterations show where it leads to: below the
//! solution's cost it is followed to its end, above it is left.

use super::case::Case;
use super::equations::Origin;
use super::estimation::Elsewhere;
use super::regression::{Regression, regress};
use super::regressors::ESTIMATED;
use super::solution::Solution;
use super::{Asked, Settings, Stop};
use crate::engine::Here;
use crate::least_squares::{Fit, Layout, Method, minimise};

/// Iterations that another start is followed for while its cost is above that of the solution.
const FEW: usize = 4;
/// A lower cost counts from here on: one standard deviation.
pub(super) const GAIN: f64 = 0.5;
/// Ends closer than this, in standard deviations, are the same.
const SAME: f64 = 0.5;

pub(super) const FILE: &str = "the start values";
const EQUATIONS: &str = "regression on the equations";

impl Case {
    /// Compares the solution with where another start leads to.
    pub fn elsewhere(
        &mut self,
        solution: Solution,
        regression: Option<&Regression>,
        settings: &Settings,
        (origin, here): (&Origin, &Here),
    ) -> (Solution, Option<Elsewhere>) {
        let Some((from, start)) = self.other_start(&solution, regression, settings) else {
            return (solution, None);
        };
        let fit = self.tried(start, FEW, settings, origin, here);
        let (old, new) = (solution.fit.cost(), fit.cost());
        let instead = if from == FILE { EQUATIONS } else { FILE };
        if new < old - GAIN {
            let before = std::mem::replace(&mut self.layout.start, fit.theta.clone());
            let better = self.solve(settings, origin, here);
            if better.fit.stop == Stop::Converged && better.fit.cost() < old - GAIN {
                let said = Elsewhere {
                    from: instead,
                    taken: true,
                    worse: old - better.fit.cost(),
                    ends: self.ends(&solution.fit.theta, &better),
                };
                return (better, Some(said));
            }
            self.layout.start = before;
            return (solution, None);
        }
        let ends = self.ends(&fit.theta, &solution);
        let another = fit.stop == Stop::Converged && !ends.is_empty() && new > old + GAIN;
        let said = Elsewhere { from, taken: false, worse: new - old, ends };
        (solution, another.then_some(said))
    }

    /// Another start than that of the solution, and where it comes from; none where there is none.
    fn other_start(
        &self,
        solution: &Solution,
        regression: Option<&Regression>,
        settings: &Settings,
    ) -> Option<(&'static str, Vec<f64>)> {
        if settings.asked == Asked::Nothing
            || solution.fit.stop != Stop::Converged
            || !self.chosen.lines.is_empty()
        {
            return None;
        }
        if let Some(taken) = regression.filter(|r| r.taken) {
            let mut start = self.layout.start.clone();
            taken.rows.iter().for_each(|row| start[row.row] = row.start);
            return Some((FILE, start));
        }
        let regression = match regression {
            Some(regression) => regression.clone(),
            // Records that cannot be smoothed have no such start.
            None => regress(self, settings).ok()?.0,
        };
        let mut start = solution.fit.theta.clone();
        for row in regression.rows.iter().filter(|row| row.outcome == ESTIMATED) {
            start[row.row] = row.value;
        }
        let same = self.ends(&start, solution).is_empty();
        (!same).then_some((EQUATIONS, start))
    }

    /// So many iterations from another start.
    pub(super) fn tried(
        &self,
        start: Vec<f64>,
        max_iterations: usize,
        settings: &Settings,
        origin: &Origin,
        here: &Here,
    ) -> Fit {
        let within =
            |(i, value): (usize, f64)| value.clamp(self.layout.lower[i], self.layout.upper[i]);
        let start = start.into_iter().enumerate().map(within).collect();
        let layout = Layout { start, ..self.layout.clone() };
        let method = Method { max_iterations, ..settings.method() };
        minimise(&layout, &origin.spread(self, here), &method)
    }

    /// Parameters that stand elsewhere than in the solution, those that are farthest off first; at most three.
    pub(super) fn ends(&self, theta: &[f64], solution: &Solution) -> Vec<(String, f64)> {
        let off = |i: usize| {
            let (sd, _) = solution.deviation(i)?;
            let off = (theta[i] - solution.fit.theta[i]).abs() / sd;
            (off > SAME).then_some((i, off))
        };
        let mut all: Vec<(usize, f64)> = (0..theta.len()).filter_map(off).collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        all.iter().take(3).map(|(i, _)| (self.unknowns[*i].name.clone(), theta[*i])).collect()
    }
}
