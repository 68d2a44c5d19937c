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
use super::projected::{Candidates, Part, Sums, sums_of_each};
use super::screening::Screening;
use super::tried::{Column, Only, Squares, Trial, Tried, pairs};
use crate::diagnose::base::training::Task;
use crate::diagnose::effect::{Added, Candidate};
use crate::error::Errors;
use crate::estimate::{Grouping, SEGMENT, Segment};
use crate::model::Scope;
use rayon::prelude::*;

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
    screen_by(ground, candidates, sums_of_each(ground.segments.len()))
}

/// The same with so many sums of samples of every segment for noise to be drawn on.
fn screen_by(ground: &Ground, candidates: &[Candidate], sums: usize) -> Result<Screening, Errors> {
    let probes = Probes::new(candidates, ground)?;
    let mut trials: Vec<Trial> =
        candidates.iter().enumerate().flat_map(|(i, c)| trials(c, i)).collect();
    let (mut columns, mut bounds) = (Vec::new(), Vec::new());
    for trial in &mut trials {
        let added = &candidates[trial.candidate].added;
        for size in 0..added.len() {
            let Some(null) = added[size].null else { continue };
            for only in sets(ground, &added[size]) {
                trial.columns.push(columns.len());
                columns.push(Column { size, only });
                bounds.push(reach(&added[size], null, trial.row));
            }
        }
    }
    let squares = Squares::of(&trials);
    let draw = (ground.seed, sums);
    let asked = Asked { trials: &trials, columns: &columns, squares: &squares, draw };
    let parts: Vec<Part> = ground
        .segments
        .par_iter()
        .map(|&s| segment(ground, &probes, &asked, s))
        .collect::<Option<_>>()
        .ok_or_else(|| {
            crate::error::Error::new(
                "the base model is not finite at its own estimate: it cannot be diagnosed"
                    .to_string(),
            )
        })?;
    let (n, m) = (ground.free.len(), columns.len());
    let places = pairs(&trials).map(|pair| pair.map(|c| n + c)).collect();
    let mut all = Sums::zero(n, places, n + m + 1, sums * parts.len());
    parts.iter().enumerate().for_each(|(k, part)| all.add(part, k * sums));
    all.priors(ground);
    let before = all.clone();
    all.eliminate(0, n);
    let asked = Tried { trials, columns, bounds };
    Ok(Screening::new(asked, &squares, (&before, &all), ground, candidates))
}

/// How far from null a size may be taken: to its bounds, and to twice the step at which it is tried.
fn reach(added: &Added, null: f64, row: usize) -> (f64, f64) {
    let (low, high) = (added.min - null, added.max - null);
    match added.step(row).map(|step| 2.0 * (step - null)) {
        Some(twice) => (low.max(twice.min(0.0)), high.min(twice.max(0.0))),
        None => (low, high),
    }
}

/// The sets of training segments that share one value of a size, but where it is held; none for all of
/// them.
fn sets(ground: &Ground, added: &Added) -> Vec<Option<Only>> {
    let column = match &added.scope {
        Scope::Campaign => return vec![None],
        Scope::Segment => SEGMENT,
        Scope::Column(column) => column,
    };
    let these: Vec<&Segment> = ground.segments.iter().map(|&s| ground.of[s]).collect();
    let grouping = Grouping::by(column, &these);
    let members = |group: usize| {
        let of = ground.segments.iter().zip(&grouping.of);
        of.filter(move |(_, of)| **of == group).map(|(&s, _)| s).collect()
    };
    let one =
        |(group, value): (usize, &String)| Only { segments: members(group), value: value.clone() };
    let sets = grouping.values.iter().enumerate().map(one);
    sets.filter(|only| added.held_in.as_ref() != Some(&only.value)).map(Some).collect()
}

/// What is asked of every segment.
struct Asked<'a> {
    trials: &'a [Trial],
    columns: &'a [Column],
    squares: &'a Squares,
    /// Seed of the sums of samples, and how many of a segment.
    draw: (u64, usize),
}

/// Sums of one segment; none where the base's model does not run there.
fn segment(ground: &Ground, probes: &Probes, asked: &Asked, s: usize) -> Option<Part> {
    let Ground { case, noise, theta, free, thresholds, .. } = *ground;
    let task = Task { case, noise, segments: ground.segments, free, thresholds };
    let base = task.columns(s, theta)?;
    let samples = base.residuals.len();
    let mut made = probes.run(ground, s);
    let (mut columns, mut places, mut pairs) = (Vec::new(), Vec::new(), Vec::new());
    for (t, trial) in asked.trials.iter().enumerate() {
        let mut made = made[trial.candidate][trial.row].take().unwrap_or_default();
        let from = columns.len();
        let mut here = Vec::new();
        for (k, &c) in trial.columns.iter().enumerate() {
            let column = &asked.columns[c];
            if column.only.as_ref().is_some_and(|only| !only.segments.contains(&s)) {
                continue;
            }
            let known = made.iter_mut().find(|(size, _)| *size == column.size);
            let values = known.map(|(_, values)| std::mem::take(values));
            let values = values.filter(|values| values.iter().all(|v| v.is_finite()));
            columns
                .push(values.filter(|v| v.len() == samples).unwrap_or_else(|| vec![0.0; samples]));
            places.push(c);
            here.push(k);
        }
        for (i, &a) in here.iter().enumerate() {
            for (j, &b) in here.iter().enumerate() {
                let to = asked.squares.place(t, trial.columns.len(), [a, b]);
                pairs.push(([from + i, from + j], to));
            }
        }
    }
    let added = Candidates { columns, places, of: asked.columns.len(), pairs };
    Some(Part::of(ground, s, base, added, asked.draw))
}

#[cfg(test)]
mod tests {
    use super::super::probes::tests::grounded;
    use super::super::surrogate::best_of_surrogates;
    use super::*;
    use crate::diagnose::settings::Settings;

    /// Noise drawn on some sums of samples says of the best of all candidates what noise drawn on as many
    /// sums as there are samples says: mean and 99% within three sd of the difference of two draws
    /// (of the 99% of 4000 some 5%).
    #[test]
    fn coverage_chance_is_the_same_on_sums_of_samples() {
        grounded(&|ground, candidates| {
            let settings = Settings { surrogates: 4000, ..Settings::default() };
            let best = |sums: usize| {
                let screening =
                    screen_by(ground, candidates, sums).unwrap_or_else(|e| panic!("{e}"));
                best_of_surrogates(&screening, &vec![true; candidates.len()], &settings)
            };
            let (few, many) = (best(sums_of_each(ground.segments.len())), best(1500));
            let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
            let sd = (few.iter().map(|x| (x - mean(&few)).powi(2)).sum::<f64>() / 4000.0).sqrt();
            let off = (mean(&few) - mean(&many)) / (sd * (2.0f64 / 4000.0).sqrt());
            assert!(off.abs() < 3.0, "{off}");
            assert!((few[3959] / many[3959] - 1.0).abs() < 0.15, "{} {}", few[3959], many[3959]);
        });
    }
}
