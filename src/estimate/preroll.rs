//! A case and a parameter vector in; delays of inputs that reach back to before the record, out.

use super::case::Case;
use crate::dynamics::{Directions, Propagator, Record};
use crate::error::Result;
use crate::model::{Delayed, Quantity};

/// An input that moves by less than this share of its range while a delay reaches back was at rest before, too.
const RESTS: f64 = 0.01;

/// A delay that reaches back to before a record, whose input moves there.
#[derive(Debug, Clone, PartialEq)]
pub struct TooShort {
    /// Index of the record.
    pub segment: usize,
    pub input: String,
    /// The delay at the start, and what the record has before it, s.
    pub delay: f64,
    pub preroll: f64,
}

impl Case {
    /// The delays that are longer than the pre-roll of their record; `used`: the records that the segments are.
    ///
    /// # Errors
    /// Start values that depend on each other.
    pub fn short_of_preroll(&self, theta: &[f64], used: &[usize]) -> Result<Vec<TooShort>> {
        let delays = &self.model.delays;
        let late: Vec<(usize, usize)> = delays
            .iter()
            .enumerate()
            .filter_map(|(k, d)| if let Delayed::Input(j) = d.of { Some((k, j)) } else { None })
            .collect();
        if late.is_empty() {
            return Ok(Vec::new());
        }
        let (mut model, from) = ((*self.model).clone(), self.model.outputs.len());
        model.outputs.extend(late.iter().map(|_| Quantity::default()));
        model.output_nodes.extend(late.iter().map(|(k, _)| delays[*k].tau));
        let directions = Directions { parameters: Vec::new(), starts: self.chosen.initial.clone() };
        let propagator =
            Propagator::of_outputs(&model, directions, (from..from + late.len()).collect())?;
        let mut found: Vec<TooShort> = Vec::new();
        for (s, &segment) in used.iter().enumerate() {
            let record = &self.records[s];
            let (parameters, starts) = self.place(s, &self.layout.local(s, theta));
            let first = Record { n: record.n.min(record.start + 2), ..record.clone() };
            let grid = propagator.run(&parameters, &starts, &first, false);
            for (column, &(_, j)) in late.iter().enumerate() {
                let delay = grid.y.get(column).copied().unwrap_or(f64::NAN);
                let preroll = record.start as f64 * record.dt;
                let input = self.model.inputs[j].name.clone();
                let said = found.iter().any(|f| f.segment == segment && f.input == input);
                if delay > preroll + 1e-9 && !said && self.moves(s, j, delay) {
                    found.push(TooShort { segment, input, delay, preroll });
                }
            }
        }
        Ok(found)
    }

    /// Whether input `j` moves in the first `seconds` of the record of segment `s`.
    fn moves(&self, s: usize, j: usize, seconds: f64) -> bool {
        let (record, nu) = (&self.records[s], self.model.inputs.len());
        let column = || record.inputs.iter().skip(j).step_by(nu).take(record.n);
        let range = |n: usize| {
            let low = column().take(n).fold(f64::NAN, |low, u| u.min(low));
            column().take(n).fold(f64::NAN, |high, u| u.max(high)) - low
        };
        let points = (seconds / record.dt).ceil() as usize + 1;
        range(points) > RESTS * range(record.n)
    }
}
