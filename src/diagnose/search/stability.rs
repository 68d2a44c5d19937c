//! A round that tested an effect in; how often it is chosen when other maneuvers train and others
//! are held out, out.
//!
//! One split of the maneuvers is one draw: what it says hangs on which ones were held out. So the
//! choice is repeated over all `variants`. In each the noise is that of its training maneuvers, and
//! base and candidates go one Gauss-Newton step from the solution over all maneuvers to their own
//! (where that does not lower the cost, half of it or a quarter): near the solution a model is
//! linear in its parameters, and a test shows that full fits choose alike. What is measured then
//! is exact: costs of the models at those parameters, and held-out maneuvers with derivatives
//! frozen. A variant chooses the candidate of most evidence that its held-out maneuvers do not
//! contradict, or none; where it predicts next to nothing for an effect there, it cannot vote on
//! it.

use super::decide::held_out_objection;
use super::judged::{Judged, Round, Standing};
use super::refit::{Left, held_out_gain, joined, shared};
use super::surrogate::chance;
use super::value::Gain;
use super::variants::{Variant, variants};
use crate::diagnose::base::found::Found;
use crate::diagnose::base::frozen::{Frozen, frozen};
use crate::diagnose::base::stand::{Stand, seen, settle_steps};
use crate::diagnose::base::training::Task;
use crate::diagnose::effect::Candidate;
use crate::diagnose::residual::absorbed::Fitted;
use crate::diagnose::residual::colour::noise_of;
use crate::diagnose::residual::evaluation::Evaluation;
use crate::diagnose::residual::responses::Responses;
use crate::diagnose::residual::whitening::Noise;
use crate::diagnose::settings::Settings;
use crate::diagnose::subject::{Places, Subject};
use crate::diagnose::thresholds::Thresholds;
use crate::error::Errors;
use crate::estimate::{Case, Prepared};
use crate::noise::Part;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A candidate in one variant; not a number where its model does not run.
#[derive(Debug, Clone, PartialEq)]
pub struct Weighed {
    pub name: String,
    pub evidence: f64,
    /// Gain that it predicts on the held-out maneuvers.
    pub predicted: f64,
}

/// What one variant says.
#[derive(Debug, Clone, PartialEq)]
pub struct Vote {
    pub variant: String,
    /// The candidate of most evidence; none where none passes.
    pub chosen: Option<String>,
    /// The candidates that took part.
    pub weighed: Vec<Weighed>,
}

impl Vote {
    /// Whether it can say anything about a candidate.
    fn is_cast(&self, candidate: &str, decisive: f64) -> bool {
        self.weighed.iter().any(|w| w.name == candidate && w.predicted > decisive)
    }
}

/// The votes on an effect.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Stability {
    pub votes: Vec<Vote>,
}

/// How often each was chosen, of the variants that can tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Count {
    /// How many variants can tell.
    pub cast: usize,
    /// The effect itself.
    pub own: usize,
    /// Others, most often chosen first.
    pub rivals: Vec<(String, usize)>,
}

impl Stability {
    pub fn count(&self, candidate: &str, settings: &Settings) -> Count {
        let cast: Vec<&Vote> =
            self.votes.iter().filter(|v| v.is_cast(candidate, settings.decisive)).collect();
        let mut rivals = BTreeMap::<&str, usize>::new();
        for name in cast.iter().filter_map(|v| v.chosen.as_deref()) {
            *rivals.entry(name).or_default() += 1;
        }
        let own = rivals.remove(candidate).unwrap_or_default();
        let mut rivals: Vec<(String, usize)> =
            rivals.into_iter().map(|(name, n)| (name.to_string(), n)).collect();
        rivals.sort_by_key(|rival| std::cmp::Reverse(rival.1));
        Count { cast: cast.len(), own, rivals }
    }

