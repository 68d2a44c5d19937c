//! The colour of a base fit's residuals in; residuals and sensitivities made white, segment by segment, out.
//!
//! Every output has an autoregressive model `r_k = a_1 r_(k-1) + ... + w_k`, restarted at each segment: sample `i` is predicted by the
//! predictor of order `min(i, p)` (Levinson and Durbin), so that the first samples count as what they are. Rows are divided by the sd of
//! their innovation: `w = D^-1/2 A r` has unit covariance, and the same linear map makes sensitivities comparable with it.
//! A masked sample counts as its own prediction: it adds nothing, and those after it go on. What the white residuals of outputs that are
//! sampled together still have in common (a gust moves all of them) is taken out by a joint model.

use super::gram::dot;
use super::joint::{Joint, together};
use crate::estimate::{Block, Case, Estimation, OutputScatter, Stop, Trace};
use crate::math::ar::{self, Ar, Order, step_down};
use rayon::prelude::*;

/// The whitening filter of one output's residuals.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    /// `predictors[q]`: coefficients of the predictor of order q, `0..=p`.
    predictors: Vec<Vec<f64>>,
    /// Standard deviation of the innovation at each order.
    deviations: Vec<f64>,
}

impl Filter {
    /// Of a process of this model; `None` where it is not stationary or has no variance.
    pub fn new(model: &Ar) -> Option<Filter> {
        let mut predictors = vec![Vec::new()];
        predictors.extend(step_down(&model.coefficients)?);
        let mut variances = vec![model.variance];
        for a in predictors.iter().skip(1).rev() {
            let last = a.last().copied().unwrap_or(0.0);
            variances.push(variances[variances.len() - 1] / (1.0 - last * last));
        }
        let deviations: Vec<f64> = variances.into_iter().rev().map(f64::sqrt).collect();
        deviations.iter().all(|d| *d > 0.0 && d.is_finite()).then_some(Filter { predictors, deviations })
    }

    /// Of residuals of variance `r` with these coefficients.
    pub fn of(coefficients: &[f64], r: f64) -> Option<Filter> {
        let orders = step_down(coefficients)?;
        let left = orders.iter().filter_map(|a| a.last()).fold(r, |v, k| v * (1.0 - k * k));
        Filter::new(&Ar { coefficients: coefficients.to_vec(), variance: left, order: coefficients.len() })
    }

    /// A column made white; `masked[i]` tells which samples were not measured.
    pub fn apply(&self, x: &mut Vec<f64>, masked: &[bool]) {
        let last = self.predictors.len() - 1;
        let innovation = |x: &[f64], i: usize| {
            let a = &self.predictors[i.min(last)];
            x[i] - a.iter().zip(x[..i].iter().rev()).map(|(a, x)| a * x).sum::<f64>()
        };
        // Masked samples first take the value of their prediction.
        for i in (0..x.len()).filter(|&i| masked.get(i).copied().unwrap_or(false)) {
            x[i] = 0.0;
            x[i] = -innovation(x, i);
        }
        let n = x.len();
        let mut white: Vec<f64> = (0..last.min(n)).map(|i| innovation(x, i) / self.deviations[i]).collect();
        // From order p on the predictor stays the same: lag by lag over the whole column.
        white.extend_from_slice(&x[last.min(n)..]);
        for (j, a) in self.predictors[last].iter().enumerate().filter(|_| n > last) {
            white[last..].iter_mut().zip(&x[last - 1 - j..]).for_each(|(w, x)| *w -= a * x);
        }
        let scale = 1.0 / self.deviations[last];
        white.iter_mut().skip(last).for_each(|w| *w *= scale);
        *x = white;
    }
}

/// The noise of a base fit: a filter per group of segments and output.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// `[group][scored output]`; none where nothing is known of it.
    filters: Vec<Vec<Option<Filter>>>,
    /// `[group]`: joint models of the white residuals, each of other outputs.
    joint: Vec<Vec<Joint>>,
    /// Variance per group and output, of the residuals as they are.
    pub variances: Vec<Vec<f64>>,
    /// Group of each segment.
    pub groups: Vec<usize>,
}

