//! Logged signals and a state with its covariance in; the same moved through updates and steps,
//! with a tape of what was done, out.

use super::flight::{Flight, SAME};
use super::kinematics::{Derivatives, Evaluator, Kinematics};
use super::levels::Levels;
use super::matrix::{VECTOR, joseph, multiply, padded, predict, transition};
use crate::dynamics::{AHEAD, WEIGHT};
use crate::math::products::dot_by;

/// Longest step of the integration, s.
const LONGEST: f64 = 0.05;
/// Local iterations of one update at most; they end when the linear prediction holds to a tenth of
/// a standard deviation.
const ITERATIONS: usize = 6;
/// An update whose prior knowledge is better than this share of the measurement's variance is as
/// good as linear.
const SHARP: f64 = 0.25;

/// Where a filter is: time, mean, covariance, and the next sample of everything.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct State {
    pub t: f64,
    /// States, then free parameters.
    pub x: Vec<f64>,
    /// `[n][m]`.
    pub p: Vec<f64>,
    /// The last sample of every clock at or before `t`.
    pub clocks: Vec<usize>,
    /// The next sample of every packet.
    pub packets: Vec<usize>,
    /// Nodes before this one.
    pub node: usize,
}

/// Where a filter linearises; without one it does so where it is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct About {
    /// The smoothed means of an earlier run over the first nodes, `[node][n]`.
    pub means: Vec<f64>,
    /// Beyond those, where the filter knows its states: sensor errors as an earlier run found them,
    /// `[n]` (the states are not read). NaN, or nothing: what the filter has.
    pub known: Vec<f64>,
}

impl About {
    /// The point of linearisation of a filter at `state` with `nx` states.
    fn at(&self, state: &State, nx: usize, out: &mut [f64]) {
        let n = out.len();
        if let Some(means) = self.means.get(state.node * n..(state.node + 1) * n) {
            out.copy_from_slice(means);
            return;
        }
        out.copy_from_slice(&state.x);
        for (x, known) in
            out.iter_mut().zip(&self.known).skip(nx).filter(|(_, known)| known.is_finite())
        {
            *x = *known;
        }
    }
}

/// One scalar update.
#[derive(Debug, Clone, Copy, Default)]
pub struct Scalar {
    pub channel: usize,
    /// Innovation and its variance.
    pub nu: f64,
    pub s: f64,
}

/// What the backward pass needs of a stretch of nodes: flat, refilled for every stretch.
#[derive(Debug, Clone, Default)]
pub struct Tape {
    pub t: Vec<f64>,
    /// `[node][n]`, `[node][n][m]` after the updates.
    pub x: Vec<f64>,
    pub p: Vec<f64>,
    /// Step to the next node: its length, `[nx][lanes]`, variances of the inputs over it.
    pub h: Vec<f64>,
    pub s: Vec<f64>,
    pub q: Vec<f64>,
    /// Index of the first scalar of each node.
    pub first: Vec<usize>,
    pub scalars: Vec<Scalar>,
    /// `[scalar][m]`.
    pub rows: Vec<f64>,
    pub gains: Vec<f64>,
}

