//! All candidates in; their whitened sensitivities in one segment, trial by trial, out.
//!
//! Most candidates add terms to a model and nothing else: with all sizes at null its trajectory is the
//! base's, whatever else stands at null beside them. So many of them are put into one model and run at
//! once: states and Jacobian of the base are computed once for all, and its sensitivities have one
//! column for each size. What adds states, delays or stops, or is tried at steps of its size, has a
//! run of its own.

use super::ground::Ground;
use super::probe::Probe;
use crate::diagnose::effect::{Added, Candidate};
use crate::error::Errors;
use crate::least_squares::give_back;
use crate::model::Model;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::OnceLock;

/// Sizes that are run at once, about: a few rows of states and sizes stay in the first cache.
const MANY: usize = 64;

/// Whitened columns of one trial, by size.
pub type Columns = Vec<(usize, Vec<f64>)>;

/// The models of all candidates.
pub struct Probes<'a> {
    candidates: &'a [Candidate],
    groups: Vec<Group>,
    /// Of the candidates that are in no group, and of those whose group did not run.
    own: Vec<OnceLock<Option<Probe>>>,
}

/// Candidates that are run at once.
struct Group {
    /// Places among all, ascending, and where the parameters of each begin among those of the probe.
    members: Vec<(usize, usize)>,
    probe: Probe,
}

