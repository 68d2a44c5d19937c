//! A case in; both sides of the equations that its measurements allow, as a least-squares problem
//! (equation error), out.
//!
//! The equation of a measured state is `d x/dt = f(x, u, theta)`. Both sides are seen through one
//! filter: the derivative filter of Savitzky and Golay acts on the measured state and on the
//! integral of `f` at the measured states, as they are, so that without noise both sides are the same
//! but for the trapezoidal rule, whatever the window. (States that are smoothed before `f` lack what
//! inputs still have: that was taken up by the derivatives.) A measured output that is not a state
//! gives `z = h(x, u, theta)` at the same points, both sides smoothed where `h` has states. Nothing is
//! integrated over time.

use super::case::Case;
use super::sampled::{Filters, Sampled, prepare, run};
use super::sides::{Considered, Seen, Side, sides};
use super::{Settings, Trace};
use crate::dynamics::Numbers;
use crate::error::Result;
use crate::least_squares::{Block, Evaluate, Layout, Structure};
use crate::model::Program;
use crate::model::linear::{Entry, Linear};
use crate::signal::robust::noise_sd;
use std::collections::{BTreeMap, btree_map};
use std::sync::Arc;

/// The equations of a case over its segments.
pub(super) struct Problem<'a> {
    pub case: &'a Case,
    rates: Program,
    outputs: Program,
    linear: Linear,
    pub sides: Vec<Side>,
    pub segments: Vec<Sampled>,
}

/// What becomes of a parameter of the equations, and of one that none of them has.
pub(super) const ESTIMATED: &str = "estimated";
pub(super) const NOWHERE: &str = "in none of these equations";

/// A variance is never taken smaller than this share of the mean square of the left side.
const ROUNDING: f64 = 1e-20;

impl<'a> Problem<'a> {
    /// The equations of a case that can be used, and all of them by name.
    ///
    /// # Errors
    /// The smoothing cannot be built.
    pub fn new(case: &'a Case, settings: &Settings) -> Result<(Problem<'a>, Vec<Considered>)> {
        let (sides, equations) = sides(case);
        let model = &case.model;
        // Segments of one spacing share their filters.
        let mut filters: BTreeMap<u64, Arc<Filters>> = BTreeMap::new();
        for record in &case.records {
            if let btree_map::Entry::Vacant(place) = filters.entry(record.dt.to_bits()) {
                place.insert(Arc::new(Filters::new(settings.smoothing_s, record.dt)?));
            }
        }
        let of = |s: usize| filters[&case.records[s].dt.to_bits()].clone();
        let segments = (0..case.records.len()).map(|s| prepare(case, &sides, s, of(s))).collect();
        let linear = model.linearize(&case.free(), &case.outputs);
        let (rates, outputs) = (model.rates_program(), model.outputs_program(&case.outputs));
        Ok((Problem { case, rates, outputs, linear, sides, segments }, equations))
    }

    /// The case's parameters with an `R` of the equations, and its priors and groups of segments.
    pub fn layout(&self, settings: &Settings) -> Layout {
        let mut layout = self.case.layout.clone();
        let floor = |(j, side): (usize, &Side)| {
            let sd = match side.is_rate {
                true => 0.0,
                false => {
                    let name = &self.case.model.outputs[side.output].name;
                    settings.floor.get(name).copied().unwrap_or(0.0)
                }
            };
            let left = self.segments.iter().flat_map(|s| &s.left[j]).filter(|l| l.is_finite());
            let (n, square) = left.fold((0.0, 0.0), |(n, sum), l| (n + 1.0, sum + l * l));
            let least = if square > 0.0 { ROUNDING * square / n } else { ROUNDING };
            least.max(sd * sd)
        };
        layout.noise = Structure {
            outputs: self.sides.len(),
            groups: layout.noise.groups,
            full: false,
            floor: self.sides.iter().enumerate().map(floor).collect(),
            known: false,
        };
        layout.parts.iter_mut().for_each(|part| part.instants.clear());
        layout
    }

    /// The case's parameters with one `R` of the equations, without priors: what the data alone say.
    pub fn layout_of_starts(&self) -> Layout {
        let mut layout = self.case.layout.clone();
        layout.noise = Structure {
            outputs: self.sides.len(),
            groups: 1,
            full: false,
            floor: vec![1e-30; self.sides.len()],
            known: false,
        };
        layout.prior_sd.fill(f64::INFINITY);
        for part in &mut layout.parts {
            part.group = 0;
            part.instants.clear();
        }
        layout
    }

