//! A case and times by which some of its records are late in; residuals with what is late put right, and their
//! sensitivities to those times, out.

use super::case::Case;
use crate::dynamics::{Interpolation, Record, between_samples};
use crate::least_squares::Block;
use std::borrow::Cow;

/// Differences to both sides are taken over this share of a step of the grid. What is held, and an output's line
/// between two points, changes its slope from one step to the next: differences over a whole one would mix the
/// slopes of both, and the iteration would not come to rest.
const INSIDE: f64 = 1.0 / 64.0;

/// Whose record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Of {
    Input(usize),
    /// By its place among the scored ones.
    Output(usize),
}

/// A record that may be late, in all flights or in one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shift {
    pub of: Of,
    /// By its place among the flights of the case.
    pub flight: Option<usize>,
}

impl Shift {
    /// Whether a segment is late if this record is.
    pub fn is_in(&self, case: &Case, s: usize) -> bool {
        self.flight.is_none_or(|flight| case.flight_of[s] == flight)
    }
}

/// A case with the times by which records are late as further shared parameters.
pub(super) struct Shifted<'a> {
    pub case: &'a Case,
    pub of: &'a [Shift],
    /// Whether differences are taken close by and to both sides, or over a step of the grid to one, which is half the
    /// work.
    pub both: bool,
}

/// What a step of some of those times does: residuals before and after it, and how large it is, s.
struct Stepped<'b> {
    before: Cow<'b, [Block]>,
    after: Vec<Block>,
    step: f64,
}

impl Shifted<'_> {
    /// Residuals, with sensitivities to those times between those to shared parameters and to the segment's own.
    pub fn evaluate(&self, s: usize, local: &[f64], sensitivities: bool) -> Option<Vec<Block>> {
        let of: Vec<Of> = self
            .of
            .iter()
            .filter(|shift| shift.is_in(self.case, s))
            .map(|shift| shift.of)
            .collect();
        let (shared, k) = (self.case.layout.parts[s].shared.len(), of.len());
        let (known, own) = (&local[..shared], &local[shared + k..]);
        let (late, plain) = (&local[shared..shared + k], [known, own].concat());
        let at = |late: &[f64], slopes: bool| {
            self.case.evaluate_as(&self.record(s, &of, late), s, &plain, slopes)
        };
        let blocks = at(late, sensitivities)?;
        if !sensitivities {
            return Some(blocks);
        }
        let steps = self.steps(s, (&of, late), &blocks, &|late| at(late, false))?;
        let nd = plain.len();
        let mut wide = Vec::with_capacity(blocks.len());
        for (b, block) in blocks.iter().enumerate() {
            let mut g = Vec::with_capacity(block.e.len() * (nd + k));
            for row in 0..block.e.len() {
                let known = &block.g[row * nd..(row + 1) * nd];
                g.extend_from_slice(&known[..shared]);
                let slope = |(of, step): (&Of, &Option<usize>)| match (of, step) {
                    (Of::Output(j), _) if *j != block.output => 0.0,
                    (_, Some(step)) => steps.1[*step].slope(b, row),
                    (_, None) => 0.0,
                };
                g.extend(of.iter().zip(&steps.0).map(slope));
                g.extend_from_slice(&known[shared..]);
            }
            wide.push(g);
        }
        Some(blocks.into_iter().zip(wide).map(|(block, g)| Block { g, ..block }).collect())
    }

    /// Which step tells of each of the times, and the steps. A shift of one output is seen in no other, so that one
    /// step does for all of them, and none is needed for an input that stands still.
    fn steps<'b>(
        &self,
        s: usize,
        (of, late): (&[Of], &[f64]),
        blocks: &'b [Block],
        at: &dyn Fn(&[f64]) -> Option<Vec<Block>>,
    ) -> Option<(Vec<Option<usize>>, Vec<Stepped<'b>>)> {
        let record = &self.case.records[s];
        let is_output = |of: &Of| matches!(of, Of::Output(_));
        let outputs = (0..of.len()).filter(|&j| is_output(&of[j]));
        let moves = |j: &usize| matches!(of[*j], Of::Input(i) if moves(record, i));
        let inputs = (0..of.len()).filter(moves).map(|j| vec![j]);
        let groups: Vec<Vec<usize>> =
            inputs.chain([outputs.collect()]).filter(|group| !group.is_empty()).collect();
        let by = |group: &[usize], h: f64| {
            let mut late = late.to_vec();
            group.iter().for_each(|&j| late[j] += h);
            at(&late)
        };
        let h = if self.both { INSIDE * record.dt } else { record.dt };
        let one = |group: &Vec<usize>| {
            let after = by(group, h)?;
            Some(match self.both {
                true => Stepped { before: by(group, -h)?.into(), after, step: 2.0 * h },
                false => Stepped { before: blocks.into(), after, step: h },
            })
        };
        let steps: Vec<Stepped> = groups.iter().map(one).collect::<Option<_>>()?;
        let step = |j: usize| groups.iter().position(|group| group.contains(&j));
        Some(((0..of.len()).map(step).collect(), steps))
    }

    /// The record of a segment with what is late put right.
    fn record(&self, s: usize, of: &[Of], late: &[f64]) -> Record {
        let mut record = self.case.records[s].clone();
        for (of, &late) in of.iter().zip(late).filter(|(_, late)| **late != 0.0) {
            match of {
                Of::Input(i) => {
                    let steps = late / record.dt;
                    earlier(&mut record, *i, steps);
                }
                Of::Output(j) => {
                    let output = self.case.outputs[*j];
                    let first = record.t0 + record.start as f64 * record.dt;
                    let last = record.t0 + (record.n.max(1) - 1) as f64 * record.dt;
                    let channels = record.channels.iter_mut().filter(|c| c.output == output);
                    for channel in channels {
                        // as many samples count whatever the shift
                        let earlier = |t: &f64| match *t >= first && *t <= last {
                            true => (t - late).clamp(first, last),
                            false => *t,
                        };
                        channel.t = channel.t.iter().map(earlier).collect::<Vec<f64>>().into();
                    }
                }
            }
        }
        record
    }
}

