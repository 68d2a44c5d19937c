//! An autoregressive model in; series made white, and products with its covariance matrix, in time
//! linear in the number of samples, out.
//!
//! `Sigma = A^-1 D A^-T` of a process that starts stationary: row `i` of `A` is the predictor of
//! the order `min(i, p)`, so that the first samples of a series count as what they are, and `D`
//! holds the variances of the predictions' errors. `D^-1/2 A r` is white, of unit variance.

use super::ar::Ar;
use super::gaps::{Gaps, innovation};
use crate::math::mixed::{Term, mix};
use crate::math::products::dot;
use crate::math::simd::{Eight, Width, by_width};

/// The predictors of a process, of every order.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    /// `predictors[q]`: coefficients of the predictor of order q, `0..=p`.
    predictors: Vec<Vec<f64>>,
    /// Variance of the error of each.
    variances: Vec<f64>,
}

impl Filter {
    pub fn new(model: &Ar) -> Filter {
        Filter { predictors: model.predictors(), variances: model.errors() }
    }

    /// Whether there is noise to divide by.
    pub fn is_definite(&self) -> bool {
        self.variances.iter().all(|v| *v > 0.0 && v.is_finite())
    }

    fn order(&self, i: usize) -> usize {
        i.min(self.predictors.len() - 1)
    }

    /// A series made white, `D^-1/2 A x`; `masked[i]` tells which samples were not measured.
    pub fn whiten(&self, x: &mut [f64], masked: &[bool]) {
        self.whiten_all([&mut x[..]].into_iter(), masked);
    }

    /// Series that were measured at the same samples, each made white: what was measured comes out
    /// with unit covariance (`gaps`), and what was not as 0, whatever it held.
    pub fn whiten_all<'a>(&self, columns: impl Iterator<Item = &'a mut [f64]>, masked: &[bool]) {
        let gaps = Gaps::new(&self.predictors, &self.variances, masked);
        let mut measured = Vec::new();
        for x in columns {
            if gaps.are_none() {
                self.ordinary(x);
                continue;
            }
            let unmeasured = masked.iter().zip(x.iter_mut()).filter(|(masked, _)| **masked);
            unmeasured.for_each(|(_, x)| *x = 0.0);
            measured.clear();
            measured.extend_from_slice(x);
            self.ordinary(x);
            gaps.bridge(&self.predictors, &mut measured, x);
        }
    }

    /// Every sample less its prediction from measured ones, over the sd of that; in place.
    fn ordinary(&self, x: &mut [f64]) {
        let last = self.predictors.len() - 1;
        // From order p on the predictor stays the same.
        if x.len() > last {
            let scale = 1.0 / self.variances[last].sqrt();
            predicted(x, &self.predictors[last], scale);
        }
        // Samples are predicted from those before them: from the last one down.
        for i in (0..last.min(x.len())).rev() {
            x[i] = innovation(&self.predictors[i], &x[..=i]) / self.variances[i].sqrt();
        }
    }

    /// Rows `[sample][n]` of series that were measured throughout, each series made white, into `to`.
    pub fn whiten_rows(&self, x: &[f64], n: usize, to: &mut [f64]) {
        let back = |(j, a): (usize, &f64)| Term { factor: -a, row: -(((j + 1) * n) as isize) };
        let terms: Vec<Vec<Term>> =
            self.predictors.iter().map(|of| of.iter().enumerate().map(back).collect()).collect();
        let (last, samples) = (terms.len() - 1, x.len().checked_div(n).unwrap_or(0));
        let mut white = |from: usize, until: usize| {
            let order = self.order(from);
            let scale = 1.0 / self.variances[order].sqrt();
            mix((x, from * n, &terms[order]), (to, from * n, &[]), (until - from) * n, scale);
        };
        (0..last.min(samples)).for_each(|sample| white(sample, sample + 1));
        // From order p on the predictor stays the same: rows are one row of all their numbers.
        if samples > last {
            white(last, samples);
        }
    }

    /// `A^-T g` for rows `[sample][nd]`.
    pub fn backward(&self, g: &[f64], nd: usize) -> Vec<f64> {
        let mut v = g.to_vec();
        let n = g.len().checked_div(nd).unwrap_or(0);
        for i in (0..n).rev() {
            // Sample i predicts nothing any more: hand its value to the samples it is predicted
            // from.
            let (before, at) = v.split_at_mut(i * nd);
            for (j, a) in self.predictors[self.order(i)].iter().enumerate() {
                let to = &mut before[(i - 1 - j) * nd..(i - j) * nd];
                to.iter_mut().zip(&at[..nd]).for_each(|(to, v)| *to += a * v);
            }
        }
        v
    }

    /// Variance of the innovation of sample `i`: element `i` of `D`.
    pub fn variance(&self, i: usize) -> f64 {
        self.variances[self.order(i)]
    }

    /// Sum of products of the responses of two processes to an impulse, `sum_k psi(k) phi(k)`, over
    /// that of each with itself: 1 for processes of the same colour.
    pub fn likeness(&self, other: &Filter) -> f64 {
        let (a, b) = (self.impulse(), other.impulse());
        dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt()
    }

    /// The stationary process's response to an impulse, until nothing is left of it.
    fn impulse(&self) -> Vec<f64> {
        let last = self.predictors.last().map(Vec::as_slice).unwrap_or_default();
        let mut psi = vec![1.0];
        let left = |psi: &[f64]| psi.iter().rev().take(last.len()).any(|v: &f64| v.abs() > LEFT);
        while psi.len() < LONGEST && left(&psi) {
            psi.push(last.iter().zip(psi.iter().rev()).map(|(a, v)| a * v).sum());
        }
        psi
    }
}