impl<'a> Probes<'a> {
    /// # Errors
    /// A candidate's model does not fit the settings of the base's estimation.
    pub fn new(candidates: &'a [Candidate], ground: &Ground) -> Result<Probes<'a>, Errors> {
        let (plain, rest): (Vec<usize>, Vec<usize>) =
            (0..candidates.len()).partition(|&i| adds_terms(&candidates[i], &ground.case.model));
        let found: Vec<Found> = bunches(candidates, &plain)
            .par_iter()
            .map(|bunch| together(candidates, bunch, ground))
            .collect::<Result<_, _>>()?;
        let kept: Vec<OnceLock<Option<Probe>>> =
            (0..candidates.len()).map(|_| OnceLock::new()).collect();
        let mut groups = Vec::new();
        let mut alone: Vec<(usize, Probe)> = rest
            .par_iter()
            .map(|&i| Ok((i, own(&candidates[i], ground)?)))
            .collect::<Result<_, Errors>>()?;
        for one in found {
            groups.extend(one.groups);
            alone.extend(one.alone);
        }
        for (i, probe) in alone {
            kept[i].get_or_init(|| Some(probe));
        }
        Ok(Probes { candidates, groups, own: kept })
    }

    /// Whitened columns of every row of starts of every candidate in segment `s`,
    /// `[candidate][row]`; none where its model does not run.
    pub fn run(&self, ground: &Ground, s: usize) -> Vec<Vec<Option<Columns>>> {
        let mut all: Vec<Vec<Option<Columns>>> =
            self.candidates.iter().map(|c| vec![None; c.rows()]).collect();
        for group in &self.groups {
            for row in 0..group.rows(self.candidates) {
                let Some(made) = group.run(self.candidates, ground, s, row) else { continue };
                for (candidate, columns) in made {
                    all[candidate][row] = Some(columns);
                }
            }
        }
        for (i, rows) in all.iter_mut().enumerate() {
            let candidate = &self.candidates[i];
            for (row, columns) in rows.iter_mut().enumerate().filter(|(_, known)| known.is_none()) {
                let probe = self.own[i].get_or_init(|| own(candidate, ground).ok());
                let at = candidate.start(row);
                let made = probe.as_ref().and_then(|probe| white(probe, ground, s, &at, row));
                *columns = made.map(Iterator::collect);
            }
        }
        all
    }
}

/// The probe of one candidate alone.
fn own(candidate: &Candidate, ground: &Ground) -> Result<Probe, Errors> {
    Ok(Probe::new(candidate, ground)?.compiled(ground.case, candidate.rows()))
}

/// Whether it adds terms and nothing else.
fn adds_terms(candidate: &Candidate, base: &Model) -> bool {
    let model = &candidate.model;
    let counts = |m: &Model| [m.states.len(), m.delays.len(), m.moving.len(), m.layout.inputs];
    let limited = |m: &Model| m.states.iter().flat_map(|s| [s.min, s.max]).flatten().count();
    counts(model) == counts(base)
        && limited(model) == limited(base)
        && candidate.added.iter().all(|a| a.steps.is_empty())
        && candidate.added.iter().any(|a| a.null.is_some())
}

/// Candidates in bunches of about so many sizes, none with names that another of its bunch declares.
fn bunches(candidates: &[Candidate], plain: &[usize]) -> Vec<Vec<usize>> {
    let mut all: Vec<(Vec<usize>, BTreeSet<&str>, usize)> = Vec::new();
    for &i in plain {
        let sizes = candidates[i].added.iter().filter(|a| a.null.is_some()).count();
        let fits = |(_, names, n): &&mut (Vec<usize>, BTreeSet<&str>, usize)| {
            *n < MANY && candidates[i].names().all(|name| !names.contains(name))
        };
        match all.iter_mut().find(fits) {
            Some((members, names, n)) => {
                members.push(i);
                names.extend(candidates[i].names());
                *n += sizes;
            }
            None => all.push((vec![i], candidates[i].names().collect(), sizes)),
        }
    }
    all.into_iter().map(|(members, ..)| members).collect()
}

/// What became of a bunch.
#[derive(Default)]
struct Found {
    groups: Vec<Group>,
    alone: Vec<(usize, Probe)>,
}

/// The group of a bunch; of each half, where its candidates do not go together (each reads what the
/// other changes, say).
fn together(candidates: &[Candidate], bunch: &[usize], ground: &Ground) -> Result<Found, Errors> {
    if let [i] = *bunch {
        let alone = vec![(i, own(&candidates[i], ground)?)];
        return Ok(Found { alone, ..Found::default() });
    }
    match Group::new(candidates, bunch, ground) {
        Ok(group) => Ok(Found { groups: vec![group], ..Found::default() }),
        Err(_) => {
            let (one, other) = bunch.split_at(bunch.len() / 2);
            let mut found = together(candidates, one, ground)?;
            let more = together(candidates, other, ground)?;
            found.groups.extend(more.groups);
            found.alone.extend(more.alone);
            Ok(found)
        }
    }
}

impl Group {
    fn new(candidates: &[Candidate], bunch: &[usize], ground: &Ground) -> Result<Group, Errors> {
        let all: Vec<&Candidate> = bunch.iter().map(|&i| &candidates[i]).collect();
        let model = all[0].with(&all[1..])?;
        let mut added: Vec<Added> = Vec::new();
        let mut members = Vec::new();
        for (&i, candidate) in bunch.iter().zip(&all) {
            members.push((i, added.len()));
            added.extend(candidate.added.iter().cloned());
        }
        let rows = all.iter().map(|c| c.rows()).max().unwrap_or(1);
        let probe = Probe::of(&model, added, ground)?.compiled(ground.case, rows);
        Ok(Group { members, probe })
    }

    fn rows(&self, candidates: &[Candidate]) -> usize {
        self.members.iter().map(|(i, _)| candidates[*i].rows()).max().unwrap_or(0)
    }

