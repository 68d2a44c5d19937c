//! Sums over all segments in; the gain in log-likelihood that every candidate promises, and what
//! noise would make of the same columns, out.

use super::ground::Ground;
use super::projected::Sums;
use super::settled::Settled;
use super::tried::{Imitator, Reference, Screened, Squares, Tried};
use crate::diagnose::effect::{Added, Candidate};
use crate::diagnose::residual::gain::gain;
use crate::math::products::{DEPENDENT, with_each};
use crate::model::Scope;

/// Of a candidate's column less than this share is left beside the base: an estimate of its size
/// would have more than thirty times the sd that it has with the base known.
const IMITATED: f64 = 1e-3;

/// All candidates at one base fit.
#[derive(Debug, Clone)]
pub struct Screening {
    pub screened: Vec<Screened>,
    tried: Tried,
    /// Per trial, its columns that are told apart.
    settled: Vec<Settled>,
    /// Per candidate, its trials.
    trials: Vec<Vec<usize>>,
    /// Per column: what residuals say.
    slopes: Vec<f64>,
    /// Per column that is kept of a trial, in their order: its sums of samples beside the base.
    sums: Vec<Vec<f64>>,
    /// Per trial, the first of those.
    from: Vec<usize>,
}

/// A gain, the trial that has it, and its coefficients.
type Best = (f64, usize, Vec<f64>);

impl Screening {
    /// `sums`: with the base's shared parameters, and with them eliminated.
    pub(super) fn new(
        tried: Tried,
        squares: &Squares,
        (before, all): (&Sums, &Sums),
        ground: &Ground,
        candidates: &[Candidate],
    ) -> Screening {
        let (n, m) = (ground.free.len(), tried.columns.len());
        let collinear = ground.thresholds.collinear.max(DEPENDENT);
        let (mut settled, mut sums, mut from) = (Vec::new(), Vec::new(), Vec::new());
        let mut shares = vec![0.0; m];
        for (t, trial) in tried.trials.iter().enumerate() {
            let k = trial.columns.len();
            let products = &all.products[squares.of_trial(t, k)];
            let raw: Vec<f64> = trial.columns.iter().map(|c| all.scale[n + c]).collect();
            for (i, &c) in trial.columns.iter().enumerate().filter(|(i, _)| raw[*i] > 0.0) {
                shares[c] = products[i * k + i] / raw[i];
            }
            let sound: Vec<bool> = trial.columns.iter().map(|&c| shares[c] > collinear).collect();
            let drawn: Vec<&[f64]> =
                trial.columns.iter().map(|c| all.sketch[n + c].as_slice()).collect();
            let one = Settled::of(products, &raw, &sound, &drawn);
            from.push(sums.len());
            sums.extend(one.kept.iter().map(|&i| drawn[i].to_vec()));
            settled.push(one);
        }
        let of = |c: usize| {
            let own = |t: &usize| tried.trials[*t].candidate == c;
            (0..tried.trials.len()).filter(own).collect()
        };
        let trials = (0..candidates.len()).map(of).collect();
        let slopes = all.slopes[n..n + m].to_vec();
        let mut screening =
            Screening { screened: Vec::new(), tried, settled, trials, slopes, sums, from };
        let judge = |c| screening.judge(c, candidates, (&shares, before), ground);
        screening.screened = (0..candidates.len()).map(judge).collect();
        screening
    }

    /// The trial of a candidate that gains most for the slopes `u` of what is kept of each (by trial),
    /// with columns within the bounds `bounds`.
    fn most(
        &self,
        candidate: usize,
        u: &dyn Fn(usize) -> Vec<f64>,
        bounds: &dyn Fn(usize) -> (f64, f64),
    ) -> Option<Best> {
        let mut best: Option<Best> = None;
        for &t in &self.trials[candidate] {
            let (trial, settled) = (&self.tried.trials[t], &self.settled[t]);
            if settled.kept.is_empty() {
                continue;
            }
            let bounds: Vec<(f64, f64)> =
                settled.kept.iter().map(|&k| bounds(trial.columns[k])).collect();
            let (gain, b) = gain(&settled.information, &u(t), &bounds);
            if best.as_ref().is_none_or(|(g, ..)| gain > *g) {
                let mut all = vec![0.0; trial.columns.len()];
                settled.kept.iter().zip(&b).for_each(|(&k, b)| all[k] = *b);
                best = Some((gain, t, all));
            }
        }
        best
    }

    /// What residuals say of the columns kept of a trial.
    fn found(&self, trial: usize) -> Vec<f64> {
        let columns = &self.tried.trials[trial].columns;
        self.settled[trial].kept.iter().map(|&k| self.slopes[columns[k]]).collect()
    }

    fn best(&self, candidate: usize, u: &dyn Fn(usize) -> Vec<f64>) -> Option<Best> {
        self.most(candidate, u, &|c| self.tried.bounds[c])
    }

    /// Where a fit starts: the best trial once switches are held. With a size that is free as well,
    /// much play at half its size looks like half of it, and a fit from there does not find back.
    fn start(&self, candidate: usize, candidates: &[Candidate]) -> Option<Best> {
        let added = &candidates[candidate].added;
        let bounds = |c: usize| {
            let size = &added[self.tried.columns[c].size];
            size.hold.map_or(self.tried.bounds[c], |hold| {
                let b = hold - size.null.unwrap_or_default();
                (b, b)
            })
        };
        self.most(candidate, &|t| self.found(t), &bounds)
    }

