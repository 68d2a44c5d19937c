//! A model and the segments used in; the least-squares problem over them out: its unknowns
//! (`unknowns.rs`), what it knows of every segment, and its residuals (`residuals.rs`).

use super::choice::Chosen;
use super::segment::Segment;
use super::unknowns::{Unknown, Unknowns};
use super::{Line, Settings};
use crate::dynamics::{Directions, Filter, Lost, Propagator, Record};
use crate::error::Result;
use crate::least_squares::{Layout, Part};
use crate::model::Model;
use crate::model::graph::Leaf;
use indexmap::IndexSet;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// Passes over the records that an estimation usually makes.
pub(super) const PASSES: usize = 20;

/// A propagator with fewer directions, made when it is first asked for; none where the model has none.
pub(super) type Narrow = Arc<OnceLock<Option<Propagator>>>;

/// The segments that are used together.
#[derive(Clone)]
pub struct Case {
    pub model: Arc<Model>,
    pub(super) chosen: Arc<Chosen>,
    pub propagator: Arc<Propagator>,
    /// The same with the directions of what belongs to a segment alone.
    pub(super) narrow: Narrow,
    /// Of a model whose states are driven by noise.
    pub(super) filter: Option<Filter>,
    pub records: Vec<Record>,
    /// Which of them ask for integration steps by the model's fastest mode.
    automatic: Vec<bool>,
    /// Start values of the states that need one from outside, per segment.
    pub given: Vec<Vec<f64>>,
    /// Per segment how far its conditions are from the centres of the lines that parameters follow.
    pub(super) away: Vec<Vec<f64>>,
    /// Where all segments say of which flight they are: the flights, and for each segment which of them it is.
    pub(super) flights: Vec<String>,
    pub(super) flight_of: Vec<usize>,
    /// Scored outputs of the model.
    pub outputs: Vec<usize>,
    pub layout: Layout,
    /// In the order of the parameter vector.
    pub unknowns: Vec<Unknown>,
}

impl Case {
    /// `given`: start values of the states that the propagator wants from outside, per segment.
    pub fn new(
        model: Arc<Model>,
        chosen: Arc<Chosen>,
        propagator: Arc<Propagator>,
        segments: &[&Segment],
        given: Vec<Vec<f64>>,
        settings: &Settings,
    ) -> Case {
        let records: Vec<Record> = segments.iter().map(|s| s.scored()).collect();
        let automatic = records.iter().map(|r| r.substeps == 0).collect();
        let outputs = propagator.outputs.clone();
        let of = (&*model, &*chosen, &*propagator);
        let Unknowns { layout, all: unknowns } =
            Unknowns::new(of, (segments, &records), settings, &given);
        let away = |s: &&Segment| {
            let of = |(_, line): &(usize, Line)| {
                s.conditions.get(&line.against).map_or(f64::NAN, |x| x - line.centre)
            };
            chosen.lines.iter().map(of).collect()
        };
        let away = segments.iter().map(away).collect();
        let (flights, flight_of) = flights(segments);
        let mut case = Case {
            filter: Filter::new(&model, &propagator),
            model,
            chosen,
            propagator,
            narrow: Narrow::default(),
            records,
            automatic,
            given,
            away,
            flights,
            flight_of,
            outputs,
            layout,
            unknowns,
        };
        case.layout.squares = case.squares();
        case
    }

    /// Whether noise drives its states.
    pub(super) fn is_filtered(&self) -> bool {
        self.filter.is_some()
    }

    /// Free parameters of the model, in the order of a segment's directions.
    pub fn free(&self) -> Vec<usize> {
        self.chosen.shared.iter().chain(&self.chosen.own).copied().collect()
    }

    /// Places of parameters that are one and the same of different segments, where the model has
    /// friction: then the cost of a segment has several minima.
    pub fn alike(&self) -> Vec<Vec<usize>> {
        let mut all: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        if !self.model.moving.is_empty() {
            for (i, unknown) in self.unknowns.iter().enumerate() {
                if unknown.segment.is_some() {
                    all.entry(&unknown.name).or_default().push(i);
                }
            }
        }
        all.into_values().collect()
    }

    /// Places of the parameters that are nothing but densities of noise.
    pub fn densities(&self) -> Vec<usize> {
        let Some(covariance) = &self.model.covariance else { return Vec::new() };
        let (model, motion) = (&self.model, covariance.motion);
        let noise: Vec<_> = model.states[..motion].iter().filter_map(|s| s.noise).collect();
        let others = model.rates[..motion].iter().chain(&model.output_nodes).copied();
        let others = model.graph.leaves(&others.collect::<Vec<_>>());
        let of = |name: &str| model.parameter(name).map(Leaf::Parameter);
        let noise = model.graph.leaves(&noise);
        let is = |leaf: Leaf| noise.contains(&leaf) && !others.contains(&leaf);
        (0..self.unknowns.len()).filter(|&i| of(&self.unknowns[i].name).is_some_and(is)).collect()
    }

    /// Places of the parameters that act by their squares: densities, and what the noise of a filter's
    /// measurements is.
    fn squares(&self) -> Vec<usize> {
        let sds = self.model.covariance.iter().flat_map(|c| &c.sd).flatten();
        let names: Vec<&str> =
            sds.map(|&p| self.model.parameters[p].quantity.name.as_str()).collect();
        let sds = (0..self.unknowns.len()).filter(|&i| names.contains(&&*self.unknowns[i].name));
        let mut all: Vec<usize> = sds.chain(self.densities()).collect();
        all.sort_unstable();
        all
    }

