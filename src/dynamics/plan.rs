//! The compiled programs of one model for one choice of free directions, ready to run over any number of records.

use super::propagate;
use super::record::{Sampling, Weights};
use super::rows::Rows;
use super::stiffness;
use super::{Grid, Record, Response};
use crate::error::{Error, Result};
use crate::math::pool;
use crate::model::linear::{Linear, Starts};
use crate::model::native::{Native, Points, Steps};
use crate::model::{Layout, Model, Program, StartKind, Tables};
use std::sync::Arc;

/// Free directions: the columns of the sensitivities, parameters first.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Directions {
    /// Indices of parameters.
    pub parameters: Vec<usize>,
    /// Indices of states whose start value is free, ascending.
    pub starts: Vec<usize>,
}

impl Directions {
    pub fn len(&self) -> usize {
        self.parameters.len() + self.starts.len()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Their number, padded to whole vectors of eight.
    pub(super) fn lanes(&self) -> usize {
        self.len().div_ceil(8) * 8
    }
}

/// How the rates of a model are evaluated. The results are the same to the bit.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Tier {
    /// Machine code where the work is worth making it.
    #[default]
    Auto,
    Interpreter,
    Native,
}

/// The rates as machine code: whole steps of a plain model, single points of others.
#[derive(Debug)]
pub(super) enum Compiled {
    Steps(Native<Steps>),
    Points(Native<Points>),
}

/// Programs and sizes, shared by all records and threads.
#[derive(Debug, Clone)]
pub struct Plan {
    pub directions: Directions,
    /// The outputs of the model that are computed: the columns of a grid, in this order.
    pub outputs: Vec<usize>,
    pub(super) layout: Layout,
    pub(super) tables: Tables,
    pub(super) rates: Program,
    pub(super) output_values: Program,
    pub(super) delay_values: Program,
    pub(super) limits: Program,
    pub(super) limited: Vec<usize>,
    pub(super) delays: Vec<crate::model::Delay>,
    pub(super) uses_input_rates: bool,
    pub(super) linear: Linear,
    /// Machine code of the rates, where it was worth making.
    pub(super) native: Option<Arc<Compiled>>,
    /// The Jacobians of rates, outputs and delay times, row by row.
    pub(super) rate_rows: Rows,
    pub(super) output_rows: Rows,
    pub(super) delay_rows: Rows,
    pub(super) starts: Starts,
    /// Per given start: how it begins, and the output that measures it.
    begin: Vec<(StartKind, Option<usize>, String)>,
}

impl Plan {
    /// Lowers a model for the given free directions, with all its outputs.
    ///
    /// # Errors
    /// Start values that depend on each other.
    pub fn new(model: &Model, directions: Directions) -> Result<Plan> {
        Plan::of_outputs(model, directions, (0..model.outputs.len()).collect())
    }

    /// The same with the given outputs only (indices): what is not scored need not be computed.
    ///
    /// # Errors
    /// As `new`.
    pub fn of_outputs(model: &Model, directions: Directions, outputs: Vec<usize>) -> Result<Plan> {
        let starts = model.starts(&directions.starts, &directions.parameters)?;
        let begin = starts.given.iter().map(|&i| {
            let name = &model.states[i].quantity.name;
            (model.states[i].start, model.output(name), name.clone())
        });
        let nodes: Vec<_> = model.rates.iter().chain(&model.output_nodes).copied().collect();
        let leaves = model.graph.leaves(&nodes);
        let linear = model.linearize(&directions.parameters, &outputs);
        let (lanes, nx) = (directions.lanes(), model.states.len());
        Ok(Plan {
            rate_rows: Rows::new(&linear.rates, &linear.rates_program, nx, nx, lanes),
            output_rows: Rows::new(&linear.outputs, &linear.outputs_program, outputs.len(), nx, lanes),
            delay_rows: Rows::new(&linear.delays, &linear.delays_program, model.delays.len(), nx, lanes),
            linear,
            native: None,
            layout: model.layout,
            tables: model.tables.clone(),
            rates: model.rates_program(),
            output_values: model.outputs_program(&outputs),
            delay_values: model.delays_program(),
            limits: model.limits_program(),
            limited: (0..model.states.len()).filter(|&i| model.states[i].min.is_some() || model.states[i].max.is_some()).collect(),
            delays: model.delays.clone(),
            uses_input_rates: leaves.iter().any(|l| matches!(l, crate::model::graph::Leaf::InputRate(_))),
            outputs,
            begin: begin.collect(),
            starts,
            directions,
        })
    }

    /// Makes machine code of the rates if `tier` says so. `points`: grid points that one pass goes through.
    pub fn compile(&mut self, tier: Tier, points: usize) {
        // An operation costs the interpreter about 2 ns more than machine code, some 20 passes are usual; making code takes about 0.3 ms
        // and 15 us per operation.
        let operations = self.rates.operations() as f64;
        let worth = 20.0 * 4.0 * points as f64 * operations * 2e-9 > 0.3e-3 + 15e-6 * operations;
        if tier == Tier::Native || (tier == Tier::Auto && worth) {
            let width = self.layout.time() + 1;
            let compiled = match self.plain() {
                true => Native::compile(&self.rates, width).map(Compiled::Steps),
                false => Native::compile(&self.rates, width).map(Compiled::Points),
            };
            self.native = compiled.map(Arc::new);
        }
    }