impl Stepped<'_> {
    /// Sensitivity of a sample: y moves by what e does not.
    fn slope(&self, block: usize, row: usize) -> f64 {
        let slope = (self.before[block].e[row] - self.after[block].e[row]) / self.step;
        if slope.is_finite() { slope } else { 0.0 }
    }
}

/// Whether an input of a record moves.
fn moves(record: &Record, input: usize) -> bool {
    let nu = record.inputs.len() / record.n.max(1);
    let mut column = record.inputs.iter().skip(input).step_by(nu.max(1));
    let first = column.next();
    column.any(|u| Some(u) != first)
}

/// Moves an input to earlier times by so many steps of the grid; what is held changes by shares of its area.
fn earlier(record: &mut Record, input: usize, steps: f64) {
    let nu = record.inputs.len() / record.n.max(1);
    let column: Vec<f64> = record.inputs.iter().skip(input).step_by(nu).copied().collect();
    let is_held = record.interpolation.get(input) == Some(&Interpolation::Hold);
    let at = |k: isize| column[k.clamp(0, column.len() as isize - 1) as usize];
    let (whole, share) = (steps.floor() as isize, steps - steps.floor());
    let mut inputs = record.inputs.to_vec();
    for (k, u) in inputs.iter_mut().skip(input).step_by(nu).enumerate() {
        let k = k as isize + whole;
        *u = match is_held {
            true => (1.0 - share) * at(k) + share * at(k + 1),
            false => between_samples([k - 1, k, k + 1, k + 2].map(at), share),
        };
    }
    record.inputs = inputs.into();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_is_moved_by_whole_steps_and_parts_of_them() {
        let ramp = |n: usize| (0..n).map(|k| k as f64).collect::<Vec<f64>>();
        let mut record = Record { n: 8, dt: 0.1, inputs: ramp(8).into(), ..Record::default() };
        earlier(&mut record, 0, 2.0);
        assert_eq!(record.inputs.to_vec(), [2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 7.0, 7.0]);
        record.inputs = ramp(8).into();
        earlier(&mut record, 0, -1.25);
        assert!((record.inputs[4] - 2.75).abs() < 1e-12, "{:?}", record.inputs);
        record.interpolation = vec![Interpolation::Hold];
        record.inputs = vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0].into();
        earlier(&mut record, 0, 0.25);
        assert_eq!(record.inputs[2], 0.25);
        assert_eq!(record.inputs[3], 1.0);
    }
}
