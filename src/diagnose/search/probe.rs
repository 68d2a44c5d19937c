//! A model with what candidates add and a place where the base stands in; its residuals and its
//! sensitivities to what is added, out.

use super::ground::Ground;
use crate::diagnose::effect::{Added, Candidate};
use crate::dynamics::{Channel, Directions, Propagator, Record, Tier};
use crate::error::Errors;
use crate::estimate::{self, Block, Case};
use crate::model::{Delayed, Model, StartKind};
use std::borrow::Cow;

/// States, delayed ones besides.
fn dynamics(model: &Model) -> usize {
    model.states.len() + model.delays.iter().filter(|d| matches!(d.of, Delayed::State(_))).count()
}

/// A model with what one candidate or several add, to be run where the base stands.
pub struct Probe {
    propagator: Propagator,
    starts: Vec<f64>,
    /// Per parameter of the candidate's model: its index in the base's.
    base: Vec<Option<usize>>,
    /// Per state that needs a start value: its place among the base's.
    given: Vec<Option<usize>>,
    /// Index of each added parameter in the candidate's model.
    added: Vec<usize>,
    /// Directions of the propagator: indices into `added`.
    pub sizes: Vec<usize>,
    /// Per added parameter what it is; sizes with steps are tried at them.
    of: Vec<Added>,
    /// It has more states, or more of them delayed, than the base.
    adds_dynamics: bool,
}

impl Probe {
    /// # Errors
    /// The candidate's model does not fit the settings of the base's estimation.
    pub fn new(candidate: &Candidate, ground: &Ground) -> Result<Probe, Errors> {
        Probe::of(&candidate.model, candidate.added.clone(), ground)
    }

    /// The same of a model with all these parameters added.
    ///
    /// # Errors
    /// As `new`.
    pub fn of(model: &Model, of: Vec<Added>, ground: &Ground) -> Result<Probe, Errors> {
        let model = estimate::extended(model, ground.method)?.into_owned();
        let added: Vec<usize> = of.iter().filter_map(|a| model.parameter(&a.name)).collect();
        let sizes: Vec<usize> = (0..of.len()).filter(|&i| of[i].null.is_some()).collect();
        let case = ground.case;
        let index = |name: &str| case.model.parameter(name);
        // Free initial states need no directions here, only a place for their values: those that
        // start measured have one anyway.
        let names =
            case.propagator.directions.starts.iter().map(|&i| &case.model.states[i].quantity.name);
        let free: Vec<usize> = names
            .filter_map(|name| model.state(name))
            .filter(|&i| model.states[i].start != StartKind::Measured)
            .collect();
        let parameters = sizes.iter().filter_map(|&i| added.get(i).copied()).collect();
        let directions = Directions { parameters, starts: Vec::new() };
        let propagator = Propagator::placed(&model, directions, case.outputs.clone(), &free)?;
        let place = |&state: &usize| {
            let name = &model.states[state].quantity.name;
            case.propagator
                .given()
                .iter()
                .position(|&b| case.model.states[b].quantity.name == *name)
        };
        Ok(Probe {
            given: propagator.given().iter().map(place).collect(),
            base: model.parameters.iter().map(|p| index(&p.quantity.name)).collect(),
            starts: model.parameter_starts(),
            propagator,
            added,
            sizes,
            of,
            adds_dynamics: dynamics(&model) > dynamics(&case.model),
        })
    }

    /// With machine code, where so many runs of all segments are worth it.
    pub fn compiled(mut self, case: &Case, runs: usize) -> Probe {
        let points = case.records.iter().map(|record| record.n).sum();
        self.propagator.compile(Tier::Auto, runs, points);
        self
    }

    /// A base's record with steps as small as states that a candidate adds ask for (a play's end
    /// pushes back within milliseconds), where the user leaves that to the program.
    fn record<'r>(
        &self,
        case: &'r Case,
        s: usize,
        parameters: &[f64],
        given: &[f64],
    ) -> Cow<'r, Record> {
        let base = &case.records[s];
        let steps = if self.adds_dynamics && case.is_automatic(s) {
            self.propagator.substeps(parameters, given, base)
        } else {
            1
        };
        if steps <= base.substeps.max(1) {
            return Cow::Borrowed(base);
        }
        Cow::Owned(Record { substeps: steps, ..base.clone() })
    }

    /// The blocks of segment `s` with the added parameters at `at`, in row `row` of their starts:
    /// residuals, and sensitivities to the sizes.
    pub fn run(&self, ground: &Ground, s: usize, at: &[f64], row: usize) -> Option<Vec<Block>> {
        let case = ground.case;
        let (base, given) = case.place(s, &case.layout.local(s, ground.theta));
        let mut parameters: Vec<f64> = self
            .base
            .iter()
            .zip(&self.starts)
            .map(|(from, start)| from.map_or(*start, |i| base[i]))
            .collect();
        self.added.iter().zip(at).for_each(|(&i, value)| parameters[i] = *value);
        let given: Vec<f64> =
            self.given.iter().map(|from| from.map(|i| given[i])).collect::<Option<_>>()?;
        let respond = |parameters: &[f64], derivatives: bool| {
            let record = self.record(case, s, parameters, &given);
            let response = self.propagator.respond(parameters, &given, &record, derivatives);
            response.finite.then_some(response)
        };
        let mut response = respond(&parameters, true)?;
        let all = self.propagator.directions.len();
        for (k, &size) in self.sizes.iter().enumerate() {
            let Some(step) = self.of[size].step(row) else { continue };
            let mut parameters = parameters.clone();
            parameters[self.added[size]] = step;
            let there = respond(&parameters, false)?;
            for ((g, y), y_step) in response.dy.iter_mut().zip(&response.y).zip(&there.y) {
                for (g, (y, y_step)) in g.chunks_exact_mut(all).zip(y.iter().zip(y_step)) {
                    g[k] = (y_step - y) / (step - at[size]);
                }
            }
        }
        let mut dy = response.dy.into_iter();
        let block = |(channel, mut e): (&Channel, Vec<f64>)| {
            let output = case.outputs.iter().position(|&o| o == channel.output)?;
            // what was predicted becomes the residual
            e.iter_mut()
                .zip(&channel.z)
                .for_each(|(e, z)| *e = if z.is_finite() { z - *e } else { f64::NAN });
            Some(Block::new(output, e, dy.next().unwrap_or_default()))
        };
        case.records[s].channels.iter().zip(response.y).map(block).collect()
    }
}
