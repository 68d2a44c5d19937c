//! A base fit and candidates in; the gain in log-likelihood that each promises, by a score test,
//! out.
//!
//! At the base fit, with `e` the whitened residuals and `H` the whitened sensitivities of the
//! outputs to what a candidate adds (at its null), projected on what the base's own free parameters
//! cannot imitate: `u = H~'e`, `F = H~'H~`, gain `= max_b (b'u - b'Fb/2)` within the candidate's
//! bounds (Rao's score test; `u'F^-1 u/2` inside them). Shapes (a delay, a threshold) matter only
//! once the size is not null: every row of their starts has columns of its own. A fit starts from
//! the row that is best once switches are held.
//!
//! Of some sizes the derivative at null says nothing: friction that is close to none only slows what
//! moves, and what matters is that it holds. An effect gives such a size steps; a row then has the
//! difference quotient `(y(step) - y(null))/(step - null)` for a column, taken as far as to twice
//! that step.

use super::ground::Ground;
use super::probes::Probes;
use crate::diagnose::base::spread::Columns;
use crate::diagnose::base::training::Task;
use crate::diagnose::effect::{Added, Candidate};
use crate::diagnose::residual::gain::gain;
use crate::error::Errors;
use crate::estimate::{Grouping, SEGMENT, Segment};
use crate::math::products::{DEPENDENT, Gram};
use crate::model::Scope;
use rayon::prelude::*;

/// One column of a candidate.
#[derive(Debug, Clone, PartialEq)]
struct Column {
    trial: usize,
    /// Index into `Candidate::added`.
    size: usize,
    /// The segments it belongs to; none for a size common to all.
    only: Option<Vec<usize>>,
}

/// One way to bring a candidate in: a row of the starts of its shapes and the steps of its sizes.
#[derive(Debug, Clone, PartialEq)]
struct Trial {
    candidate: usize,
    /// Of the starts of its shapes and the steps of its sizes.
    row: usize,
    /// Values of the added parameters, sizes at null.
    at: Vec<f64>,
    columns: Vec<usize>,
}

/// What screening says of one candidate.
#[derive(Debug, Clone, PartialEq)]
pub struct Screened {
    /// Gain in log-likelihood of the best of its trials.
    pub gain: f64,
    /// Parameters that this gain takes.
    pub taken: usize,
    /// Values of the added parameters that a fit may start from (of the first segment, for those
    /// per segment).
    pub at: Vec<f64>,
    /// Share of the column that the base's parameters cannot imitate.
    pub left: f64,
    /// Base parameters that imitate it most, where next to nothing is left.
    pub imitators: Vec<Imitator>,
    /// The model did not run, or nothing in the flights moves it.
    pub silent: bool,
}

/// A parameter of the base that takes over what a candidate would say.
#[derive(Debug, Clone, PartialEq)]
pub struct Imitator {
    pub name: String,
    pub unit: String,
    /// How far it comes out off where one unit of the candidate's size is left out.
    pub shift: f64,
}

/// Of a candidate's column less than this share is left beside the base: an estimate of its size
/// would have more than thirty times the sd that it has with the base known.
const IMITATED: f64 = 1e-3;

/// All candidates at one base fit.
#[derive(Debug, Clone)]
pub struct Screening {
    pub screened: Vec<Screened>,
    trials: Vec<Trial>,
    columns: Vec<Column>,
    bounds: Vec<(f64, f64)>,
    /// Products of the projected columns, then of the residuals.
    rest: Gram,
    raw: Vec<f64>,
    /// A column is of the base's making if less than this share of it is left.
    collinear: f64,
}

fn trials(candidate: &Candidate, index: usize) -> Vec<Trial> {
    (0..candidate.rows())
        .map(|row| Trial { candidate: index, row, at: candidate.start(row), columns: Vec::new() })
        .collect()
}

/// Screens all candidates.
///
/// # Errors
/// A candidate's model does not fit the settings of the base's estimation.
pub fn screen(ground: &Ground, candidates: &[Candidate]) -> Result<Screening, Errors> {
    let probes = Probes::new(candidates, ground)?;
    let mut trials: Vec<Trial> =
        candidates.iter().enumerate().flat_map(|(i, c)| trials(c, i)).collect();
    let (mut columns, mut bounds) = (Vec::new(), Vec::new());
    for (t, trial) in trials.iter_mut().enumerate() {
        let added = &candidates[trial.candidate].added;
        for size in 0..added.len() {
            let Some(null) = added[size].null else { continue };
            for only in sets(ground, &added[size].scope) {
                trial.columns.push(columns.len());
                columns.push(Column { trial: t, size, only });
                bounds.push(reach(&added[size], null, trial.row));
            }
        }
    }
    let parts: Vec<(Gram, Vec<usize>)> = ground
        .segments
        .par_iter()
        .map(|&s| segment(ground, &probes, &trials, &columns, s))
        .collect::<Option<_>>()
        .ok_or_else(|| {
            crate::error::Error::new(
                "the base model is not finite at its own estimate: it cannot be diagnosed"
                    .to_string(),
            )
        })?;
    let (n, m) = (ground.free.len(), columns.len());
    let mut all = Gram::zero(n + m + 1);
    for ((part, to), &s) in parts.iter().zip(ground.segments) {
        all.add(part, ground.case.layout.parts[s].own, to);
    }
    for (place, &i) in ground.free.iter().enumerate() {
        all.pull(place, ground.case.layout.prior(i, ground.theta[i]));
    }
    let before = all.clone();
    all.eliminate(0, n);
    let rest = all.rest(n);
    let raw = rest.scale.clone();
    let collinear = ground.thresholds.collinear;
    let mut screening =
        Screening { screened: Vec::new(), trials, columns, bounds, rest, raw, collinear };
    screening.screened =
        (0..candidates.len()).map(|c| screening.judge(c, candidates, ground, &before)).collect();
    Ok(screening)
}