    /// The class of an effect, with those that are chosen in its place; or why it may not be named.
    ///
    /// # Errors
    /// Words on how seldom it is chosen.
    pub fn says(
        &self,
        candidate: &str,
        round: &Round,
        class: &[usize],
        settings: &Settings,
    ) -> Result<Vec<usize>, String> {
        let thresholds = &settings.thresholds;
        let count = self.count(candidate, settings);
        let (cast, all) = (count.cast as f64, self.votes.len());
        if count.cast < thresholds.fewest_votes {
            return Err(format!(
                "of {all} other choices of the maneuvers that are held out only {} could tell",
                count.cast
            ));
        }
        let place = |name: &str| round.judged.iter().position(|j| j.name == name);
        let among = |class: &[usize]| {
            let rivals = count
                .rivals
                .iter()
                .filter(|(name, _)| place(name).is_some_and(|at| class.contains(&at)));
            count.own + rivals.map(|r| r.1).sum::<usize>()
        };
        let with = |least: f64| {
            let often = count.rivals.iter().filter(|r| r.1 as f64 > least * cast);
            let more = often.filter_map(|r| place(&r.0)).filter(|at| !class.contains(at));
            class.iter().copied().chain(more).collect::<Vec<usize>>()
        };
        // Who is chosen often in its place cannot be told from it; if that is not all, whoever is chosen at all.
        [with(thresholds.rival_votes), with(0.0)]
            .into_iter()
            .find(|class| among(class) as f64 >= thresholds.votes * cast)
            .ok_or_else(|| {
                format!(
                    "it is chosen in {} of {} other choices of the maneuvers that are held out",
                    count.own, count.cast
                )
            })
    }
}

/// A model at its solution over all maneuvers.
struct Solution<'a> {
    case: Case,
    theta: Vec<f64>,
    /// Parameters that effects brought, and where they are nothing.
    nulls: BTreeMap<String, Option<f64>>,
    /// The candidate; none for the base.
    judged: Option<&'a Judged>,
}

/// A model fitted to a variant.
struct Moved {
    cost: f64,
    frozen: Vec<Option<Frozen>>,
}

/// The votes of all variants on candidate `this` of a round, and those that came far enough and explain
/// the same. `found`: the base of the round.
///
/// # Errors
/// A candidate's model does not fit the settings of the base's estimation.
pub fn stability(
    (stand, found): (&Stand, &Found),
    (round, this): (&Round, usize),
    candidates: &[Candidate],
    subject: &Subject,
) -> Result<Stability, Errors> {
    let base = base(stand, found);
    let mut models = Vec::new();
    for judged in contenders(round, this, &subject.settings.thresholds) {
        let Some(candidate) = candidates.iter().find(|c| c.name == judged.name) else { continue };
        models.extend(solved(stand, found, candidate, judged, subject)?);
    }
    let models =
        alternatives(&base, models, &found.noise, this, round, &subject.settings.thresholds);
    let all: Vec<usize> = (0..found.prepared.used.len()).collect();
    let free = seen(&base.case, &all);
    let rule = stand.method.colour();
    let at = Evaluation::new(&base.case, &base.theta, &all);
    let fitted = Fitted::new(&at, &all, &free, &[], rule);
    let mut responses = Responses::default();
    let mut noise = found.noise.clone();
    while responses.more(&fitted, &noise, subject.settings) {
        let again = Fitted::new(&at, &all, &free, &responses.values, rule);
        match again.weighted(&noise) {
            Some(fitted) => noise = noise_of(&fitted, &subject.settings.thresholds),
            None => break,
        }
    }
    // What each maneuver says of the fit is the same in every draw.
    let parts = Fitted::new(&at, &all, &free, &responses.values, rule).parts(&noise);
    let noise = |variant: Variant| {
        let training = &variant.places.training;
        let without: Vec<_> =
            training.iter().filter_map(|&s| responses.values.get(s).cloned()).collect();
        let moving = seen(&base.case, training);
        let part = |&s: &usize| parts[s].as_ref()?.placed(&free, &moving);
        let parts: Vec<Part> = training.iter().map(part).collect::<Option<_>>()?;
        let fitted = Fitted::new(&at, training, &moving, &without, rule).with(&parts);
        let noise = noise_of(&fitted, &subject.settings.thresholds);
        Some((variant, noise))
    };
    let draws: Vec<(Variant, Noise)> =
        variants(&found.prepared, subject.settings).into_par_iter().filter_map(noise).collect();
    drop(at);
    // A model is run once where it stands, and asked by every draw.
    let moved = |model: &Solution| -> Vec<Option<Moved>> {
        let at = Evaluation::new(&model.case, &model.theta, &all);
        let one = |(variant, noise): &(Variant, Noise)| {
            model.moved(&at, noise, &variant.places, subject.settings)
        };
        draws.par_iter().map(one).collect()
    };
    let without = moved(&base);
    let with: Vec<Vec<Option<Moved>>> = models.iter().map(moved).collect();
    let one = |(k, (variant, noise)): (usize, &(Variant, Noise))| {
        let models = models.iter().zip(&with).map(|(model, moved)| (model, moved[k].as_ref()));
        let without = without[k].as_ref()?;
        Some(vote(without, models, noise, (&found.prepared, variant), round.limit, subject))
    };
    Ok(Stability { votes: draws.iter().enumerate().filter_map(one).collect() })
}

