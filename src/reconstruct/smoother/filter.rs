//! Logged signals and a state with its covariance in; the same moved through updates and steps,
//! with a tape of what was done, out.

use super::flight::{Flight, SAME};
use super::kinematics::{Derivatives, Evaluator, Kinematics};
use super::levels::Levels;
use super::matrix::{Size, padded};
use super::state::{About, State};
use super::step::Stepper;
use super::tape::{Scalar, Tape};
use crate::math::simd::Aligned;

/// Longest step of the integration, s.
const LONGEST: f64 = 0.05;

/// What becomes of the innovations: called for every scalar, accepted or not, in order.
pub trait Watch {
    /// `t`, and the innovation with its predicted variance.
    fn innovation(&mut self, t: f64, scalar: &Scalar, accepted: bool);
}

impl Watch for () {
    fn innovation(&mut self, _: f64, _: &Scalar, _: bool) {}
}

/// The filter of one flight.
pub struct Filter<'a> {
    pub kinematics: &'a Kinematics<'a>,
    pub flight: &'a Flight,
    pub levels: &'a Levels,
    /// Innovations beyond this many of their standard deviations are rejected.
    pub gate: f64,
    /// End of the run, s.
    pub end: f64,
    pub about: Option<&'a About>,
    pub size: Size,
    pub(super) stepper: Stepper<'a>,
    programs: &'a [Derivatives],
    measured: Vec<Evaluator<'a, 1>>,
    // scratch of the updates
    pub(super) u: Vec<f64>,
    slope: Vec<f64>,
    pub(super) row: Aligned,
    pub(super) kept: Aligned,
    pub(super) gain: Aligned,
    /// `P h`.
    pub(super) ph: Aligned,
    pub(super) prior: Vec<f64>,
    pub(super) at: Vec<f64>,
}

/// One program per channel: its output with the derivatives.
pub fn programs(kinematics: &Kinematics, flight: &Flight) -> Vec<Derivatives> {
    flight.channels.iter().map(|c| kinematics.measured(&[c.output])).collect()
}

impl<'a> Filter<'a> {
    pub fn new(
        kinematics: &'a Kinematics<'a>,
        flight: &'a Flight,
        programs: &'a [Derivatives],
        levels: &'a Levels,
        gate: f64,
        end: f64,
    ) -> Filter<'a> {
        let (n, x, q) = (kinematics.size(), kinematics.states(), kinematics.model.inputs.len());
        let size = Size { n, m: padded(n), x, y: padded(x), k: kinematics.moving, q };
        let row = || Aligned::of_zeros(size.m);
        Filter {
            stepper: Stepper::new(kinematics, size),
            measured: programs
                .iter()
                .map(|d| Evaluator::new(kinematics.model, &d.program))
                .collect(),
            u: vec![0.0; q],
            slope: vec![0.0; q],
            row: row(),
            kept: row(),
            gain: row(),
            ph: row(),
            prior: vec![0.0; n],
            at: vec![0.0; n],
            about: None,
            kinematics,
            flight,
            levels,
            gate,
            end,
            size,
            programs,
        }
    }

    /// The state at time `t` with mean `x` and the start's standard deviations.
    pub fn start(&self, t: f64, x: &[f64]) -> State {
        let mut p = Aligned::of_zeros(self.size.square());
        for (i, sd) in self.levels.start_sd.iter().enumerate() {
            p[i * self.size.m + i] = sd * sd;
        }
        let packets =
            self.flight.packets.iter().map(|p| p.t.partition_point(|&x| x < t - SAME)).collect();
        State { t, x: x.to_vec(), p, clocks: self.flight.locate(t), packets, node: 0 }
    }

    /// One node: the updates at the state's time, then the step to the next time at which something
    /// happens. False at the end, and where the state is no longer finite.
    pub fn node(
        &mut self,
        state: &mut State,
        mut tape: Option<&mut Tape>,
        watch: &mut impl Watch,
    ) -> bool {
        if let Some(tape) = &mut tape {
            tape.first.push(tape.scalars.len());
        }
        self.updates(state, tape.as_deref_mut(), watch);
        if let Some(tape) = &mut tape {
            tape.state(state.t, &state.x, &state.p);
        }
        let h = self.next(state) - state.t;
        let go = state.t < self.end && state.x.iter().all(|v| v.is_finite());
        if go {
            let next = state.t + h;
            self.stepper.step(self.flight, self.levels, self.about, state, h);
            state.t = next;
            state.node += 1;
            self.count(state);
        }
        if let Some(tape) = tape {
            let h = if go { h } else { 0.0 };
            tape.step(self.size, h, &self.stepper.step, &self.stepper.q);
        }
        go
    }

    /// The next time at which a step ends.
    fn next(&self, state: &State) -> f64 {
        let mut next = self.end.min(state.t + LONGEST);
        for (clock, &k) in self.flight.clocks.iter().zip(&state.clocks) {
            if clock.steps && k + 1 < clock.t.len() && clock.t[k + 1] > state.t {
                next = next.min(clock.t[k + 1]);
            }
        }
        for (packet, &k) in self.flight.packets.iter().zip(&state.packets) {
            if k < packet.t.len() && packet.t[k] > state.t {
                next = next.min(packet.t[k]);
            }
        }
        next
    }

    /// Moves the clocks' cursors to the state's time.
    fn count(&self, state: &mut State) {
        for (clock, k) in self.flight.clocks.iter().zip(&mut state.clocks) {
            while *k + 1 < clock.t.len() && clock.t[*k + 1] <= state.t + SAME {
                *k += 1;
            }
        }
    }

    /// All scalar updates at the state's time.
    fn updates(&mut self, state: &mut State, mut tape: Option<&mut Tape>, watch: &mut impl Watch) {
        for (number, packet) in self.flight.packets.iter().enumerate() {
            loop {
                let k = state.packets[number];
                if k >= packet.t.len() || packet.t[k] > state.t + SAME {
                    break;
                }
                state.packets[number] += 1;
                self.flight.inputs_at(state.t, &state.clocks, &mut self.u, &mut self.slope);
                for &channel in &packet.channels {
                    let z = self.flight.channels[channel].z[k];
                    if z.is_finite() && self.levels.r[channel].is_finite() {
                        self.update(state, channel, z, tape.as_deref_mut(), watch);
                    }
                }
            }
        }
    }

    /// Prediction of one channel at `self.at` and its row of derivatives, into `self.row`.
    pub(super) fn predict(&mut self, t: f64, channel: usize) -> f64 {
        let (x, theta) = self.at.split_at(self.size.x);
        let evaluator = &mut self.measured[channel];
        evaluator.point(0, x, &self.u, &self.slope, t);
        evaluator.parameters(0, &self.kinematics.free, theta);
        evaluator.run();
        let d = &self.programs[channel];
        self.row.fill(0.0);
        for (e, &(_, column)) in d.entries.iter().enumerate() {
            self.row[column] = evaluator.get(d.rows + e, 0);
        }
        evaluator.get(0, 0)
    }

    /// Where the row of a channel is not zero.
    pub(super) fn places(&self, channel: usize) -> &'a [usize] {
        &self.programs[channel].columns
    }
}