/// How far from null a size may be taken: to its bounds, and to twice the step at which it is tried.
fn reach(added: &Added, null: f64, row: usize) -> (f64, f64) {
    let (low, high) = (added.min - null, added.max - null);
    match added.step(row).map(|step| 2.0 * (step - null)) {
        Some(twice) => (low.max(twice.min(0.0)), high.min(twice.max(0.0))),
        None => (low, high),
    }
}

/// The sets of training segments that share one value of a parameter; none for all of them.
fn sets(ground: &Ground, scope: &Scope) -> Vec<Option<Vec<usize>>> {
    let column = match scope {
        Scope::Campaign => return vec![None],
        Scope::Segment => SEGMENT,
        Scope::Column(column) => column,
    };
    let these: Vec<&Segment> = ground.segments.iter().map(|&s| ground.of[s]).collect();
    let grouping = Grouping::by(column, &these);
    let members = |group: usize| {
        ground
            .segments
            .iter()
            .zip(&grouping.of)
            .filter(move |(_, of)| **of == group)
            .map(|(&s, _)| s)
            .collect()
    };
    (0..grouping.values.len()).map(|group| Some(members(group))).collect()
}

/// Products of one segment: own parameters eliminated, then the free shared ones, the candidates'
/// columns, the residuals.
fn segment(
    ground: &Ground,
    probes: &Probes,
    trials: &[Trial],
    columns: &[Column],
    s: usize,
) -> Option<(Gram, Vec<usize>)> {
    let Ground { case, noise, theta, free, thresholds, .. } = *ground;
    let task = Task { case, noise, segments: ground.segments, free, thresholds };
    let Columns { columns: mut used, mut to, residuals: e } = task.columns(s, theta)?;
    let made = probes.run(ground, s);
    for (t, trial) in trials.iter().enumerate() {
        let made = made[trial.candidate][trial.row].as_ref();
        for &c in &trial.columns {
            let column = &columns[c];
            debug_assert_eq!(column.trial, t);
            if column.only.as_ref().is_some_and(|only| !only.contains(&s)) {
                continue;
            }
            let known = made.and_then(|made| made.iter().find(|(size, _)| *size == column.size));
            let values = known
                .map(|(_, values)| values.clone())
                .filter(|values| values.iter().all(|v| v.is_finite()));
            used.push(values.unwrap_or_else(|| vec![0.0; e.len()]));
            to.push(ground.free.len() + c);
        }
    }
    to.push(ground.free.len() + columns.len());
    used.push(e);
    Some((task.products(s, theta, &used), to))
}

impl Screening {
    /// Best trial of a candidate for slopes `u` of all columns: gain, trial, coefficients.
    fn best(&self, candidate: usize, u: &dyn Fn(usize) -> f64) -> Option<(f64, usize, Vec<f64>)> {
        self.most(candidate, u, &|c| self.bounds[c])
    }

    /// The same with the columns within other bounds.
    fn most(
        &self,
        candidate: usize,
        u: &dyn Fn(usize) -> f64,
        bounds: &dyn Fn(usize) -> (f64, f64),
    ) -> Option<(f64, usize, Vec<f64>)> {
        let mut best: Option<(f64, usize, Vec<f64>)> = None;
        for (t, trial) in self.trials.iter().enumerate().filter(|(_, t)| t.candidate == candidate) {
            let sound: Vec<usize> =
                trial.columns.iter().copied().filter(|&c| self.is_sound(c)).collect();
            if sound.is_empty() {
                continue;
            }
            let f = self.rest.block(&sound);
            let slopes: Vec<f64> = sound.iter().map(|&c| u(c)).collect();
            let bounds: Vec<(f64, f64)> = sound.iter().map(|&c| bounds(c)).collect();
            let (gain, b) = gain(&f, &slopes, &bounds);
            if best.as_ref().is_none_or(|(g, _, _)| gain > *g) {
                let all = trial
                    .columns
                    .iter()
                    .map(|c| sound.iter().position(|k| k == c).map_or(0.0, |k| b[k]))
                    .collect();
                best = Some((gain, t, all));
            }
        }
        best
    }

