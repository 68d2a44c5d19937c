//! Whitened sensitivities of a fit in; what the fit absorbed of the noise, put back beside its
//! residuals, out.
//!
//! The fit is taken as linear about its end: what was measured is `y + G d + n` with all of `d`
//! unknown (up to priors) and noise `n` of covariance `Sigma`. Then `d` is known to be normal about
//! the generalised least-squares step `d^ = P G' Sigma^-1 e`, with the covariance
//! `P = (G' Sigma^-1 G)^-1`, so that
//!
//! `E[n n' | z] = (e - G d^)(e - G d^)' + G P G'`.
//!
//! The residuals of that step and the columns of `G P^(1/2)` are series whose products at every lag
//! add up to this: they stand in for the noise. Where the fit was weighted by `Sigma`, `d^` is
//! nothing; where it was weighted by the outputs' variances alone, it is the rest of the way.
//!
//! Own parameters of a segment are eliminated first. What the data do not determine counts as held.

use crate::math::combined::combined;
use crate::math::products::{Gram, dot, factor};

/// What a column of a segment's sensitivities belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// A shared parameter, by its place among those that are free.
    Shared(usize),
    /// A parameter of this segment alone.
    Own,
    /// One that was not free.
    Held,
}

/// What is known of a parameter besides the data.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Prior {
    /// `1/sd^2`; zero without a prior.
    pub weight: f64,
    /// `(centre - value)/sd^2`.
    pub pull: f64,
}

/// Information of one segment, its own parameters eliminated.
#[derive(Debug, Clone)]
pub struct Part {
    directions: usize,
    /// Direction of each column: own ones, then shared ones.
    order: Vec<usize>,
    /// Place of each shared column among the free shared parameters.
    to: Vec<usize>,
    own: usize,
    /// `[own][own]`: root of the inverse of the own parameters' information.
    own_root: Vec<f64>,
    /// `[own][to + 1]`: how own parameters answer to shared ones, and their own step behind.
    answer: Vec<f64>,
    /// `[to][to + 1]`: information on shared ones with the own ones free, and the slope behind.
    information: Vec<f64>,
}

impl Part {
    /// `white`: sensitivities made white, one column per direction, and the residuals behind.
    /// `priors`: one per direction; only those of own parameters are used. `None` where a number is
    /// not finite.
    pub fn new(directions: &[Direction], white: &[Vec<f64>], priors: &[Prior]) -> Option<Part> {
        let places = |wanted: fn(&Direction) -> bool| {
            directions.iter().enumerate().filter(move |(_, d)| wanted(d)).map(|(i, _)| i)
        };
        let own: Vec<usize> = places(|d| *d == Direction::Own).collect();
        let shared: Vec<usize> = places(|d| matches!(d, Direction::Shared(_))).collect();
        let to = directions
            .iter()
            .filter_map(|d| if let Direction::Shared(place) = d { Some(*place) } else { None })
            .collect();
        let order: Vec<usize> = own.iter().chain(&shared).copied().collect();
        let columns: Vec<&[f64]> = order
            .iter()
            .copied()
            .chain([directions.len()])
            .map(|d| white.get(d).map(Vec::as_slice).unwrap_or_default())
            .collect();
        let mut gram = Gram::of(&columns);
        let e = order.len();
        for (k, &d) in own.iter().enumerate() {
            gram.sums[k * gram.n + k] += priors[d].weight;
            gram.sums[k * gram.n + e] += priors[d].pull;
        }
        gram.sums
            .iter()
            .all(|v| v.is_finite())
            .then(|| Part::eliminated(&gram, own.len(), order, to, directions.len()))
    }

    fn eliminated(
        gram: &Gram,
        own: usize,
        order: Vec<usize>,
        to: Vec<usize>,
        directions: usize,
    ) -> Part {
        let m = to.len() + 1;
        let own_root = inverse_root(&gram.block(&(0..own).collect::<Vec<_>>()), own);
        // A^-1 B = R R' B with A over own parameters, B of these with shared ones and residuals.
        let half: Vec<f64> = (0..own * m)
            .map(|k| (0..own).map(|i| own_root[i * own + k / m] * gram.at(i, own + k % m)).sum())
            .collect();
        let answer = (0..own * m)
            .map(|k| (0..own).map(|i| own_root[(k / m) * own + i] * half[i * m + k % m]).sum())
            .collect();
        let taken =
            |a: usize, b: usize| (0..own).map(|i| half[i * m + a] * half[i * m + b]).sum::<f64>();
        let information = (0..to.len() * m)
            .map(|k| gram.at(own + k / m, own + k % m) - taken(k / m, k % m))
            .collect();
        Part { directions, order, to, own, own_root, answer, information }
    }

    /// The same among other free shared parameters than those that it was made for; none where it sees one
    /// that is not among them.
    pub fn placed(&self, before: &[usize], free: &[usize]) -> Option<Part> {
        let place = |&to: &usize| free.iter().position(|i| *i == before[to]);
        let to = self.to.iter().map(place).collect::<Option<_>>()?;
        Some(Part { to, ..self.clone() })
    }
}

