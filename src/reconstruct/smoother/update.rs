//! A filter's state and one measured number in; the state after it out.

use super::filter::{Filter, Watch};
use super::matrix::{deduct, joseph, seen};
use super::state::State;
use super::tape::{Scalar, Tape};

/// Local iterations of one update at most; they end when the linear prediction holds to a tenth of
/// a standard deviation.
const ITERATIONS: usize = 6;
/// An update whose prior knowledge is better than this share of the measurement's variance is as
/// good as linear.
const SHARP: f64 = 0.25;

impl Filter<'_> {
    /// One scalar update, iterated where the prior is wide: the fixed point is the mode of the
    /// posterior (Bell and Cathey 1993).
    pub(super) fn update(
        &mut self,
        state: &mut State,
        channel: usize,
        z: f64,
        tape: Option<&mut Tape>,
        watch: &mut impl Watch,
    ) {
        let r = self.levels.r[channel];
        let angle = self.flight.channels[channel].angle;
        let error = |y: f64| if angle { nearest_turn(z - y) } else { z - y };
        match self.about {
            Some(about) => about.at(state, self.size.x, &mut self.at),
            None => self.at.copy_from_slice(&state.x),
        }
        let mut nu = error(self.predict(state.t, channel)) - self.ahead(&state.x, channel);
        let mut s = self.spread(state, channel) + r;
        if !(nu.is_finite() && s.is_finite()) {
            watch.innovation(state.t, &Scalar { channel, nu, s }, false);
            return;
        }
        let accepted = nu * nu <= self.gate * self.gate * s;
        watch.innovation(state.t, &Scalar { channel, nu, s }, accepted);
        if !accepted {
            return;
        }
        self.prior.copy_from_slice(&state.x);
        if self.about.is_none() {
            (nu, s) = self.mode(state, channel, [nu, s, r], error);
        }
        for (gain, ph) in self.gain.iter_mut().zip(self.ph.iter()) {
            *gain = ph / s;
        }
        for ((x, prior), gain) in state.x.iter_mut().zip(&self.prior).zip(self.gain.iter()) {
            *x = prior + gain * nu;
        }
        let scalar = Scalar { channel, nu, s };
        self.narrow(state, &scalar, r);
        if let Some(tape) = tape {
            tape.update(scalar, &self.row, &self.gain);
        }
    }

    /// How far the linear prediction at `x` is ahead of that at `self.at`.
    fn ahead(&self, x: &[f64], channel: usize) -> f64 {
        self.places(channel).iter().map(|&i| self.row[i] * (x[i] - self.at[i])).sum()
    }

    /// `P h` into `self.ph`; gives `h' P h`.
    fn spread(&mut self, state: &State, channel: usize) -> f64 {
        let places = self.places(channel);
        seen(&state.p, self.size.m, &self.row, places, &mut self.ph);
        places.iter().map(|&i| self.row[i] * self.ph[i]).sum()
    }

    /// Innovation and its variance, linearised at the mode of the posterior, from those at the
    /// prior.
    fn mode(
        &mut self,
        state: &State,
        channel: usize,
        [mut nu, mut s, r]: [f64; 3],
        error: impl Fn(f64) -> f64,
    ) -> (f64, f64) {
        for _ in 0..ITERATIONS {
            if s - r <= SHARP * r {
                break;
            }
            for ((at, prior), ph) in self.at.iter_mut().zip(&self.prior).zip(self.ph.iter()) {
                *at = prior + ph / s * nu;
            }
            // what the linear prediction says is left, and what is left
            let linear = nu - (s - r) / s * nu;
            let before = [nu, s];
            self.kept.copy_from_slice(&self.row);
            let left = error(self.predict(state.t, channel));
            if !left.is_finite() || (left - linear).abs() <= 0.1 * r.sqrt() {
                self.row.copy_from_slice(&self.kept);
                break;
            }
            s = self.spread(state, channel) + r;
            nu = left - self.ahead(&self.prior, channel);
            if !(nu.is_finite() && s.is_finite()) {
                self.row.copy_from_slice(&self.kept);
                [nu, s] = before;
                self.spread(state, channel);
                break;
            }
        }
        (nu, s)
    }

    /// The covariance after the update with `self.gain`.
    fn narrow(&mut self, state: &mut State, scalar: &Scalar, r: f64) {
        let (n, m) = (self.size.n, self.size.m);
        if scalar.s - r > SHARP * r {
            let places = self.places(scalar.channel);
            joseph(&mut state.p, n, m, &self.row, places, &self.ph, &self.gain, r);
            return;
        }
        // a sharp prior loses at most a fifth along the row: nothing cancels, and Joseph's form is
        // `P - P h h' P / s`
        let root = scalar.s.sqrt();
        self.ph.iter_mut().for_each(|ph| *ph /= root);
        deduct(&mut state.p, n, m, &self.ph);
    }
}

/// The angle without whole turns, -pi to pi.
fn nearest_turn(a: f64) -> f64 {
    let turn = 2.0 * std::f64::consts::PI;
    a - turn * (a / turn).round()
}
