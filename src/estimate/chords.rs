//! A solution in; what the estimates owe to straight lines between the points of the grid, out.
//!
//! A straight line between two samples, `h` apart, of an input that is curved there is off by
//! `h^2/12 u''` in the mean, so that estimates are off by what goes with `h^2`. Lines through every second
//! point are off by four times that: a third of what one step of the iteration makes of the difference is
//! what the lines themselves do (Richardson's extrapolation). What noise of the inputs does is in it.

use super::case::Case;
use super::solution::Solution;
use super::{Settings, Stop};
use crate::dynamics::{Interpolation, Record};

/// Errors go with the square of the spacing: of twice of it, less its own, there are three.
const RICHARDSON: f64 = 3.0;

/// What the estimates owe to straight lines between the points of the grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Chords {
    /// The spacing of the grid, s; the largest of all segments.
    pub spacing: f64,
    /// Parameters with the standard deviations by which lines move them, those that are moved most first.
    pub moved: Vec<(String, f64)>,
}

impl Case {
    /// What straight lines move; none where no input runs on them, or nothing moves by its sd.
    pub(super) fn chords(&self, solution: &Solution, settings: &Settings) -> Option<Chords> {
        if self.is_filtered() || solution.fit.stop != Stop::Converged {
            return None;
        }
        let mut coarser = self.clone();
        let nu = self.model.inputs.len();
        let spacing = coarser.records.iter_mut().filter_map(|record| thinned(record, nu));
        let spacing = spacing.reduce(f64::max)?;
        let mut moved = self.moved(&coarser, solution, settings, RICHARDSON);
        moved.iter_mut().for_each(|(_, by)| *by /= RICHARDSON);
        (!moved.is_empty()).then_some(Chords { spacing, moved })
    }
}

/// Puts every second point of the inputs that run on straight lines onto the line between its neighbours;
/// the spacing of the grid, s, where there is such an input.
fn thinned(record: &mut Record, nu: usize) -> Option<f64> {
    let is_linear =
        |i: &usize| record.interpolation.get(*i).is_none_or(|kind| *kind == Interpolation::Linear);
    let linear: Vec<usize> = (0..nu).filter(is_linear).collect();
    if linear.is_empty() || record.n < 3 {
        return None;
    }
    let mut inputs = record.inputs.to_vec();
    for i in linear {
        for k in (1..record.n - 1).step_by(2) {
            let (before, behind) = (inputs[(k - 1) * nu + i], inputs[(k + 1) * nu + i]);
            inputs[k * nu + i] = 0.5 * (before + behind);
        }
    }
    record.inputs = inputs.into();
    Some(record.dt)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_second_point_of_what_runs_on_lines_is_on_one() {
        let inputs = [0.0, 7.0, 3.0, 5.0, 2.0, 6.0, 9.0, 1.0, 4.0, 8.0];
        let interpolation = vec![Interpolation::Linear, Interpolation::Hold];
        let mut record = Record {
            n: 5,
            dt: 0.1,
            inputs: inputs.to_vec().into(),
            interpolation,
            ..Record::default()
        };
        assert_eq!(thinned(&mut record, 2), Some(0.1));
        assert_eq!(record.inputs.to_vec(), [0.0, 7.0, 1.0, 5.0, 2.0, 6.0, 3.0, 1.0, 4.0, 8.0]);
        record.interpolation = vec![Interpolation::Hold; 2];
        assert_eq!(thinned(&mut record, 2), None);
    }
}
