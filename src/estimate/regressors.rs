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
use super::sides::{Considered, Seen, Side, is_itself, measured, sides};
use super::{Settings, Trace};
use crate::dynamics::{self, Numbers, Record};
use crate::error::Result;
use crate::least_squares::{Block, Evaluate, Layout, Structure};
use crate::model::linear::{Entry, Linear};
use crate::model::{Delayed, Model, Program};
use crate::signal::resample::{Grid, linear};
use crate::signal::robust::noise_sd;
use crate::signal::smooth::SavitzkyGolay;
use std::collections::{BTreeMap, btree_map};
use std::sync::Arc;

/// What one segment contributes, independent of the parameters.
pub(super) struct Sampled {
    /// Grid points `[n][width]`: states, inputs and their rates, delayed values, time.
    pub points: Vec<f64>,
    pub n: usize,
    pub dt: f64,
    pub filters: Arc<Filters>,
    /// Per equation the left side; NaN where the equation has no value.
    pub left: Vec<Vec<f64>>,
}

/// What smooths both sides of an output's equation, and of a rate's, on a grid of one spacing.
pub(super) struct Filters {
    pub smooth: SavitzkyGolay,
    pub rate: SavitzkyGolay,
}

impl Filters {
    fn new(smoothing_s: f64, dt: f64) -> Result<Filters> {
        let window = (((smoothing_s / dt / 2.0).round() as usize).max(2) * 2) + 1;
        let filter = |derivative| SavitzkyGolay::new(window, ORDER, derivative, dt);
        Ok(Filters { smooth: filter(0)?, rate: filter(1)? })
    }
}

/// The equations of a case over its segments.
pub(super) struct Problem<'a> {
    pub case: &'a Case,
    rates: Program,
    outputs: Program,
    linear: Linear,
    pub sides: Vec<Side>,
    pub segments: Vec<Sampled>,
}

const ORDER: usize = 3;

/// Passes over what an output adds to its state: of a tenth of it a millionth is left.
const PASSES: usize = 6;

/// What becomes of a parameter of the equations, and of one that none of them has.
pub(super) const ESTIMATED: &str = "estimated";
pub(super) const NOWHERE: &str = "in none of these equations";

/// A variance is never taken smaller than this share of the mean square of the left side.
const ROUNDING: f64 = 1e-20;

/// What was measured of an output on the grid: straight lines between samples, none where one of
/// the two is masked.
fn on_grid(record: &Record, output: usize, first: usize) -> Vec<f64> {
    let channel = record.channels.iter().find(|c| c.output == output);
    let n = record.n.saturating_sub(first);
    let grid = Grid { t0: record.t0 + first as f64 * record.dt, dt: record.dt, n };
    channel.map_or_else(|| vec![f64::NAN; n], |c| linear(&c.t, &c.z, &grid, f64::INFINITY))
}

fn prepare(case: &Case, sides: &[Side], s: usize, filters: Arc<Filters>) -> Sampled {
    let (model, record) = (&case.model, &case.records[s]);
    let (first, dt) = (record.start, record.dt);
    let n = record.n.saturating_sub(first);
    let (parameters, _) = case.place(s, &case.layout.local(s, &case.layout.start));
    let grid = OnGrid { model, record, n, taus: delays(model, &parameters) };
    let seen: Vec<Vec<f64>> = (0..model.states.len())
        .map(|i| {
            measured(case, i)
                .map_or_else(|| vec![f64::NAN; n], |output| on_grid(record, output, first))
        })
        .collect();
    let (states, points) = grid.states(case, seen, &parameters);
    let left = sides.iter().map(|side| {
        let known = |k: usize| side.states.iter().all(|&i| states[i][k].is_finite());
        let z = match side.is_rate {
            true => states[side.row].clone(),
            false => on_grid(record, side.output, first),
        };
        let z: Vec<f64> =
            z.into_iter().enumerate().map(|(k, z)| if known(k) { z } else { f64::NAN }).collect();
        match side.seen() {
            Seen::Rate => filters.rate.apply(&z),
            Seen::Smoothed => filters.smooth.apply(&z),
            Seen::Raw => z,
        }
    });
    let left = left.collect();
    Sampled { points, n, dt, filters, left }
}

/// A segment's grid from its first scored point on.
struct OnGrid<'a> {
    model: &'a Model,
    record: &'a Record,
    n: usize,
    /// Times of the delays, s.
    taus: Vec<f64>,
}

