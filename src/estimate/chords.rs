//! A solution in; what the estimates owe to what is not known of inputs between their samples, out.
//!
//! A straight line between two samples, `h` apart, of an input that is curved there is off by
//! `h^2/12 u''` in the mean, and a smooth curve by as much where the input has a corner, so that
//! estimates are off by what goes with `h^2`. Curves through every second sample are off by four times
//! that: a third of what one step of the iteration makes of the difference is what they do themselves
//! (Richardson's extrapolation). Samples are those of the record: a finer grid knows no more than it.
//! Noise of the inputs, and edges, which lie somewhere between two samples, move the estimates one way where the
//! even samples are kept and another where the odd ones are: only what both do alike, beyond what they differ
//! by, is told.

use super::case::Case;
use super::solution::Solution;
use super::{Settings, Stop};
use crate::dynamics::{Channel, Interpolation, Record, between_samples};

/// Errors go with the square of the spacing: of twice of it, less its own, there are three.
const RICHARDSON: f64 = 3.0;

/// What even and odd samples do alike is so many times what they differ by (root mean square over all
/// parameters). *Convention*, as three standard deviations.
const BEYOND: f64 = 3.0;

/// Points between samples are on lines where they bend by less than this share of what the samples do.
const ON_LINES: f64 = 0.1;

/// What the estimates owe to the curves between samples of the inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Chords {
    /// The time between two samples, or points of the grid where that is coarser, s; the least and the largest.
    pub spacing: [f64; 2],
    /// The record has samples between the points of the grid.
    pub finer: bool,
    /// All of the curves are smooth ones.
    pub smooth: bool,
    /// Parameters with the standard deviations by which they are moved, those that are moved most first.
    pub moved: Vec<(String, f64)>,
}

/// An input of a record as it is known: a sample every so many points of the grid, from one on.
pub(super) struct Known {
    pub(super) every: usize,
    pub(super) first: usize,
    pub(super) smooth: bool,
    finer: bool,
}

impl Case {
    /// What curves between samples move; none where every input is held, or nothing moves by its sd.
    pub(super) fn chords(&self, solution: &Solution, settings: &Settings) -> Option<Chords> {
        if self.is_filtered() || solution.fit.stop != Stop::Converged {
            return None;
        }
        let nu = self.model.inputs.len();
        let mut told =
            Chords { spacing: [f64::INFINITY, 0.0], finer: false, smooth: true, moved: Vec::new() };
        let mut steps = [const { Vec::new() }; 2];
        for (phase, steps) in steps.iter_mut().enumerate() {
            let mut coarser = self.clone();
            for record in &mut coarser.records {
                let dt = record.dt;
                for known in thinned(record, nu, phase) {
                    let spacing = known.every as f64 * dt;
                    told.spacing = [told.spacing[0].min(spacing), told.spacing[1].max(spacing)];
                    told.finer |= known.finer;
                    told.smooth &= known.smooth;
                }
            }
            if told.spacing[1] == 0.0 {
                return None;
            }
            *steps = self.steps_to(&coarser, solution, settings);
        }
        told.moved = common(&steps)
            .map(|(i, by)| (self.unknowns[i].name.clone(), by / RICHARDSON))
            .filter(|(_, by)| *by > 1.0)
            .collect();
        told.moved.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        (!told.moved.is_empty()).then_some(told)
    }
}

/// What two choices of every second sample move alike, by index, in standard deviations; nothing of what is no
/// more than what they differ by.
fn common([even, odd]: &[Vec<f64>; 2]) -> impl Iterator<Item = (usize, f64)> {
    let both = || even.iter().zip(odd).enumerate().filter(|(_, (a, b))| (*a + *b).is_finite());
    let (n, square) = both()
        .fold((0.0, 0.0), |(n, square), (_, (a, b))| (n + 1.0, square + 0.25 * (a - b) * (a - b)));
    let differ = (square / f64::max(n, 1.0)).sqrt();
    both().map(|(i, (a, b))| (i, 0.5 * (a + b).abs())).filter(move |(_, by)| *by > BEYOND * differ)
}

