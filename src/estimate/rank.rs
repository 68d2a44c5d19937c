//! A normal matrix in; its condition and the combinations of parameters that the data cannot
//! separate out.

use super::Label;
use crate::least_squares::{Arrow, diagonal};
use crate::math::dense::symmetric_eigen;

/// Whether the data determine the parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// Largest over smallest eigenvalue of the normal matrix scaled to a unit diagonal (every
    /// segment's own parameters first, then the common ones after those are eliminated; the worst
    /// of them). Infinite when singular, NaN without data.
    pub condition: f64,
    /// At least one combination is not determined at all.
    pub singular: bool,
    /// Combinations that are not determined, or hardly (less than 1e-6 of the information of their
    /// parameters alone).
    pub combinations: Vec<Combination>,
}

/// Parameters that can change together with (nearly) no effect on any output.
#[derive(Debug, Clone, PartialEq)]
pub struct Combination {
    /// Share of information left: 0 when the combination has no effect at all.
    pub information: f64,
    pub terms: Vec<Term>,
}

/// A parameter's part in a combination.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    pub name: String,
    /// The segment or the group of segments it belongs to; neither for a value common to all.
    pub segment: Option<usize>,
    pub group: Option<Label>,
    /// In its own unit.
    pub change: f64,
}

impl Combination {
    /// Its terms, each with the group or the segment that it belongs to by the name that `segment`
    /// has for it.
    pub fn names(&self, segment: &dyn Fn(usize) -> String) -> Vec<String> {
        let one = |term: &Term| match (&term.group, term.segment) {
            (Some(group), _) => format!("{} of {group}", term.name),
            (None, Some(s)) => format!("{} of {}", term.name, segment(s)),
            (None, None) => term.name.clone(),
        };
        self.terms.iter().map(one).collect()
    }

    /// What is wrong, with segments by their names.
    pub fn words(&self, segment: &dyn Fn(usize) -> String) -> String {
        weak_words(&self.names(segment))
    }
}

impl std::fmt::Display for Combination {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(&self.words(&|s| format!("segment {s}")))
    }
}

/// What is wrong with parameters that only together, or not at all, have an effect.
pub fn weak_words<S: std::borrow::Borrow<str>>(names: &[S]) -> String {
    match names {
        [one] => format!("{} has no effect on the measured outputs", one.borrow()),
        _ => format!("{} are not distinguishable", names.join(", ")),
    }
}

impl Verdict {
    /// What is not determined at all, in words, by the parameters' names alone.
    pub fn undetermined(&self) -> Vec<String> {
        let names = |c: &Combination| {
            weak_words(&c.terms.iter().map(|term| term.name.as_str()).collect::<Vec<_>>())
        };
        self.combinations.iter().filter(|c| c.information <= NONE).map(names).collect()
    }
}

/// A combination by parameter index.
#[derive(Debug, Clone, PartialEq)]
pub struct Weak {
    pub information: f64,
    pub terms: Vec<(usize, f64)>,
}

/// Below this share of information a combination is reported, below `NONE` it counts as
/// undetermined.
const WEAK: f64 = 1e-6;
/// Squares and sums of some thousand products, each good to 1e-16, leave about this.
pub const NONE: f64 = 1e-12;
/// Components smaller than this share of the largest do not belong to a combination.
const PART: f64 = 0.05;

/// Condition, singular or not, and the weak combinations of `matrix` (priors included).
pub fn judge(matrix: &Arrow) -> (f64, bool, Vec<Weak>) {
    let nc = matrix.shared;
    let mut matrix = matrix.clone();
    let mut weak = Vec::new();
    let mut condition: f64 = 1.0;
    let mut offset = nc;
    for s in 0..matrix.own.len() {
        let n = matrix.own[s].n;
        loop {
            let ss = &matrix.own[s].ss;
            let scale = diagonal(ss, n);
            let found = weakest(ss, &scale, &mut condition);
            let Some((share, change)) = found else { break };
            weak.push(Weak { information: share, terms: terms(&change, &scale, offset) });
            if share > NONE {
                break;
            }
            // Hold the largest part of what cannot be determined, and look at the rest.
            hold(&mut matrix, offset + largest(&change, &scale));
        }
        offset += n;
    }
    judge_shared(&mut matrix, &mut weak, &mut condition);
    let singular = weak.iter().any(|w| w.information <= NONE);
    (if singular { f64::INFINITY } else { condition }, singular, weak)
}

/// The common parameters, with every segment's own ones free to follow.
fn judge_shared(matrix: &mut Arrow, weak: &mut Vec<Weak>, condition: &mut f64) {
    let nc = matrix.shared;
    for _ in 0..nc {
        let Some(schur) = matrix.schur() else { return };
        let scale = diagonal(&matrix.cc, nc);
        let Some((share, change)) = weakest(&schur, &scale, condition) else { return };
        let mut all = terms(&change, &scale, 0);
        let most = all.iter().map(|&(i, d)| d.abs() * scale[i].sqrt()).fold(0.0, f64::max);
        let mut offset = nc;
        for (s, own) in matrix.own.iter().enumerate() {
            for (i, d) in matrix.follow(s, &change).into_iter().enumerate() {
                if d.abs() * own.ss[i * own.n + i].sqrt() > PART * most {
                    all.push((offset + i, d));
                }
            }
            offset += own.n;
        }
        weak.push(Weak { information: share, terms: all });
        if share > NONE {
            return;
        }
        hold(matrix, largest(&change, &scale));
    }
}

/// The eigenvector of the smallest eigenvalue of `matrix` scaled by `scale`, as a change of the
/// parameters, if that eigenvalue is below `WEAK`; notes the condition otherwise.
fn weakest(matrix: &[f64], scale: &[f64], condition: &mut f64) -> Option<(f64, Vec<f64>)> {
    let n = scale.len();
    if let Some(i) = (0..n).find(|&i| !(scale[i] > 0.0)) {
        let mut change = vec![0.0; n];
        change[i] = 1.0;
        return Some((0.0, change));
    }
    let root: Vec<f64> = scale.iter().map(|d| d.sqrt()).collect();
    let scaled: Vec<f64> = (0..n * n).map(|k| matrix[k] / (root[k / n] * root[k % n])).collect();
    let eigen = symmetric_eigen(&scaled, n);
    let (Some(&least), Some(&most)) = (eigen.values.first(), eigen.values.last()) else {
        return None;
    };
    let share = (least / most).max(0.0);
    if share > 0.0 {
        *condition = condition.max(1.0 / share);
    }
    if share >= WEAK {
        return None;
    }
    Some((share, (0..n).map(|i| eigen.vectors[i] / root[i]).collect()))
}

/// The parts of a change that matter, each measured against what its parameter alone would show.
fn terms(change: &[f64], scale: &[f64], offset: usize) -> Vec<(usize, f64)> {
    let size =
        |i: usize| if scale[i] > 0.0 { change[i].abs() * scale[i].sqrt() } else { change[i].abs() };
    let most = (0..change.len()).map(size).fold(0.0, f64::max);
    (0..change.len()).filter(|&i| size(i) > PART * most).map(|i| (offset + i, change[i])).collect()
}

fn largest(change: &[f64], scale: &[f64]) -> usize {
    let size = |i: usize| change[i].abs() * if scale[i] > 0.0 { scale[i].sqrt() } else { 1.0 };
    (0..change.len()).fold(0, |best, i| if size(i) > size(best) { i } else { best })
}

fn hold(matrix: &mut Arrow, index: usize) {
    matrix.clear(index);
    matrix.add_diagonal(index, 1.0);
}
