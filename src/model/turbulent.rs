//! A model and some of its states in; the same with noise of densities yet to be found that drives the
//! rates of these states, out: white, or noise that lasts for a time yet to be found.

use super::graph::{Leaf, Node};
use super::{Delay, Delayed, Model, Parameter, Quantity, Scope, StartKind, State};
use crate::error::Errors;
use crate::units::simplified;
use std::collections::BTreeMap;

/// Name of the density of the noise that drives a state.
pub fn density_of(state: &str) -> String {
    format!("F_{state}")
}

/// Name of the time for which that noise lasts.
pub fn lasting_of(state: &str) -> String {
    format!("lasts_{state}")
}

/// Noise on the rate of a state, to begin with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Driven {
    pub state: usize,
    /// Root of its spectral density, in the state's unit per root of a second: at all frequencies, or at
    /// those that are slow for noise that lasts.
    pub density: f64,
    /// How long it lasts at least, and to begin with, s; white without.
    pub lasts: Option<[f64; 2]>,
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

    /// With noise on the rates of these states. Where a state is read with a delay, it is taken to first
    /// order, `x(t - tau) = x - tau dx/dt`: a filter does not remember states.
    ///
    /// # Errors
    /// Names of densities and times that are taken.
    pub fn driven_by(&self, by: &[Driven]) -> Result<Model, Errors> {
        let (mut model, mut errors) = (self.without_delayed_states(), Errors::default());
        for driven in by {
            let Quantity { name, unit, .. } = &self.states[driven.state].quantity;
            let density = (density_of(name), simplified(&format!("{unit} s^-0.5")));
            let doc = format!("turbulence in the rate of {name}");
            let density = model.unknown(density, &doc, [0.0, driven.density]);
            let Some(density) = errors.take(density) else { continue };
            let Some(lasts) = driven.lasts else {
                model.states[driven.state].noise = Some(density);
                continue;
            };
            let time = (lasting_of(name), "s".to_string());
            let doc = format!("how long turbulence in the rate of {name} lasts");
            let Some(time) = errors.take(model.unknown(time, &doc, lasts)) else { continue };
            model.lasting((driven.state, name, unit), density, time);
        }
        // Its text does not say so.
        model.recipe = None;
        errors.or(model)
    }

    /// A parameter to be found, from `least` on.
    fn unknown(
        &mut self,
        (name, unit): (String, String),
        doc: &str,
        [least, start]: [f64; 2],
    ) -> crate::error::Result<Node> {
        self.is_new(&name)?;
        self.parameters.push(Parameter {
            quantity: Quantity { name, unit, doc: doc.to_string() },
            start,
            min: least,
            max: f64::INFINITY,
            scope: Scope::Campaign,
            held_in: None,
            fixed: false,
            prior_sd: f64::INFINITY,
        });
        self.layout.parameters += 1;
        Ok(self.graph.leaf(Leaf::Parameter(self.parameters.len() - 1)))
    }

    /// A first-order Markov process on the rate of a state (Gelb 1974, sec. 3.6): `x' = f + n`,
    /// `n' = (F w - n)/T`, white of density `F` for what is slow beside `T`. Its sd is `F/sqrt(2 T)`.
    fn lasting(&mut self, (state, name, unit): (usize, &str, &str), density: Node, time: Node) {
        let g = &mut self.graph;
        let n = g.leaf(Leaf::State(self.states.len()));
        let (zero, half) = (g.c(0.0), g.c(0.5));
        let noise = g.div(density, time);
        let decay = g.div(n, time);
        let rate = g.sub(zero, decay);
        let per = g.div(half, time);
        let per = g.pow(per, 0.5);
        let sd = g.mul(density, per);
        let driven = g.add(self.rates[state], n);
        self.rates[state] = driven;
        self.rates.push(rate);
        self.layout.states += 1;
        self.states.push(State {
            quantity: Quantity {
                name: format!("gust_{name}"),
                unit: simplified(&format!("{unit} s^-1")),
                doc: format!("turbulence in the rate of {name}"),
            },
            start: StartKind::Expression(zero),
            min: None,
            max: None,
            rate_max: None,
            noise: Some(noise),
            start_sd: Some(sd),
            rests: false,
            hidden: true,
        });
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