/// All segments together.
pub struct Absorbed {
    /// `[shared][shared]`: root of the covariance of the shared parameters.
    root: Vec<f64>,
    step: Vec<f64>,
    /// Whether the step is left out.
    rests: bool,
}

impl Absorbed {
    /// `priors`: of the free shared parameters.
    pub fn new(parts: &[Part], priors: &[Prior]) -> Absorbed {
        let n = priors.len();
        let (mut information, mut slope) = (vec![0.0; n * n], vec![0.0; n]);
        for (i, prior) in priors.iter().enumerate() {
            information[i * n + i] += prior.weight;
            slope[i] += prior.pull;
        }
        for part in parts {
            let m = part.to.len() + 1;
            for (a, &i) in part.to.iter().enumerate() {
                let row = &part.information[a * m..(a + 1) * m];
                part.to.iter().zip(row).for_each(|(&j, v)| information[i * n + j] += v);
                slope[i] += row[m - 1];
            }
        }
        let root = inverse_root(&information, n);
        let half: Vec<f64> =
            (0..n).map(|k| (0..n).map(|i| root[i * n + k] * slope[i]).sum()).collect();
        let step = (0..n).map(|i| (0..n).map(|k| root[i * n + k] * half[k]).sum()).collect();
        Absorbed { root, step, rests: false }
    }

    /// The generalised least-squares step of the shared parameters.
    pub fn step(&self) -> &[f64] {
        &self.step
    }

    /// With the fit where it is: no step.
    pub fn at_rest(self) -> Absorbed {
        Absorbed { rests: true, ..self }
    }

    /// What was absorbed in one segment.
    pub fn of(&self, part: &Part) -> Taken {
        let (own, m, n) = (part.own, part.to.len() + 1, self.step.len());
        let columns = own + n;
        let mut taken = Taken {
            columns,
            step: vec![0.0; part.directions],
            root: vec![0.0; part.directions * columns],
        };
        for (place, &direction) in part.order.iter().enumerate() {
            let row = &mut taken.root[direction * columns..(direction + 1) * columns];
            match place.checked_sub(own) {
                Some(a) => {
                    row[own..].copy_from_slice(&self.root[part.to[a] * n..(part.to[a] + 1) * n]);
                    taken.step[direction] = self.step[part.to[a]];
                }
                None => {
                    row[..own].copy_from_slice(&part.own_root[place * own..(place + 1) * own]);
                    let answer = &part.answer[place * m..(place + 1) * m];
                    taken.step[direction] = answer[m - 1];
                    for (&to, answer) in part.to.iter().zip(answer) {
                        taken.step[direction] -= answer * self.step[to];
                        row[own..]
                            .iter_mut()
                            .zip(&self.root[to * n..(to + 1) * n])
                            .for_each(|(v, r)| *v -= answer * r);
                    }
                }
            }
        }
        if self.rests {
            taken.step.fill(0.0);
        }
        taken.narrowed()
    }
}

/// What was absorbed in one segment.
pub struct Taken {
    columns: usize,
    /// The generalised least-squares step, by direction.
    step: Vec<f64>,
    /// `[directions][columns]`: the segment's rows of `P^(1/2)`.
    root: Vec<f64>,
}

impl Taken {
    /// As many columns as directions at most: a segment that sees few of many shared parameters is
    /// not charged for the others.
    fn narrowed(self) -> Taken {
        let (nd, columns) = (self.step.len(), self.columns);
        if columns <= nd {
            return self;
        }
        let row = |i: usize| &self.root[i * columns..(i + 1) * columns];
        let product = |k: usize| dot(row(k / nd), row(k % nd));
        let root = factor(&(0..nd * nd).map(product).collect::<Vec<f64>>(), nd);
        Taken { columns: nd, step: self.step, root }
    }

    /// The series that stand in for the noise of one output: the residuals of the step, then what
    /// was absorbed; NaN where `e` is. `g`: its sensitivities, `[sample][direction]`.
    pub fn series(&self, e: &[f64], g: &[f64]) -> Vec<Vec<f64>> {
        let nd = self.step.len();
        let left = |(k, e): (usize, &f64)| e - dot(&g[k * nd..(k + 1) * nd], &self.step);
        let mut all = vec![e.iter().enumerate().map(left).collect::<Vec<f64>>()];
        all.extend(combined(g, nd, &self.root, self.columns));
        for k in (0..e.len()).filter(|&k| e[k].is_nan()) {
            all.iter_mut().for_each(|column| column[k] = f64::NAN);
        }
        all
    }
}

/// `R` with `R R' = A^-1`, `[n][n]`; rows of what `A` does not determine are zero, as if it had
/// been held.
fn inverse_root(a: &[f64], n: usize) -> Vec<f64> {
    let l = factor(a, n);
    let mut root = vec![0.0; n * n];
    for column in (0..n).filter(|&c| l[c * n + c] > 0.0) {
        // L' x = e
        for i in (0..=column).rev().filter(|&i| l[i * n + i] > 0.0) {
            let known: f64 = (i + 1..=column).map(|j| l[j * n + i] * root[j * n + column]).sum();
            root[i * n + column] = (if i == column { 1.0 } else { 0.0 } - known) / l[i * n + i];
        }
    }
    root
}