    /// `shares`: what the base leaves of each column.
    fn judge(
        &self,
        candidate: usize,
        candidates: &[Candidate],
        (shares, before): (&[f64], &Sums),
        ground: &Ground,
    ) -> Screened {
        let n = ground.free.len();
        let trials = self.trials[candidate].iter().map(|&t| &self.tried.trials[t]);
        let mine: Vec<usize> = trials.flat_map(|t| t.columns.iter().copied()).collect();
        let raw = |c: usize| before.scale[n + c];
        let left = mine.iter().map(|&c| shares[c]).fold(0.0, f64::max);
        let silent = mine.iter().all(|&c| raw(c) <= 0.0);
        let none = Screened {
            gain: 0.0,
            taken: 0,
            at: Vec::new(),
            left,
            imitators: Vec::new(),
            references: Vec::new(),
            silent,
        };
        let imitators = || {
            let by = mine.iter().max_by(|a, b| raw(**a).total_cmp(&raw(**b)));
            let by = by.filter(|_| !silent && left < IMITATED);
            by.map(|&c| imitators(ground, before, c)).unwrap_or_default()
        };
        let (Some((gain, best, found)), Some((_, t, b))) =
            (self.best(candidate, &|t| self.found(t)), self.start(candidate, candidates))
        else {
            return Screened { imitators: imitators(), ..none };
        };
        let references = self.references(best, &found, &candidates[candidate].added);
        let trial = &self.tried.trials[t];
        let mut at = trial.at.clone();
        for (&c, b) in trial.columns.iter().zip(&b).rev() {
            let column = &self.tried.columns[c];
            let null = candidates[candidate].added[column.size].null.unwrap_or_default();
            at[column.size] = null + b;
        }
        let taken = self.settled[t].kept.len();
        Screened { gain, taken, at, imitators: imitators(), references, ..none }
    }

    /// Of each size of a trial that differs by a column, and whose values the base moves all at once: the
    /// value in the middle of those found. What is common to them is the base's.
    fn references(&self, trial: usize, found: &[f64], added: &[Added]) -> Vec<Reference> {
        let (columns, settled) = (&self.tried.trials[trial].columns, &self.settled[trial]);
        let size_of = |k: &usize| self.tried.columns[columns[*k]].size;
        let by_column = |size: &usize| matches!(added[*size].scope, Scope::Column(_));
        let mut sizes: Vec<usize> =
            settled.dependent.iter().map(size_of).filter(by_column).collect();
        sizes.dedup();
        let middle = |size: usize| {
            let told = settled.kept.iter().chain(&settled.dependent);
            let mut mine: Vec<usize> = told.copied().filter(|k| size_of(k) == size).collect();
            mine.sort_by(|&a, &b| found[a].total_cmp(&found[b]).then(a.cmp(&b)));
            let at = mine.get((mine.len() - 1) / 2)?;
            let value = self.tried.columns[columns[*at]].only.as_ref()?.value.clone();
            Some(Reference { size, value })
        };
        sizes.into_iter().filter_map(middle).collect()
    }

    /// How many sums of samples noise is drawn on.
    pub fn sums(&self) -> usize {
        self.sums.first().map_or(0, Vec::len)
    }

    /// Gains of the candidates that take part, 0 for the others, in surrogate campaigns with the white
    /// noise `noise` on the sums of samples, `[campaign][candidate]`.
    pub fn gains(&self, noise: &[Vec<f64>], takes_part: &[bool]) -> Vec<Vec<f64>> {
        // A column at a time for all campaigns: it is read once.
        let drawn: Vec<Vec<f64>> = self.sums.iter().map(|sums| with_each(sums, noise)).collect();
        let of = |campaign: usize, t: usize| {
            let own = self.from[t]..self.from[t] + self.settled[t].kept.len();
            let slopes: Vec<f64> = drawn[own].iter().map(|of| of[campaign]).collect();
            self.settled[t].drawn(&slopes)
        };
        let gain = |campaign: usize, c: usize| {
            let best = || self.best(c, &|t| of(campaign, t));
            if takes_part[c] { best().map_or(0.0, |best| best.0) } else { 0.0 }
        };
        (0..noise.len()).map(|i| (0..self.trials.len()).map(|c| gain(i, c)).collect()).collect()
    }
}

/// Free base parameters that imitate a column most; none where those of single maneuvers do.
fn imitators(ground: &Ground, before: &Sums, column: usize) -> Vec<Imitator> {
    let n = ground.free.len();
    let (alone, x) = before.imitated(n + column);
    if alone <= ground.thresholds.collinear.max(DEPENDENT) * before.scale[n + column] {
        return Vec::new();
    }
    let worth = |i: usize| x[i] * x[i] * before.at(i, i);
    let mut parts: Vec<(f64, usize)> = (0..n).map(|i| (worth(i), i)).collect();
    parts.sort_by(|a, b| b.0.total_cmp(&a.0));
    let most = parts.first().map_or(0.0, |p| p.0);
    let named = |&(_, i): &(f64, usize)| {
        let unknown = &ground.case.unknowns[ground.free[i]];
        Imitator { name: unknown.name.clone(), unit: unknown.unit.clone(), shift: x[i] }
    };
    parts.iter().filter(|p| p.0 > 1e-2 * most).take(5).map(named).collect()
}
