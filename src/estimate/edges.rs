//! A solution in; the parameters that hang on when inputs stepped between two of their samples, out.
//!
//! An input that is sampled once before and once after a step says no more of when it stepped. A
//! straight line between the two puts it into their middle; at the later sample it is half a sample
//! late. One step of the iteration from the solution, with the steps there, shows what the estimates
//! owe to that.

use super::case::Case;
use super::coarse::MOVES;
use super::solution::Solution;
use super::{Settings, Stop};
use crate::dynamics::{Interpolation, Record};
use crate::math::mad_sd;

/// A change between two samples of more than this share of the input's range is a step.
const STEP: f64 = 0.3;
/// And of more than so many standard deviations of the input's noise.
const CLEAR: f64 = 10.0;

/// What the estimates owe to how inputs stepped between two samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Edges {
    /// Inputs that step, and the time between two samples of each, s.
    pub inputs: Vec<(String, f64)>,
    /// Parameters with the standard deviations by which they move, those that move most first.
    pub moved: Vec<(String, f64)>,
}

impl Case {
    /// What steps at the later sample would move; none where nothing steps, or nothing moves much.
    pub(super) fn edges(&self, solution: &Solution, settings: &Settings) -> Option<Edges> {
        if self.is_filtered() || solution.fit.stop != Stop::Converged {
            return None;
        }
        let mut later = self.clone();
        let mut inputs = Vec::new();
        for (input, quantity) in self.model.inputs.iter().enumerate() {
            let spacing = later.records.iter_mut().filter_map(|record| late(record, input));
            if let Some(spacing) = spacing.reduce(f64::max) {
                inputs.push((quantity.name.clone(), spacing));
            }
        }
        if inputs.is_empty() {
            return None;
        }
        let moved = self.moved(&later, solution, settings, MOVES);
        (!moved.is_empty()).then_some(Edges { inputs, moved })
    }
}

/// Puts the steps of an input at the later of the two samples that they lie between; the time between
/// these, s, where there is one.
fn late(record: &mut Record, input: usize) -> Option<f64> {
    if record.interpolation.get(input).is_some_and(|kind| *kind != Interpolation::Linear) {
        return None;
    }
    let nu = record.inputs.len() / record.n.max(1);
    let column: Vec<f64> = record.inputs.iter().skip(input).step_by(nu).copied().collect();
    let own = record.spacings.get(input).copied().filter(|own| own.is_finite());
    let points = own.map_or(1, |own| (own / record.dt).round().max(1.0) as usize);
    let at = steps(&column, points);
    if at.is_empty() {
        return None;
    }
    let mut inputs = record.inputs.to_vec();
    for k in at {
        (k + 1..k + points).for_each(|j| inputs[j * nu + input] = column[k]);
        // straight lines through the mean have the area of a step there
        inputs[(k + points) * nu + input] = 0.5 * (column[k] + column[k + points]);
    }
    record.inputs = inputs.into();
    Some(points as f64 * record.dt)
}

/// Standard deviation of the noise of a column that has a sample of its own at every `points`: between these it
/// runs on lines, which know none. By the changes from one to the next, of which a few may be steps.
fn noise(column: &[f64], points: usize) -> f64 {
    let own: Vec<f64> = column.iter().step_by(points.max(1)).copied().collect();
    let changes: Vec<f64> = own.windows(2).map(|w| w[1] - w[0]).collect();
    mad_sd(&changes) / std::f64::consts::SQRT_2
}

/// The points before each step: where the change over `points` is largest.
fn steps(column: &[f64], points: usize) -> Vec<usize> {
    let (low, high) = column
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
    let least = (STEP * (high - low)).max(CLEAR * noise(column, points));
    let change = |k: usize| match column.get(k + points) {
        Some(next) => (next - column[k]).abs(),
        None => 0.0,
    };
    let is_step = |k: &usize| {
        let near = k.saturating_sub(points - 1)..k + points;
        let largest = near.map(|j| change(j) - if j < *k { 0.0 } else { 1e-12 * least });
        change(*k) > least && largest.fold(0.0, f64::max) <= change(*k)
    };
    (0..column.len()).filter(is_step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_one_whatever_the_grid_and_noise_or_a_wave_is_none() {
        let step = |k: usize| f64::from(k > 10 && k <= 30) - f64::from(k > 30 && k <= 40);
        let column: Vec<f64> = (0..60).map(step).collect();
        assert_eq!(steps(&column, 1), [10, 30, 40]);
        // sampled four times slower than the grid
        let coarse = |k: usize| {
            let (a, b) = (4 * (k / 4), 4 * (k / 4) + 4);
            step(a) + (step(b) - step(a)) * (k % 4) as f64 / 4.0
        };
        let column: Vec<f64> = (0..60).map(coarse).collect();
        assert_eq!(steps(&column, 4), [8, 28, 40]);
        let wave: Vec<f64> = (0..200).map(|k| libm::sin(0.2 * k as f64)).collect();
        assert!(steps(&wave, 1).is_empty());
        let noise: Vec<f64> =
            (0..200).map(|k: usize| (k * k * 7919 % 104_729) as f64 / 104_729.0).collect();
        assert!(steps(&noise, 1).is_empty(), "{:?}", steps(&noise, 1));
        // the same, sampled slower than the grid
        let slow: Vec<f64> = (0..199 * 5)
            .map(|k: usize| {
                let (i, w) = (k / 5, (k % 5) as f64 / 5.0);
                noise[i] + (noise[i + 1] - noise[i]) * w
            })
            .collect();
        assert!(steps(&slow, 5).is_empty(), "{:?}", steps(&slow, 5));
        assert!(steps(&[0.0; 20], 1).is_empty());
    }

    #[test]
    fn a_step_at_the_later_sample_has_that_area() {
        let inputs = [0.0, 0.0, 0.5, 1.0, 1.0, 1.0].to_vec();
        let mut record = Record {
            n: 6,
            dt: 0.1,
            inputs: inputs.into(),
            spacings: vec![0.2],
            ..Record::default()
        };
        assert_eq!(late(&mut record, 0), Some(0.2));
        assert_eq!(record.inputs.to_vec(), [0.0, 0.0, 0.0, 0.5, 1.0, 1.0]);
        record.interpolation = vec![Interpolation::Hold];
        assert_eq!(late(&mut record, 0), None);
    }
}
