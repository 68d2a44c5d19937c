//! Residuals of all segments in; the covariance `R` of the measurement noise per group of segments,
//! and the cost at it, out.
//!
//! Samples of different outputs at the same instant belong together; what is there at an instant is
//! its *pattern*. With `R` diagonal every sample stands alone. All that `R` and the cost need of
//! the residuals is, per pattern `m`, the number `n_m` of instants and the sum of products
//! `S_m = sum e e'` over them (the sub-block `R_m` weighs them):
//!
//! `J = 1/2 sum_m (n_m ln|R_m| + tr(R_m^-1 S_m) - n_m dim m)`
//!
//! which for complete instants is `N/2 ln|R|` at its minimum `R = S/N` (attas A4). Where patterns
//! differ, `R` is the minimum of `J` by expectation and maximisation: with `B = R_{:m} R_m^-1` the
//! missing residuals are replaced by what those at hand say of them,
//! `R <- 1/N sum_m (B S_m B' + n_m (R - B R_{m:}))`, which lowers `J` in every round and keeps `R`
//! positive definite. Two outputs that never share an instant keep a covariance of zero.
//!
//! `R` is never smaller than the floor `F` (diagonal): `R - F` stays positive semidefinite, so that
//! neither one output nor any combination of them gets more weight than the floor allows. Each
//! round's minimum under that condition is known in closed form: eigenvalues of `F^-1/2 A F^-1/2`
//! below one are raised to one. Because `R` minimises `J` at every parameter vector, the gradient
//! of the concentrated cost is the gradient at fixed `R`.

use crate::math::dense::{self, multiply};
use crate::math::products::dot;
use serde::{Deserialize, Serialize};

/// Rounds of expectation and maximisation, and the relative change that ends them: its square is
/// what is missing in the cost.
const ROUNDS: usize = 2000;
const SETTLED: f64 = 1e-12;

/// How noise is structured.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// Number of scored outputs.
    pub outputs: usize,
    /// Number of groups of segments, each with an `R` of its own.
    pub groups: usize,
    /// Outputs may be correlated.
    pub full: bool,
    /// Per output, the smallest variance it may be given.
    pub floor: Vec<f64>,
    /// `R` is one and stays so: the residuals come white. Then only for `full: false`.
    pub known: bool,
}

impl Structure {
    /// One diagonal `R` for all segments: sums per output can be weighed after they are added.
    pub fn is_simple(&self) -> bool {
        !self.full && self.groups == 1
    }
}

/// Outputs present at the same instants.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Pattern {
    /// Ascending.
    outputs: Vec<usize>,
    count: usize,
    /// `S_m`, `[m][m]`, lower triangle.
    products: Vec<f64>,
}

/// What is known of the residuals of one segment, or one group of them.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Scatter(Vec<Pattern>);

impl Scatter {
    fn pattern(&mut self, outputs: &[usize]) -> &mut Pattern {
        let found = self.0.iter().position(|p| p.outputs == outputs);
        let at = found.unwrap_or_else(|| {
            let m = outputs.len();
            self.0.push(Pattern {
                outputs: outputs.to_vec(),
                count: 0,
                products: vec![0.0; m * m],
            });
            self.0.len() - 1
        });
        &mut self.0[at]
    }

    /// `count` samples of one output that stand alone, with this sum of squares.
    pub fn add_alone(&mut self, output: usize, count: usize, square: f64) {
        let pattern = self.pattern(&[output]);
        pattern.count += count;
        pattern.products[0] += square;
    }

    /// Residuals `e` of `outputs` (ascending) at one instant.
    pub fn add_together(&mut self, outputs: &[usize], e: &[f64]) {
        let m = outputs.len();
        let pattern = self.pattern(outputs);
        pattern.count += 1;
        for (i, ei) in e.iter().enumerate() {
            pattern.products[i * m..i * m + i + 1]
                .iter_mut()
                .zip(e)
                .for_each(|(s, ej)| *s += ei * ej);
        }
    }

    pub fn merge(&mut self, other: &Scatter) {
        for p in &other.0 {
            let mine = self.pattern(&p.outputs);
            mine.count += p.count;
            mine.products.iter_mut().zip(&p.products).for_each(|(a, b)| *a += b);
        }
    }

    pub fn is_finite(&self) -> bool {
        self.0.iter().all(|p| p.products.iter().all(|v| v.is_finite()))
    }

