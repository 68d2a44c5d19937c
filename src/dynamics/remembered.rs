//! Sensitivities of the states that some delay reads, step by step, in; what those of a past value are
//! made of, out.

use super::history::Past;
use super::propagator::Propagator;
use crate::math::mixed::{Term, mix};
use crate::math::pool;

/// Sensitivities at the remembered step times; of no other states than those that are read.
#[derive(Default)]
pub(super) struct Remembered {
    /// Ascending.
    states: Vec<usize>,
    lanes: usize,
    /// Of the states and of their rates, `[step][state][lanes]`.
    s: Vec<f64>,
    k: Vec<f64>,
    /// A row to work with.
    past: Vec<f64>,
}

impl Remembered {
    /// `steps`: about how many there will be.
    pub fn of(propagator: &Propagator, steps: usize) -> Remembered {
        let states = propagator.read_later();
        let lanes = propagator.directions.lanes();
        let empty = || {
            let mut list = pool::take(steps * states.len() * lanes);
            list.clear();
            list
        };
        let [s, k] = [empty(), empty()];
        Remembered { states, lanes, s, k, past: Vec::new() }
    }

    /// Whether any state is read later.
    pub fn is_kept(&self) -> bool {
        !self.states.is_empty()
    }

    /// How many states are read later.
    pub fn count(&self) -> usize {
        self.states.len()
    }

    /// A step begins at `s`, `[state][lanes]` of all states; its rates come later.
    pub fn begin(&mut self, s: &[f64]) {
        for i in &self.states {
            self.s.extend_from_slice(&s[i * self.lanes..(i + 1) * self.lanes]);
        }
        self.k.resize(self.s.len(), 0.0);
    }

    /// The rates of the step that began last, of all states; zero of those that rest.
    pub fn rates(&mut self, k: &[f64], rests: impl Fn(usize) -> bool) {
        let first = self.k.len() - self.states.len() * self.lanes;
        for (row, &i) in self.k[first..].chunks_exact_mut(self.lanes.max(1)).zip(&self.states) {
            row.copy_from_slice(&k[i * self.lanes..(i + 1) * self.lanes]);
            if rests(i) {
                row.fill(0.0);
            }
        }
    }

    /// The same, of the remembered states alone, of which none rests.
    pub fn rates_of(&mut self, k: &[f64]) {
        let first = self.k.len() - k.len();
        self.k[first..].copy_from_slice(k);
    }

    /// Whether a past value is made of the rates at the begin of the step that began last.
    pub fn is_present(&self, past: &Past) -> bool {
        let begun = self.s.len() / (self.states.len() * self.lanes).max(1);
        let reads = |w: f64, step: usize| w != 0.0 && step + 1 == begun;
        reads(past.w[1], past.i) || reads(past.w[3], past.j)
    }

    /// `row = past - slope row`, with the sensitivities of the value that `past` reads of a state.
    pub fn late(&mut self, state: Option<usize>, past: &Past, slope: f64, row: &mut [f64]) {
        let mut own = std::mem::take(&mut self.past);
        own.clear();
        own.resize(row.len(), 0.0);
        if let Some(state) = state {
            self.read(state, past, &mut own);
        }
        let n = row.len();
        mix((&own, 0, &[]), (row, 0, &[Term { factor: -slope, row: 0 }]), n, 1.0);
        self.past = own;
    }

    /// Adds those of the value that `past` reads of a state to `row`.
    pub fn read(&self, state: usize, past: &Past, row: &mut [f64]) {
        let Ok(slot) = self.states.binary_search(&state) else { return };
        let parts = [
            (past.w[0], &self.s, past.i),
            (past.w[1], &self.k, past.i),
            (past.w[2], &self.s, past.j),
            (past.w[3], &self.k, past.j),
        ];
        for (w, list, step) in parts.into_iter().filter(|part| part.0 != 0.0) {
            let from = (step * self.states.len() + slot) * self.lanes;
            row.iter_mut().zip(&list[from..from + self.lanes]).for_each(|(r, v)| *r += w * v);
        }
    }
}

impl Drop for Remembered {
    fn drop(&mut self) {
        pool::give(std::mem::take(&mut self.s));
        pool::give(std::mem::take(&mut self.k));
    }
}
