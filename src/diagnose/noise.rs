//! The colour of a base fit's residuals in; residuals and sensitivities made white, segment by segment, out.
//!
//! Every output has an autoregressive model `r_k = a_1 r_(k-1) + ... + w_k`, restarted at each segment: sample `i` is predicted by the
//! predictor of order `min(i, p)` (Levinson and Durbin), so that the first samples count as what they are. Rows are divided by the sd of
//! their innovation: `w = D^-1/2 A r` has unit covariance, and the same linear map makes sensitivities comparable with it.
//! A masked sample counts as its own prediction: it adds nothing, and those after it go on. What the white residuals of outputs that are
//! sampled together still have in common (a gust moves all of them) is taken out by a joint model.

use super::absorbed::{Fitted, Series};
use super::gram::dot;
use super::joint::{Joint, Lagged, together};
use super::thresholds::noise::ORDER;
use crate::estimate::Block;
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
    /// Group of each segment.
    groups: Vec<usize>,
}

impl Noise {
    /// Of the residuals of a fit, with what it absorbed (as far as `fitted` knows) put back. A group that the fit has nothing of has the
    /// noise of the first one.
    pub fn of(fitted: &Fitted) -> Noise {
        let case = fitted.case;
        let groups: Vec<usize> = case.layout.parts.iter().map(|part| part.group).collect();
        let count = groups.iter().copied().max().map_or(1, |g| g + 1);
        let mut noise = Noise { filters: vec![Vec::new(); count], joint: vec![Vec::new(); count], groups };
        let own: Vec<Vec<Products>> = (0..fitted.segments.len()).into_par_iter().map(|at| products(fitted, at)).collect();
        for group in 0..count {
            noise.filters[group] =
                (0..case.outputs.len()).map(|output| filter_of(noise.members(fitted, &own, group), output)).collect();
        }
        let sets = together(case, fitted.segments);
        let sums: Vec<Vec<Lagged>> = (0..fitted.segments.len()).into_par_iter().map(|at| noise.lagged(fitted, at, &sets)).collect();
        for group in 0..count {
            for (k, set) in sets.iter().enumerate() {
                let mut all = Lagged::zero(set.len());
                noise.members(fitted, &sums, group).for_each(|sums| all.add(&sums[k]));
                noise.joint[group].extend(Joint::new(set.clone(), all));
            }
        }
        let known = |g: &usize| fitted.segments.iter().any(|&s| noise.groups[s] == *g);
        let (first, unknown) = ((0..count).find(known), (0..count).filter(|g| !known(g)).collect::<Vec<_>>());
        for (first, group) in unknown.into_iter().filter_map(|g| Some((first?, g))) {
            noise.filters[group] = noise.filters[first].clone();
            noise.joint[group] = noise.joint[first].clone();
        }
        noise
    }

    /// Those of `of` (one per segment of the fit) that belong to a group.
    fn members<'t, T>(&'t self, fitted: &'t Fitted, of: &'t [T], group: usize) -> impl Iterator<Item = &'t T> {
        fitted.segments.iter().zip(of).filter(move |(s, _)| self.groups[**s] == group).map(|(_, t)| t)
    }

    /// Products of one segment's white series, for every set of outputs that are sampled together.
    fn lagged(&self, fitted: &Fitted, at: usize, sets: &[Vec<usize>]) -> Vec<Lagged> {
        let s = fitted.segments[at];
        let mut series = fitted.series(at);
        for one in &mut series {
            match self.filter(s, one.output) {
                Some(filter) => one.columns.iter_mut().for_each(|column| filter.apply(column, &one.masked)),
                None => one.columns.clear(),
            }
        }
        let of = |set: &Vec<usize>| {
            let find = |&o: &usize| series.iter().find(|one| one.output == o && !one.columns.is_empty());
            let all: Option<Vec<&Series>> = set.iter().map(find).collect();
            let all = all.filter(|all| all.iter().all(|one| one.masked.len() == all[0].masked.len()));
            let mut sums = Lagged::zero(set.len());
            let Some(all) = all else { return sums };
            sums.count = all[0].masked.len();
            for column in 0..all[0].columns.len() {
                sums.take(&all.iter().map(|one| &one.columns[column][..]).collect::<Vec<_>>());
            }
            sums
        };
        sets.iter().map(of).collect()
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

/// Sums of products of one output's series in one segment.
struct Products {
    output: usize,
    /// Residuals that were measured.
    count: usize,
    /// By lag.
    sums: Vec<f64>,
}

fn products(fitted: &Fitted, at: usize) -> Vec<Products> {
    let one = |series: Series| {
        let count = series.masked.iter().filter(|masked| !**masked).count();
        let mut sums = vec![0.0; ORDER + 1];
        for column in &series.columns {
            // per valid sample of this column
            let valid = column.iter().filter(|x| x.is_finite()).count() as f64;
            ar::sample_autocovariance(column, ORDER).iter().zip(&mut sums).for_each(|(c, sum)| *sum += valid * c);
        }
        Products { output: series.output, count, sums }
    };
    fitted.series(at).into_iter().map(one).collect()
}

/// The filter of one output's noise from the products of its segments; none where nothing was measured.
fn filter_of<'t>(segments: impl Iterator<Item = &'t Vec<Products>>, output: usize) -> Option<Filter> {
    let (mut count, mut c) = (0, vec![0.0; ORDER + 1]);
    for one in segments.flatten().filter(|one| one.output == output) {
        count += one.count;
        c.iter_mut().zip(&one.sums).for_each(|(c, sum)| *c += sum);
    }
    c.iter_mut().for_each(|c| *c /= count.max(1) as f64);
    c.first().filter(|v| **v > 0.0)?;
    Filter::new(&ar::fit_by(&c, count, ORDER, Order::White))
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
}