    /// Columns of the members that have such a row; none where the model does not run.
    fn run(
        &self,
        candidates: &[Candidate],
        ground: &Ground,
        s: usize,
        row: usize,
    ) -> Option<Vec<(usize, Columns)>> {
        let at: Vec<f64> =
            self.members.iter().flat_map(|(i, _)| candidates[*i].start(row)).collect();
        let mut columns = white(&self.probe, ground, s, &at, row)?.peekable();
        let mut made = Vec::new();
        for &(i, from) in &self.members {
            let to = from + candidates[i].added.len();
            let mut own = Vec::new();
            while let Some((size, values)) = columns.next_if(|(size, _)| *size < to) {
                own.push((size - from, values));
            }
            if row < candidates[i].rows() {
                made.push((i, own));
            }
        }
        Some(made)
    }
}

/// Whitened columns of a probe in a segment, by size; none where its model does not run.
fn white<'p>(
    probe: &'p Probe,
    ground: &Ground,
    s: usize,
    at: &[f64],
    row: usize,
) -> Option<impl Iterator<Item = (usize, Vec<f64>)> + use<'p>> {
    let blocks = probe.run(ground, s, at, row)?;
    let all: Vec<usize> = (0..probe.sizes.len()).collect();
    let white = ground.noise.whiten(s, &blocks, &all);
    give_back(blocks);
    Some(probe.sizes.iter().copied().zip(white))
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::diagnose::effect::{self, Context};
    use crate::diagnose::residual::absorbed::Fitted;
    use crate::diagnose::residual::colour::noise_of;
    use crate::diagnose::residual::evaluation::Evaluation;
    use crate::diagnose::tests::{campaign, model};
    use crate::diagnose::thresholds::Thresholds;
    use crate::estimate::{Prepared, Segment, Settings};
    use crate::noise::Rule;

    /// What candidates of the whole library are screened against in a small campaign.
    pub fn grounded(check: &dyn Fn(&Ground, &[Candidate])) {
        let base = model("", "", "alpha");
        let segments = campaign(&base, 1, 0.0);
        let (method, thresholds) = (Settings::default(), Thresholds::default());
        let prepared = Prepared::new(&base, &segments, &method).unwrap_or_else(|e| panic!("{e}"));
        let case = prepared.case();
        let theta = case.layout.start.clone();
        let all: Vec<usize> = (0..segments.len()).collect();
        let free: Vec<usize> = (0..5).collect();
        let at = Evaluation::new(&case, &theta, &all);
        let noise = noise_of(&Fitted::new(&at, &all, &free, &[], Rule::default()), &thresholds);
        let of: Vec<&Segment> = segments.iter().collect();
        let ground = Ground {
            case: &case,
            noise: &noise,
            method: &method,
            theta: &theta,
            segments: &all,
            free: &free,
            of: &of,
            seed: 1,
            thresholds: &thresholds,
        };
        let library = effect::load(&[]).expect("the library");
        let candidates = effect::candidates(&base, &Context::default(), &library).candidates;
        check(&ground, &candidates);
    }

    #[test]
    fn truth_what_many_say_at_once_each_says_alone() {
        grounded(&|ground, candidates| {
            let probes = Probes::new(candidates, ground).unwrap_or_else(|e| panic!("{e}"));
            let grouped: usize = probes.groups.iter().map(|group| group.members.len()).sum();
            assert!(2 * grouped > candidates.len(), "{grouped} of {}", candidates.len());
            let alone = Probes {
                candidates,
                groups: Vec::new(),
                own: candidates.iter().map(|_| OnceLock::new()).collect(),
            };
            for s in [0, 4] {
                for (i, (many, one)) in
                    probes.run(ground, s).iter().zip(alone.run(ground, s)).enumerate()
                {
                    for (many, one) in many.iter().zip(one) {
                        assert_eq!(many.is_some(), one.is_some(), "{}", candidates[i].name);
                        let (Some(many), Some(one)) = (many, one) else { continue };
                        assert_eq!(many.len(), one.len());
                        for ((size, a), (other, b)) in many.iter().zip(&one) {
                            assert_eq!(size, other);
                            let square =
                                |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>();
                            let off = square(&mut a.iter().zip(b).map(|(a, b)| a - b)).sqrt();
                            let norm = square(&mut b.iter().copied()).sqrt();
                            assert!(off <= 1e-9 * norm, "{}: {off} of {norm}", candidates[i].name);
                        }
                    }
                }
            }
        });
    }
}
