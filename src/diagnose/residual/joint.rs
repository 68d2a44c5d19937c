//! White residuals of several outputs in; what they have in common taken out, so that they are
//! white together, out.
//!
//! A gust moves all outputs at once: whitened one by one they are still correlated, at one instant
//! and over a few. The model is `w_t = B_1 w_(t-1) + ... + B_q w_(t-q) + v_t`, `cov(v) = L L'`,
//! over the outputs that are sampled at the same instants; `L^-1 v` has unit covariance. Like the
//! filters of single outputs it restarts at each segment: sample `t` is predicted from the
//! `min(t, q)` before it. At instants at which an output was not measured, and those behind them,
//! `partly` says what becomes of the others.

use crate::math::dense::cholesky_log_det;
use crate::math::mixed::{Term, mix};
use crate::math::pool;

use super::instants::Set;
use super::lagged::{Lagged, predictor};
use super::partly::{Partly, Predictor};
use crate::diagnose::thresholds::Thresholds;

/// A vector autoregressive model of outputs sampled together.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    pub set: Set,
    predictors: Vec<Predictor>,
}

/// The rows of one output in a segment's columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Rows {
    /// The first of them.
    pub from: usize,
    /// Which of them were not measured.
    pub masked: Vec<bool>,
}

impl Joint {
    /// Of the sums of products of white residuals, the order by BIC; `None` where there is nothing
    /// in common to be known of.
    pub fn new(set: Set, sums: Lagged, thresholds: &Thresholds) -> Option<Joint> {
        let m = set.outputs.len();
        if m < 2 || sums.count < thresholds.samples_per_coefficient * m * m {
            return None;
        }
        let n = sums.count as f64;
        let lags: Vec<Vec<f64>> =
            sums.lags.into_iter().map(|lag| lag.into_iter().map(|s| s / n).collect()).collect();
        let all: Vec<Predictor> = (0..lags.len()).map_while(|q| predictor(&lags, m, q)).collect();
        let bic = |q: usize| n * cholesky_log_det(&all[q].l, m) + (q * m * m) as f64 * libm::log(n);
        let best = (0..all.len()).min_by(|&a, &b| bic(a).total_cmp(&bic(b)))?;
        Some(Joint { set, predictors: all[..=best].to_vec() })
    }

    /// Makes the columns of one segment white together, in place; masked rows must be 0, and stay
    /// so. `rows`: those of each output. An output without rows counts as masked; nothing is done
    /// where the others differ in number, or there is but one.
    pub fn apply(&self, columns: &mut [Vec<f64>], rows: &[Option<Rows>]) {
        let of = |&o: &usize| {
            rows.get(o).and_then(Option::as_ref).filter(|rows| !rows.masked.is_empty())
        };
        let at: Vec<Option<&Rows>> = self.set.outputs.iter().map(of).collect();
        let lengths: Vec<usize> = at.iter().flatten().map(|rows| rows.masked.len()).collect();
        if lengths.len() < 2 || lengths.iter().any(|n| *n != lengths[0]) {
            return;
        }
        let n = lengths[0];
        let masked: Vec<Option<&[bool]>> =
            at.iter().map(|rows| rows.map(|rows| &rows.masked[..])).collect();
        let partly = Partly::new(&self.predictors, &masked, n);
        let m = at.len();
        let between = |to: usize, from: usize, back: usize| {
            (from as isize - to as isize) * n as isize - back as isize
        };
        let all = self.terms(m, &between);
        let (mut series, mut white) = (Vec::new(), pool::take(m * n));
        let in_a_row = in_a_row(&at, n);
        for column in columns {
            if let Some(first) = in_a_row {
                let rows = first..first + m * n;
                self.whiten(&column[rows.clone()], &mut white, &all);
                partly.bridge(&self.predictors, &mut column[rows.clone()], &mut white);
                match column.len() == white.len() {
                    true => std::mem::swap(column, &mut white),
                    false => column[rows].copy_from_slice(&white),
                }
                continue;
            }
            series.resize(m * n, 0.0);
            for (one, rows) in series.chunks_exact_mut(n).zip(&at) {
                match rows {
                    Some(rows) => one.copy_from_slice(&column[rows.from..rows.from + n]),
                    None => one.fill(0.0),
                }
            }
            self.whiten(&series, &mut white, &all);
            partly.bridge(&self.predictors, &mut series, &mut white);
            for (rows, white) in at.iter().zip(white.chunks_exact(n)) {
                let Some(rows) = rows else { continue };
                column[rows.from..rows.from + n].copy_from_slice(white);
            }
        }
        pool::give(white);
    }

