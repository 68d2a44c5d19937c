//! The compiled programs of one model for one choice of free directions, ready to run over any
//! number of records.

use super::rows::Rows;
use super::sweep::{Late, Sweep};
use super::sweep_rows::RowSweep;
use crate::error::Result;
use crate::math::simd::Width;
use crate::model::linear::{Linear, Starts};
use crate::model::machine::{Chain, Lanes, Points};
use crate::model::{Delay, Delayed, Layout, Model, Moving, Program, StartKind, Tables};
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

    /// Their number, padded to whole vectors of eight.
    pub(super) fn lanes(&self) -> usize {
        self.len().div_ceil(8) * 8
    }
}

/// How the rates of a model are evaluated. The results are the same to the bit.
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    serde::Deserialize,
    serde::Serialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Tier {
    /// Machine code where the work is worth making it.
    #[default]
    Auto,
    Interpreter,
    Native,
}

/// A program as machine code: the rates of a plain model in whole steps, others at single points.
#[derive(Debug)]
pub(super) enum Compiled {
    Steps(Chain),
    Points(Points),
}

/// What a trajectory needs point by point as machine code, where it was worth making.
#[derive(Debug, Default)]
pub(super) struct Machine {
    pub(super) rates: Option<Compiled>,
    pub(super) taus: Option<Compiled>,
    pub(super) limits: Option<Compiled>,
    pub(super) moving: Option<Compiled>,
    /// Values of the outputs over lanes of points.
    pub(super) values: Option<Lanes>,
    pub(super) entries: Entries,
    /// S through steps of a model without stops and friction, and the rows of its outputs.
    pub(super) sweep: Option<(Sweep, RowSweep)>,
}

/// Entries of Jacobians over lanes of points.
#[derive(Debug, Default)]
pub(super) struct Entries {
    pub(super) rates: Option<Lanes>,
    pub(super) outputs: Option<Lanes>,
    pub(super) delays: Option<Lanes>,
    pub(super) limits: Option<Lanes>,
    pub(super) moving: Option<Lanes>,
}

/// Programs and sizes, shared by all records and threads.
#[derive(Debug, Clone)]
pub struct Propagator {
    pub directions: Directions,
    /// The outputs of the model that are computed: the columns of a grid, in this order.
    pub outputs: Vec<usize>,
    pub(super) layout: Layout,
    pub(super) tables: Tables,
    pub(super) rates: Program,
    pub(super) output_values: Program,
    pub(super) delay_values: Program,
    pub(super) limits: Program,
    /// Whether they change along a trajectory.
    pub(super) limits_move: bool,
    /// Whether they depend on delayed values.
    pub(super) limits_are_late: bool,
    /// States with limits, level by level, and the ends of the levels (`Model::limited_in_order`).
    pub(super) limited: Vec<usize>,
    pub(super) level_ends: Vec<usize>,
    /// Whether stops that move take some state along no faster than its rate allows.
    pub(super) hurries: bool,
    /// Per state whether it moves where stops take it alone.
    pub(super) rests: Vec<bool>,
    /// Velocities that friction or a stop may hold, and what would move them.
    pub(super) moving: Vec<Moving>,
    pub(super) moving_values: Program,
    pub(super) delays: Vec<Delay>,
    pub(super) uses_input_rates: bool,
    pub(super) linear: Linear,
    pub(super) native: Arc<Machine>,
    /// The Jacobians of rates, outputs, delay times and limits, row by row.
    pub(super) rate_rows: Rows,
    pub(super) output_rows: Rows,
    pub(super) delay_rows: Rows,
    pub(super) limit_rows: Rows,
    pub(super) moving_rows: Rows,
    pub(super) starts: Starts,
    /// Per given start: how it begins, and the output that measures it.
    pub(super) begin: Vec<(StartKind, Option<usize>, String)>,
}

impl Propagator {
    /// Lowers a model for the given free directions, with all its outputs.
    ///
    /// # Errors
    /// Start values that depend on each other.
    pub fn new(model: &Model, directions: Directions) -> Result<Propagator> {
        Propagator::of_outputs(model, directions, (0..model.outputs.len()).collect())
    }

    /// The same with the given outputs only (indices): what is not scored need not be computed.
    ///
    /// # Errors
    /// As `new`.
    pub fn of_outputs(
        model: &Model,
        directions: Directions,
        outputs: Vec<usize>,
    ) -> Result<Propagator> {
        let placed = directions.starts.clone();
        Propagator::placed(model, directions, outputs, &placed)
    }

