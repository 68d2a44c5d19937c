//! Columns of whitened numbers in; sums of their products, with columns eliminated one after the
//! other, out.
//!
//! With columns `X = [nuisances | wanted | e]`, eliminating the nuisances from `X'X` leaves the
//! products of what they cannot imitate: `H~'H~`, `H~'e~`, `e~'e~`. Only the upper triangle is
//! kept. A column that depends on those before it is left out, not divided by.

use super::tiles::{add_each, add_products};
use crate::math::simd::Width;

/// A pivot below this share of its column's own sum of squares is rounding: the column depends on
/// those before it.
pub const DEPENDENT: f64 = 1e-11;

/// Rows at a time.
pub(super) const PIECE: usize = 256;

/// Symmetric sums of products, upper triangle of `[n][n]`, and the sums of squares before anything
/// was eliminated.
#[derive(Debug, Clone, PartialEq)]
pub struct Gram {
    pub n: usize,
    pub sums: Vec<f64>,
    pub scale: Vec<f64>,
}

impl Gram {
    pub fn zero(n: usize) -> Gram {
        Gram { n, sums: vec![0.0; n * n], scale: vec![0.0; n] }
    }

    /// Products of columns of equal length.
    pub fn of<C: AsRef<[f64]>>(columns: &[C]) -> Gram {
        let n = columns.len();
        let sums = upper_rows(columns, n);
        let scale = (0..n).map(|i| sums[i * n + i]).collect();
        Gram { n, sums, scale }
    }

    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.sums[i.min(j) * self.n + i.max(j)]
    }

    /// Adds the rows and columns of `other` from `first` on, each to the place that `to` says.
    pub fn add(&mut self, other: &Gram, first: usize, to: &[usize]) {
        for (i, &a) in to.iter().enumerate() {
            self.scale[a] += other.scale[first + i];
            for (j, &b) in to.iter().enumerate().skip(i) {
                self.sums[a.min(b) * self.n + a.max(b)] +=
                    other.sums[(first + i) * other.n + first + j];
            }
        }
    }

    /// Adds to column `i` what a prior says: its weight, and its pull on the last column's fit.
    pub fn pull(&mut self, i: usize, (weight, pull): (f64, f64)) {
        let n = self.n;
        self.sums[i * n + i] += weight;
        self.scale[i] += weight;
        self.sums[i * n + n - 1] += pull;
    }

    /// Eliminates columns `from..to`; row `i` then holds what `solve` needs. Dependent columns
    /// become rows of zeros.
    pub fn eliminate(&mut self, from: usize, to: usize) {
        let n = self.n;
        for i in from..to {
            let pivot = self.sums[i * n + i];
            let (before, after) = self.sums.split_at_mut((i + 1) * n);
            let row = &mut before[i * n..];
            if !(pivot > DEPENDENT * self.scale[i]) {
                row[i..].fill(0.0);
                continue;
            }
            for j in i + 1..n {
                let factor = row[j] / pivot;
                if factor != 0.0 {
                    let target = &mut after[(j - i - 1) * n..(j - i) * n];
                    target[j..].iter_mut().zip(&row[j..]).for_each(|(t, r)| *t -= factor * r);
                }
            }
        }
    }

    /// Coefficients of the eliminated columns `from..to` that fit column `e`, once those of the
    /// columns behind them are known: the rest of `x` (`[n]`) is read, its entries `from..to` are
    /// written. Dependent ones are zero.
    pub fn solve(&self, from: usize, to: usize, e: usize, x: &mut [f64]) {
        let n = self.n;
        for i in (from..to).rev() {
            let row = &self.sums[i * n..(i + 1) * n];
            let known: f64 = (i + 1..n).filter(|&j| j != e).map(|j| row[j] * x[j]).sum();
            x[i] = if row[i] > 0.0 { (row[e] - known) / row[i] } else { 0.0 };
        }
    }

    /// The square block of these columns, full.
    pub fn block(&self, of: &[usize]) -> Vec<f64> {
        of.iter().flat_map(|&i| of.iter().map(move |&j| self.at(i, j))).collect()
    }

    /// Without rows and columns before `first`.
    pub fn rest(&self, first: usize) -> Gram {
        let mut rest = Gram::zero(self.n - first);
        rest.add(self, first, &(0..self.n - first).collect::<Vec<_>>());
        rest
    }
}

/// Products of each of the first `wanted` columns with itself and all behind it: `[wanted][columns]`,
/// zero before the diagonal.
pub fn upper_rows<C: AsRef<[f64]>>(columns: &[C], wanted: usize) -> Vec<f64> {
    let columns: Vec<&[f64]> = columns.iter().map(AsRef::as_ref).collect();
    let width = Width::detect();
    let rows = columns.iter().map(|column| column.len()).min().unwrap_or(0);
    let mut sums = vec![0.0; wanted * columns.len()];
    // Rows in pieces that stay in the cache while every column meets every other.
    for from in (0..rows).step_by(PIECE) {
        let rows = from..(from + PIECE).min(rows);
        let piece: Vec<&[f64]> = columns.iter().map(|column| &column[rows.clone()]).collect();
        // SAFETY: the width is this machine's.
        unsafe { add_products(width, &piece[..wanted], &piece, true, &mut sums) };
    }
    sums
}