/// Puts every second sample of the inputs that are not held, and what lies beside it, onto the curve through the
/// others, in the first or the second `phase`; how each of them is known.
fn thinned(record: &mut Record, nu: usize, phase: usize) -> Vec<Known> {
    // How commands run is known.
    let held = |i: &usize| {
        let kind = record.interpolation.get(*i);
        matches!(kind, Some(Interpolation::Hold | Interpolation::Ramps))
    };
    let mut inputs = record.inputs.to_vec();
    let mut all = Vec::new();
    for i in (0..nu).filter(|i| !held(i)) {
        let column: Vec<f64> = record.inputs.iter().skip(i).step_by(nu).copied().collect();
        let known = Known::of(record, i, &column);
        let (step, first) = (2 * known.every, known.first + phase * known.every);
        if record.n <= first + step {
            continue;
        }
        let last = (record.n - 1 - first) / step;
        let at = |k: isize| column[first + step * k.clamp(0, last as isize) as usize];
        for k in first..first + step * last {
            let (place, s) = ((k - first) / step, ((k - first) % step) as f64 / step as f64);
            let place = place as isize;
            inputs[k * nu + i] = match known.smooth {
                true => between_samples([place - 1, place, place + 1, place + 2].map(at), s),
                false => (1.0 - s) * at(place) + s * at(place + 1),
            };
        }
        all.push(known);
    }
    record.inputs = inputs.into();
    all
}

impl Known {
    /// How an input is known. One that is made of others is taken to have the samples of what is measured.
    pub(super) fn of(record: &Record, input: usize, column: &[f64]) -> Known {
        let measured = || record.channels.iter().map(Channel::spacing).filter(|s| s.is_finite());
        let own = record.spacings.get(input).copied().unwrap_or(record.dt);
        let own = if own.is_finite() { own } else { measured().fold(f64::INFINITY, f64::min) };
        let own = if own.is_finite() { own } else { record.dt };
        let every = (own / record.dt).round().max(1.0) as usize;
        // Between samples a line does not bend.
        let bend = |phase: usize| {
            let at = (phase..column.len().saturating_sub(1)).step_by(every).filter(|k| *k > 0);
            at.map(|k| (column[k - 1] - 2.0 * column[k] + column[k + 1]).abs()).sum::<f64>()
        };
        let bends: Vec<f64> = (0..every).map(bend).collect();
        let first = (0..every).fold(0, |best, k| if bends[k] > bends[best] { k } else { best });
        let rest = bends.iter().sum::<f64>() - bends[first];
        let is_cubic = record.interpolation.get(input) == Some(&Interpolation::Cubic);
        let bent = every > 1 && rest > ON_LINES * bends[first];
        Known { every, first, smooth: is_cubic || bent, finer: own < 0.75 * record.dt }
    }
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
        let known = thinned(&mut record, 2, 0);
        assert!(known.len() == 1 && known[0].every == 1 && !known[0].smooth && !known[0].finer);
        assert_eq!(record.inputs.to_vec(), [0.0, 7.0, 1.0, 5.0, 2.0, 6.0, 3.0, 1.0, 4.0, 8.0]);
        record.interpolation = vec![Interpolation::Hold; 2];
        assert!(thinned(&mut record, 2, 0).is_empty());
    }

    /// A wave with a sample every four points of the grid, the first of them at point 1.
    fn sampled(smooth: bool) -> Record {
        let wave = |k: isize| (0.4 * k as f64).sin();
        let value = |j: isize| {
            let (k, s) = ((j - 1).div_euclid(4), (j - 1).rem_euclid(4) as f64 / 4.0);
            match smooth {
                true => between_samples([k - 1, k, k + 1, k + 2].map(wave), s),
                false => (1.0 - s) * wave(k) + s * wave(k + 1),
            }
        };
        let inputs: Vec<f64> = (0..80).map(value).collect();
        let (spacings, inputs) = (vec![0.04], inputs.into());
        Record { n: 80, dt: 0.01, inputs, spacings, ..Record::default() }
    }

    #[test]
    fn a_finer_grid_has_the_samples_of_the_record() {
        for smooth in [false, true] {
            let (mut record, before) = (sampled(smooth), sampled(smooth).inputs);
            let known = thinned(&mut record, 1, 0);
            assert_eq!((known[0].every, known[0].first, known[0].smooth), (4, 1, smooth));
            let moved = |k: usize| (record.inputs[k] - before[k]).abs();
            // samples 0, 2, 4 are kept, and 1, 3 are on the curve through them
            assert!([1, 9, 17].iter().all(|&k| moved(k) < 1e-12));
            assert!([5, 13].iter().all(|&k| moved(k) > if smooth { 1e-4 } else { 1e-2 }));
        }
        let mut record = Record { spacings: vec![0.004], ..sampled(false) };
        assert!(thinned(&mut record, 1, 0)[0].finer);
    }
}
