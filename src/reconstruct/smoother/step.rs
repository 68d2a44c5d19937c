//! A filter's state in; its mean, transition and covariance over a step out.
//!
//! The mean goes by the classic Runge-Kutta, the transition is its exact derivative with respect to
//! states, parameters and (constant over the step) errors of the inputs.

use super::flight::Flight;
use super::kinematics::{Evaluator, Kinematics};
use super::levels::Levels;
use super::matrix::{Size, predict, transition};
use super::state::{About, State};
use crate::math::simd::Aligned;

/// Takes steps: the programs and what they need on the way.
pub struct Stepper<'a> {
    kinematics: &'a Kinematics<'a>,
    size: Size,
    /// The last step, `[D | Gamma]` by columns (see `matrix`), and the variances of the inputs over
    /// it.
    pub step: Aligned,
    pub q: Vec<f64>,
    rates: Evaluator<'a, 1>,
    jacobian: Evaluator<'a, 1>,
    /// What the Jacobian's program says at the four stages.
    entries: Vec<f64>,
    /// Where the entries of the Jacobian stand within one stage of `columns`.
    places: Vec<usize>,
    /// `[A | B]` by columns at the four stages.
    columns: Aligned,
    scratch: Aligned,
    w: Aligned,
    /// Registers at the four stages: states, inputs, their rates, time.
    points: Vec<f64>,
    sum: Vec<f64>,
    /// Where it is linearised, and where that leads to.
    base: Vec<f64>,
    end: Vec<f64>,
}

impl<'a> Stepper<'a> {
    pub fn new(kinematics: &'a Kinematics<'a>, size: Size) -> Stepper<'a> {
        let Size { n, x, y, k, q, .. } = size;
        let place = |&(row, column): &(usize, usize)| {
            (if column < n { column } else { k + column - n }) * y + row
        };
        let places: Vec<usize> = kinematics.jacobian.entries.iter().map(place).collect();
        Stepper {
            step: Aligned::of_zeros(size.step()),
            q: vec![0.0; q],
            rates: Evaluator::new(kinematics.model, &kinematics.rates),
            jacobian: Evaluator::new(kinematics.model, &kinematics.jacobian.program),
            entries: vec![0.0; 4 * kinematics.jacobian.program.outputs()],
            places,
            columns: Aligned::of_zeros(4 * size.step()),
            scratch: Aligned::of_zeros(3 * size.step()),
            w: Aligned::of_zeros(n * y),
            points: vec![0.0; 4 * (kinematics.model.layout.time() + 1)],
            sum: vec![0.0; x],
            base: vec![0.0; n],
            end: vec![0.0; x],
            kinematics,
            size,
        }
    }

    /// Takes `state` (but for its time and place in the signals) over a step of `h` s.
    pub fn step(
        &mut self,
        flight: &Flight,
        levels: &Levels,
        about: Option<&About>,
        state: &mut State,
        h: f64,
    ) {
        let Size { x: nx, n, m, .. } = self.size;
        match about {
            Some(about) => about.at(state, nx, &mut self.base),
            None => self.base.copy_from_slice(&state.x),
        }
        self.rates(flight, state, h);
        self.transition(h);
        if about.is_some() {
            // from where it was linearised, by the transition to where the mean is
            let away = state.x.iter().zip(&self.base).map(|(x, base)| x - base);
            self.end.iter_mut().zip(away.clone()).for_each(|(x, away)| *x += away);
            let columns = self.step.chunks_exact(self.size.y).take(self.size.k);
            for (column, away) in columns.zip(away).filter(|(_, away)| *away != 0.0) {
                self.end.iter_mut().zip(column).for_each(|(x, d)| *x += d * away);
            }
        }
        state.x[..nx].copy_from_slice(&self.end);
        for (i, input) in flight.inputs.iter().enumerate() {
            self.q[i] = flight.density(i, state.clocks[input.clock], levels.density[i]) / h;
        }
        predict(&mut state.p, self.size, &self.step, &self.q, &mut self.w);
        for i in 0..n {
            state.p[i * m + i] += levels.walk[i] * h;
        }
    }

    /// From `self.base` to `self.end`, and the points of the stages on the way.
    fn rates(&mut self, flight: &Flight, state: &State, h: f64) {
        let layout = &self.kinematics.model.layout;
        let width = layout.time() + 1;
        let inputs = |point: &mut [f64], c: f64| {
            let t = state.t + c * h;
            let (u, slope) = point[layout.input()..].split_at_mut(self.size.q);
            flight.inputs_at(t, &state.clocks, u, slope);
            point[layout.time()] = t;
        };
        let (first, others) = self.points.split_at_mut(width);
        let (second, others) = others.split_at_mut(width);
        let (third, fourth) = others.split_at_mut(width);
        inputs(first, 0.0);
        inputs(second, 0.5);
        third.copy_from_slice(second);
        inputs(fourth, 1.0);
        let (base, theta) = self.base.split_at(self.size.x);
        self.end.copy_from_slice(base);
        self.rates.parameters_of_all(&self.kinematics.free, theta);
        self.jacobian.parameters_of_all(&self.kinematics.free, theta);
        let native = self.kinematics.steps.as_deref();
        self.rates.step(native, &mut self.points, &mut self.end, &mut self.sum, h);
    }

    /// The step's columns from the Jacobians at the four stages.
    fn transition(&mut self, h: f64) {
        let derivatives = &self.kinematics.jacobian;
        let points = (&self.points[..], self.kinematics.model.layout.time() + 1);
        self.jacobian.at_each(self.kinematics.slopes.as_deref(), points, &mut self.entries);
        let stages = self.entries.chunks_exact(derivatives.program.outputs());
        for (to, values) in self.columns.chunks_exact_mut(self.size.step()).zip(stages) {
            for (&place, value) in self.places.iter().zip(&values[derivatives.rows..]) {
                to[place] = *value;
            }
        }
        transition(&mut self.step, self.size, &self.columns, &mut self.scratch, h);
    }
}
