//! White columns of the base's parameters and of candidates in; what is left of the candidates' beside
//! the base's, and the noise that chance makes of it, out.
//!
//! With columns `[G | H | e]`, the base's parameters `G`, the candidates' `H` and the residuals `e`,
//! eliminating `G` leaves `H~'H~` and `H~'e`. A trial asks for the products of its own columns only,
//! and those alone are kept: all of them would be the square of some thousand columns.
//!
//! *Chance* needs to know how the columns of all candidates go together: `u = H~'w` with `w` white.
//! `w` is drawn on sums of samples with random signs instead of on samples (a sketch: Charikar, Chen and
//! Farach-Colton 2002): of every segment each sample is added, with a random sign, to one of some sums.
//! With `S` that map, `E[S'S] = 1`, so that `(S H~)'z` with `z` white has the covariance `H~'H~`
//! within `sqrt(2/K)` of its size, `K` being the number of sums. That concerns what columns of
//! different trials have in common; within a trial the covariance is made exact (`settled`).

use super::ground::Ground;
use crate::diagnose::base::spread::Columns;
use crate::math::pool;
use crate::math::products::{DEPENDENT, Gram, dot, upper_rows, with_each};
use crate::simulate::Stream;

/// Sums in which the samples of all segments are added up, and of each segment at least.
const SUMS: [usize; 2] = [2048, 64];

/// Sums of one segment, of so many.
pub fn sums_of_each(segments: usize) -> usize {
    SUMS[1].max(SUMS[0] / segments.max(1))
}

/// Products of nuisances with every column, and those of the others that are asked for.
#[derive(Debug, Clone)]
pub struct Sums {
    nuisances: usize,
    /// `[nuisance][column]`, upper part; the residuals are the last column.
    rows: Vec<f64>,
    /// Sums of squares of each column, before anything was eliminated.
    pub scale: Vec<f64>,
    /// Products with the residuals.
    pub slopes: Vec<f64>,
    /// Columns behind the nuisances whose products are asked for, and those.
    pairs: Vec<[usize; 2]>,
    pub products: Vec<f64>,
    /// Sums of samples of each column but the residuals.
    pub sketch: Vec<Vec<f64>>,
}

impl Sums {
    /// Without a sample.
    pub fn zero(nuisances: usize, pairs: Vec<[usize; 2]>, n: usize, sums: usize) -> Sums {
        Sums {
            nuisances,
            rows: vec![0.0; nuisances * n],
            scale: vec![0.0; n],
            slopes: vec![0.0; n],
            products: vec![0.0; pairs.len()],
            pairs,
            sketch: vec![vec![0.0; sums]; n - 1],
        }
    }

    /// Of white columns, nuisances first and the residuals last.
    fn of(columns: &[Vec<f64>], nuisances: usize, pairs: Vec<[usize; 2]>, rows: &Rows) -> Sums {
        let n = columns.len();
        let e = &columns[n - 1];
        let products = pairs.iter().map(|&[a, b]| dot(&columns[a], &columns[b])).collect();
        let sums = upper_rows(columns, nuisances);
        let square = |(i, column): (usize, &Vec<f64>)| match i < nuisances {
            true => sums[i * n + i],
            false => dot(column, column),
        };
        let scale = columns.iter().enumerate().map(square).collect();
        Sums {
            nuisances,
            rows: sums,
            scale,
            slopes: with_each(e, columns),
            pairs,
            products,
            sketch: columns[..n - 1].iter().map(|column| rows.added(column)).collect(),
        }
    }

    pub fn columns(&self) -> usize {
        self.scale.len()
    }