    /// The same for rows `[sample][n]`, everything measured, into those of `white`; none where an output was
    /// not measured at all.
    pub fn apply_rows(
        &self,
        series: &[f64],
        white: &mut [f64],
        n: usize,
        rows: &[Option<Rows>],
    ) -> Option<()> {
        let of = |&o: &usize| rows.get(o).and_then(Option::as_ref);
        let at: Vec<&Rows> = self.set.outputs.iter().map(of).collect::<Option<_>>()?;
        let (m, last) = (at.len(), self.predictors.len() - 1);
        let samples = at.first().map_or(0, |rows| rows.masked.len());
        if m < 2 || at.iter().any(|rows| rows.masked.len() != samples) {
            for Rows { from, masked } in at {
                let rows = from * n..(from + masked.len()) * n;
                white[rows.clone()].copy_from_slice(&series[rows]);
            }
            return Some(());
        }
        let between = |to: usize, from: usize, back: usize| {
            ((at[from].from as isize - at[to].from as isize) - back as isize) * n as isize
        };
        let all = self.terms(m, &between);
        let mut some = |from: usize, to: usize| {
            for (i, Terms { past, others, scale }) in all[from.min(last)].iter().enumerate() {
                let place = (at[i].from + from) * n;
                mix((series, place, past), (white, place, others), (to - from) * n, *scale);
            }
        };
        (0..last.min(samples)).for_each(|t| some(t, t + 1));
        // From order q on the predictor stays the same: some rows of an output are one row of all their numbers.
        for from in (last..samples).step_by(TOGETHER) {
            some(from, (from + TOGETHER).min(samples));
        }
        Some(())
    }

    /// What each of `m` outputs is made white with, `[instants before][output]`; `between`: how far a row lies
    /// behind another one.
    fn terms(&self, m: usize, between: &dyn Fn(usize, usize, usize) -> isize) -> Vec<Vec<Terms>> {
        let of = |(q, Predictor { b, l }): (usize, &Predictor)| -> Vec<Terms> {
            let one = |i: usize| {
                let past = |k: usize| Term {
                    factor: -b[i * q * m + k],
                    row: between(i, k % m, 1 + k / m),
                };
                let others = |j: usize| Term { factor: -l[i * m + j], row: between(i, j, 0) };
                Terms {
                    past: (0..q * m).map(past).collect(),
                    others: (0..i).map(others).collect(),
                    scale: 1.0 / l[i * m + i],
                }
            };
            (0..m).map(one).collect()
        };
        self.predictors.iter().enumerate().map(of).collect()
    }

    /// Series `[output][sample]`, everything measured, made white.
    fn whiten(&self, series: &[f64], white: &mut [f64], all: &[Vec<Terms>]) {
        let (last, m) = (self.predictors.len() - 1, all[0].len());
        let n = series.len() / m;
        let mut samples = |from: usize, to: usize| {
            for (i, Terms { past, others, scale }) in all[from.min(last)].iter().enumerate() {
                let place = i * n + from;
                mix((series, place, past), (white, place, others), to - from, *scale);
            }
        };
        (0..last.min(n)).for_each(|t| samples(t, t + 1));
        // From order q on the predictor stays the same: output by output over the whole column.
        if n > last {
            samples(last, n);
        }
    }
}

/// Where the rows of all outputs begin, if those of one follow those of the other; each has `n`.
fn in_a_row(at: &[Option<&Rows>], n: usize) -> Option<usize> {
    let first = at.first().copied().flatten()?.from;
    let follows =
        |(i, rows): (usize, &Option<&Rows>)| rows.is_some_and(|rows| rows.from == first + i * n);
    at.iter().enumerate().all(follows).then_some(first)
}

/// Samples whose rows are made white at once: those of all outputs stay in the nearest cache.
const TOGETHER: usize = 16;

/// What an output is made white with at an instant: series before it, white outputs of this instant, and over
/// what.
struct Terms {
    past: Vec<Term>,
    others: Vec<Term>,
    scale: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::products::dot;
    use std::ops::Range;

    /// Two outputs that share a disturbance, one of them a sample later.
    fn sample(n: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut stream = crate::simulate::Stream::new(seed, &["joint"]);
        let common: Vec<f64> = (0..=n).map(|_| stream.normal()).collect();
        let own = |stream: &mut crate::simulate::Stream, from: &[f64]| {
            from.iter().map(|c| 0.8 * c + 0.6 * stream.normal()).collect()
        };
        vec![own(&mut stream, &common[1..]), own(&mut stream, &common[..n])]
    }

