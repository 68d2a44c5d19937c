//! Products of a trial's columns, exact and of their sums of samples, in; those that are told apart, with
//! the map that makes noise drawn on the sums exact, out.

use crate::math::products::{DEPENDENT, dot};

/// Columns of a trial that are told apart.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settled {
    /// Their places in the trial.
    pub kept: Vec<usize>,
    /// Of the others those that depend on them and the base together, and on neither alone.
    pub dependent: Vec<usize>,
    /// Their information, `[k][k]`.
    pub information: Vec<f64>,
    /// `T` with `T A T' = F`, of the information `F` and that of the sums, `A`; `[k][k]`, lower. None
    /// where the sums are too few.
    exact: Option<Vec<f64>>,
}

impl Settled {
    /// `products`: of all its columns, `[k][k]`; `raw`: their sums of squares before anything was
    /// eliminated; `sound`: whether enough of a column is left beside the base; `sums`: sums of
    /// samples of each.
    ///
    /// A column that depends on those before it in the trial, as far as rounding lets it be told, is
    /// left out: what the products say of the difference of both is rounding, and noise drawn for both
    /// would be set against that.
    pub fn of(products: &[f64], raw: &[f64], sound: &[bool], sums: &[&[f64]]) -> Settled {
        let n = raw.len();
        let at = |i: usize, j: usize| products[i * n + j];
        let (mut kept, mut factor): (Vec<usize>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
        let mut dependent = Vec::new();
        for j in (0..n).filter(|&j| sound[j]) {
            let mut row: Vec<f64> = Vec::new();
            for (k, &i) in kept.iter().enumerate() {
                row.push((at(i, j) - dot(&factor[k][..k], &row)) / factor[k][k]);
            }
            let pivot = at(j, j) - dot(&row, &row);
            if pivot > DEPENDENT * raw[j] {
                row.push(pivot.sqrt());
                factor.push(row);
                kept.push(j);
            } else {
                dependent.push(j);
            }
        }
        let information = kept.iter().flat_map(|&i| kept.iter().map(move |&j| at(i, j))).collect();
        let exact = exact(&factor, &kept.iter().map(|&j| sums[j]).collect::<Vec<_>>());
        Settled { kept, dependent, information, exact }
    }

    /// Slopes with the exact covariance, of slopes drawn on sums of samples; nothing where those are
    /// too few.
    pub fn drawn(&self, slopes: &[f64]) -> Vec<f64> {
        let k = self.kept.len();
        match &self.exact {
            Some(t) => (0..k).map(|i| dot(&t[i * k..i * k + i + 1], &slopes[..i + 1])).collect(),
            None => vec![0.0; k],
        }
    }
}

/// `L M^-1` of the factors of `F = L L'` and `A = M M'`.
fn exact(l: &[Vec<f64>], sums: &[&[f64]]) -> Option<Vec<f64>> {
    let k = l.len();
    let mut m: Vec<Vec<f64>> = Vec::new();
    for (j, column) in sums.iter().enumerate() {
        let mut row: Vec<f64> = Vec::new();
        for i in 0..j {
            row.push((dot(sums[i], column) - dot(&m[i][..i], &row)) / m[i][i]);
        }
        let square = dot(column, column);
        let pivot = square - dot(&row, &row);
        if !(pivot > DEPENDENT * square) {
            return None;
        }
        row.push(pivot.sqrt());
        m.push(row);
    }
    // T M = L, row by row from the back.
    let mut t = vec![0.0; k * k];
    for i in 0..k {
        for j in (0..=i).rev() {
            let known: f64 = (j + 1..=i).map(|c| t[i * k + c] * m[c][j]).sum();
            t[i * k + j] = (l[i][j] - known) / m[j][j];
        }
    }
    Some(t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Stream;

    fn columns() -> [Vec<f64>; 3] {
        let mut stream = Stream::new(1, &["settled"]);
        let mut one = || (0..400).map(|_| stream.normal()).collect::<Vec<f64>>();
        let (a, b) = (one(), one());
        let c = a.iter().zip(&b).map(|(a, b)| a + 0.3 * b).collect();
        [a, c, b]
    }

    #[test]
    fn what_depends_on_the_columns_before_it_is_left_out() {
        let all = columns();
        let products: Vec<f64> = all.iter().flat_map(|a| all.iter().map(|b| dot(a, b))).collect();
        let raw: Vec<f64> = all.iter().map(|a| dot(a, a)).collect();
        let sums: Vec<&[f64]> = all.iter().map(Vec::as_slice).collect();
        let of = |sound: [bool; 3]| Settled::of(&products, &raw, &sound, &sums);
        assert_eq!(of([true, true, true]).kept, [0, 1]);
        assert_eq!(of([true, false, true]).kept, [0, 2]);
        let pair = of([false, true, true]);
        assert_eq!((pair.kept.len(), pair.information.len()), (2, 4));
        // The sums are all samples here: nothing is to be made exact.
        let drawn = pair.drawn(&[1.5, -2.0]);
        assert!((drawn[0] - 1.5).abs() < 1e-12 && (drawn[1] + 2.0).abs() < 1e-9, "{drawn:?}");
    }

    #[test]
    fn drawn_noise_has_the_exact_covariance() {
        let all = columns();
        let (half, rest) = (&all[1][..250], &all[2][..250]);
        let products = [900.0, 100.0, 100.0, 50.0];
        let settled = Settled::of(&products, &[900.0, 50.0], &[true, true], &[half, rest]);
        // T A T' = F
        let a = [dot(half, half), dot(half, rest), dot(half, rest), dot(rest, rest)];
        let columns: Vec<Vec<f64>> =
            (0..2).map(|i| settled.drawn(&[f64::from(i == 0), f64::from(i == 1)])).collect();
        for i in 0..2 {
            for j in 0..2 {
                let f: f64 = (0..4).map(|k| columns[k / 2][i] * a[k] * columns[k % 2][j]).sum();
                assert!((f - products[2 * i + j]).abs() < 1e-9 * products[0], "{i} {j} {f}");
            }
        }
    }
}
