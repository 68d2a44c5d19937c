//! A compiled model in; the same model with zero shifts of sensors, or with feedback of measured
//! states, out.

use std::collections::BTreeMap;

use indexmap::IndexMap;

use super::graph::{Leaf, Node};
use super::{Model, Parameter, Quantity, Scope, StartKind};
use crate::error::{Error, Errors, Result};
use crate::units::Unit;

/// Name of the zero shift of an output.
pub fn output_shift(output: &str) -> String {
    format!("dz_{output}")
}

/// Name of the zero shift of an input.
pub fn input_shift(input: &str) -> String {
    format!("du_{input}")
}

/// Whether a parameter is the zero shift of an output or of an input, by its name.
pub fn is_shift(name: &str) -> bool {
    [output_shift(""), input_shift("")].iter().any(|begin| name.starts_with(begin.as_str()))
}

/// Name of the delay of an output.
pub fn output_delay(output: &str) -> String {
    format!("tau_{output}")
}

/// Name of the scale of an output: none that a model's file may have.
pub fn output_scale(output: &str) -> String {
    format!("scale of {output}")
}

/// Name of the input that carries what was measured of an output.
fn feedback(output: &str) -> String {
    format!("measured_{output}")
}

impl Model {
    /// With a new parameter per named output and input: what the sensor reads too much.
    /// `z = y + dz_y` for an output, and the model is driven by `u - du_u`, also where it sees a
    /// delayed `u`. They start at zero, without bounds, and hold where `scope` says. A state that
    /// starts "measured" begins at the measured value as it stands.
    ///
    /// # Errors
    /// Names that the model does not have, or whose shift has the name of something else: all at
    /// once.
    pub fn with_shifts(
        &self,
        outputs: &[String],
        inputs: &[String],
        scope: &Scope,
    ) -> std::result::Result<Model, Errors> {
        let (mut model, mut errors) = (self.clone(), Errors::default());
        for name in outputs {
            let output = errors.take(self.known(self.output(name), "output", name, &self.outputs));
            if let Some(output) = output
                && let Some(p) =
                    errors.take(model.add_shift(output_shift(name), &self.outputs[output], scope))
            {
                let shift = model.graph.leaf(Leaf::Parameter(p));
                model.output_nodes[output] = model.graph.add(model.output_nodes[output], shift);
            }
        }
        let mut with: BTreeMap<Leaf, Node> = BTreeMap::new();
        for name in inputs {
            let input = errors.take(self.known(self.input(name), "input", name, &self.inputs));
            if let Some(input) = input
                && let Some(p) =
                    errors.take(model.add_shift(input_shift(name), &self.inputs[input], scope))
            {
                let delays = self
                    .delays
                    .iter()
                    .enumerate()
                    .filter(|(_, d)| d.of.now() == Leaf::Input(input));
                let leaves = delays.map(|(k, _)| Leaf::Delayed(k)).chain([Leaf::Input(input)]);
                for leaf in leaves {
                    let (read, shift) =
                        (model.graph.leaf(leaf), model.graph.leaf(Leaf::Parameter(p)));
                    with.insert(leaf, model.graph.sub(read, shift));
                }
            }
        }
        model.replace(&with);
        errors.or(model)
    }

    /// With a new parameter per named output: how many seconds its sensor is late, to first order,
    /// `z = y - tau_y dy/dt`, the slope exact by the chain rule over states, inputs and time. It
    /// starts at zero, with the prior standard deviation `sd`; where an output depends on the slope
    /// of an input, the slope of that slope is left out.
    ///
    /// # Errors
    /// Names that the model does not have, or whose delay has the name of something else: all at
    /// once.
    pub fn with_lateness(&self, outputs: &[String], sd: f64) -> std::result::Result<Model, Errors> {
        let (mut model, mut errors) = (self.clone(), Errors::default());
        let second = Quantity { unit: "s".to_string(), ..Default::default() };
        for name in outputs {
            let output = errors.take(self.known(self.output(name), "output", name, &self.outputs));
            if let Some(output) = output
                && let Some(p) =
                    errors.take(model.add_shift(output_delay(name), &second, &Scope::Campaign))
            {
                model.parameters[p].quantity.doc = format!("{name} is late by");
                model.parameters[p].prior_sd = sd;
                let (y, rates, g) = (model.output_nodes[output], &model.rates, &mut model.graph);
                let states = (0..rates.len()).map(|i| (Leaf::State(i), rates[i]));
                let inputs =
                    (0..model.inputs.len()).map(|i| (Leaf::Input(i), g.leaf(Leaf::InputRate(i))));
                let moving: Vec<(Leaf, Node)> = states.chain(inputs).collect();
                let mut slope = g.derivative(y, Leaf::Time);
                for (leaf, rate) in moving {
                    let d = g.derivative(y, leaf);
                    slope = g.fma(d, rate, slope);
                }
                let tau = g.leaf(Leaf::Parameter(p));
                let late = g.mul(tau, slope);
                model.output_nodes[output] = g.sub(y, late);
            }
        }
        errors.or(model)
    }

    /// With a new parameter, which comes along: how many times too much the sensor of an output reads,
    /// `z = k y`. It starts at one.
    ///
    /// # Errors
    /// A name that the model does not have, or whose scale has the name of something else.
    pub fn with_scale(&self, name: &str) -> Result<(Model, usize)> {
        let mut model = self.clone();
        let output = self.known(self.output(name), "output", name, &self.outputs)?;
        let none = Quantity { unit: "-".to_string(), ..Default::default() };
        let p = model.add_shift(output_scale(name), &none, &Scope::Campaign)?;
        model.parameters[p].quantity.doc = format!("scale of {name}");
        model.parameters[p].start = 1.0;
        let scale = model.graph.leaf(Leaf::Parameter(p));
        model.output_nodes[output] = model.graph.mul(scale, model.output_nodes[output]);
        Ok((model, p))
    }