    fn sums(segments: impl Iterator<Item = Vec<Vec<f64>>>) -> Lagged {
        let mut all = Lagged::zero(2, 6);
        for w in segments {
            all.count += w[0].len();
            all.take(&[&w[0], &w[1]], std::slice::from_ref(&(0..w[0].len())));
        }
        all
    }

    fn joint(sums: Lagged) -> Joint {
        Joint::new(Set { outputs: vec![0, 1], segments: vec![0] }, sums, &Thresholds::default())
            .expect("a model")
    }

    fn rows(masked: [Vec<bool>; 2]) -> Vec<Option<Rows>> {
        let from = [0, masked[0].len()];
        masked.into_iter().zip(from).map(|(masked, from)| Some(Rows { from, masked })).collect()
    }

    fn moments(x: &[f64], y: &[f64], lag: usize) -> f64 {
        x.iter().skip(lag).zip(y).map(|(a, b)| a * b).sum::<f64>() / x.len() as f64
    }

    #[test]
    fn what_outputs_have_in_common_is_taken_out() {
        let joint = joint(sums((0..6).map(|s| sample(500, s))));
        assert!(joint.predictors.len() > 1, "a delay needs a past");
        let w = sample(20_000, 99);
        assert!(moments(&w[1], &w[0], 1) > 0.6);
        let mut columns = [w.concat()];
        joint.apply(&mut columns, &rows([vec![false; 20_000], vec![false; 20_000]]));
        let (a, b) = columns[0].split_at(20_000);
        for (x, y, lag, want) in [
            (a, a, 0, 1.0),
            (b, b, 0, 1.0),
            (a, b, 0, 0.0),
            (b, a, 1, 0.0),
            (a, b, 1, 0.0),
            (a, a, 1, 0.0),
        ] {
            assert!((moments(x, y, lag) - want).abs() < 0.05, "{}", moments(x, y, lag));
        }
    }

    #[test]
    fn rows_are_made_white_as_columns_are() {
        let joint = joint(sums((0..6).map(|s| sample(500, s))));
        let rows = rows([vec![false; 60], vec![false; 60]]);
        let mut columns: Vec<Vec<f64>> = (0..11).map(|k| sample(60, 20 + k).concat()).collect();
        let series: Vec<f64> = (0..120).flat_map(|i| columns.iter().map(move |x| x[i])).collect();
        let mut white = series.clone();
        assert_eq!(joint.apply_rows(&series, &mut white, 11, &rows), Some(()));
        joint.apply(&mut columns, &rows);
        for (i, white) in white.chunks(11).enumerate() {
            assert!(white.iter().zip(&columns).all(|(a, x)| (a - x[i]).abs() < 1e-12), "{i}");
        }
        assert_eq!(joint.apply_rows(&series, &mut white, 11, &[None, rows[1].clone()]), None);
    }

    #[test]
    fn where_rows_stand_changes_no_bit() {
        let joint = joint(sums((0..6).map(|s| sample(500, s))));
        let mut w = sample(60, 5);
        w[1][30] = 0.0;
        let masked: Vec<bool> = (0..60).map(|k| k == 30).collect();
        for (before, between, behind) in [(0, 0, 0), (5, 0, 0), (0, 0, 3), (0, 9, 0)] {
            let other = |n: usize| vec![7.0; n];
            let all = [other(before), w[0].clone(), other(between), w[1].clone(), other(behind)];
            let mut columns = [all.concat(), all.concat()];
            let from = [before, before + 60 + between];
            let rows = [(from[0], vec![false; 60]), (from[1], masked.clone())]
                .map(|(from, masked)| Some(Rows { from, masked }));
            joint.apply(&mut columns, &rows);
            let mut plain = [w.concat()];
            joint.apply(&mut plain, &self::rows([vec![false; 60], masked.clone()]));
            for column in &columns {
                let (a, b) = (&column[from[0]..][..60], &column[from[1]..][..60]);
                assert_eq!([a, b].concat(), plain[0]);
                assert_eq!(column.iter().filter(|x| **x == 7.0).count(), before + between + behind);
            }
        }
    }

    #[test]
    fn outputs_of_other_lengths_stay_as_they_are() {
        let joint = joint(sums((0..6).map(|s| sample(500, s))));
        let mut columns = [vec![1.0; 7]];
        joint.apply(&mut columns, &rows([vec![false; 4], vec![false; 3]]));
        assert_eq!(columns[0], vec![1.0; 7]);
    }

