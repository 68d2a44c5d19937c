//! Standard deviations of points and what the points have in common in, the inverse of their
//! covariance out, applied to vectors in time linear in the points.
//!
//! `V = D + U U'` with the points' own variances `D` and the effects `U` of independent sources, which
//! fall into groups without common points; per group (Woodbury 1950)
//! `V^-1 v = W v - W U (I + U' W U)^-1 U' W v`, `W = D^-1`.

use crate::math::dense::{cholesky, cholesky_solve};

/// What a group of points has in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Shared {
    /// Number of the group. Lines through estimates of the same groups share their sources.
    pub group: usize,
    /// How many independent sources there are.
    pub sources: usize,
    /// Places of the points; none is in two groups.
    pub points: Vec<usize>,
    /// What an error of one sd of a source does to a point, in units of y: all sources of the first
    /// point, then those of the next one.
    pub effects: Vec<f64>,
}

/// The least part of a point's variance that is its own: claims that leave less are rounding.
const OWN: f64 = 1e-6;

/// The inverse of a covariance.
pub struct Weights {
    /// Inverses of the points' own variances.
    own: Vec<f64>,
    groups: Vec<Group>,
}

struct Group {
    /// Effects in units of the smallest sd.
    shared: Shared,
    /// Cholesky factor of `I + U' W U`.
    factor: Vec<f64>,
}

impl Shared {
    /// Places of the points with their effects.
    pub fn rows(&self) -> impl Iterator<Item = (usize, &[f64])> {
        self.points.iter().copied().zip(self.effects.chunks(self.sources.max(1)))
    }
}

impl Weights {
    /// Of points with claimed standard deviations `sd` (those parts in them that are `shared`) and
    /// scatter of variance `tau2`, in units of `unit`.
    pub fn new(sd: &[f64], shared: &[Shared], unit: f64, tau2: f64) -> Weights {
        let mut own: Vec<f64> = sd.iter().map(|s| (s / unit) * (s / unit)).collect();
        for group in shared {
            for (point, effects) in group.rows() {
                let common: f64 = effects.iter().map(|u| (u / unit) * (u / unit)).sum();
                own[point] = (own[point] - common).max(OWN * own[point]);
            }
        }
        own.iter_mut().for_each(|v| *v = 1.0 / (*v + tau2));
        let groups = shared.iter().filter_map(|group| Group::new(group, &own, unit)).collect();
        Weights { own, groups }
    }

    /// `V^-1 v`.
    pub fn times(&self, v: &[f64]) -> Vec<f64> {
        let mut out: Vec<f64> = v.iter().zip(&self.own).map(|(v, w)| v * w).collect();
        for group in &self.groups {
            let mut sums = vec![0.0; group.shared.sources];
            for (point, effects) in group.shared.rows() {
                sums.iter_mut().zip(effects).for_each(|(sum, u)| *sum += u * out[point]);
            }
            cholesky_solve(&group.factor, group.shared.sources, &mut sums);
            for (point, effects) in group.shared.rows() {
                let through: f64 = effects.iter().zip(&sums).map(|(u, sum)| u * sum).sum();
                out[point] -= self.own[point] * through;
            }
        }
        out
    }
}

impl Group {
    /// None without sources.
    fn new(shared: &Shared, own: &[f64], unit: f64) -> Option<Group> {
        let n = shared.sources;
        let effects = shared.effects.iter().map(|u| u / unit).collect();
        let shared = Shared { effects, ..shared.clone() };
        let mut sums = vec![0.0; n * n];
        (0..n).for_each(|k| sums[k * n + k] = 1.0);
        for (point, effects) in shared.rows() {
            for (row, a) in sums.chunks_mut(n.max(1)).zip(effects) {
                row.iter_mut().zip(effects).for_each(|(sum, b)| *sum += own[point] * a * b);
            }
        }
        let factor = cholesky(&sums, n).ok().filter(|_| n > 0)?;
        Some(Group { shared, factor })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_the_inverse_of_the_covariance() {
        let sd = [2.0, 3.0, 4.0, 1.5, 2.5];
        let shared = [
            Shared {
                group: 0,
                sources: 2,
                points: vec![0, 3, 4],
                effects: vec![1.0, 0.5, -0.3, 0.8, 2.0, 0.1],
            },
            Shared { group: 1, sources: 1, points: vec![1, 2], effects: vec![2.0, -1.0] },
        ];
        let (unit, tau2) = (1.5, 0.7);
        let mut covariance = [0.0; 25];
        (0..5).for_each(|i| covariance[i * 6] = sd[i] * sd[i] + tau2 * unit * unit);
        for group in &shared {
            let row = |k: usize| &group.effects[k * group.sources..][..group.sources];
            for (a, &i) in group.points.iter().enumerate() {
                for (b, &j) in group.points.iter().enumerate().filter(|(_, j)| i != **j) {
                    covariance[i * 5 + j] = row(a).iter().zip(row(b)).map(|(u, v)| u * v).sum();
                }
            }
        }
        let v = [1.0, -2.0, 0.5, 3.0, 0.2];
        let times = Weights::new(&sd, &shared, unit, tau2).times(&v);
        for (row, wanted) in covariance.chunks(5).zip(v) {
            let back: f64 = row.iter().zip(&times).map(|(a, b)| a * b).sum::<f64>() / unit / unit;
            assert!((back - wanted).abs() < 1e-12, "{back} {wanted}");
        }
    }

    #[test]
    fn a_group_without_sources_changes_nothing() {
        let none = Shared { group: 0, sources: 0, points: vec![0, 1], effects: vec![] };
        assert_eq!(Weights::new(&[1.0, 2.0], &[none], 1.0, 0.0).times(&[1.0, 1.0]), [1.0, 0.25]);
    }
}