/// Products of a column with each of some others of its length.
pub fn with_each(column: &[f64], others: &[Vec<f64>]) -> Vec<f64> {
    let others: Vec<&[f64]> = others.iter().map(Vec::as_slice).collect();
    let mut sums = vec![0.0; others.len()];
    // SAFETY: the width is this machine's.
    unsafe { add_products(Width::detect(), &[column], &others, false, &mut sums) };
    sums
}

/// Products of a series from sample `m` on with itself `0..=m` samples before.
pub fn with_lags(x: &[f64], m: usize) -> Vec<f64> {
    let mut sums = vec![0.0; m + 1];
    if x.len() > m {
        let before: Vec<&[f64]> = (0..=m).map(|lag| &x[m - lag..]).collect();
        // SAFETY: the width is this machine's.
        unsafe { add_products(Width::detect(), &[&x[m..]], &before, false, &mut sums) };
    }
    sums
}

/// Adds to sum `[i][j]` the `dot` of column `i` of `a`, all of one length, with column `j` of `b`, none of them
/// shorter.
pub fn add_dots(a: &[&[f64]], b: &[&[f64]], sums: &mut [f64]) {
    // SAFETY: the width is this machine's.
    unsafe { add_each(Width::detect(), a, b, sums) };
}

/// Number of sums that run side by side; fixed, so that the result is the same on every machine.
const LANES: usize = 8;

/// Sum of products over the shorter of both.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    dot_by::<LANES>(a, b)
}

/// The same in `L` sums side by side, for rows of which `L` is the vector.
#[inline(always)]
pub fn dot_by<const L: usize>(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; L];
    let (a, b) = (&a[..a.len().min(b.len())], &b[..a.len().min(b.len())]);
    for (x, y) in a.chunks_exact(L).zip(b.chunks_exact(L)) {
        for l in 0..L {
            sums[l] += x[l] * y[l];
        }
    }
    let rest = a.len() - a.len() % L;
    let tail: f64 = a[rest..].iter().zip(&b[rest..]).map(|(x, y)| x * y).sum();
    sums.iter().sum::<f64>() + tail
}

/// The lower factor `[n][n]` of a positive semidefinite matrix, `A = L L'`; columns of dependent
/// rows are zero.
pub fn factor(a: &[f64], n: usize) -> Vec<f64> {
    let mut l = vec![0.0; n * n];
    for j in 0..n {
        let pivot = a[j * n + j] - dot(&l[j * n..j * n + j], &l[j * n..j * n + j]);
        if !(pivot > 1e-12 * a[j * n + j]) {
            continue;
        }
        let root = pivot.sqrt();
        l[j * n + j] = root;
        for i in j + 1..n {
            l[i * n + j] = (a[i * n + j] - dot(&l[i * n..i * n + j], &l[j * n..j * n + j])) / root;
        }
    }
    l
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(f: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..37).map(|k| f(0.1 * f64::from(k))).collect()
    }

    #[test]
    fn what_is_left_after_elimination_is_the_residual_of_least_squares() {
        let columns = [
            column(|_| 1.0),
            column(|t| t),
            column(|t| t * t),
            column(|t| 2.0 + 3.0 * t - 0.5 * t * t + 0.1 * libm::sin(9.0 * t)),
        ];
        let mut gram = Gram::of(&columns);
        gram.eliminate(0, 3);
        let mut x = vec![0.0; 4];
        gram.solve(0, 3, 3, &mut x);
        let left: f64 = (0..37)
            .map(|k| columns[3][k] - (0..3).map(|i| x[i] * columns[i][k]).sum::<f64>())
            .map(|r| r * r)
            .sum();
        assert!((gram.at(3, 3) / left - 1.0).abs() < 1e-9, "{} {left}", gram.at(3, 3));
        assert!((x[1] - 3.0).abs() < 0.2, "{x:?}");
    }

    #[test]
    fn a_dependent_column_is_left_out() {
        let columns = [column(|t| t), column(|t| 2.0 * t), column(|t| 5.0 * t + libm::sin(t))];
        let (mut both, mut one) =
            (Gram::of(&columns), Gram::of(&[columns[0].clone(), columns[2].clone()]));
        both.eliminate(0, 2);
        one.eliminate(0, 1);
        assert!((both.at(2, 2) - one.at(1, 1)).abs() < 1e-9);
        let mut x = vec![0.0; 3];
        both.solve(0, 2, 2, &mut x);
        assert!(x[1] == 0.0 && x[0] > 4.0);
    }

    #[test]
    fn a_semidefinite_matrix_has_a_factor() {
        let a = [4.0, 2.0, 6.0, 2.0, 1.0, 3.0, 6.0, 3.0, 10.0];
        let l = factor(&a, 3);
        for i in 0..3 {
            for j in 0..3 {
                let product: f64 = (0..3).map(|k| l[i * 3 + k] * l[j * 3 + k]).sum();
                assert!((product - a[i * 3 + j]).abs() < 1e-12);
            }
        }
    }
}
