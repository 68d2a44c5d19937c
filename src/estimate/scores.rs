//! Normal equations with further shared parameters in; by how much each of them, or some together, lowers the cost,
//! one taken after the other (forward selection), out.
//!
//! With `b` the parameters that are estimated anyhow and `x` a further one, the step of both lowers the cost by
//! `1/2 h^2 / m` more than that of `b` alone, where `m = M_xx - M_xb M_bb^-1 M_bx` is the information that is left on
//! `x` and `h = g_x - M_xb M_bb^-1 g_b` what is left of its gradient. One that is taken is swept out of all others.

use crate::least_squares::{Arrow, PIVOT};
use crate::math::products::dot;

/// Further parameters, or sums of some.
pub(super) struct Scores {
    n: usize,
    /// Information that is left, `[n][n]`.
    left: Vec<f64>,
    /// Gradient that is left.
    pull: Vec<f64>,
    /// Information of each by itself.
    whole: Vec<f64>,
}

impl Scores {
    /// Of `candidates`, each of them further parameters (places in the vector) that are one and the same. `is_base`
    /// says which parameters are estimated anyhow; none where these are not determined.
    pub fn of(
        (matrix, gradient): (&Arrow, &[f64]),
        is_base: &dyn Fn(usize) -> bool,
        candidates: &[Vec<usize>],
    ) -> Option<Scores> {
        let n = candidates.len();
        let (mut base, mut rhs) = (matrix.clone(), gradient.to_vec());
        (0..rhs.len()).filter(|&i| !is_base(i)).for_each(|i| base.pin(&mut rhs, i, 0.0));
        let factor = base.factor().ok()?;
        let step = factor.solve(&rhs);
        let columns: Vec<Vec<f64>> = candidates.iter().map(|of| sum(matrix, of)).collect();
        let known = |column: &Vec<f64>| {
            let part = |(i, x): (usize, &f64)| if is_base(i) { *x } else { 0.0 };
            column.iter().enumerate().map(part).collect()
        };
        let with_base: Vec<Vec<f64>> = columns.iter().map(known).collect();
        let of = |from: &[f64], places: &[usize]| places.iter().map(|&i| from[i]).sum::<f64>();
        let pull = candidates.iter().zip(&with_base);
        let pull = pull.map(|(places, column)| of(gradient, places) - dot(column, &step)).collect();
        let mut left = Vec::with_capacity(n * n);
        for (places, column) in candidates.iter().zip(&with_base) {
            let solved = factor.solve(column);
            let others = columns.iter().zip(&with_base);
            left.extend(others.map(|(column, base)| of(column, places) - dot(base, &solved)));
        }
        let whole = candidates.iter().zip(&columns).map(|(places, column)| of(column, places));
        Some(Scores { n, left, pull, whole: whole.collect() })
    }

    /// By how much a candidate lowers the cost; none of one that those before it determine.
    pub fn gain(&self, j: usize) -> Option<f64> {
        let left = self.left[j * self.n + j];
        (left > PIVOT * self.whole[j]).then(|| 0.5 * self.pull[j] * self.pull[j] / left)
    }

    /// Takes a candidate: what is left of the others is what it leaves of them.
    pub fn take(&mut self, j: usize) {
        let n = self.n;
        let row: Vec<f64> = self.left[j * n..(j + 1) * n].to_vec();
        let (pivot, pull) = (row[j], self.pull[j]);
        for a in 0..n {
            let share = row[a] / pivot;
            self.left[a * n..(a + 1) * n].iter_mut().zip(&row).for_each(|(x, y)| *x -= share * y);
            self.pull[a] -= share * pull;
        }
    }
}

/// The column of parameters that are one and the same.
fn sum(matrix: &Arrow, places: &[usize]) -> Vec<f64> {
    let mut all = vec![0.0; matrix.diagonal().len()];
    for &i in places {
        all.iter_mut().zip(matrix.column(i)).for_each(|(sum, x)| *sum += x);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::least_squares::Own;

    /// Four shared parameters and a segment with one of its own, of `rows` of sensitivities and residuals.
    fn equations(rows: &[[f64; 6]]) -> (Arrow, Vec<f64>) {
        let mut own = Own::empty(1, &[0, 1, 2, 3]);
        let (mut cc, mut gradient) = (vec![0.0; 16], vec![0.0; 5]);
        for row in rows {
            (0..16).for_each(|k| cc[k] += row[k / 4] * row[k % 4]);
            (0..4).for_each(|k| own.sc[k] += row[4] * row[k]);
            own.ss[0] += row[4] * row[4];
            (0..5).for_each(|k| gradient[k] += row[k] * row[5]);
        }
        (Arrow { shared: 4, cc, own: vec![own] }, gradient)
    }

    /// By how much the step of these parameters lowers the cost.
    fn promised((matrix, gradient): (&Arrow, &[f64]), free: &[usize]) -> f64 {
        let (mut matrix, mut rhs) = (matrix.clone(), gradient.to_vec());
        (0..5).filter(|i| !free.contains(i)).for_each(|i| matrix.pin(&mut rhs, i, 0.0));
        let step = matrix.factor().unwrap().solve(&rhs);
        0.5 * dot(&step, gradient)
    }

    #[test]
    fn gains_are_those_of_the_whole_step() {
        let mut x = 0.3f64;
        let mut next = || {
            x = (x * 997.0 + 0.123).fract();
            x - 0.5
        };
        let rows: Vec<[f64; 6]> = (0..40).map(|_| std::array::from_fn(|_| next())).collect();
        let (matrix, gradient) = equations(&rows);
        let of = (&matrix, &*gradient);
        let base = |i: usize| i == 0 || i == 4;
        // each alone, and the last two as one
        let sums: Vec<[f64; 6]> =
            rows.iter().map(|r| [r[0], r[1], r[2] + r[3], r[3], r[4], r[5]]).collect();
        let (joined, pull) = equations(&sums);
        let joined = (&joined, &*pull);
        let candidates = [vec![1], vec![2], vec![3], vec![2, 3]];
        let mut scores = Scores::of(of, &base, &candidates).unwrap();
        let alone = promised(of, &[0, 4]);
        let near = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 1e-12, "{a:?} {b}");
        near(scores.gain(0), promised(of, &[0, 1, 4]) - alone);
        near(scores.gain(2), promised(of, &[0, 3, 4]) - alone);
        near(scores.gain(3), promised(joined, &[0, 2, 4]) - alone);
        scores.take(0);
        let taken = promised(of, &[0, 1, 4]);
        near(scores.gain(1), promised(of, &[0, 1, 2, 4]) - taken);
        near(scores.gain(3), promised(joined, &[0, 1, 2, 4]) - taken);
        scores.take(1);
        scores.take(2);
        assert_eq!(scores.gain(3), None, "those before it determine it");
    }
}