    /// The integration steps of every segment.
    pub fn steps(&self) -> Vec<usize> {
        self.records.iter().map(|r| r.substeps).collect()
    }

    /// With these integration steps.
    pub fn with_steps(mut self, steps: &[usize]) -> Case {
        self.records.iter_mut().zip(steps).for_each(|(record, steps)| record.substeps = *steps);
        self
    }

    /// Whether the number of integration steps of segment `s` is left to the program.
    pub fn is_automatic(&self, s: usize) -> bool {
        self.automatic[s]
    }

    /// Raises the integration steps that are left to the program to what the model asks for at
    /// `theta`; whether any rose.
    pub fn stiffen(&mut self, theta: &[f64]) -> bool {
        let mut rose = false;
        for s in 0..self.records.len() {
            if self.automatic[s] {
                let steps = self.substeps(s, theta);
                rose |= steps > self.records[s].substeps;
                self.records[s].substeps = self.records[s].substeps.max(steps);
            }
        }
        rose
    }

    /// Integration steps per step of the grid that the model asks for in segment `s`.
    pub fn substeps(&self, s: usize, theta: &[f64]) -> usize {
        let (parameters, starts) = self.place(s, &self.layout.local(s, theta));
        self.propagator.substeps(&parameters, &starts, &self.records[s])
    }

    /// Why the trajectory of segment `s` is given up, if it is.
    pub fn lost(&self, s: usize, theta: &[f64]) -> Option<Lost> {
        let (parameters, starts) = self.place(s, &self.layout.local(s, theta));
        self.propagator.run(&parameters, &starts, &self.records[s], false).lost
    }

    /// States that friction holds all along segment `s`.
    pub fn stuck(&self, s: usize, theta: &[f64]) -> Vec<usize> {
        let (parameters, starts) = self.place(s, &self.layout.local(s, theta));
        self.propagator.run(&parameters, &starts, &self.records[s], false).stuck
    }

    /// Variance of the noise of output `j` (a place among the scored ones) in segment `s`, where it
    /// is a parameter.
    pub fn noise_variance(&self, j: usize, s: usize, theta: &[f64]) -> Option<f64> {
        let sd = self.model.covariance.as_ref()?.sd[self.outputs[j]]?;
        let (parameters, _) = self.place(s, &self.layout.local(s, theta));
        Some(parameters[sd] * parameters[sd])
    }

    /// A segment's directions back in the model: all parameters, and the start values from outside.
    pub fn place(&self, s: usize, local: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let chosen = &*self.chosen;
        let mut parameters = chosen.parameters.clone();
        let mut starts = self.given[s].clone();
        let mut values = local.iter().copied();
        for (&p, value) in chosen.shared.iter().zip(&mut values) {
            parameters[p] = value;
        }
        for (((at, _), away), slope) in chosen.lines.iter().zip(&self.away[s]).zip(&mut values) {
            parameters[chosen.shared[*at]] += slope * away;
        }
        for (&p, value) in chosen.own.iter().zip(&mut values) {
            parameters[p] = value;
        }
        for (state, start) in self.propagator.given().iter().zip(&mut starts) {
            if chosen.initial.contains(state) {
                *start = values.next().unwrap_or(*start);
            }
        }
        (parameters, starts)
    }

    /// Segments without which the parameters of a combination (indices) would not be: those of its
    /// groups and its own ones.
    pub fn segments_of(&self, parameters: impl Iterator<Item = usize>) -> Vec<usize> {
        let mut found = Vec::new();
        for i in parameters {
            let sees = |part: &Part| {
                part.shared.contains(&i) || (part.offset..part.offset + part.own).contains(&i)
            };
            found.extend((0..self.layout.parts.len()).filter(|&s| sees(&self.layout.parts[s])));
        }
        found.sort_unstable();
        found.dedup();
        found
    }
}

/// The directions of a propagator: as `Case` wants them.
pub fn propagator(model: &Model, chosen: &Chosen, segments: &[Segment]) -> Result<Propagator> {
    let parameters = chosen.shared.iter().chain(&chosen.own).copied().collect();
    let outputs = scored(model, segments);
    Propagator::of_outputs(
        model,
        Directions { parameters, starts: chosen.initial.clone() },
        outputs,
    )
}

/// Model outputs measured in any record, ascending.
fn scored(model: &Model, segments: &[Segment]) -> Vec<usize> {
    let measured =
        |o: usize| segments.iter().any(|s| s.record.channels.iter().any(|c| c.output == o));
    (0..model.outputs.len()).filter(|&o| measured(o)).collect()
}

/// The flights of segments, in the order in which they come, and which of them each is; none where one does not say.
fn flights(segments: &[&Segment]) -> (Vec<String>, Vec<usize>) {
    let names: Option<Vec<&String>> = segments.iter().map(|s| s.labels.get("flight")).collect();
    let all: IndexSet<&String> = names.iter().flatten().copied().collect();
    let of = names.iter().flatten().filter_map(|name| all.get_index_of(*name)).collect();
    (all.into_iter().cloned().collect(), of)
}
