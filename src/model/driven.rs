//! A model whose states are driven by noise in; the same with the covariance of its states as
//! further states, and the measurements' noise as further parameters, out: what a filter integrates.
//!
//! With `dx = f dt + F dw` the covariance of what is not known of the states goes, to first order, by
//!
//! `P' = A P + P A' + F F'`, `A = df/dx` (the extended Kalman filter: Jazwinski 1970)
//!
//! between two measurements. As states of the model its entries are integrated by the same steps as
//! all others, and their derivatives with respect to parameters, those of `A` included, are made by
//! the same compiler. What a delayed value owes to the present state is left out of `A`. A state that
//! follows from inputs and parameters alone, such as a linkage with play or a servo that is
//! commanded, has no covariance, and may have stops.

use super::covariance::{Covariance, Scored, noise_of};
use super::graph::{Leaf, Node};
use super::{Model, Parameter, Quantity, Scope, StartKind, State};
use crate::error::{Error, Errors, Result};

impl Model {
    /// Whether noise drives any state.
    pub fn is_driven(&self) -> bool {
        self.states.iter().any(|s| s.noise.is_some())
    }

    /// The name of a state that noise drives, where none may: those who run a model as it stands draw
    /// no noise.
    ///
    /// # Errors
    /// There is such a state.
    pub fn without_noise(&self, who: &str) -> Result<()> {
        let Some(state) = self.states.iter().find(|s| s.noise.is_some()) else { return Ok(()) };
        let (name, model) = (&state.quantity.name, &self.name);
        let what = format!("noise drives \"{name}\" of model {model}, and {who} does not know it");
        Err(Error::new(what).help("only an [[estimate]] takes it into account, by a filter"))
    }

    /// The outputs that this model scores, as `with_covariance` was asked for them.
    pub fn scored(&self) -> Vec<Scored> {
        let sd = self.covariance.iter().flat_map(|c| c.sd.iter().enumerate());
        let of = |(output, p): (usize, &Option<usize>)| {
            let p = &self.parameters[(*p)?];
            Some(Scored { output, start: p.start, floor: p.min })
        };
        sd.filter_map(of).collect()
    }

    /// With the covariance of its states. `exact`: states whose start is not in doubt, because it is
    /// estimated; one that starts "measured" is as uncertain as that measurement, others are known.
    /// The noise of outputs holds where `scope` says.
    ///
    /// # Errors
    /// Friction, delayed states, and stops of states that are not known for certain, whose
    /// covariance goes by other rules; a name that is taken: all at once.
    pub fn with_covariance(
        &self,
        scored: &[Scored],
        exact: &[usize],
        scope: &Scope,
    ) -> std::result::Result<Model, Errors> {
        let (mut model, mut errors) = (self.clone(), Errors::default());
        let in_doubt = self.in_doubt(exact);
        errors.take(self.takes_noise(&in_doubt));
        let mut sd = vec![None; self.outputs.len()];
        for one in scored {
            sd[one.output] = errors.take(model.add_noise(one, scope));
        }
        errors.or(())?;
        let covariance = Covariance { motion: self.states.len(), sd };
        for i in 0..covariance.motion {
            for j in 0..=i {
                let start = if i == j { model.start_variance(i, exact, &covariance) } else { None };
                let nothing = model.graph.c(0.0);
                let rate = match in_doubt[i] && in_doubt[j] {
                    true => model.covariance_rate(i, j, (&covariance, &in_doubt)),
                    false => nothing,
                };
                model.rates.push(rate);
                model.states.push(covariance_state(&self.states, [i, j], start.unwrap_or(nothing)));
            }
        }
        model.layout.states = model.states.len();
        model.covariance = Some(covariance);
        Ok(model)
    }

    /// Per state whether noise reaches it, or a start that is in doubt: its own, or that of a state
    /// which it moves with. The others follow from inputs and parameters; their covariance is zero.
    fn in_doubt(&self, exact: &[usize]) -> Vec<bool> {
        let starts = |i: usize| {
            let state = &self.states[i];
            let measured = state.start == StartKind::Measured;
            !exact.contains(&i) && (state.start_sd.is_some() || measured)
        };
        let own = |i: usize| self.states[i].noise.is_some() || starts(i);
        let mut doubt: Vec<bool> = (0..self.states.len()).map(own).collect();
        let moves_with: Vec<Vec<usize>> =
            (0..self.states.len()).map(|i| self.moves_with(i)).collect();
        loop {
            let reached = |i: &usize| !doubt[*i] && moves_with[*i].iter().any(|&j| doubt[j]);
            let more: Vec<usize> = (0..doubt.len()).filter(reached).collect();
            if more.is_empty() {
                return doubt;
            }
            more.into_iter().for_each(|i| doubt[i] = true);
        }
    }