    /// Scored samples per output.
    pub fn counts(&self, outputs: usize) -> Vec<usize> {
        let mut counts = vec![0; outputs];
        self.0.iter().for_each(|p| p.outputs.iter().for_each(|&j| counts[j] += p.count));
        counts
    }

    /// The largest likelihood's `R`; `None` where it is not finite.
    pub fn covariance(&self, structure: &Structure) -> Option<Covariance> {
        let (n, floor) = (structure.outputs, &structure.floor);
        let count = self.counts(n);
        let mut r = vec![0.0; n * n];
        for j in 0..n {
            let of = |p: &Pattern| {
                p.outputs.iter().position(|&o| o == j).map(|i| p.products[i * p.outputs.len() + i])
            };
            let square: f64 = self.0.iter().filter_map(of).sum();
            r[j * n + j] = if count[j] > 0 && !structure.known {
                (square / count[j] as f64).max(floor[j])
            } else {
                1.0
            };
        }
        if structure.full {
            self.settle(&mut r, &count, floor)?;
        }
        let mut covariance =
            Covariance { n, r, count, weights: Vec::new(), cost: 0.0, ln_det: 0.0 };
        for p in &self.0 {
            let weight = Weight::new(&covariance, &p.outputs)?;
            // J, the part of this pattern: tr(R_m^-1 S_m) from the lower triangle of the symmetric
            // S_m.
            let (m, w) = (p.outputs.len(), &weight.inverse);
            let trace: f64 = (0..m)
                .map(|i| {
                    w[i * m + i] * p.products[i * m + i]
                        + 2.0 * dot(&w[i * m..], &p.products[i * m..i * m + i])
                })
                .sum();
            covariance.cost += 0.5 * (p.count as f64 * (weight.ln_det - m as f64) + trace);
            covariance.weights.push(weight);
        }
        if structure.known {
            // J = 1/2 sum e'e; its share of a sample stands for ln|R|, of which it is the change to
            // first order.
            let samples = covariance.count.iter().sum::<usize>() as f64;
            covariance.cost += 0.5 * samples;
            covariance.ln_det = 2.0 * covariance.cost / samples.max(1.0);
            return covariance.cost.is_finite().then_some(covariance);
        }
        let scored: Vec<usize> = (0..n).filter(|&j| covariance.count[j] > 0).collect();
        covariance.ln_det = Weight::new(&covariance, &scored)?.ln_det;
        covariance.cost.is_finite().then_some(covariance)
    }

    /// Rounds of expectation and maximisation from a diagonal `r`.
    fn settle(&self, r: &mut [f64], count: &[usize], floor: &[f64]) -> Option<()> {
        let n = count.len();
        let instants: usize = self.0.iter().map(|p| p.count).sum();
        for _ in 0..ROUNDS {
            let mut a = vec![0.0; n * n];
            for p in self.0.iter().filter(|p| p.count > 0) {
                p.expect(r, n, &mut a)?;
            }
            a.iter_mut().for_each(|a| *a /= instants.max(1) as f64);
            raise(&mut a, floor);
            let change = (0..n * n).map(|k| {
                let (i, j) = (k / n, k % n);
                (a[k] - r[k]).abs() / (a[i * n + i] * a[j * n + j]).sqrt()
            });
            let change = change.fold(0.0, f64::max);
            r.copy_from_slice(&a);
            if !change.is_finite() {
                return None;
            }
            if change <= SETTLED {
                break;
            }
        }
        Some(())
    }
}

impl Pattern {
    /// Adds `B S_m B' + n_m (R - B R_{m:})`.
    fn expect(&self, r: &[f64], n: usize, a: &mut [f64]) -> Option<()> {
        let m = self.outputs.len();
        let block = square(r, n, &self.outputs);
        let inverse = dense::cholesky_inverse(&dense::cholesky(&block, m).ok()?, m);
        let across: Vec<f64> =
            (0..n).flat_map(|i| self.outputs.iter().map(move |&j| r[i * n + j])).collect();
        let b = multiply(&across, &inverse, n, m, m);
        let mut s = vec![0.0; m * m];
        for i in 0..m {
            for j in 0..m {
                // B S B' - n B R_{m:} = B (S - n R_m) B'
                s[i * m + j] =
                    self.products[i.max(j) * m + i.min(j)] - self.count as f64 * block[i * m + j];
            }
        }
        let bs = multiply(&b, &s, n, m, m);
        for i in 0..n {
            for j in 0..=i {
                let value = dot(&bs[i * m..(i + 1) * m], &b[j * m..(j + 1) * m])
                    + self.count as f64 * r[i * n + j];
                a[i * n + j] += value;
                if i != j {
                    a[j * n + i] += value;
                }
            }
        }
        Some(())
    }
}

