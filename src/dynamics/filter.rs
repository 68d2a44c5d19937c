//! A model with a covariance in; what a filter needs of it, and the shapes of what a filter says and
//! leaves for its derivatives, out.

use super::Lost;
use super::history::Past;
use super::propagator::Propagator;
use super::rows::Rows;
use super::values::Chunk;
use crate::model::graph::Leaf;
use crate::model::{Covariance, Model, Program, StartKind};

/// The programs of what is measured, beside those of a propagator for the same model.
#[derive(Debug, Clone)]
pub struct Filter {
    /// States of the motion.
    pub(super) motion: usize,
    /// The state that is the covariance of two states, `[motion][motion]`.
    pub(super) places: Vec<usize>,
    /// Per output of the propagator.
    pub(super) measured: Vec<Measured>,
    /// Per output of the propagator, whether its first sample started a state.
    pub(super) starts: Vec<bool>,
}

/// One output: its value and its slopes with respect to the states it depends on, and the derivatives
/// of all these.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    pub(super) values: Program,
    pub(super) program: Program,
    /// The states.
    pub(super) slopes: Vec<usize>,
    /// Whether each slope changes with states or parameters.
    pub(super) bent: Vec<bool>,
    pub(super) rows: Rows,
    /// The parameter that is the standard deviation of its noise, and its direction, if it is free.
    pub(super) sd: usize,
    pub(super) direction: Option<usize>,
}

/// What one channel says, sample by sample; NaN where it is masked or outside the grid.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Innovation {
    /// `nu/sqrt(s)`
    pub e: Vec<f64>,
    /// What was predicted from all before it.
    pub y: Vec<f64>,
    /// `s`
    pub s: Vec<f64>,
    /// `-dnu/sqrt(s)` and `ds/s`, `[sample][direction]`; empty unless asked for.
    pub dy: Vec<f64>,
    pub ds: Vec<f64>,
}

/// What a filter says of a record.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Innovations {
    /// Per channel of the record.
    pub channels: Vec<Innovation>,
    /// Why it was given up, where it was.
    pub lost: Option<Lost>,
}

impl Filter {
    /// The filter of a model that has a covariance; none for another one.
    pub fn new(model: &Model, propagator: &Propagator) -> Option<Filter> {
        let covariance = model.covariance.as_ref()?;
        let motion = covariance.motion;
        let of = |&output: &usize| measured(model, covariance, propagator, output);
        let measured = propagator.outputs.iter().map(of).collect::<Option<Vec<Measured>>>()?;
        let starts = propagator.outputs.iter().map(|&output| {
            let state = model.state(&model.outputs[output].name);
            state.is_some_and(|i| {
                model.states[i].start == StartKind::Measured
                    && !propagator.directions.starts.contains(&i)
            })
        });
        let places = (0..motion * motion).map(|k| covariance.place(k / motion, k % motion));
        Some(Filter { starts: starts.collect(), places: places.collect(), motion, measured })
    }
}

/// An output of the model, to be taken by a filter.
fn measured(
    model: &Model,
    covariance: &Covariance,
    propagator: &Propagator,
    output: usize,
) -> Option<Measured> {
    let free = &propagator.directions.parameters;
    let mut g = model.graph.clone();
    let y = model.output_nodes[output];
    let leaves = g.leaves(&[y]);
    let slopes: Vec<usize> =
        (0..covariance.motion).filter(|i| leaves.contains(&Leaf::State(*i))).collect();
    let mut nodes = vec![y];
    nodes.extend(slopes.iter().map(|&i| g.derivative(y, Leaf::State(i))));
    let values = Program::lower(&g, &nodes, &model.layout);
    let (derivatives, program) = model.differentiated(&mut g, &nodes, free);
    let lists = [&derivatives.states, &derivatives.parameters, &derivatives.delayed];
    let bent = |row: usize| lists.iter().any(|list| list.iter().any(|e| e.row == row));
    let (states, lanes) = (model.layout.states, propagator.directions.lanes());
    let sd = covariance.sd[output]?;
    Some(Measured {
        bent: (1..nodes.len()).map(bent).collect(),
        rows: Rows::new(&derivatives, &program, nodes.len(), states, lanes),
        direction: free.iter().position(|&p| p == sd),
        values,
        program,
        slopes,
        sd,
    })
}

impl Innovation {
    pub(super) fn of(samples: usize, nd: usize) -> Innovation {
        let nothing = || vec![f64::NAN; samples];
        let rows = || vec![0.0; samples * nd];
        Innovation { e: nothing(), y: nothing(), s: nothing(), dy: rows(), ds: rows() }
    }
}

/// What a filter's way leaves for its derivatives.
#[derive(Default)]
pub(super) struct Way {
    /// Arguments of all stages, how their delayed values were read, lengths of steps.
    pub chunk: Chunk,
    pub taken: Vec<Taken>,
    /// Per output the arguments at its samples, rows of the layout's width.
    pub points: Vec<Vec<f64>>,
    /// Per sample taken: states before it, slopes, gains and covariances with the motion, and how its
    /// delayed values were read.
    pub x: Vec<f64>,
    pub c: Vec<f64>,
    pub h: Vec<f64>,
    pub gain: Vec<f64>,
    pub pasts: Vec<Past>,
}

/// A sample that was taken.
pub(super) struct Taken {
    /// Steps of the chunk before it.
    pub after: usize,
    /// Place among the outputs, and among the points of that output.
    pub output: usize,
    pub point: usize,
    pub channel: usize,
    pub at: usize,
    pub nu: f64,
    pub s: f64,
}

impl Way {
    pub(super) fn clear(&mut self) {
        self.chunk.clear();
        self.taken.clear();
        self.points.iter_mut().for_each(Vec::clear);
        for list in [&mut self.x, &mut self.c, &mut self.h, &mut self.gain] {
            list.clear();
        }
        self.pasts.clear();
    }
}