impl OnGrid<'_> {
    /// The states that were measured, and the points with them. An output of a state's name that is more than
    /// the state (a vane away from the centre of gravity, a scale) gives the state less what that adds at the
    /// states themselves: `x = z - (h(x, u) - x)`, `PASSES` times, at the starting values of the parameters.
    fn states(
        &self,
        case: &Case,
        seen: Vec<Vec<f64>>,
        parameters: &[f64],
    ) -> (Vec<Vec<f64>>, Vec<f64>) {
        let indirect: Vec<(usize, usize)> = (0..self.model.states.len())
            .filter(|&i| !is_itself(self.model, i))
            .filter_map(|i| Some((i, measured(case, i)?)))
            .collect();
        let outputs: Vec<usize> = indirect.iter().map(|(_, output)| *output).collect();
        let program = self.model.outputs_program(&outputs);
        let mut states = seen.clone();
        let mut points = self.points(&states);
        for _ in 0..if indirect.is_empty() { 0 } else { PASSES } {
            let all = run(&program, self.model, parameters, &points);
            for (place, &(i, _)) in indirect.iter().enumerate() {
                let h = all.iter().skip(place).step_by(outputs.len());
                for ((x, h), z) in states[i].iter_mut().zip(h).zip(&seen[i]) {
                    *x = z - (h - *x);
                }
            }
            points = self.points(&states);
        }
        (states, points)
    }

    /// `[n][width]`
    fn points(&self, states: &[Vec<f64>]) -> Vec<f64> {
        let OnGrid { model, record, n, taus } = self;
        let (l, first, dt) = (model.layout, record.start, record.dt);
        let width = l.time() + 1;
        let mut points = vec![0.0; n * width];
        let input = |k: usize, j: usize| record.inputs[k.min(record.n - 1) * l.inputs + j];
        let without_noise = dynamics::smoothed(
            &model.delays,
            &record.inputs[..record.n * l.inputs],
            l.inputs,
            dt,
            |d| taus[d],
        );
        for k in 0..*n {
            let point = &mut points[k * width..(k + 1) * width];
            states.iter().enumerate().for_each(|(i, x)| point[i] = x[k]);
            for j in 0..l.inputs {
                let (before, after) =
                    ((k + first).saturating_sub(1), (k + first + 1).min(record.n - 1));
                point[l.input() + j] = input(k + first, j);
                point[l.input_rate() + j] =
                    (input(after, j) - input(before, j)) / ((after - before).max(1) as f64 * dt);
            }
            for (d, delay) in model.delays.iter().enumerate() {
                let back = |from: f64, value: &dyn Fn(usize) -> f64| {
                    let at = (from - taus[d] / dt).max(0.0);
                    let (low, part) = (at.floor() as usize, at - at.floor());
                    if part == 0.0 {
                        value(low)
                    } else {
                        (1.0 - part) * value(low) + part * value(low + 1)
                    }
                };
                point[l.delayed() + d] = match delay.of {
                    Delayed::Input(j) => {
                        back((k + first) as f64 - record.behind(j), &|i| input(i, j))
                    }
                    Delayed::Smooth(_) | Delayed::Within(_) | Delayed::Ago(_) => {
                        let of = |d: usize| model.delays.get(d).map(|d| d.of);
                        let ago = Delayed::ago(d, of).map_or(0.0, |at| taus[at] / dt);
                        let smooth = without_noise[d].as_ref();
                        smooth.map_or(0.0, |s| s.at((k + first) as f64 - ago)[0])
                    }
                    Delayed::State(i) => {
                        back(k as f64, &|m| states[i].get(m).copied().unwrap_or(f64::NAN))
                    }
                };
            }
            point[l.time()] = record.t0 + (k + first) as f64 * dt;
        }
        points
    }
}

/// All outputs of a program at these points, `[n][outputs]`.
fn run(program: &Program, model: &Model, parameters: &[f64], points: &[f64]) -> Vec<f64> {
    let mut file = program.registers::<1>();
    parameters.iter().enumerate().for_each(|(p, v)| file[model.layout.parameter() + p] = [*v]);
    program.prepare(&mut file, &model.tables);
    let width = model.layout.time() + 1;
    let mut all = Vec::with_capacity(points.len() / width * program.outputs());
    for point in points.chunks_exact(width) {
        point.iter().zip(&mut file).for_each(|(v, slot)| *slot = [*v]);
        program.run(&mut file, &model.tables);
        all.extend((0..program.outputs()).map(|k| program.output(&file, k)[0]));
    }
    all
}

/// Delay times at these parameters.
fn delays(model: &Model, parameters: &[f64]) -> Vec<f64> {
    let program = model.delays_program();
    let mut file = program.registers::<1>();
    parameters.iter().enumerate().for_each(|(p, v)| file[model.layout.parameter() + p] = [*v]);
    program.prepare(&mut file, &model.tables);
    program.run(&mut file, &model.tables);
    (0..program.outputs()).map(|k| program.output(&file, k)[0]).collect()
}

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

impl Sampled {
    /// The variance of white noise of unit variance once it is `seen`, the mean over grid points. What is
    /// measured has a sample `every` so many of them, and straight lines between: one sample is a triangle.
    fn gain(&self, every: usize, seen: impl Fn(Vec<f64>) -> Vec<f64>) -> f64 {
        let reach = 2 * self.filters.rate.window() + every;
        let triangle = |k: usize| 1.0 - k.abs_diff(reach) as f64 / every as f64;
        let noise = (0..=2 * reach).map(|k| triangle(k).max(0.0)).collect();
        seen(noise).iter().map(|v| v * v).sum::<f64>() / every as f64
    }

    /// The same of noise in a regressor, as the equation sees it.
    pub fn gain_of_regressor(&self, side: &Side, every: usize) -> f64 {
        self.gain(every, |noise| self.seen(side, noise))
    }

    /// A column of the right side as the left one is seen: that of a rate through the derivative filter of
    /// its integral.
    fn seen(&self, side: &Side, column: Vec<f64>) -> Vec<f64> {
        match side.seen() {
            Seen::Rate => self.filters.rate.apply(&integral(&column, self.dt)),
            Seen::Smoothed => self.filters.smooth.apply(&column),
            Seen::Raw => column,
        }
    }
}

/// Running integral by the trapezoidal rule, begun afresh behind values that are not there.
fn integral(f: &[f64], dt: f64) -> Vec<f64> {
    let mut out = Vec::with_capacity(f.len());
    let (mut sum, mut before) = (0.0, f64::NAN);
    for &now in f {
        sum = if now.is_nan() || before.is_nan() { 0.0 } else { sum + 0.5 * dt * (before + now) };
        out.push(if now.is_nan() { f64::NAN } else { sum });
        before = now;
    }
    out
}
