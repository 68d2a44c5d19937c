//! The compiled programs of one model for one choice of free directions, ready to run over any number of records.

use super::propagate;
use super::{Grid, Record, Response};
use crate::error::{Error, Result};
use crate::model::linear::{Linear, Starts};
use crate::model::{Layout, Model, Program, StartKind, Tables};

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
        Ok(Plan {
            layout: model.layout,
            tables: model.tables.clone(),
            rates: model.rates_program(),
            output_values: model.outputs_program(&outputs),
            delay_values: model.delays_program(),
            limits: model.limits_program(),
            limited: (0..model.states.len()).filter(|&i| model.states[i].min.is_some() || model.states[i].max.is_some()).collect(),
            delays: model.delays.clone(),
            uses_input_rates: leaves.iter().any(|l| matches!(l, crate::model::graph::Leaf::InputRate(_))),
            linear: model.linearize(&directions.parameters, &outputs),
            outputs,
            begin: begin.collect(),
            starts,
            directions,
        })
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
        propagate::run(self, parameters, given, record, sensitivities)
    }

    /// Integration steps per grid step that the model's Jacobian asks for at the start of a record (and at its inputs' extremes).
    pub fn substeps(&self, parameters: &[f64], given: &[f64], record: &Record) -> usize {
        propagate::substeps(self, parameters, given, record)
    }

    /// Runs a record and reads the predictions at the samples of its channels.
    pub fn respond(&self, parameters: &[f64], given: &[f64], record: &Record, sensitivities: bool) -> Response {
        let grid = self.run(parameters, given, record, sensitivities);
        let (ny, nd) = (self.outputs.len(), self.directions.len());
        let mut out = Response { finite: grid.finite, ..Default::default() };
        for channel in &record.channels {
            let column = self.outputs.iter().position(|&k| k == channel.output);
            let mut y = Vec::with_capacity(channel.t.len());
            let mut dy = vec![0.0; if sensitivities { channel.t.len() * nd } else { 0 }];
            for (s, &t) in channel.t.iter().enumerate() {
                let (Some(w), Some(column)) = (record.weights(t), column) else {
                    y.push(f64::NAN);
                    continue;
                };
                let mut value = 0.0;
                for k in 0..w.len {
                    let row = (w.first + k) * ny + column;
                    value += w.w[k] * grid.y[row];
                    if sensitivities {
                        for (d, g) in dy[s * nd..(s + 1) * nd].iter_mut().zip(&grid.dy[row * nd..(row + 1) * nd]) {
                            *d += w.w[k] * g;
                        }
                    }
                }
                y.push(value);
            }
            out.y.push(y);
            if sensitivities {
                out.dy.push(dy);
            }
        }
        out
    }
}