    /// Product of nuisance `i` with a column that does not stand before it.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.rows[i * self.columns() + j]
    }

    /// Adds to nuisance `i` what a prior says, its weight and its pull: a sample more, which goes into sum
    /// `at`.
    fn pull(&mut self, i: usize, (weight, pull): (f64, f64), at: (usize, f64)) {
        let n = self.columns();
        self.rows[i * n + i] += weight;
        self.scale[i] += weight;
        self.rows[i * n + n - 1] += pull;
        self.sketch[i][at.0] += at.1 * weight.sqrt();
    }

    /// Takes nuisances `from..to` out of everything behind them; one that depends on those before it
    /// is left out.
    pub fn eliminate(&mut self, from: usize, to: usize) {
        let n = self.columns();
        for i in from..to {
            let (before, after) = self.rows.split_at_mut((i + 1) * n);
            let row = &mut before[i * n..];
            let pivot = row[i];
            if !(pivot > DEPENDENT * self.scale[i]) {
                row[i..].fill(0.0);
                continue;
            }
            for j in i + 1..self.nuisances {
                let factor = row[j] / pivot;
                let target = &mut after[(j - i - 1) * n..(j - i) * n];
                target[j..].iter_mut().zip(&row[j..]).for_each(|(t, r)| *t -= factor * r);
            }
            let pairs = self.products.iter_mut().zip(&self.pairs);
            pairs.for_each(|(product, &[a, b])| *product -= row[a] * row[b] / pivot);
            let e = row[n - 1];
            let slopes = self.slopes.iter_mut().zip(&*row);
            slopes.skip(i + 1).for_each(|(slope, r)| *slope -= r * e / pivot);
            let (before, after) = self.sketch.split_at_mut(i + 1);
            for (sums, r) in after.iter_mut().zip(&row[i + 1..]) {
                let factor = r / pivot;
                sums.iter_mut().zip(&before[i]).for_each(|(x, own)| *x -= factor * own);
            }
        }
    }

    /// Adds a segment without the `own` parameters that were eliminated: its columns to the places `to`
    /// says, its products to those of `pairs`, its samples to the sums from `from` on.
    pub fn add(&mut self, part: &Part, from: usize) {
        let (n, m, own) = (self.columns(), part.sums.columns(), part.own);
        for (i, &a) in part.to.iter().enumerate() {
            self.scale[a] += part.sums.scale[own + i];
            self.slopes[a] += part.sums.slopes[own + i];
            if let (Some(to), Some(of)) = (self.sketch.get_mut(a), part.sums.sketch.get(own + i)) {
                to[from..from + of.len()].iter_mut().zip(of).for_each(|(x, of)| *x += of);
            }
        }
        for (i, &a) in part.to[..part.sums.nuisances - own].iter().enumerate() {
            for (j, &b) in part.to.iter().enumerate().skip(i) {
                self.rows[a.min(b) * n + a.max(b)] += part.sums.rows[(own + i) * m + own + j];
            }
        }
        for (&pair, product) in part.pairs.iter().zip(&part.sums.products) {
            self.products[pair] += product;
        }
    }

    /// What is known of the shared parameters `free` before the flights.
    pub fn priors(&mut self, ground: &Ground) {
        let sums = self.sketch.first().map_or(0, Vec::len);
        let rows = Rows::drawn(ground.seed, "shared", ground.free.len(), sums);
        for (place, &i) in ground.free.iter().enumerate() {
            self.pull(place, ground.case.layout.prior(i, ground.theta[i]), rows.0[place]);
        }
    }

    /// Product of a column behind the nuisances with itself, and the nuisances that imitate a unit of
    /// it most closely.
    pub fn imitated(&self, column: usize) -> (f64, Vec<f64>) {
        let n = self.nuisances;
        let own = self.pairs.iter().position(|pair| *pair == [column; 2]);
        let mut gram = Gram::zero(n + 1);
        for i in 0..n {
            (i..n).for_each(|j| gram.sums[i * (n + 1) + j] = self.at(i, j));
            gram.sums[i * (n + 1) + n] = self.at(i, column);
            gram.scale[i] = self.scale[i];
        }
        gram.eliminate(0, n);
        let mut x = vec![0.0; n + 1];
        gram.solve(0, n, n, &mut x);
        x.truncate(n);
        (own.map_or(0.0, |at| self.products[at]), x)
    }
}

/// Into which sum each sample is added, with which sign.
struct Rows(Vec<(usize, f64)>, usize);

impl Rows {
    fn drawn(seed: u64, name: &str, samples: usize, sums: usize) -> Rows {
        let mut stream = Stream::new(seed, &["diagnose", "sums of samples", name]);
        let one = |_| {
            let at = (2.0 * sums as f64 * stream.uniform()) as usize; // a sum and a sign
            (at / 2, if at.is_multiple_of(2) { 1.0 } else { -1.0 })
        };
        Rows((0..samples).map(one).collect(), sums)
    }

    fn added(&self, column: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.1];
        column.iter().zip(&self.0).for_each(|(x, (at, sign))| sums[*at] += sign * x);
        sums
    }
}

/// A segment: own parameters eliminated, then the shared ones it sees, its candidates' columns, the
/// residuals.
pub struct Part {
    own: usize,
    to: Vec<usize>,
    /// Places of its products among all.
    pairs: Vec<usize>,
    sums: Sums,
}

/// White columns of candidates in one segment.
pub struct Candidates {
    pub columns: Vec<Vec<f64>>,
    /// Place of each among those of all segments, and how many these are.
    pub places: Vec<usize>,
    pub of: usize,
    /// Columns that are multiplied, and the place of that product among all.
    pub pairs: Vec<([usize; 2], usize)>,
}

impl Part {
    /// `base`: columns of the base's parameters in segment `s`; `sums`: sums of its samples.
    pub fn of(
        ground: &Ground,
        s: usize,
        base: Columns,
        added: Candidates,
        (seed, sums): (u64, usize),
    ) -> Part {
        let layout = &ground.case.layout;
        let Columns { mut columns, mut to, residuals } = base;
        let (own, nuisances) = (layout.parts[s].own, columns.len());
        to.extend(added.places.iter().chain([&added.of]).map(|c| ground.free.len() + c));
        columns.extend(added.columns);
        let samples = residuals.len();
        columns.push(residuals);
        let rows = Rows::drawn(seed, &s.to_string(), samples + own, sums);
        let pair = |(pair, to): ([usize; 2], usize)| (pair.map(|c| nuisances + c), to);
        let (places, pairs): (Vec<[usize; 2]>, Vec<usize>) =
            added.pairs.into_iter().map(pair).unzip();
        let mut sums = Sums::of(&columns, nuisances, places, &rows);
        let offset = layout.parts[s].offset;
        for k in 0..own {
            let prior = layout.prior(offset + k, ground.theta[offset + k]);
            sums.pull(k, prior, rows.0[samples + k]);
        }
        sums.eliminate(0, own);
        columns.into_iter().for_each(pool::give);
        Part { own, to, pairs, sums }
    }
}
