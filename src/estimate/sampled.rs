//! A segment of a case in; its grid with what was measured of states, inputs and past values, and the left
//! sides of the equations, out.
//!
//! Nothing here depends on the parameters but what an output adds to its state, and delay times: these are
//! taken at the starting values.

use super::case::Case;
use super::sides::{Seen, Side, is_itself, measured};
use crate::dynamics::{self, Record};
use crate::error::Result;
use crate::model::{Delayed, Model, Program};
use crate::signal::resample::{Grid, linear};
use crate::signal::smooth::SavitzkyGolay;
use std::sync::Arc;

const ORDER: usize = 3;

/// Passes over what an output adds to its state: of a tenth of it a millionth is left.
const PASSES: usize = 6;

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
    pub fn new(smoothing_s: f64, dt: f64) -> Result<Filters> {
        let window = (((smoothing_s / dt / 2.0).round() as usize).max(2) * 2) + 1;
        let filter = |derivative| SavitzkyGolay::new(window, ORDER, derivative, dt);
        Ok(Filters { smooth: filter(0)?, rate: filter(1)? })
    }
}

/// What was measured of an output on the grid: straight lines between samples, none where one of
/// the two is masked.
fn on_grid(record: &Record, output: usize, first: usize) -> Vec<f64> {
    let channel = record.channels.iter().find(|c| c.output == output);
    let n = record.n.saturating_sub(first);
    let grid = Grid { t0: record.t0 + first as f64 * record.dt, dt: record.dt, n };
    channel.map_or_else(|| vec![f64::NAN; n], |c| linear(&c.t, &c.z, &grid, f64::INFINITY))
}

pub(super) fn prepare(case: &Case, sides: &[Side], s: usize, filters: Arc<Filters>) -> Sampled {
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
pub(super) fn run(
    program: &Program,
    model: &Model,
    parameters: &[f64],
    points: &[f64],
) -> Vec<f64> {
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

impl Sampled {
    /// The variance of white noise of unit variance once it is `seen`, the mean over grid points. What is
    /// measured has a sample `every` so many of them, and straight lines between: one sample is a triangle.
    pub fn gain(&self, every: usize, seen: impl Fn(Vec<f64>) -> Vec<f64>) -> f64 {
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
    pub fn seen(&self, side: &Side, column: Vec<f64>) -> Vec<f64> {
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