/// Every sample from that on of which enough lie behind, less its prediction by `a`, times `scale`; in
/// place.
fn predicted(x: &mut [f64], a: &[f64], scale: f64) {
    // SAFETY: the width is this machine's, and there are more samples than coefficients.
    unsafe { predicted_by(Width::detect(), x, a, scale) }
}

by_width! {
    /// `x[i] = (x[i] - sum_j a[j] x[i-1-j]) scale` for `i` from the length of `a` on.
    fn predicted_by(x: &mut [f64], a: &[f64], scale: f64) = predicted_body
}

/// Vectors of eight samples that are predicted side by side.
const SIDE: usize = 4;

/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn predicted_body<V: Eight>(x: &mut [f64], a: &[f64], scale: f64) {
    let mut end = x.len();
    // From the end: a sample is needed by those behind it as it was.
    // SAFETY: all samples from `first - a.len()` to `first + 8 N` lie in `x`.
    unsafe {
        while end >= a.len() + 8 * SIDE {
            end -= 8 * SIDE;
            samples::<V, SIDE>(x, end, a, scale);
        }
        while end >= a.len() + 8 {
            end -= 8;
            samples::<V, 1>(x, end, a, scale);
        }
    }
    for i in (a.len()..end).rev() {
        let mut w = x[i];
        a.iter().zip(x[..i].iter().rev()).for_each(|(a, x)| w = (-a).mul_add(*x, w));
        x[i] = w * scale;
    }
}

/// # Safety
/// The machine has the width; the samples `first - a.len() .. first + 8 N` are there.
#[inline(always)]
unsafe fn samples<V: Eight, const N: usize>(x: &mut [f64], first: usize, a: &[f64], scale: f64) {
    let at = x.as_mut_ptr();
    // SAFETY: the caller's promises.
    unsafe {
        let mut w: [V; N] = std::array::from_fn(|k| V::load(at.add(first + 8 * k)));
        for (j, a) in a.iter().enumerate() {
            let a = V::splat(-a);
            for (k, w) in w.iter_mut().enumerate() {
                *w = a.fma(V::load(at.add(first + 8 * k - 1 - j)), *w);
            }
        }
        let (scale, zero) = (V::splat(scale), V::splat(0.0));
        for (k, w) in w.iter().enumerate() {
            w.fma(scale, zero).store(at.add(first + 8 * k));
        }
    }
}

