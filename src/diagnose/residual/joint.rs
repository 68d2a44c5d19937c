//! White residuals of several outputs in; what they have in common taken out, so that they are white together, out.
//!
//! A gust moves all outputs at once: whitened one by one they are still correlated, at one instant and over a few. The model is
//! `w_t = B_1 w_(t-1) + ... + B_q w_(t-q) + v_t`, `cov(v) = L L'`, over the outputs that are sampled at the same instants; `L^-1 v` has unit
//! covariance. Like the filters of single outputs it restarts at each segment: sample `t` is predicted from the `min(t, q)` before it.

use crate::estimate::Case;
use crate::math::dense::{cholesky, cholesky_log_det, cholesky_solve, forward};
use crate::math::products::dot;

use crate::diagnose::thresholds::noise::{JOINT_ORDER as ORDER, SAMPLES_PER_COEFFICIENT};

/// A vector autoregressive model of outputs sampled together.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Which of the scored outputs.
    pub outputs: Vec<usize>,
    /// Per order `0..=q`: `[B_1 | ... ]` as `[m][order * m]`, and the factor `L` of the innovations' covariance.
    predictors: Vec<(Vec<f64>, Vec<f64>)>,
}

impl Joint {
    /// Of the sums of products of white residuals, the order by BIC; `None` where there is nothing in common to be known of.
    pub fn new(outputs: Vec<usize>, sums: Lagged) -> Option<Joint> {
        let m = outputs.len();
        if m < 2 || sums.count < SAMPLES_PER_COEFFICIENT * m * m {
            return None;
        }
        let n = sums.count as f64;
        let lags: Vec<Vec<f64>> = sums.lags.into_iter().map(|lag| lag.into_iter().map(|s| s / n).collect()).collect();
        let all: Vec<(Vec<f64>, Vec<f64>)> = (0..=ORDER).map_while(|q| predictor(&lags, m, q)).collect();
        let bic = |q: usize| n * cholesky_log_det(&all[q].1, m) + (q * m * m) as f64 * libm::log(n);
        let best = (0..all.len()).min_by(|&a, &b| bic(a).total_cmp(&bic(b)))?;
        Some(Joint { outputs, predictors: all[..=best].to_vec() })
    }

    /// Makes the columns of one segment white together, in place. `rows`: where the rows of each of the outputs begin in a column, and how
    /// many there are; nothing is done where they differ in number.
    pub fn apply(&self, column: &mut [f64], rows: &[Option<(usize, usize)>]) {
        let m = self.outputs.len();
        let at: Option<Vec<(usize, usize)>> = self.outputs.iter().map(|&o| rows.get(o).copied().flatten()).collect();
        let Some(at) = at.filter(|at| at.iter().all(|r| r.1 == at[0].1)) else { return };
        let (last, n) = (self.predictors.len() - 1, at[0].1);
        let mut white: Vec<Vec<f64>> = at.iter().map(|&(from, n)| column[from..from + n].to_vec()).collect();
        for t in 0..last.min(n) {
            let b = &self.predictors[t].0;
            for (i, white) in white.iter_mut().enumerate() {
                white[t] -= (0..t * m).map(|k| b[i * t * m + k] * column[at[k % m].0 + t - 1 - k / m]).sum::<f64>();
            }
        }
        // From order q on the predictor stays the same: output by output and lag by lag over the whole column.
        let b = &self.predictors[last].0;
        for (i, white) in white.iter_mut().enumerate().filter(|_| n > last) {
            for k in 0..last * m {
                let from = at[k % m].0 + last - 1 - k / m;
                let factor = b[i * last * m + k];
                white[last..].iter_mut().zip(&column[from..from + n - last]).for_each(|(w, x)| *w -= factor * x);
            }
        }
        for t in 0..last.min(n) {
            let mut v: Vec<f64> = white.iter().map(|w| w[t]).collect();
            forward(&self.predictors[t].1, m, &mut v);
            white.iter_mut().zip(v).for_each(|(w, v)| w[t] = v);
        }
        let l = &self.predictors[last].1;
        for i in 0..m {
            let (before, rest) = white.split_at_mut(i);
            let (own, scale) = (&mut rest[0][last.min(n)..], 1.0 / l[i * m + i]);
            for (j, other) in before.iter().enumerate() {
                let factor = l[i * m + j];
                own.iter_mut().zip(&other[last.min(n)..]).for_each(|(w, v)| *w -= factor * v);
            }
            own.iter_mut().for_each(|w| *w *= scale);
        }
        for (&(from, n), white) in at.iter().zip(&white) {
            column[from..from + n].copy_from_slice(white);
        }
    }
}

/// Sums of products `w_t w_(t-lag)'` of series of several outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Lagged {
    outputs: usize,
    /// Residuals per output.
    pub count: usize,
    /// `[lag][outputs][outputs]`, lags up to the highest order.
    lags: Vec<Vec<f64>>,
}

impl Lagged {
    pub fn zero(outputs: usize) -> Lagged {
        Lagged { outputs, count: 0, lags: vec![vec![0.0; outputs * outputs]; ORDER + 1] }
    }

