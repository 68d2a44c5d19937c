//! The parameter vector: what segments share, what one segment has to itself, where the iteration
//! begins, and bounds and priors.

use super::covariance::Structure;
use std::iter::repeat_n;

/// Parameters of one segment: which shared ones it sees, and how many are its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Indices into the shared parameters, in the order of the segment's directions.
    pub shared: Vec<usize>,
    /// Where its own parameters begin in the parameter vector.
    pub offset: usize,
    /// Number of its own parameters; they follow the shared ones in the segment's directions.
    pub own: usize,
    /// The group of segments whose `R` it shares.
    pub group: usize,
    /// Where outputs may be correlated: the number of the instant of every sample of every block,
    /// ascending; samples of the same number belong together.
    pub instants: Vec<Vec<u32>>,
}

impl Part {
    /// Number of directions of this segment.
    pub fn directions(&self) -> usize {
        self.shared.len() + self.own
    }
}

/// The parameter vector: shared parameters first, then each segment's own.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Number of shared parameters.
    pub shared: usize,
    pub parts: Vec<Part>,
    /// Where the iteration begins.
    pub start: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// Centre and standard deviation of a prior; infinite without one.
    pub centre: Vec<f64>,
    pub prior_sd: Vec<f64>,
    /// Parameters that act by their squares (standard deviations, densities of noise), ascending: a
    /// step changes the square by `2 theta d`. The likelihood is nearly a parabola in it: a deviation
    /// a thousand times too large is found in one step, where halving it would take ten.
    pub squares: Vec<usize>,
    pub noise: Structure,
}

impl Layout {
    /// The parameter vector after `length` of a step, inside the bounds.
    pub fn moved(&self, theta: &[f64], step: &[f64], length: f64) -> Vec<f64> {
        let one = |i: usize| {
            let by = length * step[i];
            let to = match self.squares.binary_search(&i) {
                Ok(_) => (theta[i] * (theta[i] + 2.0 * by)).max(0.0).sqrt(),
                Err(_) => theta[i] + by,
            };
            to.clamp(self.lower[i], self.upper[i])
        };
        (0..step.len()).map(one).collect()
    }

    /// Every segment sees all `shared` parameters and has `own[s]` of its own; unbounded, no
    /// priors, one diagonal `R`.
    #[cfg(test)]
    pub fn plain(shared: usize, own: &[usize], outputs: usize, start: Vec<f64>) -> Layout {
        let mut offset = shared;
        let parts = own
            .iter()
            .map(|&own| {
                let part = Part {
                    shared: (0..shared).collect(),
                    offset,
                    own,
                    group: 0,
                    instants: Vec::new(),
                };
                offset += own;
                part
            })
            .collect();
        let n = start.len();
        Layout {
            shared,
            parts,
            centre: start.clone(),
            start,
            lower: vec![f64::NEG_INFINITY; n],
            upper: vec![f64::INFINITY; n],
            prior_sd: vec![f64::INFINITY; n],
            squares: Vec::new(),
            noise: Structure {
                outputs,
                groups: 1,
                full: false,
                floor: vec![1e-30; outputs],
                known: false,
            },
        }
    }

    /// With so many further parameters behind those that segments share, which all of them see; they start at
    /// none, without a prior or bounds.
    pub fn widened(&self, further: usize) -> Layout {
        self.widened_where(further, |_, _| true)
    }

    /// The same, where segment `s` sees further parameter `j` if `sees(s, j)`.
    pub fn widened_where(&self, further: usize, sees: impl Fn(usize, usize) -> bool) -> Layout {
        let (nc, k) = (self.shared, further);
        let mut wide = self.clone();
        wide.shared += k;
        let insert = |of: &mut Vec<f64>, value: f64| drop(of.splice(nc..nc, repeat_n(value, k)));
        insert(&mut wide.start, 0.0);
        insert(&mut wide.lower, f64::NEG_INFINITY);
        insert(&mut wide.upper, f64::INFINITY);
        insert(&mut wide.centre, 0.0);
        insert(&mut wide.prior_sd, f64::INFINITY);
        for (s, part) in wide.parts.iter_mut().enumerate() {
            part.shared.extend((0..k).filter(|&j| sees(s, j)).map(|j| nc + j));
            part.offset += k;
        }
        wide.squares.iter_mut().filter(|i| **i >= nc).for_each(|i| *i += k);
        wide
    }

    /// Information of the prior of parameter `i`: `1/sd^2`, 0 without one.
    pub fn prior_weight(&self, i: usize) -> f64 {
        let sd = self.prior_sd[i];
        if sd.is_finite() { 1.0 / (sd * sd) } else { 0.0 }
    }

    /// What the prior of parameter `i` adds to the normal equations at `value`: its weight, and its
    /// pull downhill.
    pub fn prior(&self, i: usize, value: f64) -> (f64, f64) {
        let weight = self.prior_weight(i);
        (weight, if weight > 0.0 { weight * (self.centre[i] - value) } else { 0.0 })
    }

    /// The parameters as segment `s` sees them, in the order of its directions.
    pub fn local(&self, s: usize, theta: &[f64]) -> Vec<f64> {
        let part = &self.parts[s];
        let mut local: Vec<f64> = part.shared.iter().map(|&i| theta[i]).collect();
        local.extend_from_slice(&theta[part.offset..part.offset + part.own]);
        local
    }
}