/// When an impulse is forgotten, and the number of samples after which it is given up.
const LEFT: f64 = 1e-9;
const LONGEST: usize = 1 << 14;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::dense::{cholesky, forward};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn whitening_is_the_inverse_of_the_covariances_factor() {
        let model = Ar::with_coefficients(&[1.2, -0.6, 0.2], 0.7).expect("stationary");
        let n = 12;
        let c = model.autocovariance(n);
        let sigma: Vec<f64> = (0..n * n).map(|k| c[(k / n).abs_diff(k % n)]).collect();
        let x: Vec<f64> = (0..n).map(|k| libm::sin(1.7 * k as f64)).collect();
        let (mut mine, mut want) = (x.clone(), x);
        Filter::new(&model).whiten(&mut mine, &[false; 12]);
        forward(&cholesky(&sigma, n).expect("definite"), n, &mut want);
        assert!(mine.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-9), "{mine:?} {want:?}");
    }

    #[test]
    fn rows_are_made_white_as_series_are() {
        let filter =
            Filter::new(&Ar::with_coefficients(&[1.2, -0.6, 0.2], 0.7).expect("stationary"));
        for (samples, n) in [(2, 3), (40, 11), (50, 1)] {
            let series: Vec<Vec<f64>> = (0..n)
                .map(|k| (0..samples).map(|i| libm::sin(1.7 * (i * n + k) as f64)).collect())
                .collect();
            let rows: Vec<f64> =
                (0..samples).flat_map(|i| series.iter().map(move |x| x[i])).collect();
            let mut white = vec![f64::NAN; rows.len()];
            filter.whiten_rows(&rows, n, &mut white);
            for (k, x) in series.into_iter().enumerate() {
                let mut x = x;
                filter.whiten(&mut x, &vec![false; samples]);
                let mine = white.iter().skip(k).step_by(n);
                assert!(mine.zip(&x).all(|(a, b)| (a - b).abs() < 1e-12), "{samples} {n}");
            }
        }
    }

    #[test]
    fn all_widths_predict_the_same_bits() {
        for (n, p) in [(3, 0), (3, 2), (5, 7), (40, 9), (203, 30)] {
            let a: Vec<f64> = (0..p).map(|j| 0.3 * libm::cos(0.7 * j as f64)).collect();
            let x: Vec<f64> = (0..n).map(|k| libm::sin(1.7 * k as f64)).collect();
            let by = |width: Width| {
                let mut x = x.clone();
                // SAFETY: the machine has the width.
                unsafe { predicted_by(width, &mut x, &a, 0.6) };
                x
            };
            let plain = by(Width::Plain);
            assert!(Width::available().iter().all(|width| by(*width) == plain), "{n} {p}");
            for (k, w) in plain.iter().enumerate() {
                let foretold: f64 = (0..p.min(k)).map(|j| a[j] * x[k - 1 - j]).sum();
                let want = if k < p { x[k] } else { 0.6 * (x[k] - foretold) };
                assert!((w - want).abs() < 1e-12, "{n} {p} {k}: {w} {want}");
            }
        }
    }

    #[test]
    fn a_masked_sample_says_nothing() {
        let filter = Filter::new(&Ar { partial: vec![0.8], variance: 1.0 });
        let (mut a, mut b) = (vec![1.0, 2.0, f64::NAN, 4.0, 5.0], vec![1.0, 2.0, 1e9, 4.0, 5.0]);
        let masked = [false, false, true, false, false];
        filter.whiten(&mut a, &masked);
        filter.whiten(&mut b, &masked);
        assert_eq!((&a, a[2]), (&b, 0.0));
        // Two samples ahead: the prediction is 0.8^2 of the last one, and its error is e_2 + 0.8
        // e_1.
        let after = (4.0 - 0.8 * 0.8 * 2.0) / (1.0f64 + 0.8 * 0.8).sqrt();
        assert!((a[3] - after).abs() < 1e-12 && (a[4] - (5.0 - 0.8 * 4.0)).abs() < 1e-12);
    }

    fn noise(model: &Ar, seed: u64, n: usize) -> Vec<f64> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let (predictors, errors) = (model.predictors(), model.errors());
        let mut x: Vec<f64> = Vec::new();
        for i in 0..n {
            let order = i.min(model.order());
            let foretold: f64 =
                predictors[order].iter().zip(x.iter().rev()).map(|(a, x)| a * x).sum();
            let new: f64 = StandardNormal.sample(&mut random);
            x.push(foretold + errors[order].sqrt() * new);
        }
        x
    }

    fn masked(n: usize, gaps: &[(usize, usize)]) -> Vec<bool> {
        (0..n).map(|k| gaps.iter().any(|(from, to)| (*from..*to).contains(&k))).collect()
    }

    #[test]
    fn what_was_measured_is_whitened_by_its_own_covariances_factor() {
        let model = Ar::with_coefficients(&[1.2, -0.6, 0.2], 0.7).expect("stationary");
        let n = 60;
        let c = model.autocovariance(n);
        let x = noise(&model, 1, n);
        let patterns: [&[(usize, usize)]; 7] = [
            &[(0, 1), (2, 3)],
            &[(0, 7)],
            &[(20, 21)],
            &[(12, 40)],
            &[(20, 22), (23, 26)],
            &[(3, 4), (5, 6), (7, 8), (9, 11), (30, 31), (33, 50), (58, 60)],
            &[(0, 60)],
        ];
        for pattern in patterns {
            let masked = masked(n, pattern);
            let there: Vec<usize> = (0..n).filter(|&k| !masked[k]).collect();
            let m = there.len();
            let sigma: Vec<f64> =
                (0..m * m).map(|k| c[there[k / m].abs_diff(there[k % m])]).collect();
            let mut want: Vec<f64> = there.iter().map(|&k| x[k]).collect();
            forward(&cholesky(&sigma, m).expect("definite"), m, &mut want);
            let mut columns = [x.clone(), x.iter().map(|v| 3.0 * v).collect()];
            columns[0]
                .iter_mut()
                .zip(&masked)
                .filter(|(_, masked)| **masked)
                .for_each(|(x, _)| *x = f64::NAN);
            Filter::new(&model).whiten_all(columns.iter_mut().map(|x| &mut x[..]), &masked);
            for (k, want) in there.iter().zip(&want) {
                assert!(
                    (columns[0][*k] - want).abs() < 1e-9,
                    "{pattern:?} {k}: {} {want}",
                    columns[0][*k]
                );
                assert!((columns[1][*k] - 3.0 * want).abs() < 1e-9, "{pattern:?} {k}");
            }
            assert!(
                (0..n).filter(|&k| masked[k]).all(|k| columns[0][k] == 0.0 && columns[1][k] == 0.0)
            );
        }
    }

    #[test]
    fn behind_a_long_gap_slow_noise_is_of_unit_variance() {
        let model = Ar { partial: vec![0.99], variance: 1.0 };
        let masked = masked(202, &[(100, 200)]);
        let square = |seed: u64| {
            let mut x = noise(&model, seed, 202);
            Filter::new(&model).whiten(&mut x, &masked);
            x[200] * x[200]
        };
        let mean = (0..4000).map(square).sum::<f64>() / 4000.0;
        // The sd of such a mean is (2/4000)^1/2.
        assert!((mean - 1.0).abs() < 0.1, "{mean}");
    }

    #[test]
    fn away_from_gaps_every_bit_is_as_if_nothing_were_missing() {
        let model = Ar::with_coefficients(&[1.2, -0.6, 0.2], 0.7).expect("stationary");
        let x = noise(&model, 2, 100);
        let (mut whole, mut holed) = (x.clone(), x);
        Filter::new(&model).whiten(&mut whole, &[false; 100]);
        Filter::new(&model).whiten(&mut holed, &masked(100, &[(40, 45)]));
        assert_eq!((&whole[..40], &whole[48..]), (&holed[..40], &holed[48..]));
        assert!(whole[45..48].iter().zip(&holed[45..48]).all(|(a, b)| a != b));
    }
}
