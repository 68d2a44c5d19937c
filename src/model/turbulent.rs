//! A model and some of its states in; the same with white noise of densities yet to be found that
//! drives the rates of these states, out.

use super::graph::{Leaf, Node};
use super::{Delay, Delayed, Model, Parameter, Quantity, Scope};
use crate::error::Errors;
use crate::units::simplified;
use std::collections::BTreeMap;

/// Name of the density of the noise that drives a state.
pub fn density_of(state: &str) -> String {
    format!("F_{state}")
}

impl Model {
    /// States whose rate depends on a parameter of the model: what the air does to the aircraft.
    /// The others' rates are kinematics, which holds in turbulence as well. A parameter that is
    /// somebody's zero shift counts like any other.
    pub fn uncertain_rates(&self) -> Vec<usize> {
        let uncertain = |i: &usize| {
            let leaves = self.graph.leaves(&[self.rates[*i]]);
            leaves.iter().any(|leaf| matches!(leaf, Leaf::Parameter(_)))
        };
        (0..self.states.len()).filter(|i| !self.states[*i].hidden).filter(uncertain).collect()
    }

    /// With noise on the rates of these states, each with the root of its spectral density to begin
    /// with, in the state's unit per root of a second. Where a state is read with a delay, it is
    /// taken to first order, `x(t - tau) = x - tau dx/dt`: a filter does not remember states.
    ///
    /// # Errors
    /// Names of densities that are taken.
    pub fn driven_by(&self, densities: &[(usize, f64)]) -> Result<Model, Errors> {
        let (mut model, mut errors) = (self.without_delayed_states(), Errors::default());
        for &(state, start) in densities {
            let quantity = &self.states[state].quantity;
            let name = density_of(&quantity.name);
            errors.take(model.is_new(&name));
            let parameter = Parameter {
                quantity: Quantity {
                    name,
                    unit: simplified(&format!("{} s^-0.5", quantity.unit)),
                    doc: format!("turbulence in the rate of {}", quantity.name),
                },
                start,
                min: 0.0,
                max: f64::INFINITY,
                scope: Scope::Campaign,
                fixed: false,
                prior_sd: f64::INFINITY,
            };
            model.parameters.push(parameter);
            model.layout.parameters += 1;
            let noise = model.graph.leaf(Leaf::Parameter(model.parameters.len() - 1));
            model.states[state].noise = Some(noise);
        }
        // Its text does not say so.
        model.recipe = None;
        errors.or(model)
    }

    fn without_delayed_states(&self) -> Model {
        let mut model = self.clone();
        // A delay that nothing reads any more has to be of something that is there.
        if model.inputs.is_empty() {
            return model;
        }
        let mut with: BTreeMap<Leaf, Node> = BTreeMap::new();
        for (k, delay) in self.delays.iter().enumerate() {
            let Delayed::State(i) = delay.of else { continue };
            let g = &mut model.graph;
            let (now, rate) = (g.leaf(Leaf::State(i)), self.rates[i]);
            let lag = g.mul(delay.tau, rate);
            let then = g.sub(now, lag);
            with.insert(Leaf::Delayed(k), then);
            let nothing = g.c(0.0);
            model.delays[k] = Delay { of: Delayed::Input(0), tau: nothing };
        }
        model.replace(&with);
        model
    }
}