    /// With feedback of the measurement to the rates of the named states:
    /// `rate + gain (measured - modelled)`, where both are of the output of the state's name and
    /// `measured` is a new input, appended in order. Also returns the outputs that these inputs
    /// carry.
    ///
    /// # Errors
    /// Names that are no state, or not an output of the same unit, and gains that are not finite:
    /// all at once.
    pub fn stabilised(
        &self,
        gains: &IndexMap<String, f64>,
    ) -> std::result::Result<(Model, Vec<usize>), Errors> {
        let (mut model, mut errors, mut carried) = (self.clone(), Errors::default(), Vec::new());
        let states: Vec<Quantity> =
            self.states.iter().filter(|s| !s.hidden).map(|s| s.quantity.clone()).collect();
        for (name, &gain) in gains {
            let state = errors.take(self.known(
                states.iter().position(|q| q.name == *name),
                "state",
                name,
                &states,
            ));
            let output = errors.take(self.known(self.output(name), "output", name, &self.outputs));
            let (Some(state), Some(output)) = (state, output) else { continue };
            if self.moving.iter().any(|m| m.velocity == state) {
                let error = Error::new(format!(
                    "\"{name}\" of model {} is held by friction or a stop, and takes no feedback of its measurement",
                    self.name
                ));
                errors.push(error.help("stabilise the position, or another state"));
            }
            let dim = |unit: &str| Unit::parse(unit).ok().map(|u| u.dim);
            if dim(&self.states[state].quantity.unit) != dim(&self.outputs[output].unit) {
                errors.push(Error::new(format!(
                    "state and output \"{name}\" of model {} have different units",
                    self.name
                )));
            }
            if !(gain.is_finite() && gain >= 0.0) {
                errors.push(Error::new(format!(
                    "the gain of \"{name}\" is at least zero, 1/s, not {gain}"
                )));
            }
            errors.take(self.is_new(&feedback(name)));
            let quantity = Quantity {
                name: feedback(name),
                doc: format!("measured {name}"),
                ..self.outputs[output].clone()
            };
            let g = &mut model.graph;
            let (measured, k) = (g.leaf(Leaf::Input(model.inputs.len())), g.c(gain));
            let gap = g.sub(measured, model.output_nodes[output]);
            let back = g.mul(k, gap);
            model.rates[state] = g.add(model.rates[state], back);
            model.inputs.push(quantity);
            model.layout.inputs += 1;
            carried.push(output);
        }
        errors.or((model, carried))
    }

    /// Appends the parameter of a shift and says where it is.
    fn add_shift(&mut self, name: String, of: &Quantity, scope: &Scope) -> Result<usize> {
        self.is_new(&name)?;
        let quantity =
            Quantity { name, unit: of.unit.clone(), doc: format!("zero shift of {}", of.name) };
        let (min, max) = (f64::NEG_INFINITY, f64::INFINITY);
        let scope = scope.clone();
        self.parameters.push(Parameter {
            quantity,
            start: 0.0,
            min,
            max,
            scope,
            held_in: None,
            fixed: false,
            prior_sd: f64::INFINITY,
        });
        self.layout.parameters += 1;
        Ok(self.parameters.len() - 1)
    }

    /// Replaces leaves wherever a trajectory is computed from them.
    pub(super) fn replace(&mut self, with: &BTreeMap<Leaf, Node>) {
        if with.is_empty() {
            return;
        }
        let g = &mut self.graph;
        let nodes =
            self.rates.iter_mut().chain(&mut self.output_nodes).chain(self.equations.values_mut());
        let nodes = nodes
            .chain(self.delays.iter_mut().map(|d| &mut d.tau))
            .chain(self.trim.zero.iter_mut().map(|z| &mut z.1));
        let moving =
            self.moving.iter_mut().flat_map(|m| [Some(&mut m.free), m.friction.as_mut()]).flatten();
        let of_states = self.states.iter_mut().flat_map(|s| {
            let start = match &mut s.start {
                StartKind::Expression(node) => Some(node),
                StartKind::Measured => None,
            };
            let limits = [s.min.as_mut(), s.max.as_mut(), s.rate_max.as_mut()];
            [start, s.noise.as_mut(), s.start_sd.as_mut()].into_iter().chain(limits).flatten()
        });
        nodes.chain(moving).chain(of_states).for_each(|node| *node = g.substitute(*node, with));
    }

    fn known(
        &self,
        found: Option<usize>,
        kind: &str,
        name: &str,
        all: &[Quantity],
    ) -> Result<usize> {
        found.ok_or_else(|| {
            let names: Vec<&str> = all.iter().map(|q| q.name.as_str()).collect();
            let error = Error::new(format!("model {} has no {kind} \"{name}\"", self.name));
            error.help(format!("it has {}", crate::config::list(&names)))
        })
    }

    pub(super) fn is_new(&self, name: &str) -> Result<()> {
        let taken = self.parameter(name).is_some()
            || self.input(name).is_some()
            || self.state(name).is_some()
            || self.equations.contains_key(name)
            || self.constants.iter().any(|c| c.quantity.name == name);
        if taken {
            return Err(Error::new(format!("model {} has a \"{name}\" already", self.name)));
        }
        Ok(())
    }
}