impl Noise {
    /// As an estimation over the training segments found it. `groups`: the group of every segment, of those left out of the training too;
    /// a group that the training has nothing of has the noise of the first one.
    pub fn of(base: &Estimation, outputs: &[String], groups: Vec<usize>) -> Noise {
        let count = groups.iter().copied().max().map_or(1, |g| g + 1);
        let find = |group: usize, output: &String| {
            let of = |g: usize| base.outputs.iter().find(|o| o.group == g && o.name == *output && o.count > 0);
            of(group).or(of(0))
        };
        let each = |group: usize| outputs.iter().map(move |output| find(group, output));
        let filters = (0..count).map(|g| each(g).map(|o| o.and_then(|o| filter_of(base, o))).collect()).collect();
        let variances = (0..count).map(|g| each(g).map(|o| o.map_or(f64::NAN, |o| o.r)).collect()).collect();
        let mut noise = Noise { filters, joint: vec![Vec::new(); count], variances, groups };
        noise.join(base, outputs);
        noise
    }

    /// Makes the joint models from the residuals of the training segments.
    fn join(&mut self, base: &Estimation, outputs: &[String]) {
        for set in together(base, outputs) {
            for group in 0..self.joint.len() {
                let white: Vec<Vec<Vec<f64>>> = (base.responses.iter().zip(&base.noise_groups))
                    .filter(|(_, g)| **g == Some(group))
                    .filter_map(|(traces, _)| set.iter().map(|&o| self.white_trace(group, o, &outputs[o], traces)).collect())
                    .collect();
                self.joint[group].extend(Joint::new(set.clone(), &white));
            }
        }
        // A group that the training has nothing of has the noise of the first one.
        let first = self.joint.first().cloned().unwrap_or_default();
        let known = |g: usize| base.noise_groups.contains(&Some(g));
        for group in (0..self.joint.len()).filter(|g| !known(*g)) {
            self.joint[group] = first.clone();
        }
    }

    fn white_trace(&self, group: usize, output: usize, name: &str, traces: &[Trace]) -> Option<Vec<f64>> {
        let trace = traces.iter().find(|t| t.name == name)?;
        let mut x: Vec<f64> = trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y).collect();
        let masked: Vec<bool> = x.iter().map(|e| !e.is_finite()).collect();
        self.filters[group].get(output)?.as_ref()?.apply(&mut x, &masked);
        Some(x)
    }

    /// As the residuals of a fit to the training segments show it; outputs without any keep what they had.
    pub fn of_residuals(&self, case: &Case, training: &[usize], theta: &[f64]) -> Noise {
        let mut noise = self.clone();
        let blocks: Vec<Option<Vec<Block>>> =
            training.par_iter().map(|&s| case.evaluate(s, &case.layout.local(s, theta), false)).collect();
        for group in 0..self.filters.len() {
            for output in 0..self.filters[group].len() {
                let mut residuals: Vec<f64> = Vec::new();
                let mine = training.iter().zip(&blocks).filter(|(s, _)| self.groups[**s] == group);
                for block in mine.flat_map(|(_, blocks)| blocks.iter().flatten()).filter(|b| b.output == output) {
                    append(&mut residuals, block.e.iter().copied());
                }
                if let Some((filter, variance)) = modelled(&residuals) {
                    (noise.filters[group][output], noise.variances[group][output]) = (Some(filter), variance);
                }
            }
            let filters = &noise.filters[group];
            let white = |blocks: &[Block], output: usize| {
                let block = blocks.iter().find(|b| b.output == output)?;
                let (mut x, masked) = (block.e.clone(), block.e.iter().map(|e| !e.is_finite()).collect::<Vec<bool>>());
                filters[output].as_ref()?.apply(&mut x, &masked);
                Some(x)
            };
            let again = |joint: &Joint| {
                let mine = training.iter().zip(&blocks).filter(|(s, _)| self.groups[**s] == group);
                let all: Vec<Vec<Vec<f64>>> =
                    mine.filter_map(|(_, blocks)| joint.outputs.iter().map(|&o| white(blocks.as_ref()?, o)).collect()).collect();
                Joint::new(joint.outputs.clone(), &all)
            };
            noise.joint[group] = self.joint[group].iter().filter_map(again).collect();
        }
        noise
    }

    /// Residuals and sensitivities of a segment's blocks, made white: one column per direction, then the residuals; rows block by block.
    /// Outputs of unknown noise are left out.
    pub fn whiten(&self, segment: usize, blocks: &[Block]) -> Vec<Vec<f64>> {
        let directions = blocks.iter().find(|b| !b.e.is_empty()).map_or(0, |b| b.g.len() / b.e.len());
        let mut columns = vec![Vec::new(); directions + 1];
        let mut rows: Vec<Option<(usize, usize)>> = Vec::new();
        for block in blocks {
            let masked: Vec<bool> = block.e.iter().map(|e| !e.is_finite()).collect();
            let Some(filter) = self.filter(segment, block.output) else { continue };
            rows.resize(rows.len().max(block.output + 1), None);
            rows[block.output] = Some((columns[0].len(), block.e.len()));
            for (d, column) in columns.iter_mut().enumerate() {
                let mut x: Vec<f64> = match d == directions {
                    true => block.e.clone(),
                    false => block.g.iter().skip(d).step_by(directions).copied().collect(),
                };
                filter.apply(&mut x, &masked);
                column.extend(x);
            }
        }
        let joint = self.groups.get(segment).and_then(|&g| self.joint.get(g));
        for joint in joint.into_iter().flatten() {
            columns.iter_mut().for_each(|column| joint.apply(column, &rows));
        }
        columns
    }

    pub fn filter(&self, segment: usize, output: usize) -> Option<&Filter> {
        self.filters.get(*self.groups.get(segment)?)?.get(output)?.as_ref()
    }

    /// Half the sum of squares of a segment's white residuals: its part of the cost.
    pub fn cost(&self, segment: usize, blocks: &[Block]) -> f64 {
        let columns = self.whiten(segment, blocks);
        columns.last().map_or(0.0, |e| 0.5 * dot(e, e))
    }
}