/// Candidates with a full fit against which nothing speaks but, at most, one split of the maneuvers;
/// the best ones, and `this` in any case.
fn contenders<'r>(round: &'r Round, this: usize, thresholds: &Thresholds) -> Vec<&'r Judged> {
    let able = [
        Standing::Chosen,
        Standing::Alike,
        Standing::Beaten,
        Standing::Faint,
        Standing::HeldOut,
        Standing::Untold,
    ];
    let mut all: Vec<&Judged> = round
        .judged
        .iter()
        .filter(|j| able.contains(&j.standing) && j.evidence > round.limit)
        .collect();
    all.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    all.sort_by_key(|j| j.name != round.judged[this].name);
    all.truncate(thresholds.contenders);
    all
}

/// The models that explain what `this` explains, itself among them: the others are no alternatives to
/// it, whatever they explain.
fn alternatives<'a>(
    base: &Solution,
    models: Vec<Solution<'a>>,
    noise: &Noise,
    this: usize,
    round: &Round,
    thresholds: &Thresholds,
) -> Vec<Solution<'a>> {
    let without = base.left(noise);
    let name = &round.judged[this].name;
    let is = |m: &Solution| m.judged.is_some_and(|j| j.name == *name);
    let Some(with) = models.iter().find(|m| is(m)).map(|m| m.left(noise)) else { return models };
    let alike =
        |m: &Solution| is(m) || shared(&without, &with, &m.left(noise)) > thresholds.replaces;
    models.into_iter().filter(alike).collect()
}

fn base<'a>(stand: &Stand, found: &Found) -> Solution<'a> {
    let case = found.case();
    let mut theta = found.fit.theta.clone();
    for (&s, frozen) in found.places.held_out.iter().zip(&found.frozen) {
        take_over(&case, &mut theta, s, frozen.as_ref());
    }
    Solution { case, theta, nulls: stand.nulls.clone(), judged: None }
}

/// Own parameters of a held-out maneuver into the others'.
fn take_over(case: &Case, theta: &mut [f64], s: usize, frozen: Option<&Frozen>) {
    let part = &case.layout.parts[s];
    let own = part.offset..part.offset + part.own;
    if let Some(frozen) = frozen {
        theta[own.clone()].copy_from_slice(&frozen.theta[own]);
    }
}

/// A candidate's model where its full fit ended; none where it cannot be run so.
fn solved<'a>(
    stand: &Stand,
    found: &Found,
    candidate: &Candidate,
    judged: &'a Judged,
    subject: &Subject,
) -> Result<Option<Solution<'a>>, Errors> {
    let Some(refit) = &judged.refit else { return Ok(None) };
    let values: Vec<f64> = refit.values.iter().map(|v| v.value).collect();
    let stand = joined(stand, candidate, &values);
    let prepared = Prepared::new(&stand.model, &found.prepared.segments, &stand.method)?.compiled();
    if prepared.used != found.prepared.used {
        return Ok(None);
    }
    let mut case = prepared.case();
    let mut theta = refit.known.placed(&case, &prepared);
    let least: Vec<usize> = found.case().records.iter().map(|r| r.substeps).collect();
    settle_steps(&mut case, &theta, &least);
    let nulls = stand.nulls;
    let unseen =
        frozen(&case, &found.noise, &found.places, &theta, (&nulls, &subject.settings.thresholds));
    for (&s, frozen) in found.places.held_out.iter().zip(&unseen) {
        take_over(&case, &mut theta, s, frozen.as_ref());
    }
    Ok(Some(Solution { case, theta, nulls, judged: Some(judged) }))
}