impl Tape {
    pub fn clear(&mut self) {
        for list in [
            &mut self.t,
            &mut self.x,
            &mut self.p,
            &mut self.h,
            &mut self.s,
            &mut self.q,
            &mut self.rows,
            &mut self.gains,
        ] {
            list.clear();
        }
        self.first.clear();
        self.scalars.clear();
    }
}

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
    pub n: usize,
    pub m: usize,
    pub lanes: usize,
    rates: Evaluator<'a, 1>,
    jacobian: Evaluator<'a, 4>,
    programs: &'a [Derivatives],
    measured: Vec<Evaluator<'a, 1>>,
    // scratch
    points: [Vec<f64>; 4],
    u: [Vec<f64>; 3],
    slope: [Vec<f64>; 3],
    sum: Vec<f64>,
    s: Vec<f64>,
    stage: Vec<f64>,
    k: Vec<f64>,
    entries: Vec<[f64; 4]>,
    q: Vec<f64>,
    w: Vec<f64>,
    row: Vec<f64>,
    gain: Vec<f64>,
    ph: Vec<f64>,
    prior: Vec<f64>,
    base: Vec<f64>,
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
        let (n, nx, nu) = (kinematics.size(), kinematics.states(), kinematics.model.inputs.len());
        let m = padded(n);
        let lanes = m + padded(nu);
        Filter {
            rates: Evaluator::new(kinematics.model, &kinematics.rates),
            jacobian: Evaluator::new(kinematics.model, &kinematics.jacobian.program),
            measured: programs
                .iter()
                .map(|d| Evaluator::new(kinematics.model, &d.program))
                .collect(),
            points: std::array::from_fn(|_| vec![0.0; nx]),
            u: std::array::from_fn(|_| vec![0.0; nu]),
            slope: std::array::from_fn(|_| vec![0.0; nu]),
            sum: vec![0.0; nx],
            s: vec![0.0; nx * lanes],
            stage: vec![0.0; nx * lanes],
            k: vec![0.0; nx * lanes],
            entries: vec![[0.0; 4]; kinematics.jacobian.entries.len()],
            q: vec![0.0; nu],
            w: vec![0.0; nx * m],
            row: vec![0.0; m],
            gain: vec![0.0; m],
            ph: vec![0.0; m],
            prior: vec![0.0; n],
            base: vec![0.0; m],
            about: None,
            kinematics,
            flight,
            levels,
            gate,
            end,
            n,
            m,
            lanes,
            programs,
        }
    }

    /// Bytes of the tape per node with one update.
    pub fn taped(&self) -> usize {
        let (nx, nu) = (self.kinematics.states(), self.q.len());
        8 * (self.n * (self.m + 1) + nx * self.lanes + nu + 2 * self.m + 6)
    }

    /// The state at time `t` with mean `x` and the start's standard deviations.
    pub fn start(&self, t: f64, x: &[f64]) -> State {
        let mut p = vec![0.0; self.n * self.m];
        for i in 0..self.n {
            p[i * self.m + i] = self.levels.start_sd[i] * self.levels.start_sd[i];
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
        tape: Option<&mut Tape>,
        watch: &mut impl Watch,
    ) -> bool {
        let mut none = Tape::default();
        let taping = tape.is_some();
        let tape = tape.unwrap_or(&mut none);
        if taping {
            tape.first.push(tape.scalars.len());
        }
        self.updates(state, taping.then_some(&mut *tape), watch);
        if taping {
            tape.t.push(state.t);
            tape.x.extend_from_slice(&state.x);
            tape.p.extend_from_slice(&state.p);
        }
        let next = self.next(state);
        let go = state.t < self.end && state.x.iter().all(|v| v.is_finite());
        if go {
            self.step(state, next - state.t);
            state.t = next;
            state.node += 1;
            self.count(state);
        }
        if taping {
            tape.h.push(if go { next - tape.t[tape.t.len() - 1] } else { 0.0 });
            tape.s.extend_from_slice(&self.s);
            tape.q.extend_from_slice(&self.q);
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

    /// Mean, transition and covariance over a step of `h` s: classic Runge-Kutta, and its exact
    /// derivative with respect to states, parameters and (constant over the step) errors of the
    /// inputs.
    fn step(&mut self, state: &mut State, h: f64) {
        let (nx, m, lanes) = (self.kinematics.states(), self.m, self.lanes);
        let free = &self.kinematics.free;
        at(self.about, state, nx, &mut self.base[..self.n]);
        let (base, theta) = self.base[..self.n].split_at(nx);
        for (stage, c) in [0.0, 0.5, 1.0].iter().enumerate() {
            let (u, slope) = (&mut self.u[stage], &mut self.slope[stage]);
            self.flight.inputs_at(state.t + c * h, &state.clocks, u, slope);
        }
        self.rates.parameters(0, free, theta);
        self.points[0].copy_from_slice(base);
        self.sum.fill(0.0);
        for stage in 0..4 {
            let at = [0, 1, 1, 2][stage];
            let time = state.t + [0.0, 0.5, 0.5, 1.0][stage] * h;
            self.rates.point(0, &self.points[stage], &self.u[at], &self.slope[at], time);
            self.jacobian.point(stage, &self.points[stage], &self.u[at], &self.slope[at], time);
            self.jacobian.parameters(stage, free, theta);
            self.rates.run();
            for i in 0..nx {
                let f = self.rates.get(i, 0);
                self.sum[i] += WEIGHT[stage] * f;
                if stage < 3 {
                    self.points[stage + 1][i] = base[i] + AHEAD[stage] * h * f;
                }
            }
        }
        self.jacobian.run();
        self.transition(h);
        // from where it was linearised, then by the transition to where the mean is
        for (x, base) in state.x.iter().zip(&mut self.base) {
            *base = x - *base;
        }
        let away = self.base.iter().any(|d| *d != 0.0);
        for i in 0..nx {
            let from = state.x[i] - self.base[i] + h / 6.0 * self.sum[i];
            self.points[0][i] = from
                + if away {
                    dot_by::<VECTOR>(&self.s[i * lanes..i * lanes + m], &self.base)
                } else {
                    0.0
                };
        }
        state.x[..nx].copy_from_slice(&self.points[0]);
        for (i, input) in self.flight.inputs.iter().enumerate() {
            self.q[i] =
                self.flight.density(i, state.clocks[input.clock], self.levels.density[i]) / h;
        }
        predict(&mut state.p, self.n, m, nx, &self.s, lanes, &self.q, &mut self.w);
        for i in 0..self.n {
            state.p[i * m + i] += self.levels.walk[i] * h;
        }
    }

    /// `s = [Phi | Gamma]` from the Jacobians at the four stages.
    fn transition(&mut self, h: f64) {
        let derivatives = &self.kinematics.jacobian;
        for (e, values) in self.entries.iter_mut().enumerate() {
            *values = self.jacobian.lanes(derivatives.rows + e);
        }
        let (nx, n, m, lanes) = (self.kinematics.states(), self.n, self.m, self.lanes);
        let entries = &derivatives.entries;
        transition(
            &mut self.s,
            &mut self.k,
            &mut self.stage,
            entries,
            &self.entries,
            nx,
            n,
            m,
            lanes,
            h,
        );
    }

    /// All scalar updates at the state's time.
    fn updates(&mut self, state: &mut State, mut tape: Option<&mut Tape>, watch: &mut impl Watch) {
        for number in 0..self.flight.packets.len() {
            loop {
                let packet = &self.flight.packets[number];
                let k = state.packets[number];
                if k >= packet.t.len() || packet.t[k] > state.t + SAME {
                    break;
                }
                state.packets[number] += 1;
                self.flight.inputs_at(state.t, &state.clocks, &mut self.u[0], &mut self.slope[0]);
                for &channel in &packet.channels {
                    let z = self.flight.channels[channel].z[k];
                    if z.is_finite() && self.levels.r[channel].is_finite() {
                        self.update(state, channel, z, tape.as_deref_mut(), watch);
                    }
                }
            }
        }
    }

    /// Prediction of one channel at `x` and its row of derivatives, into `self.row`.
    fn predict(&mut self, x: &[f64], t: f64, channel: usize) -> f64 {
        let nx = self.kinematics.states();
        let evaluator = &mut self.measured[channel];
        evaluator.point(0, &x[..nx], &self.u[0], &self.slope[0], t);
        evaluator.parameters(0, &self.kinematics.free, &x[nx..]);
        evaluator.run();
        let d = &self.programs[channel];
        self.row.fill(0.0);
        for (e, &(_, column)) in d.entries.iter().enumerate() {
            self.row[column] = evaluator.get(d.rows + e, 0);
        }
        evaluator.get(0, 0)
    }

    /// One scalar update, iterated where the prior is wide: the fixed point is the mode of the
    /// posterior (Bell and Cathey 1993).
    #[allow(clippy::too_many_arguments)]
    fn update(
        &mut self,
        state: &mut State,
        channel: usize,
        z: f64,
        tape: Option<&mut Tape>,
        watch: &mut impl Watch,
    ) {
        let (n, m) = (self.n, self.m);
        let r = self.levels.r[channel];
        let angle = self.flight.channels[channel].angle;
        let error = |y: f64| if angle { nearest_turn(z - y) } else { z - y };
        let linear = self.about.is_some();
        at(self.about, state, self.kinematics.states(), &mut self.prior);
        let mut nu = error(self.predict(&self.prior.clone(), state.t, channel));
        if linear {
            nu -= (0..n).map(|i| self.row[i] * (state.x[i] - self.prior[i])).sum::<f64>();
        }
        let mut ph = std::mem::take(&mut self.ph);
        multiply(&state.p, m, &self.row, &mut ph[..n]);
        let mut s = dot_by::<VECTOR>(&ph, &self.row) + r;
        if !(nu.is_finite() && s.is_finite()) {
            self.ph = ph;
            watch.innovation(state.t, &Scalar { channel, nu, s }, false);
            return;
        }
        let accepted = nu * nu <= self.gate * self.gate * s;
        watch.innovation(state.t, &Scalar { channel, nu, s }, accepted);
        if accepted {
            self.prior.copy_from_slice(&state.x);
            for _ in 0..ITERATIONS {
                for i in 0..n {
                    state.x[i] = self.prior[i] + ph[i] / s * nu;
                }
                if linear || s - r <= SHARP * r {
                    break;
                }
                // what the linear prediction says is left, and what is left
                let linear = nu - (s - r) / s * nu;
                let (old_row, old_nu) = (self.row.clone(), nu);
                let left = error(self.predict(&state.x.clone(), state.t, channel));
                if !left.is_finite() || (left - linear).abs() <= 0.1 * r.sqrt() {
                    self.row = old_row;
                    break;
                }
                multiply(&state.p, m, &self.row, &mut ph[..n]);
                s = dot_by::<VECTOR>(&ph, &self.row) + r;
                nu = left + (0..n).map(|i| self.row[i] * (state.x[i] - self.prior[i])).sum::<f64>();
                if !(nu.is_finite() && s.is_finite()) {
                    nu = old_nu;
                    self.row = old_row;
                    multiply(&state.p, m, &self.row, &mut ph[..n]);
                    s = dot_by::<VECTOR>(&ph, &self.row) + r;
                    for i in 0..n {
                        state.x[i] = self.prior[i] + ph[i] / s * nu;
                    }
                    break;
                }
            }
            for i in 0..n {
                self.gain[i] = ph[i] / s;
                state.x[i] = self.prior[i] + self.gain[i] * nu;
            }
            joseph(&mut state.p, n, m, &self.row, &ph, &self.gain, r);
            if let Some(tape) = tape {
                tape.scalars.push(Scalar { channel, nu, s });
                tape.rows.extend_from_slice(&self.row);
                tape.gains.extend_from_slice(&self.gain);
            }
        }
        self.ph = ph;
    }

    /// The step's matrix `[nx][lanes]` of the last node, for tests.
    #[cfg(test)]
    pub fn last_step(&self) -> &[f64] {
        &self.s
    }
}

/// Where a filter at `state` linearises.
fn at(about: Option<&About>, state: &State, nx: usize, out: &mut [f64]) {
    match about {
        Some(about) => about.at(state, nx, out),
        None => out.copy_from_slice(&state.x),
    }
}

/// The angle without whole turns, -pi to pi.
fn nearest_turn(a: f64) -> f64 {
    let turn = 2.0 * std::f64::consts::PI;
    a - turn * (a / turn).round()
}