    /// Two outputs of correlation 0.9 at every instant, the second masked where asked.
    fn alike(n: usize, seed: u64, masked: &[bool]) -> Vec<Vec<f64>> {
        let mut stream = crate::simulate::Stream::new(seed, &["alike"]);
        let first: Vec<f64> = (0..n).map(|_| stream.normal()).collect();
        let like = |a: &f64| 0.9 * a + (1.0 - 0.81f64).sqrt() * stream.normal();
        let second: Vec<f64> = first.iter().map(like).collect();
        let second = second
            .into_iter()
            .zip(masked)
            .map(|(b, masked)| if *masked { 0.0 } else { b })
            .collect();
        vec![first, second]
    }

    #[test]
    fn masked_samples_neither_count_nor_cost() {
        let n = 20_000;
        for masked in [
            (0..n).map(|k| k % 2 == 0).collect(),
            (0..n).map(|k| k / 100 % 2 == 0).collect::<Vec<bool>>(),
        ] {
            let w = alike(n, 1, &masked);
            let mut sums = Lagged::zero(2, 6);
            let runs = crate::diagnose::residual::partly::runs(
                &masked.iter().map(|m| !m).collect::<Vec<_>>(),
            );
            sums.count = runs.iter().map(Range::len).sum();
            sums.take(&[&w[0], &w[1]], &runs);
            assert_eq!(sums.count, n / 2);
            let joint = joint(sums);
            let l = &joint.predictors[0].l;
            assert!(
                (l[0] - 1.0).abs() < 0.03
                    && (l[2] - 0.9).abs() < 0.03
                    && (l[3] - 0.19f64.sqrt()).abs() < 0.03,
                "{l:?}"
            );
            let mut columns = [alike(n, 2, &masked).concat()];
            joint.apply(&mut columns, &rows([vec![false; n], masked.clone()]));
            let (a, b) = columns[0].split_at(n);
            assert!(masked.iter().zip(b).all(|(masked, b)| !masked || *b == 0.0));
            let square = (dot(a, a) + dot(b, b)) / (1.5 * n as f64);
            assert!((square - 1.0).abs() < 0.03, "{square}");
            assert!((moments(b, b, 0) - 0.5).abs() < 0.03 && moments(a, b, 0).abs() < 0.03);
        }
    }

    #[test]
    fn a_masked_sample_is_guessed_from_the_past_and_from_what_was_measured_beside_it() {
        let joint = joint(sums((0..6).map(|s| sample(500, s))));
        let (q, w) = (joint.predictors.len() - 1, sample(60, 7));
        let white = |w: &[Vec<f64>], masked: &[bool]| {
            let mut columns = [w.concat()];
            joint.apply(&mut columns, &rows([vec![false; 60], masked.to_vec()]));
            columns[0].clone()
        };
        let masked: Vec<bool> = (0..60).map(|k| k == 30).collect();
        let mut holed = w.clone();
        holed[1][30] = 0.0;
        let (whole, found) = (white(&w, &[false; 60]), white(&holed, &masked));
        // Before it, and as far behind it as predictions do not reach, not a bit is another.
        assert_eq!((&whole[..30], &whole[31 + q..60]), (&found[..30], &found[31 + q..60]));
        // The first output comes first in the factor.
        assert!((whole[30] - found[30]).abs() < 1e-12 && found[90] == 0.0);
        assert_ne!(whole[31], found[31]);
        // With the conditional mean in its place its own innovation is nothing, and the others are
        // the same.
        let Predictor { b, l } = &joint.predictors[q];
        let mean =
            |i: usize| (0..2 * q).map(|k| b[i * 2 * q + k] * w[k % 2][29 - k / 2]).sum::<f64>();
        holed[1][30] = mean(1) + l[2] / l[0] * (w[0][30] - mean(0));
        let guessed = white(&holed, &[false; 60]);
        assert!(guessed.iter().zip(&found).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn an_output_that_a_segment_does_not_measure_is_masked_there() {
        let three =
            |n: usize, seed: u64| [sample(n, seed), vec![sample(n, seed + 50)[0].clone()]].concat();
        let mut all = Lagged::zero(3, 6);
        for w in (0..6).map(|s| three(500, s)) {
            all.count += 500;
            all.take(&[&w[0], &w[1], &w[2]], std::slice::from_ref(&(0..500)));
        }
        let joint = Joint::new(
            Set { outputs: vec![0, 1, 2], segments: vec![0] },
            all,
            &Thresholds::default(),
        )
        .expect("a model");
        let w = sample(5000, 99);
        let mut columns = [w.concat()];
        joint.apply(&mut columns, &rows([vec![false; 5000], vec![false; 5000]]));
        let (a, b) = columns[0].split_at(5000);
        assert!(
            (moments(a, a, 0) - 1.0).abs() < 0.06
                && (moments(b, b, 0) - 1.0).abs() < 0.06
                && moments(b, a, 1).abs() < 0.06
        );
    }
}