/// The smallest raise of `a` that makes `a - floor` positive semidefinite (`floor` diagonal).
fn raise(a: &mut [f64], floor: &[f64]) {
    let n = floor.len();
    let mut above = a.to_vec();
    (0..n).for_each(|i| above[i * n + i] -= floor[i]);
    if dense::cholesky(&above, n).is_ok() {
        return;
    }
    let root: Vec<f64> = floor.iter().map(|f| f.sqrt()).collect();
    let scaled: Vec<f64> = (0..n * n).map(|k| a[k] / (root[k / n] * root[k % n])).collect();
    let eigen = dense::symmetric_eigen(&scaled, n);
    for i in 0..n {
        for j in 0..n {
            let product = |e: usize| {
                eigen.values[e].max(1.0) * eigen.vectors[e * n + i] * eigen.vectors[e * n + j]
            };
            a[i * n + j] = root[i] * root[j] * (0..n).map(product).sum::<f64>();
        }
    }
}

/// `R` of one group of segments.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Covariance {
    /// Number of outputs.
    pub n: usize,
    /// `[n][n]`; 1 on the diagonal for an output without samples.
    pub r: Vec<f64>,
    /// Scored samples per output.
    pub count: Vec<usize>,
    /// One per pattern.
    weights: Vec<Weight>,
    /// Negative log-likelihood of the group without its constants.
    pub cost: f64,
    /// `ln|R|` over the outputs that have samples; where `R` is known, the mean square of the
    /// residuals.
    pub ln_det: f64,
}

impl Covariance {
    /// A diagonal one, without residuals: for tests.
    #[cfg(test)]
    pub fn diagonal(variances: &[f64], count: &[usize]) -> Covariance {
        let n = variances.len();
        let mut r = vec![0.0; n * n];
        (0..n).for_each(|j| r[j * n + j] = variances[j]);
        let mut c =
            Covariance { n, r, count: count.to_vec(), weights: Vec::new(), cost: 0.0, ln_det: 0.0 };
        c.weights = (0..n).filter_map(|j| Weight::new(&c, &[j])).collect();
        c
    }

    /// Variances.
    pub fn variances(&self) -> Vec<f64> {
        (0..self.n).map(|j| self.r[j * self.n + j]).collect()
    }

    pub fn correlation(&self, i: usize, j: usize) -> f64 {
        let n = self.n;
        if i == j {
            1.0
        } else {
            self.r[i * n + j] / (self.r[i * n + i] * self.r[j * n + j]).sqrt()
        }
    }

    /// How residuals of these outputs at one instant are weighed.
    pub fn weight(&self, outputs: &[usize]) -> Option<&Weight> {
        self.weights.iter().find(|w| w.outputs == outputs)
    }
}

/// `R_m = C C'` of one pattern.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Weight {
    outputs: Vec<usize>,
    /// `C^-1`, `[m][m]`, lower triangle: rows `C^-1 G_m` have noise of covariance one.
    pub root: Vec<f64>,
    /// `R_m^-1`, `[m][m]`.
    pub inverse: Vec<f64>,
    ln_det: f64,
}

impl Weight {
    fn new(covariance: &Covariance, outputs: &[usize]) -> Option<Weight> {
        let m = outputs.len();
        let l = dense::cholesky(&square(&covariance.r, covariance.n, outputs), m).ok()?;
        let mut root = vec![0.0; m * m];
        for j in 0..m {
            let mut column = vec![0.0; m];
            column[j] = 1.0;
            dense::forward(&l, m, &mut column);
            (0..m).for_each(|i| root[i * m + j] = column[i]);
        }
        let inverse = dense::cholesky_inverse(&l, m);
        Some(Weight {
            outputs: outputs.to_vec(),
            root,
            inverse,
            ln_det: dense::cholesky_log_det(&l, m),
        })
    }
}

/// Rows and columns `of` of a square matrix of size `n`.
fn square(matrix: &[f64], n: usize, of: &[usize]) -> Vec<f64> {
    of.iter().flat_map(|&i| of.iter().map(move |&j| matrix[i * n + j])).collect()
}