    /// Where a fit starts: the best trial once switches are held. With a size that is free as well,
    /// much play at half its size looks like half of it, and a fit from there does not find back.
    fn start(&self, candidate: usize, candidates: &[Candidate]) -> Option<(f64, usize, Vec<f64>)> {
        let added = &candidates[candidate].added;
        let bounds = |c: usize| {
            let size = &added[self.columns[c].size];
            size.hold.map_or(self.bounds[c], |hold| {
                let b = hold - size.null.unwrap_or_default();
                (b, b)
            })
        };
        self.most(candidate, &|c| self.rest.at(c, self.columns.len()), &bounds)
    }

    fn is_sound(&self, column: usize) -> bool {
        self.raw[column] > 0.0
            && self.rest.at(column, column) > self.collinear.max(DEPENDENT) * self.raw[column]
    }

    fn judge(
        &self,
        candidate: usize,
        candidates: &[Candidate],
        ground: &Ground,
        before: &Gram,
    ) -> Screened {
        let e = self.columns.len();
        let mine: Vec<usize> = self
            .trials
            .iter()
            .filter(|t| t.candidate == candidate)
            .flat_map(|t| t.columns.iter().copied())
            .collect();
        let left = mine
            .iter()
            .filter(|&&c| self.raw[c] > 0.0)
            .map(|&c| self.rest.at(c, c) / self.raw[c])
            .fold(0.0, f64::max);
        let silent = mine.iter().all(|&c| self.raw[c] <= 0.0);
        let none =
            Screened { gain: 0.0, taken: 0, at: Vec::new(), left, imitators: Vec::new(), silent };
        let imitators = || {
            let by = mine.iter().max_by(|a, b| self.raw[**a].total_cmp(&self.raw[**b]));
            let by = by.filter(|_| !silent && left < IMITATED);
            by.map(|&c| imitators(ground, before, c)).unwrap_or_default()
        };
        let (Some((gain, ..)), Some((_, t, b))) =
            (self.best(candidate, &|c| self.rest.at(c, e)), self.start(candidate, candidates))
        else {
            return Screened { imitators: imitators(), ..none };
        };
        let trial = &self.trials[t];
        let mut at = trial.at.clone();
        for (&c, b) in trial.columns.iter().zip(&b).rev() {
            let column = &self.columns[c];
            let null = candidates[candidate].added[column.size].null.unwrap_or_default();
            at[column.size] = null + b;
        }
        Screened { gain, taken: trial.columns.len(), at, imitators: imitators(), ..none }
    }

    /// Gains of the candidates that take part for slopes `u` (per column), 0 for the others: what a
    /// surrogate campaign yields.
    pub fn gains(&self, u: &[f64], takes_part: &[bool]) -> Vec<f64> {
        let gain =
            |c: usize| self.best(c, &|k| u[k]).filter(|_| takes_part[c]).map_or(0.0, |best| best.0);
        (0..self.screened.len()).map(gain).collect()
    }

    /// Information of all columns, `[n][n]`, and how many there are; those that say nothing are
    /// zero.
    pub fn information(&self) -> (Vec<f64>, usize) {
        let n = self.columns.len();
        let all: Vec<usize> = (0..n).collect();
        let mut f = self.rest.block(&all);
        for k in 0..n * n {
            if !self.is_sound(k / n) || !self.is_sound(k % n) {
                f[k] = 0.0;
            }
        }
        (f, n)
    }
}

/// Free base parameters that imitate a column most; none where those of single maneuvers do.
fn imitators(ground: &Ground, before: &Gram, column: usize) -> Vec<Imitator> {
    let n = ground.free.len();
    if before.at(n + column, n + column)
        <= ground.thresholds.collinear.max(DEPENDENT) * before.scale[n + column]
    {
        return Vec::new();
    }
    let order: Vec<usize> = (0..n).chain([n + column]).collect();
    let mut gram = Gram::zero(n + 1);
    for (a, &from) in order.iter().enumerate() {
        gram.scale[a] = before.scale[from];
        (a..=n).for_each(|b| gram.sums[a * (n + 1) + b] = before.at(from, order[b]));
    }
    gram.eliminate(0, n);
    let mut x = vec![0.0; n + 1];
    gram.solve(0, n, n, &mut x);
    let mut parts: Vec<(f64, usize)> = (0..n).map(|i| (x[i] * x[i] * before.at(i, i), i)).collect();
    parts.sort_by(|a, b| b.0.total_cmp(&a.0));
    let most = parts.first().map_or(0.0, |p| p.0);
    let named = |&(_, i): &(f64, usize)| {
        let unknown = &ground.case.unknowns[ground.free[i]];
        Imitator { name: unknown.name.clone(), unit: unknown.unit.clone(), shift: x[i] }
    };
    parts.iter().filter(|p| p.0 > 1e-2 * most).take(5).map(named).collect()
}
