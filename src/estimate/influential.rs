//! A solution in; the one sample on which a parameter hangs, if it hangs on one, out.
//!
//! Without one sample the estimates move by `M^-1 g w e/(1 - h)` (Cook, Technometrics 19, 1977),
//! with `g` the sensitivities of the output there, `e` its residual, `w` one over the variance of
//! its noise and `h = w g'M^-1 g` its leverage; of a model that is not linear this is the first
//! step. Both are needed: a residual that no parameter follows moves nothing, nor does a sample that
//! decides much and is met. A sample far off makes the noise of its output, and every standard
//! deviation, look larger than the others do; it is judged by those of the others, whose variance is
//! `(N/w - e^2/(1 - h))/(N - 1)`.

use super::case::Case;
use super::solution::Solution;
use rayon::prelude::*;

/// A parameter hangs on a sample that moves it by so many of the standard deviations that the other
/// samples give.
const MOVES: f64 = 1.0;
/// Residuals below so many standard deviations of the noise are those of any sample.
const FAR: f64 = 4.0;
/// So many samples of a segment, those that may move most, are looked at closely.
const LOOKED_AT: usize = 20;

/// A sample on which an estimate hangs.
#[derive(Debug, Clone, PartialEq)]
pub struct Influential {
    /// Index of the record.
    pub segment: usize,
    pub output: String,
    /// On the record's time, s.
    pub t: f64,
    /// Residual in standard deviations of the noise that the output's other samples have.
    pub residual: f64,
    /// The parameter that it moves most, by its place among the rows.
    pub row: usize,
    /// By how much that would be larger without the sample, in the standard deviations of the
    /// estimate with it.
    pub shift: f64,
}

/// A sample whose residual is large.
struct Far {
    /// Place of the segment, and of the channel in it.
    at: (usize, usize),
    t: f64,
    residual: f64,
    /// Sensitivities by index of the parameter vector, and one over the noise's variance.
    g: Vec<(usize, f64)>,
    w: f64,
    /// Samples of the output.
    count: f64,
    /// Bound of what it may move.
    most: f64,
}

impl Case {
    /// The sample that moves a common parameter most, where that is more than `MOVES`; `used`: indices of
    /// the records.
    pub fn influential(&self, solution: &Solution, used: &[usize]) -> Option<Influential> {
        let mut matrix = solution.fit.matrix.clone()?;
        let diagonal = matrix.diagonal();
        let mut rhs = vec![0.0; diagonal.len()];
        for (i, _) in solution.fit.held.iter().enumerate().filter(|(_, held)| **held) {
            matrix.pin(&mut rhs, i, 0.0);
        }
        let segments = 0..self.records.len();
        let far: Vec<Far> =
            segments.into_par_iter().flat_map_iter(|s| self.far(s, solution, &diagonal)).collect();
        let mut worst: Option<(f64, Influential)> = None;
        // Start values and shifts of one maneuver are nobody's result.
        let of = (solution, self.layout.shared);
        let factor = if far.is_empty() { None } else { matrix.factor().ok() }?;
        for sample in &far {
            let Some(Moved { row, shift, larger }) = moved(sample, of, &|rhs| factor.solve(rhs))
            else {
                continue;
            };
            let moves = larger * shift.abs();
            if moves > MOVES && worst.as_ref().is_none_or(|(most, _)| moves > *most) {
                let (s, channel) = sample.at;
                let output = self.records[s].channels[channel].output;
                let output = self.model.outputs[output].name.clone();
                let (t, residual) = (sample.t, larger * sample.residual);
                let found = Influential { segment: used[s], output, t, residual, row, shift };
                worst = Some((moves, found));
            }
        }
        worst.map(|(_, found)| found)
    }

    /// The samples of a segment that may move most, of those whose residuals are large.
    fn far(&self, s: usize, solution: &Solution, diagonal: &[f64]) -> Vec<Far> {
        let part = &self.layout.parts[s];
        let local = self.layout.local(s, &solution.fit.theta);
        let (Some(blocks), Some(noise)) =
            (self.evaluate(s, &local, true), solution.fit.noise.get(part.group))
        else {
            return Vec::new();
        };
        let variances = noise.variances();
        let own = part.offset..part.offset + part.own;
        let places: Vec<usize> = part.shared.iter().copied().chain(own).collect();
        let mut found = Vec::new();
        // Rows that stand for a likelihood's variances are no samples.
        let samples = blocks.iter().filter(|block| block.instead.is_none());
        for (channel, (block, of)) in samples.zip(&self.records[s].channels).enumerate() {
            let (w, count) = (1.0 / variances[block.output], noise.count[block.output] as f64);
            let rows = block.g.chunks_exact(places.len().max(1));
            for ((e, row), t) in block.e.iter().zip(rows).zip(&of.t) {
                let residual = e * w.sqrt();
                if !(residual.abs() > FAR) {
                    continue;
                }
                let g: Vec<(usize, f64)> =
                    places.iter().copied().zip(row.iter().copied()).collect();
                let size = |&(i, g): &(usize, f64)| g * g / diagonal[i].max(f64::MIN_POSITIVE);
                let most = residual * residual * w * g.iter().map(size).sum::<f64>();
                found.push(Far { at: (s, channel), t: *t, residual, g, w, count, most });
            }
        }
        found.sort_by(|a, b| b.most.total_cmp(&a.most));
        found.truncate(LOOKED_AT);
        found
    }
}

/// What a sample does.
struct Moved {
    /// The common parameter that it moves most, and by how many of its standard deviations.
    row: usize,
    shift: f64,
    /// By what the sample makes the noise of its output look larger.
    larger: f64,
}

fn moved(
    sample: &Far,
    (solution, shared): (&Solution, usize),
    solve: &dyn Fn(&[f64]) -> Vec<f64>,
) -> Option<Moved> {
    let held = &solution.fit.held;
    let mut rhs = vec![0.0; solution.fit.theta.len()];
    sample.g.iter().filter(|(i, _)| !held[*i]).for_each(|&(i, g)| rhs[i] = g);
    let step = solve(&rhs);
    let leverage: f64 = sample.w * rhs.iter().zip(&step).map(|(g, d)| g * d).sum::<f64>();
    // Of a sample that alone determines something nothing can be said.
    let rest = (1.0 - leverage).max(f64::EPSILON);
    let square = sample.residual * sample.residual;
    let others = (sample.count - square / rest) / (sample.count - 1.0).max(1.0);
    let larger = 1.0 / others.max(f64::EPSILON).sqrt();
    let factor = sample.residual * sample.w.sqrt() / rest;
    let of = |i: usize| Some((i, -factor * step[i] / solution.deviation(i)?.0));
    let most = (0..shared).filter_map(of).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    most.map(|(row, shift)| Moved { row, shift, larger })
}