    /// Whether a step is nothing but rates: without delays and stops.
    pub(super) fn plain(&self) -> bool {
        self.delays.is_empty() && self.limited.is_empty()
    }

    /// States that need a start value from outside: those that start "measured" and the free ones, ascending.
    pub fn given(&self) -> &[usize] {
        &self.starts.given
    }

    /// Start values for the `given` states of one record: the first measured value, or what the model says.
    ///
    /// # Errors
    /// A state starts "measured" and the record has no finite sample of its output.
    pub fn first_values(&self, model: &Model, parameters: &[f64], record: &Record) -> Result<Vec<f64>> {
        self.first_values_of(model, parameters, record, record)
    }

    /// The same with the first measured values of another record.
    ///
    /// # Errors
    /// As `first_values`.
    pub fn first_values_of(&self, model: &Model, parameters: &[f64], record: &Record, first: &Record) -> Result<Vec<f64>> {
        let mut values = Vec::with_capacity(self.begin.len());
        let free: Vec<usize> = Vec::new();
        let natural = model.starts(&[], &free)?;
        let measured: Vec<f64> = natural
            .given
            .iter()
            .map(|&i| {
                let name = &model.states[i].quantity.name;
                model.output(name).and_then(|o| first.first_measured(o)).ok_or_else(|| {
                    Error::new(format!(
                        "state \"{name}\" starts at its first measured value, but there is no measured output \"{name}\""
                    ))
                    .help("map a measured signal to that output, or give the state a start value")
                })
            })
            .collect::<Result<_>>()?;
        let x = propagate::evaluate_starts(&natural, self.layout, &self.tables, parameters, &measured, record);
        for (&i, _) in self.starts.given.iter().zip(&self.begin) {
            values.push(x[i]);
        }
        Ok(values)
    }

    /// Runs a record. `parameters`: all of the model's; `given`: start values of the `given()` states.
    pub fn run(&self, parameters: &[f64], given: &[f64], record: &Record, sensitivities: bool) -> Grid {
        let (mut grid, rows) = propagate::run(self, parameters, given, record, sensitivities);
        let nd = self.directions.len();
        let point = |k: usize| rows.iter().flat_map(move |row| row[k * nd..(k + 1) * nd].iter().copied());
        if sensitivities {
            grid.dy = (0..grid.n).flat_map(point).collect();
        }
        grid
    }

    /// Integration steps per grid step that the model's Jacobian asks for at the start of a record (and at its inputs' extremes).
    pub fn substeps(&self, parameters: &[f64], given: &[f64], record: &Record) -> usize {
        stiffness::substeps(self, parameters, given, record)
    }

    /// Runs a record and reads the predictions at the samples of its channels.
    pub fn respond(&self, parameters: &[f64], given: &[f64], record: &Record, sensitivities: bool) -> Response {
        self.respond_at(parameters, given, record, &record.sampling(), sensitivities)
    }

    /// The same where the record's `sampling()` is known already.
    pub fn respond_at(
        &self,
        parameters: &[f64],
        given: &[f64],
        record: &Record,
        sampling: &[Sampling],
        sensitivities: bool,
    ) -> Response {
        let (grid, mut rows) = propagate::run(self, parameters, given, record, sensitivities);
        let (ny, nd) = (self.outputs.len(), self.directions.len());
        let mut out = Response { finite: grid.finite, ..Default::default() };
        for (i, (channel, sampling)) in record.channels.iter().zip(sampling).enumerate() {
            let Some(column) = self.outputs.iter().position(|&k| k == channel.output) else {
                out.y.push(vec![f64::NAN; channel.t.len()]);
                out.dy.extend(sensitivities.then(|| vec![0.0; channel.t.len() * nd]));
                continue;
            };
            let y = |point: usize| grid.y[point * ny + column];
            let mut values = pool::take(channel.t.len());
            match sampling {
                Sampling::Grid => values.iter_mut().enumerate().for_each(|(k, v)| *v = y(k)),
                Sampling::Between(weights) => {
                    values.iter_mut().zip(weights).for_each(|(v, w)| *v = w.as_ref().map_or(f64::NAN, |w| w.value(y)));
                }
            }
            out.y.push(values);
            if sensitivities {
                let again = record.channels[i + 1..].iter().any(|c| c.output == channel.output);
                out.dy.push(match sampling {
                    Sampling::Grid if again => rows[column].clone(),
                    Sampling::Grid => std::mem::take(&mut rows[column]),
                    Sampling::Between(weights) => weights.iter().flat_map(|w| between(w.as_ref(), &rows[column], nd)).collect(),
                });
            }
        }
        pool::give(grid.y);
        out
    }
}

/// Sensitivities at one sample; zero outside the grid.
fn between(weights: Option<&Weights>, rows: &[f64], nd: usize) -> Vec<f64> {
    let mut out = vec![0.0; nd];
    if let Some(w) = weights {
        for k in 0..w.len {
            let row = &rows[(w.first + k) * nd..(w.first + k + 1) * nd];
            out.iter_mut().zip(row).for_each(|(d, g)| *d += w.w[k] * g);
        }
    }
    out
}