    /// The same with start values of the states `placed` from outside, of which not all need be
    /// directions.
    ///
    /// # Errors
    /// As `new`.
    pub fn placed(
        model: &Model,
        directions: Directions,
        outputs: Vec<usize>,
        placed: &[usize],
    ) -> Result<Propagator> {
        let starts = model.starts(placed, &directions.parameters)?;
        let begin = starts.given.iter().map(|&i| {
            let name = &model.states[i].quantity.name;
            (model.states[i].start, model.output(name), name.clone())
        });
        let nodes: Vec<_> = model.rates.iter().chain(&model.output_nodes).copied().collect();
        let leaves = model.graph.leaves(&nodes);
        let linear = model.linearize(&directions.parameters, &outputs);
        let (lanes, nx) = (directions.lanes(), model.states.len());
        let (limited, level_ends) = model.limited_in_order();
        Ok(Propagator {
            rate_rows: Rows::new(&linear.rates, &linear.rates_program, nx, nx, lanes),
            output_rows: Rows::new(
                &linear.outputs,
                &linear.outputs_program,
                outputs.len(),
                nx,
                lanes,
            ),
            delay_rows: Rows::new(
                &linear.delays,
                &linear.delays_program,
                model.delays.len(),
                nx,
                lanes,
            ),
            limit_rows: Rows::new(&linear.limits, &linear.limits_program, 3 * nx, nx, lanes),
            moving_rows: Rows::new(
                &linear.moving,
                &linear.moving_program,
                2 * model.moving.len(),
                nx,
                lanes,
            ),
            linear,
            native: Arc::default(),
            layout: model.layout,
            tables: model.tables.clone(),
            rates: model.rates_program(),
            output_values: model.outputs_program(&outputs),
            delay_values: model.delays_program(),
            limits: model.limits_program(),
            limits_move: model.limits_move(),
            moving: model.moving.clone(),
            moving_values: model.moving_program(),
            limits_are_late: model.limits_are_late(),
            limited,
            level_ends,
            rests: model.states.iter().map(|state| state.rests).collect(),
            hurries: (0..nx).any(|i| model.taken_along(i).is_some()),
            delays: model.delays.clone(),
            uses_input_rates: leaves
                .iter()
                .any(|l| matches!(l, crate::model::graph::Leaf::InputRate(_))),
            outputs,
            begin: begin.collect(),
            starts,
            directions,
        })
    }

    /// Makes machine code of rates, delays, limits and what moves the movers if `tier` says so.
    /// `points`: grid points that one of the `passes` goes through.
    pub fn compile(&mut self, tier: Tier, passes: usize, points: usize) {
        // What an operation saves at a grid point, and what its code takes to make, ns (and a code
        // 30 us): four stages number by number, lanes of points, vectors of directions.
        let (at_once, side_by_side, swept) = ([8.0, 1000.0], [0.8, 300.0], [2.0, 1000.0]);
        let worth = |operations: usize, [saved, made]: [f64; 2]| {
            let operations = operations as f64;
            let pays = (passes * points) as f64 * saved * operations > 30e3 + made * operations;
            operations > 0.0 && (tier == Tier::Native || (tier == Tier::Auto && pays))
        };
        let (width, vectors) = (self.layout.time() + 1, Width::detect());
        let at_points = |program: &Program| {
            let code = || Points::compile(program, width, vectors).map(Compiled::Points);
            worth(program.operations(), at_once).then(code).flatten()
        };
        let over_lanes = |program: &Program| {
            let code = || Lanes::compile(program, vectors);
            worth(program.operations(), side_by_side).then(code).flatten()
        };
        let rates = match self.plain() && worth(self.rates.operations(), at_once) {
            true => Chain::compile(&self.rates, width, vectors).map(Compiled::Steps),
            false => at_points(&self.rates),
        };
        let linear = &self.linear;
        let sweep = || {
            let rows = RowSweep::compile(&self.output_rows, self.directions.len(), vectors);
            let kept = self.read_later();
            let late = Late { times: &self.delay_rows, kept: &kept };
            Sweep::compile(&self.rate_rows, (!self.plain()).then_some(late), vectors).zip(rows)
        };
        let sweep = (self.glides() && worth(self.rate_rows.operations(), swept)).then(sweep);
        let entries = || Entries {
            rates: over_lanes(&linear.rates_program),
            outputs: over_lanes(&linear.outputs_program),
            delays: over_lanes(&linear.delays_program),
            limits: over_lanes(&linear.limits_program),
            moving: over_lanes(&linear.moving_program),
        };
        let differentiated = self.directions.len() > 0;
        self.native = Arc::new(Machine {
            values: over_lanes(&self.output_values),
            entries: differentiated.then(entries).unwrap_or_default(),
            sweep: sweep.flatten(),
            rates,
            taus: at_points(&self.delay_values),
            limits: at_points(&self.limits),
            moving: at_points(&self.moving_values),
        });
    }

    /// Whether there is machine code of anything.
    pub fn is_compiled(&self) -> bool {
        self.native.values.is_some() || self.native.rates.is_some()
    }

    /// Whether a step is nothing but rates: without delays, stops and friction.
    pub(super) fn plain(&self) -> bool {
        self.delays.is_empty() && self.limited.is_empty() && self.moving.is_empty()
    }

    /// States that some delay reads, ascending.
    pub(super) fn read_later(&self) -> Vec<usize> {
        let read = |delay: &Delay| match delay.of {
            Delayed::State(i) => Some(i),
            _ => None,
        };
        let mut states: Vec<usize> = self.delays.iter().filter_map(read).collect();
        states.sort_unstable();
        states.dedup();
        states
    }

    /// Whether a step is nothing but rates, of past values too.
    pub(super) fn glides(&self) -> bool {
        let is_past = |delay: &Delay| matches!(delay.of, Delayed::Input(_) | Delayed::State(_));
        self.delays.iter().all(is_past) && self.limited.is_empty() && self.moving.is_empty()
    }

    /// States that need a start value from outside: those that start "measured" and the free ones,
    /// ascending.
    pub fn given(&self) -> &[usize] {
        &self.starts.given
    }
}
