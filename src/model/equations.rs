//! A compiled model and names of its equations in; the model of these equations alone, as its outputs, out.

use super::graph::{Leaf, Node};
use super::{Layout, Model, Quantity};
use crate::error::{Error, Result};

impl Model {
    /// The equations named as outputs of a model without states, with the inputs, parameters and constants of this one.
    ///
    /// # Errors
    /// There is no such equation; one depends on the motion: on states, delays, rates or time.
    pub fn of_equations(&self, names: &[String]) -> Result<Model> {
        let mut nodes: Vec<Node> = Vec::new();
        for name in names {
            let node = self.equations.get(name).copied().ok_or_else(|| {
                Error::new(format!("model {} has no equation \"{name}\"", self.name))
            })?;
            let of_motion = |leaf: &Leaf| !matches!(leaf, Leaf::Input(_) | Leaf::Parameter(_));
            if self.graph.leaves(&[node]).iter().any(of_motion) {
                let what =
                    format!("equation \"{name}\" of model {} depends on the motion", self.name);
                return Err(Error::new(what)
                    .help("it may depend on inputs, constants and parameters alone"));
            }
            nodes.push(node);
        }
        let unit = |name: &String| {
            self.dims.get(name).map_or_else(|| "-".to_string(), ToString::to_string)
        };
        let output =
            |name: &String| Quantity { name: name.clone(), unit: unit(name), doc: String::new() };
        Ok(Model {
            states: Vec::new(),
            rates: Vec::new(),
            delays: Vec::new(),
            moving: Vec::new(),
            outputs: names.iter().map(output).collect(),
            output_nodes: nodes,
            layout: Layout {
                states: 0,
                inputs: self.inputs.len(),
                delayed: 0,
                moving: 0,
                parameters: self.parameters.len(),
            },
            ..self.clone()
        })
    }

    /// Whether an output depends on the parameter of this name.
    pub fn uses(&self, parameter: &str) -> bool {
        let leaf = self.parameter(parameter).map(Leaf::Parameter);
        leaf.is_some_and(|leaf| self.graph.leaves(&self.output_nodes).contains(&leaf))
    }

    /// Whether an output depends on the input of this name.
    pub fn reads(&self, input: &str) -> bool {
        let leaf = self.input(input).map(Leaf::Input);
        leaf.is_some_and(|leaf| self.graph.leaves(&self.output_nodes).contains(&leaf))
    }
}