    /// The states on which the rate and the stops of a state depend.
    fn moves_with(&self, i: usize) -> Vec<usize> {
        let State { min, max, rate_max, .. } = self.states[i];
        let mut nodes = vec![self.rates[i]];
        nodes.extend([min, max, rate_max].into_iter().flatten());
        let late = |leaf: Leaf| match leaf {
            Leaf::Delayed(k) => Some(self.delays[k].tau),
            _ => None,
        };
        nodes.extend(self.graph.leaves(&nodes).into_iter().filter_map(late));
        let state = |leaf: Leaf| match leaf {
            Leaf::State(j) => Some(j),
            _ => None,
        };
        self.graph.leaves(&nodes).into_iter().filter_map(state).collect()
    }

    fn takes_noise(&self, in_doubt: &[bool]) -> Result<()> {
        let limited = |s: &State| s.min.is_some() || s.max.is_some();
        let reached = (0..self.states.len()).find(|&i| in_doubt[i] && limited(&self.states[i]));
        let name = |i: usize| &self.states[i].quantity.name;
        let late = |d: &super::Delay| matches!(d.of, super::Delayed::State(_));
        let what = match (self.moving.first(), reached) {
            (Some(mover), _) => format!("\"{}\" has a stop or friction", name(mover.velocity)),
            (_, Some(i)) => format!("\"{}\" has a stop, and noise reaches it", name(i)),
            _ if self.delays.iter().any(late) => "a state is read with a delay".to_string(),
            _ => return Ok(()),
        };
        let what = format!("model {} cannot be filtered: {what}", self.name);
        Err(Error::new(what).help(
            "drive such a part of the model by what was measured of it, or leave the noise out",
        ))
    }

    /// Appends the standard deviation of an output's noise.
    fn add_noise(&mut self, one: &Scored, scope: &Scope) -> Result<usize> {
        let output = self.outputs[one.output].clone();
        let name = noise_of(&output.name);
        self.is_new(&name)?;
        let doc = format!("standard deviation of the noise of {}", output.name);
        self.parameters.push(Parameter {
            quantity: Quantity { name, unit: output.unit, doc },
            start: one.start.max(one.floor),
            min: one.floor,
            max: f64::INFINITY,
            scope: scope.clone(),
            held_in: None,
            fixed: false,
            prior_sd: f64::INFINITY,
        });
        self.layout.parameters += 1;
        Ok(self.parameters.len() - 1)
    }

    /// Variance of a state at the start; none is zero.
    fn start_variance(&mut self, i: usize, exact: &[usize], all: &Covariance) -> Option<Node> {
        if exact.contains(&i) {
            return None;
        }
        if let Some(sd) = self.states[i].start_sd {
            return Some(self.graph.mul(sd, sd));
        }
        let measured = self.states[i].start == StartKind::Measured;
        let output = self.output(&self.states[i].quantity.name).filter(|_| measured)?;
        let sd = self.graph.leaf(Leaf::Parameter(all.sd[output]?));
        Some(self.graph.mul(sd, sd))
    }

    /// `(A P + P A' + F F')_ij`; of states that are not in doubt `P` is zero.
    fn covariance_rate(
        &mut self,
        i: usize,
        j: usize,
        (all, in_doubt): (&Covariance, &[bool]),
    ) -> Node {
        let mut rate = self.graph.c(0.0);
        for (row, other) in [(i, j), (j, i)] {
            for k in (0..all.motion).filter(|&k| in_doubt[k]) {
                let slope = self.graph.derivative(self.rates[row], Leaf::State(k));
                let p = self.graph.leaf(Leaf::State(all.place(k, other)));
                rate = self.graph.fma(slope, p, rate);
            }
        }
        match self.states[i].noise.filter(|_| i == j) {
            Some(noise) => self.graph.fma(noise, noise, rate),
            None => rate,
        }
    }
}

fn covariance_state(states: &[State], [i, j]: [usize; 2], start: Node) -> State {
    let [a, b] = [i, j].map(|i| &states[i].quantity);
    State {
        quantity: Quantity {
            name: format!("cov({}, {})", a.name, b.name),
            unit: crate::units::simplified(&format!("({}) ({})", a.unit, b.unit)),
            doc: format!("covariance of {} and {}", a.name, b.name),
        },
        start: StartKind::Expression(start),
        min: None,
        max: None,
        rate_max: None,
        noise: None,
        start_sd: None,
        rests: false,
        hidden: true,
    }
}