impl Solution<'_> {
    /// White residuals of every maneuver; none of one over which the model does not run.
    fn left(&self, noise: &Noise) -> Left {
        let of = |s: usize| {
            let local = self.case.layout.local(s, &self.theta);
            noise.whiten(s, &self.case.evaluate(s, &local, false)?, &[]).pop()
        };
        (0..self.case.records.len()).map(|s| of(s).unwrap_or_default()).collect()
    }

    /// Fitted to a variant's training maneuvers; none where the model is not finite.
    fn moved(
        &self,
        at: &Evaluation,
        noise: &Noise,
        places: &Places,
        settings: &Settings,
    ) -> Option<Moved> {
        let thresholds = &settings.thresholds;
        let free = seen(&self.case, &places.training);
        let segments = &places.training[..];
        let task = Task { case: &self.case, noise, segments, free: &free, thresholds };
        let (theta, cost) = if settings.whole_votes {
            let fit = task.fit(self.theta.clone())?;
            let cost = fit.cost();
            (fit.theta, cost)
        } else {
            self.stepped(at, &task)?
        };
        let frozen = frozen(&self.case, noise, places, &theta, (&self.nulls, thresholds));
        Some(Moved { cost, frozen })
    }

    /// The best of a step, half of it, a quarter, and none.
    fn stepped(&self, at: &Evaluation, task: &Task) -> Option<(Vec<f64>, f64)> {
        let (whole, here) = task.stepped(at)?;
        let at = |share: f64| -> Vec<f64> {
            self.theta.iter().zip(&whole).map(|(from, to)| from + share * (to - from)).collect()
        };
        let lower = [1.0, 0.5, 0.25].into_iter().find_map(|share| {
            let theta = at(share);
            let cost = task.whole_cost(&theta).filter(|cost| *cost <= here)?;
            Some((theta, cost))
        });
        Some(lower.unwrap_or_else(|| (self.theta.clone(), here)))
    }
}

/// `without`: the base as the variant moved it; `models`: the candidates', likewise.
fn vote<'m>(
    without: &Moved,
    models: impl Iterator<Item = (&'m Solution<'m>, Option<&'m Moved>)>,
    noise: &Noise,
    (prepared, variant): (&Prepared, &Variant),
    limit: f64,
    subject: &Subject,
) -> Vote {
    let (settings, places) = (subject.settings, &variant.places);
    let thresholds = &settings.thresholds;
    let (mut best, mut weighed): (Option<(f64, &str)>, Vec<Weighed>) = (None, Vec::new());
    for (model, with) in models {
        let Some(judged) = model.judged else { continue };
        let Some(with) = with else {
            let (name, none) = (judged.name.clone(), f64::NAN);
            weighed.push(Weighed { name, evidence: none, predicted: none });
            continue;
        };
        let pairs = without.frozen.iter().zip(&with.frozen).zip(&places.held_out);
        let gains: Vec<Gain> = pairs
            .map(|((a, b), &s)| held_out_gain(noise, a.as_ref(), b.as_ref(), (s, prepared.used[s])))
            .collect();
        let sum = |of: fn(&Gain) -> f64| gains.iter().map(of).sum::<f64>();
        let fitted =
            judged.refit.as_ref().map_or(0, |r| r.values.iter().filter(|v| !v.held).count());
        let alone = chance(judged.screened.taken.max(fitted), thresholds.false_alarm);
        let this = without.cost - with.cost - alone + sum(|g| g.realised);
        let (name, predicted) = (judged.name.clone(), sum(|g| g.predicted));
        weighed.push(Weighed { name, evidence: this, predicted });
        let passes = this > limit && held_out_objection(&gains, settings, judged.noise).is_none();
        if passes && best.is_none_or(|(most, _)| this > most) {
            best = Some((this, &judged.name));
        }
    }
    let chosen = best.map(|(_, name)| name.to_string());
    Vote { variant: variant.name.clone(), chosen, weighed }
}
