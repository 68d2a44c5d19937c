//! A solution of a model with friction in; the same, or a better one that more or less friction
//! leads to, out.
//!
//! Friction holds a state at one place or at another, in this swing or in the next one: each order
//! of such events has a minimum of its own, and the next one may be half as much friction again
//! away, with damping and stiffness that make up for it. An iteration ends in the minimum that its
//! start lies above, and its standard deviations are of that one. So where a solution leaves more
//! than noise, friction is followed upwards and downwards in steps, all else adapted to each, and the
//! iteration goes on from the best of these, and from other friction with all else as it was found,
//! as long as that leads lower.

use super::case::Case;
use super::elsewhere::{FILE, GAIN};
use super::equations::Origin;
use super::estimation::Elsewhere;
use super::solution::Solution;
use super::watched::parameters;
use super::{Asked, Settings, Stop};
use crate::engine::Here;
use crate::least_squares::{Layout, Method, minimise};
use crate::signal::adequacy::{Adequacy, Leaves};
use std::collections::BTreeMap;

/// Friction is followed in steps of this factor, so many upwards and downwards.
const STEP: f64 = 1.25;
const STEPS: i32 = 5;
/// So many of them are gone on from, the best first, then from these factors.
const BEST: usize = 4;
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
        let is_asked = settings.asked != Asked::Nothing && self.chosen.lines.is_empty();
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
            let starts = self.other_frictions(&places, &begin, now, settings, (origin, here));
            let lower = |start| self.from_friction(start, now, settings, (origin, here));
            let Some(better) = starts.into_iter().find_map(lower) else { break };
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

    /// Starts with other friction, those first that leave least.
    fn other_frictions(
        &self,
        places: &[usize],
        begin: &[f64],
        now: &Solution,
        settings: &Settings,
        (origin, here): (&Origin, &Here),
    ) -> Vec<Vec<f64>> {
        let method = Method { max_iterations: FEW, ..settings.method() };
        let mut adapted: Vec<(f64, Vec<f64>)> = Vec::new();
        for direction in [1, -1] {
            let mut theta = now.fit.theta.clone();
            for step in 1..=STEPS {
                let of = |i: usize| now.fit.theta[i].max(LEAST * begin[i]);
                for &i in places {
                    theta[i] = of(i) * STEP.powi(direction * step);
                }
                if !self.is_likely(places, &theta) {
                    break;
                }
                let mut held = Layout { start: theta, ..self.layout.clone() };
                for &i in places {
                    (held.lower[i], held.upper[i]) = (held.start[i], held.start[i]);
                }
                let fit = minimise(&held, &origin.spread(self, here), &method);
                theta = fit.theta.clone();
                adapted.push((fit.cost(), fit.theta));
            }
        }
        adapted.retain(|(cost, _)| cost.is_finite());
        adapted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let alone = |factor: f64| {
            let mut start = now.fit.theta.clone();
            places.iter().for_each(|&i| start[i] = factor * start[i].max(LEAST * begin[i]));
            start
        };
        let others = FACTORS.into_iter().map(alone).filter(|start| self.is_likely(places, start));
        adapted.into_iter().take(BEST).map(|(_, theta)| theta).chain(others).collect()
    }

    /// Whether friction is as its prior lets it be.
    fn is_likely(&self, places: &[usize], theta: &[f64]) -> bool {
        places
            .iter()
            .all(|&i| (theta[i] - self.layout.centre[i]).abs() <= KNOWN * self.layout.prior_sd[i])
    }

    /// The solution that a start leads to; none where it is no better.
    fn from_friction(
        &mut self,
        start: Vec<f64>,
        now: &Solution,
        settings: &Settings,
        (origin, here): (&Origin, &Here),
    ) -> Option<Solution> {
        let fit = self.tried(start, FEW, settings, origin, here);
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
