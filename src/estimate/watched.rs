//! A model in; the same with the limits of its states, and what they limit, as further outputs, out; and what a case
//! then sees of them along its segments.

use super::case::Case;
use crate::dynamics::{Directions, Propagator};
use crate::error::Result;
use crate::model::graph::{Leaf, Node};
use crate::model::{Model, Quantity};

/// A state is on its limit where it is not farther from it than this share of it: what is put there is there but for
/// rounding.
const ON: f64 = 1e-9;

/// A limit as outputs of a model: what is limited, and its bound.
pub struct Watch {
    pub state: usize,
    pub limit: &'static str,
    pub unit: String,
    pub bound: Node,
    value: usize,
}

/// How near the motion of a segment comes to a limit, grid point by grid point.
pub struct Seen {
    /// What is limited, with the sign that makes nearer larger.
    pub motion: Vec<f64>,
    pub active: Vec<bool>,
    pub bound: Vec<f64>,
}

impl Watch {
    /// What grows towards the limit.
    pub fn towards(&self, value: f64) -> f64 {
        match self.limit {
            "min" => -value,
            "rate_max" => value.abs(),
            _ => value,
        }
    }
}

/// The model with what is limited and the limits as further outputs.
pub fn watched(model: &Model) -> (Model, Vec<Watch>) {
    let (mut model, mut all) = (model.clone(), Vec::new());
    for state in 0..model.states.len() {
        let own = model.states[state].clone();
        let x = model.graph.leaf(Leaf::State(state));
        let unit = &own.quantity.unit;
        let rate = if unit == "-" { "1/s".to_string() } else { format!("{unit}/s") };
        let limits = [
            ("min", own.min, x, unit.clone()),
            ("max", own.max, x, unit.clone()),
            ("rate_max", own.rate_max, model.rates[state], rate),
        ];
        for (limit, bound, node, unit) in limits {
            let Some(bound) = bound else { continue };
            let value = model.outputs.len();
            model.outputs.extend([Quantity::default(), Quantity::default()]);
            model.output_nodes.extend([node, bound]);
            all.push(Watch { state, limit, unit, bound, value });
        }
    }
    (model, all)
}

/// Names of the parameters that nodes depend on.
pub fn parameters(model: &Model, nodes: &[Node]) -> Vec<String> {
    let of = |leaf: &Leaf| match leaf {
        Leaf::Parameter(p) => Some(model.parameters.get(*p)?.quantity.name.clone()),
        _ => None,
    };
    model.graph.leaves(nodes).iter().filter_map(of).collect()
}

/// The inputs that limits depend on; all of them where none does.
pub fn conditions(model: &Model, watches: &[Watch]) -> Vec<usize> {
    let bounds: Vec<Node> = watches.iter().map(|watch| watch.bound).collect();
    let leaves = model.graph.leaves(&bounds);
    let all = 0..model.inputs.len();
    let told: Vec<usize> = all.clone().filter(|j| leaves.contains(&Leaf::Input(*j))).collect();
    if told.is_empty() { all.collect() } else { told }
}

impl Case {
    /// What is seen of all limits in every segment.
    pub fn seen_all(
        &self,
        model: &Model,
        watches: &[Watch],
        theta: &[f64],
    ) -> Result<Vec<Vec<Seen>>> {
        let from = self.model.outputs.len();
        let starts = self.chosen.initial.clone();
        let directions = Directions { parameters: Vec::new(), starts };
        let outputs = (from..model.outputs.len()).collect();
        let propagator = Propagator::of_outputs(model, directions, outputs)?;
        let of = |s: usize| self.seen(&propagator, watches, from, s, theta);
        Ok((0..self.records.len()).map(of).collect())
    }

    /// What is seen of all limits in a segment.
    fn seen(
        &self,
        propagator: &Propagator,
        watches: &[Watch],
        from: usize,
        s: usize,
        theta: &[f64],
    ) -> Vec<Seen> {
        let (parameters, starts) = self.place(s, &self.layout.local(s, theta));
        let grid = propagator.run(&parameters, &starts, &self.records[s], false);
        let (n, width) = (grid.n, propagator.outputs.len());
        let of = |watch: &Watch| {
            let column = |k: usize, at: usize| grid.y[k * width + watch.value - from + at];
            let motion: Vec<f64> = (0..n).map(|k| watch.towards(column(k, 0))).collect();
            let bound: Vec<f64> = (0..n).map(|k| column(k, 1)).collect();
            let mut seen = Seen { active: Vec::new(), motion, bound };
            seen.active = (0..n).map(|k| on(watch, &seen, k)).collect();
            seen
        };
        let mut all: Vec<Seen> = watches.iter().map(of).collect();
        for (w, watch) in watches.iter().enumerate().filter(|(_, w)| w.limit == "rate_max") {
            let stop = |other: &Watch| other.state == watch.state && other.limit != "rate_max";
            let stops: Vec<usize> = (0..watches.len()).filter(|i| stop(&watches[*i])).collect();
            if let Some(&stop) = stops.first()
                && self.model.taken_along(watch.state).is_some()
            {
                // A stop that moves takes it along: its rate is how it moves.
                all[w].motion = speeds(&all[stop].motion, self.records[s].dt);
                all[w].active = (0..n).map(|k| on(watch, &all[w], k)).collect();
                continue;
            }
            // On a stop there is no rate, whatever it would be without.
            for stop in stops {
                for k in (0..n).filter(|k| all[stop].active[*k]).collect::<Vec<_>>() {
                    (all[w].active[k], all[w].motion[k]) = (false, 0.0);
                }
            }
        }
        all
    }
}

/// Whether what is limited is on its limit at a grid point.
fn on(watch: &Watch, seen: &Seen, k: usize) -> bool {
    let limit = watch.towards(seen.bound[k]);
    seen.motion[k] >= limit - ON * limit.abs().max(f64::MIN_POSITIVE)
}

/// How fast a value moves from each grid point to the next one.
fn speeds(values: &[f64], dt: f64) -> Vec<f64> {
    let steps = values.windows(2).map(|pair| (pair[1] - pair[0]).abs() / dt);
    steps.chain((!values.is_empty()).then_some(0.0)).collect()
}
