//! Sensitivities of the states that some delay reads, step by step, in; what those of a past value are
//! made of, out.

use super::history::Past;
use super::propagator::Propagator;
use crate::model::Delayed;

/// Sensitivities at the remembered step times; of no other states than those that are read.
#[derive(Default)]
pub(super) struct Remembered {
    /// Ascending.
    states: Vec<usize>,
    lanes: usize,
    /// Of the states and of their rates, `[step][state][lanes]`.
    s: Vec<f64>,
    k: Vec<f64>,
}

impl Remembered {
    pub fn of(propagator: &Propagator) -> Remembered {
        let read = |delay: &crate::model::Delay| match delay.of {
            Delayed::State(i) => Some(i),
            _ => None,
        };
        let mut states: Vec<usize> = propagator.delays.iter().filter_map(read).collect();
        states.sort_unstable();
        states.dedup();
        Remembered { states, lanes: propagator.directions.lanes(), ..Remembered::default() }
    }

    /// Whether any state is read later.
    pub fn is_kept(&self) -> bool {
        !self.states.is_empty()
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