/// Highest order of the models that are fitted here.
const ORDER: usize = 24;

/// The estimation's own model of the residuals, which knows what the fit absorbed; where there is none, one of the residuals as they are.
fn filter_of(base: &Estimation, output: &OutputScatter) -> Option<Filter> {
    if base.stop == Stop::Converged {
        return Filter::of(&output.ar, output.r);
    }
    let mut residuals: Vec<f64> = Vec::new();
    for (traces, group) in base.responses.iter().zip(&base.noise_groups) {
        for trace in traces.iter().filter(|t| *group == Some(output.group) && t.name == output.name) {
            append(&mut residuals, trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y));
        }
    }
    modelled(&residuals).map(|(filter, _)| filter)
}

/// Adds a segment's residuals so that no pair reaches across two segments.
fn append(all: &mut Vec<f64>, residuals: impl Iterator<Item = f64>) {
    all.extend(residuals);
    all.extend([f64::NAN; ORDER]);
}

/// The filter and the variance of residuals as they are.
fn modelled(residuals: &[f64]) -> Option<(Filter, f64)> {
    let count = residuals.iter().filter(|r| r.is_finite()).count();
    let c = ar::sample_autocovariance(residuals, ORDER);
    let variance = c.first().copied().filter(|v| *v > 0.0)?;
    Some((Filter::new(&ar::fit_by(&c, count, ORDER, Order::White))?, variance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::ar::autocovariance;
    use crate::math::dense::{cholesky, forward};

    #[test]
    fn whitening_is_the_inverse_of_the_covariances_factor() {
        let model = Ar { coefficients: vec![1.2, -0.6, 0.2], variance: 0.7, order: 3 };
        let n = 12;
        let c = autocovariance(&model, n);
        let sigma: Vec<f64> = (0..n * n).map(|k| c[(k / n).abs_diff(k % n)]).collect();
        let x: Vec<f64> = (0..n).map(|k| libm::sin(1.7 * k as f64)).collect();
        let (mut mine, mut want) = (x.clone(), x);
        Filter::new(&model).expect("stationary").apply(&mut mine, &[false; 12]);
        forward(&cholesky(&sigma, n).expect("definite"), n, &mut want);
        assert!(mine.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-9), "{mine:?} {want:?}");
    }

    #[test]
    fn a_masked_sample_says_nothing() {
        let filter = Filter::new(&Ar { coefficients: vec![0.8], variance: 1.0, order: 1 }).expect("stationary");
        let (mut a, mut b) = (vec![1.0, 2.0, f64::NAN, 4.0, 5.0], vec![1.0, 2.0, 1e9, 4.0, 5.0]);
        let masked = [false, false, true, false, false];
        filter.apply(&mut a, &masked);
        filter.apply(&mut b, &masked);
        assert_eq!((&a, a[2]), (&b, 0.0));
        assert!((a[3] - (4.0 - 0.8 * 0.8 * 2.0)).abs() < 1e-12 && (a[4] - (5.0 - 0.8 * 4.0)).abs() < 1e-12);
    }

    #[test]
    fn variance_and_coefficients_give_the_innovations_variance() {
        let model = Ar { coefficients: vec![1.2, -0.6], variance: 0.3, order: 2 };
        let r = autocovariance(&model, 0)[0];
        let (a, b) = (Filter::of(&model.coefficients, r).expect("stationary"), Filter::new(&model).expect("stationary"));
        assert!(a.deviations.iter().zip(&b.deviations).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