    /// Adds the products of one segment's series `[output][sample]`, all of one length.
    pub fn take(&mut self, w: &[&[f64]]) {
        let m = self.outputs;
        for (lag, sums) in self.lags.iter_mut().enumerate() {
            for i in 0..m {
                let late = w[i].get(lag..).unwrap_or_default();
                (0..m).for_each(|j| sums[i * m + j] += dot(late, w[j]));
            }
        }
    }

    pub fn add(&mut self, other: &Lagged) {
        self.count += other.count;
        for (lag, more) in self.lags.iter_mut().zip(&other.lags) {
            lag.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        }
    }
}

/// The best linear predictor of order `q` (multivariate Yule-Walker equations; Brockwell and Davis, section 11.4) and the factor of
/// its innovations' covariance; `None` where that is not definite.
fn predictor(lags: &[Vec<f64>], m: usize, q: usize) -> Option<(Vec<f64>, Vec<f64>)> {
    let n = q * m;
    // E[w_(t-1-a) w_(t-1-b)'] of the stacked past
    let of = |a: usize, b: usize, i: usize, j: usize| if b >= a { lags[b - a][i * m + j] } else { lags[a - b][j * m + i] };
    let past: Vec<f64> = (0..n * n).map(|k| of(k / n / m, k % n / m, k / n % m, k % n % m)).collect();
    let mut b = vec![0.0; m * n];
    if q > 0 {
        let l = cholesky(&past, n).ok()?;
        for i in 0..m {
            let row = &mut b[i * n..(i + 1) * n];
            (0..n).for_each(|k| row[k] = lags[1 + k / m][i * m + k % m]);
            cholesky_solve(&l, n, row);
        }
    }
    let mut left = lags[0].clone();
    for i in 0..m {
        for j in 0..m {
            left[i * m + j] -= (0..n).map(|k| b[i * n + k] * lags[1 + k / m][j * m + k % m]).sum::<f64>();
        }
    }
    let l = cholesky(&left, m).ok()?;
    Some((b, l))
}

/// Scored outputs that these segments sample at the same instants; those that none of them samples are in no set.
pub fn together(case: &Case, segments: &[usize]) -> Vec<Vec<usize>> {
    let times = |o: usize| -> Vec<Option<&Vec<f64>>> {
        let of = |&s: &usize| case.records[s].channels.iter().find(|c| c.output == case.outputs[o]).map(|c| &c.t);
        segments.iter().map(of).collect()
    };
    let mut sets: Vec<Vec<usize>> = Vec::new();
    for o in 0..case.outputs.len() {
        let own = times(o);
        if own.iter().all(Option::is_none) {
            continue;
        }
        match sets.iter_mut().find(|set| times(set[0]) == own) {
            Some(set) => set.push(o),
            None => sets.push(vec![o]),
        }
    }
    sets
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two outputs that share a disturbance, one of them a sample later.
    fn sample(n: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut stream = crate::simulate::Stream::new(seed, &["joint"]);
        let common: Vec<f64> = (0..=n).map(|_| stream.normal()).collect();
        let own =
            |stream: &mut crate::simulate::Stream, from: &[f64]| from.iter().map(|c| 0.8 * c + 0.6 * stream.normal()).collect();
        vec![own(&mut stream, &common[1..]), own(&mut stream, &common[..n])]
    }

    fn sums(segments: impl Iterator<Item = Vec<Vec<f64>>>) -> Lagged {
        let mut all = Lagged::zero(2);
        for w in segments {
            all.count += w[0].len();
            all.take(&[&w[0], &w[1]]);
        }
        all
    }

    fn moments(x: &[f64], y: &[f64], lag: usize) -> f64 {
        x.iter().skip(lag).zip(y).map(|(a, b)| a * b).sum::<f64>() / x.len() as f64
    }

    #[test]
    fn what_outputs_have_in_common_is_taken_out() {
        let joint = Joint::new(vec![0, 1], sums((0..6).map(|s| sample(500, s)))).expect("a model");
        assert!(joint.predictors.len() > 1, "a delay needs a past");
        let w = sample(20_000, 99);
        assert!(moments(&w[1], &w[0], 1) > 0.6);
        let mut column = w.concat();
        joint.apply(&mut column, &[Some((0, 20_000)), Some((20_000, 20_000))]);
        let (a, b) = column.split_at(20_000);
        for (x, y, lag, want) in [(a, a, 0, 1.0), (b, b, 0, 1.0), (a, b, 0, 0.0), (b, a, 1, 0.0), (a, b, 1, 0.0), (a, a, 1, 0.0)] {
            assert!((moments(x, y, lag) - want).abs() < 0.05, "{}", moments(x, y, lag));
        }
    }

    #[test]
    fn outputs_of_other_lengths_stay_as_they_are() {
        let joint = Joint::new(vec![0, 1], sums((0..6).map(|s| sample(500, s)))).expect("a model");
        let mut column = vec![1.0; 7];
        joint.apply(&mut column, &[Some((0, 4)), Some((4, 3))]);
        assert_eq!(column, vec![1.0; 7]);
    }
}