    /// Which unknowns are in an equation in use.
    pub fn unreached(&self) -> Vec<&'static str> {
        let reached = |column: usize| {
            self.sides.iter().any(|side| self.entries(side).any(|e| e.column == column))
        };
        let columns: Vec<bool> = (0..self.case.free().len()).map(reached).collect();
        let mut outcome = vec![NOWHERE; self.case.layout.start.len()];
        for part in &self.case.layout.parts {
            let own = part.offset..part.offset + part.own;
            for (i, _) in part
                .shared
                .iter()
                .copied()
                .chain(own)
                .zip(&columns)
                .filter(|(_, reached)| **reached)
            {
                outcome[i] = ESTIMATED;
            }
        }
        outcome
    }

    pub fn entries(&self, side: &Side) -> impl Iterator<Item = &Entry> {
        let (sparse, row) =
            (if side.is_rate { &self.linear.rates } else { &self.linear.outputs }, side.row);
        sparse.parameters.iter().filter(move |e| e.row == row)
    }

    /// All outputs of a program at all points of a segment, `[n][outputs]`.
    pub fn over(&self, program: &Program, s: usize, parameters: &[f64]) -> Vec<f64> {
        run(program, &self.case.model, parameters, &self.segments[s].points)
    }

    /// A column of the right side of segment `s` as the left one is seen.
    pub fn seen(&self, side: &Side, s: usize, column: Vec<f64>) -> Vec<f64> {
        self.segments[s].seen(side, column)
    }

    fn residuals(&self, s: usize, local: &[f64], sensitivities: bool) -> Vec<Block> {
        let (parameters, _) = self.case.place(s, local);
        let nd = self.case.layout.parts[s].directions();
        let sampled = &self.segments[s];
        let values =
            [self.over(&self.rates, s, &parameters), self.over(&self.outputs, s, &parameters)];
        let slopes = sensitivities.then(|| {
            [
                self.over(&self.linear.rates_program, s, &parameters),
                self.over(&self.linear.outputs_program, s, &parameters),
            ]
        });
        let column = |all: &[f64], of: usize, k: usize| -> Vec<f64> {
            all.iter().skip(k).step_by(of.max(1)).copied().collect()
        };
        let mut blocks = Vec::with_capacity(self.sides.len());
        for (equation, side) in self.sides.iter().enumerate() {
            let which = usize::from(!side.is_rate);
            let programs = [
                (&self.rates, &self.linear.rates_program),
                (&self.outputs, &self.linear.outputs_program),
            ];
            let (program, derived) = programs[which];
            let right = self.seen(side, s, column(&values[which], program.outputs(), side.row));
            let e: Vec<f64> =
                sampled.left[equation].iter().zip(&right).map(|(l, r)| l - r).collect();
            let mut g = Vec::new();
            if let Some(slopes) = &slopes {
                g = vec![0.0; sampled.n * nd];
                for entry in self.entries(side) {
                    let seen =
                        self.seen(side, s, column(&slopes[which], derived.outputs(), entry.output));
                    seen.iter().enumerate().for_each(|(k, v)| g[k * nd + entry.column] = *v);
                }
            }
            blocks.push(Block::new(equation, e, g));
        }
        blocks
    }

    /// Standard deviation that the sensor's noise has on the left side, where that is seen through a filter.
    fn noise(&self, s: usize, side: &Side) -> Option<f64> {
        let (record, sampled) = (&self.case.records[s], &self.segments[s]);
        let channel = record.channels.iter().find(|c| c.output == side.output)?;
        let filter = match side.seen() {
            Seen::Rate => &sampled.filters.rate,
            Seen::Smoothed => &sampled.filters.smooth,
            Seen::Raw => return None,
        };
        let variance = sampled.gain(channel.every(record.dt), |noise| filter.apply(&noise));
        Some(noise_sd(&channel.z) * variance.sqrt()).filter(|sd| sd.is_finite())
    }

    /// Both sides of the equations of segment `s` at its points.
    pub fn traces(&self, s: usize, theta: &[f64]) -> Vec<Trace> {
        let (record, sampled) = (&self.case.records[s], &self.segments[s]);
        let t: Numbers =
            (0..sampled.n).map(|k| record.t0 + (k + record.start) as f64 * record.dt).collect();
        let blocks = self.residuals(s, &self.case.layout.local(s, theta), false);
        let trace = |(block, side): (Block, &Side)| {
            let left = &sampled.left[block.output];
            Trace {
                output: side.number(&self.case.model),
                name: side.name.clone(),
                unit: side.unit.clone(),
                t: t.clone(),
                measured: left.clone().into(),
                modelled: left.iter().zip(&block.e).map(|(l, e)| l - e).collect(),
                noise: self.noise(s, side),
                filtered: None,
            }
        };
        blocks.into_iter().zip(&self.sides).map(trace).collect()
    }
}

impl Evaluate for Problem<'_> {
    fn blocks(&self, s: usize, local: &[f64], sensitivities: bool) -> Option<Vec<Block>> {
        Some(self.residuals(s, local, sensitivities))
    }
}
