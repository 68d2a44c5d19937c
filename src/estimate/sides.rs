//! A case in; its equations, and which of them its measurements allow, out.

use super::case::Case;
use crate::model::graph::{Leaf, Node, View};
use crate::model::{Delayed, Model};

/// An equation in use: the row of its program, what is on its left side, what it needs.
pub(super) struct Side {
    /// Row among the rates or the outputs of the propagator.
    pub row: usize,
    pub is_rate: bool,
    pub output: usize,
    pub states: Vec<usize>,
    pub name: String,
    pub unit: String,
}

/// How both sides of an equation are seen.
pub(super) enum Seen {
    /// Through the derivative filter: what is measured, and the integral of the right side.
    Rate,
    /// Smoothed: noise of the states would else weigh on their derivatives.
    Smoothed,
    /// As they are: there is no state in it.
    Raw,
}

/// An equation of the model, and whether it is used.
pub(super) struct Considered {
    pub name: String,
    pub unit: String,
    /// "used", or what is missing.
    pub outcome: String,
}

/// The outcome of an equation that is used.
pub(super) const USED: &str = "used";

impl Side {
    pub fn seen(&self) -> Seen {
        match (self.is_rate, self.states.is_empty()) {
            (true, _) => Seen::Rate,
            (false, false) => Seen::Smoothed,
            (false, true) => Seen::Raw,
        }
    }

    /// The number of the output, or of the state's rate behind all outputs.
    pub fn number(&self, model: &Model) -> usize {
        if self.is_rate { model.outputs.len() + self.row } else { self.output }
    }
}

/// The equations that can be used, and all of them by name.
pub(super) fn sides(case: &Case) -> (Vec<Side>, Vec<Considered>) {
    let model = &case.model;
    let (mut sides, mut equations) = (Vec::new(), Vec::new());
    let mut add = |name: String,
                   unit: String,
                   node: Node,
                   row: usize,
                   is_rate: bool,
                   output: Option<usize>,
                   of_state: bool| {
        let outcome = match (needed(model, node), output) {
            (_, Some(o)) if of_state => of_its_state(model, o),
            (Err(hidden), _) => format!("needs {hidden}, which is not measured"),
            (_, None) => "the state is not measured".to_string(),
            (Ok(states), Some(output)) => {
                match states.iter().find(|&&i| measured(case, i).is_none()) {
                    Some(&i) => {
                        format!("needs {}, which is not measured", model.states[i].quantity.name)
                    }
                    None => {
                        let (name, unit) = (name.clone(), unit.clone());
                        sides.push(Side { row, is_rate, output, states, name, unit });
                        USED.to_string()
                    }
                }
            }
        };
        equations.push(Considered { name, unit, outcome });
    };
    // The covariance of a filter has no measurement.
    let motion = model.covariance.as_ref().map_or(model.states.len(), |c| c.motion);
    for (i, state) in model.states.iter().enumerate().take(motion) {
        let q = &state.quantity;
        add(
            format!("rate of {}", q.name),
            format!("{}/s", q.unit),
            model.rates[i],
            i,
            true,
            measured(case, i),
            false,
        );
    }
    for (row, &o) in case.outputs.iter().enumerate() {
        let q = &model.outputs[o];
        add(
            q.name.clone(),
            q.unit.clone(),
            model.output_nodes[o],
            row,
            false,
            Some(o),
            model.state(&q.name).is_some(),
        );
    }
    (sides, equations)
}

/// Whether what is measured under a state's name is the state, and nothing else.
pub(super) fn is_itself(model: &Model, state: usize) -> bool {
    let output = model.output(&model.states[state].quantity.name);
    let node = output.and_then(|o| model.output_nodes.get(o));
    node.is_none_or(
        |node| matches!(model.graph.view(*node), View::Leaf(Leaf::State(i)) if i == state),
    )
}

/// What becomes of an output that measures a state.
fn of_its_state(model: &Model, output: usize) -> String {
    let name = &model.outputs[output].name;
    if model.state(name).is_some_and(|state| is_itself(model, state)) {
        return "the state itself: its rate is used".to_string();
    }
    let leaves = model.graph.leaves(&[model.output_nodes[output]]);
    let parameter = |leaf: &Leaf| match leaf {
        Leaf::Parameter(p) => Some(model.parameters[*p].quantity.name.clone()),
        _ => None,
    };
    let names: Vec<String> = leaves.iter().filter_map(parameter).collect();
    let at = match names.is_empty() {
        true => String::new(),
        false => format!(" ({} at the start)", names.join(", ")),
    };
    format!("the state, and more that is taken off{at}: its rate is used")
}

/// States that a node depends on, those behind delays included, or the name of one that nobody can
/// measure.
fn needed(model: &Model, node: Node) -> std::result::Result<Vec<usize>, String> {
    let mut states = Vec::new();
    for leaf in model.graph.leaves(&[node]) {
        match leaf {
            Leaf::State(i) => states.push(i),
            Leaf::Delayed(k) => {
                if let Delayed::State(i) = model.delays[k].of {
                    states.push(i);
                }
            }
            _ => {}
        }
    }
    match states.iter().find(|&&i| model.states[i].hidden) {
        Some(&i) => Err(model.states[i].quantity.name.clone()),
        None => Ok(states),
    }
}

/// The output that measures a state.
pub(super) fn measured(case: &Case, state: usize) -> Option<usize> {
    case.model.output(&case.model.states[state].quantity.name).filter(|o| case.outputs.contains(o))
}
