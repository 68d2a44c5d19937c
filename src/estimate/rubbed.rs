//! A solution of a model with friction in; the same, or a better one that more or less friction
//! leads to, out.
//!
//! Friction holds a state at one place or at another, in this swing or in the next one: each order
//! of such events has a minimum of its own, and the next one may be half as much friction again
//! away, with damping and stiffness that make up for it. An iteration ends in the minimum that its
//! start lies above, and its standard deviations are of that one. So where a solution leaves more
//! than noise, the iteration goes on from it with more friction and with less, as long as that leads
//! lower: at first with that friction held, then with all.

use super::case::Case;
use super::elsewhere::{FILE, GAIN};
use super::equations::Origin;
use super::estimation::Elsewhere;
use super::solution::Solution;
use super::watched::parameters;
use super::{Settings, Stop};
use crate::engine::Here;
use crate::least_squares::{Layout, Method, minimise};
use crate::signal::adequacy::{Adequacy, Leaves};
use std::collections::BTreeMap;

/// How much friction is tried, of what was found.
const FACTORS: [f64; 4] = [1.5, 1.0 / 1.5, 2.0, 0.5];
/// Friction that was found to be next to nothing is taken to be at least this share of its start.
const LEAST: f64 = 0.1;
/// No friction is tried that is so many standard deviations off its prior.
const KNOWN: f64 = 3.0;
/// Iterations that another friction is followed for before its cost is compared.
const FEW: usize = 10;
/// Better minima, one behind the other, that are gone to at most.
const MOST: usize = 12;

impl Case {
    /// Goes on with other friction where that leads lower.
    pub fn rubbed(
        &mut self,
        solution: Solution,
        settings: &Settings,
        (origin, here): (&Origin, &Here),
    ) -> (Solution, Option<Elsewhere>) {
        let places = self.frictions();
        let is_asked = !settings.briefly && self.chosen.lines.is_empty();
        if places.is_empty() || !is_asked || solution.fit.stop != Stop::Converged {
            return (solution, None);
        }
        let (first, begin) = (solution, self.layout.start.clone());
        let mut best: Option<Solution> = None;
        for _ in 0..MOST {
            let now = best.as_ref().unwrap_or(&first);
            if self.is_noise(&now.fit.theta) {
                break;
            }
            let lower = |case: &mut Case, factor: f64| {
                case.with_friction(&places, &begin, factor, now, settings, (origin, here))
            };
            let Some(better) = FACTORS.into_iter().find_map(|factor| lower(self, factor)) else {
                break;
            };
            best = Some(better);
        }
        let Some(better) = best else { return (first, None) };
        let said = Elsewhere {
            from: FILE,
            taken: true,
            worse: first.fit.cost() - better.fit.cost(),
            ends: self.ends(&first.fit.theta, &better),
        };
        (better, Some(said))
    }

    /// The solution that a solution with so many times its friction leads to; none where it is no
    /// better.
    fn with_friction(
        &mut self,
        places: &[usize],
        begin: &[f64],
        factor: f64,
        now: &Solution,
        settings: &Settings,
        (origin, here): (&Origin, &Here),
    ) -> Option<Solution> {
        let mut start = now.fit.theta.clone();
        for &i in places {
            start[i] = factor * start[i].max(LEAST * begin[i]);
            let off = (start[i] - self.layout.centre[i]).abs();
            if off > KNOWN * self.layout.prior_sd[i] {
                return None;
            }
        }
        // Damping and stiffness make up for it first.
        let mut held = Layout { start, ..self.layout.clone() };
        for &i in places {
            (held.lower[i], held.upper[i]) = (held.start[i], held.start[i]);
        }
        let method = Method { max_iterations: FEW, ..settings.method() };
        let adapted = minimise(&held, &origin.spread(self, here), &method);
        let fit = self.tried(adapted.theta, FEW, settings, origin, here);
        let before = now.fit.cost() - GAIN;
        if fit.cost() >= before {
            return None;
        }
        let earlier = std::mem::replace(&mut self.layout.start, fit.theta);
        let better = self.solve(settings, origin, here);
        if better.fit.stop == Stop::Converged && better.fit.cost() < before {
            return Some(better);
        }
        self.layout.start = earlier;
        None
    }

    /// The unknowns that the friction of some state depends on.
    fn frictions(&self) -> Vec<usize> {
        let nodes: Vec<_> = self.model.moving.iter().filter_map(|m| m.friction).collect();
        let names = parameters(&self.model, &nodes);
        (0..self.unknowns.len()).filter(|&i| names.contains(&self.unknowns[i].name)).collect()
    }

    /// Whether noise of the sensors is all that is left of every output.
    fn is_noise(&self, theta: &[f64]) -> bool {
        let mut outputs: BTreeMap<String, Adequacy> = BTreeMap::new();
        for s in 0..self.records.len() {
            for trace in self.traces(s, theta) {
                let one = Adequacy::of(&trace.measured, &trace.modelled);
                outputs.entry(trace.name).or_default().add(&one);
            }
        }
        outputs.values().all(|all| matches!(all.leaves(), Leaves::Noise | Leaves::Unmoved))
    }
}
