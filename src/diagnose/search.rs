//! A subject and the library in; rounds of base fit, screening, refits and decision until nothing passes, and the verdict, out.

use super::base::{Places, Stand, estimation, fitted, placed, settle_steps};
use super::closure::{At, Shift, closure};
use super::decide::{Standing, class, objection};
use super::effect::Candidate;
use super::fit::{Fit, Task};
use super::gaps::{Flown, gaps};
use super::located::{Located, locate};
use super::noise::Noise;
use super::refit::{self, Frozen, joined, refit};
use super::screen::{self, Screened, screen};
use super::surrogate::{best_of_surrogates, luck};
use super::{Closing, Diagnosis, Judged, Round, Subject, Trouble, Verdict};
use crate::error::Errors;
use crate::estimate::{Case, Prepared, Stop};
use crate::math::quantile;
use crate::model::Model;

/// What the library has for a model: candidates, and effects that could not be attached with the reason.
pub type Offered = (Vec<Candidate>, Vec<(String, String)>);

/// Diagnoses a subject. `offer` attaches the library to a base model; `progress` is called with words on what is being done.
///
/// # Errors
/// Settings that do not fit the model. What the data say is never an error.
pub fn diagnose(
    subject: &Subject,
    offer: &dyn Fn(&Model) -> Result<Offered, Errors>,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, Errors> {
    let mut stand = Stand::first(subject.model, subject.method, subject.settings.base);
    let mut out = Diagnosis {
        verdict: Verdict::NothingMissing,
        rounds: Vec::new(),
        added: Vec::new(),
        values: Vec::new(),
        located: Vec::new(),
        skipped: Vec::new(),
        closing: Closing::default(),
    };
    let held = subject.held_out.iter().filter(|h| **h).count();
    if held == 0 || held == subject.held_out.len() {
        out.verdict = Verdict::None(Trouble::Segments("there must be maneuvers to train on and maneuvers held out".into()));
        return Ok(out);
    }
    let mut first: Option<Found> = None;
    loop {
        let number = out.rounds.len() + 1;
        progress(&format!("round {number}: base fit"));
        let found = match at_base(&stand, subject)? {
            Ok(found) => found,
            Err(trouble) => {
                out.verdict = Verdict::None(trouble);
                return Ok(out);
            }
        };
        let case = found.case();
        out.values = values(&case, &stand, &found.fit.theta);
        let located = locate(&case, &found.noise, &found.places, &|s| found.theta(s), subject.settings.quantile);
        out.located = located.iter().filter(|l| l.is_real()).cloned().collect();
        let round = if out.added.len() < subject.settings.effects {
            let (candidates, skipped) = offer(&stand.model)?;
            if number == 1 {
                out.skipped = skipped;
            }
            let tell = |text: &str| progress(&format!("round {number}: {text}"));
            let round = held_against(&stand, &found, &case, located, &candidates, subject, &tell)?;
            let chosen = round.class.first().copied();
            let step = chosen.and_then(|c| Some((candidates.get(c)?.clone(), round.judged[c].refit.clone()?)));
            out.rounds.push(round);
            step
        } else {
            None
        };
        let Some((candidate, refit)) = round else {
            out.closing = closing(first.as_ref().unwrap_or(&found), &found);
            break;
        };
        let at: Vec<f64> = refit.values.iter().map(|v| v.value).collect();
        stand = joined(&stand, &candidate, &at);
        out.added.push(candidate);
        drop(case);
        first = first.or(Some(found));
    }
    out.verdict = verdict(&out);
    Ok(out)
}

fn verdict(out: &Diagnosis) -> Verdict {
    match (out.added.is_empty(), out.located.is_empty()) {
        (true, true) => Verdict::NothingMissing,
        (_, false) => Verdict::Located,
        (false, true) if out.rounds.iter().any(|r| r.class.len() > 1) => Verdict::OneOfThese,
        (false, true) => Verdict::Named,
    }
}

/// The base fitted as it stands.
struct Found {
    prepared: Prepared,
    places: Places,
    noise: Noise,
    fit: Fit,
    free: Vec<usize>,
    substeps: Vec<usize>,
    /// The held-out maneuvers at frozen derivatives.
    frozen: Vec<Option<Frozen>>,
}

impl Found {
    /// The parameters as segment place `s` has them.
    fn theta(&self, s: usize) -> Vec<f64> {
        let place = self.places.held_out.iter().position(|&h| h == s);
        place.and_then(|p| self.frozen[p].as_ref()).map_or_else(|| self.fit.theta.clone(), |f| f.theta.clone())
    }

    fn case(&self) -> Case<'_> {
        let mut case = self.prepared.case();
        case.records.iter_mut().zip(&self.substeps).for_each(|(record, steps)| record.substeps = *steps);
        case
    }
}

fn at_base(stand: &Stand, subject: &Subject) -> Result<Result<Found, Trouble>, Errors> {
    let estimated = estimation(stand, subject)?;
    if estimated.stop == Stop::NotFinite {
        return Ok(Err(Trouble::Base("the base model is not finite at its start".into())));
    }
    let prepared = Prepared::new(&stand.model, subject.segments, &stand.method)?;
    let places = Places::of(&prepared, subject.held_out);
    let (noise, fit, free, substeps, frozen) = {
        let mut case = prepared.case();
        let theta = placed(&case, &prepared, subject, &estimated);
        settle_steps(&mut case, &theta, &[]);
        let names: Vec<String> = case.outputs.iter().map(|&o| case.model.outputs[o].name.clone()).collect();
        let noise = Noise::of(&estimated, &names, groups(&case, &prepared, subject, &estimated));
        let (free, fit) = fitted(&case, &noise, &places, theta, &stand.added);
        let substeps: Vec<usize> = case.records.iter().map(|r| r.substeps).collect();
        let frozen = fit.as_ref().map(|fit| refit::frozen(&case, &noise, &places, &fit.theta)).unwrap_or_default();
        (noise, fit, free, substeps, frozen)
    };
    let Some(fit) = fit else {
        return Ok(Err(Trouble::Base("the base model is not finite at its own estimate".into())));
    };
    Ok(Ok(Found { prepared, places, noise, fit, free, substeps, frozen }))
}

/// The group of every segment, as the estimation over the training segments numbers them.
fn groups(case: &Case, prepared: &Prepared, subject: &Subject, found: &crate::estimate::Estimation) -> Vec<usize> {
    let training: Vec<usize> = (0..subject.segments.len()).filter(|&s| !subject.held_out[s]).collect();
    let of = |at: usize| {
        let place = training.iter().position(|&s| s == prepared.used[at])?;
        found.noise_groups.get(place).copied().flatten()
    };
    let known: Vec<Option<usize>> = (0..case.records.len()).map(of).collect();
    let like = |at: usize| {
        (0..case.records.len()).find(|&o| case.layout.parts[o].group == case.layout.parts[at].group && known[o].is_some())
    };
    (0..case.records.len()).map(|at| known[at].or(like(at).and_then(|o| known[o])).unwrap_or(0)).collect()
}

fn values(case: &Case, stand: &Stand, theta: &[f64]) -> Vec<(String, f64)> {
    let held = |name: &String| stand.method.starts.get(name).copied();
    let of = |name: &String| {
        let at = case.unknowns.iter().position(|u| u.name == *name && u.segment.is_none());
        Some((name.clone(), at.map(|i| theta[i]).or(held(name))?))
    };
    stand.added.iter().filter_map(of).collect()
}

/// What the additions did: the gap before and after, and the other parameters' shifts.
fn closing(first: &Found, last: &Found) -> Closing {
    let (before, after) = (first.case(), last.case());
    let flown = |found: &Found, case: &Case| {
        let one = |s: usize| (found.prepared.used[s], case.traces(s, &found.theta(s)));
        (0..case.records.len()).map(one).collect::<Vec<_>>()
    };
    let gap = |found: &Found, case: &Case| {
        let traces = flown(found, case);
        let all: Vec<Flown> = traces
            .into_iter()
            .enumerate()
            .map(|(s, (segment, traces))| Flown { segment, record: &case.records[s], traces })
            .collect();
        gaps(&all, &case.model.inputs.iter().map(|i| i.name.clone()).collect::<Vec<_>>())
    };
    let mut closing = Closing { gaps_before: gap(first, &before), ..Closing::default() };
    closing.gaps_after = gap(last, &after);
    if first.prepared.used != last.prepared.used {
        return closing;
    }
    let at = |s: usize| first.theta(s);
    let then = |s: usize| last.theta(s);
    (closing.channels, closing.overlays) = closure(
        &At { case: &before, theta: &at },
        &At { case: &after, theta: &then },
        &first.noise,
        &first.places.held_out,
        &first.places.training,
        &first.prepared.used,
    );
    closing.shifts = shifts((first, &before), (last, &after));
    closing
}

/// Shared parameters of the base, before and after.
fn shifts((first, before): (&Found, &Case), (last, after): (&Found, &Case)) -> Vec<Shift> {
    let sds = |found: &Found, case: &Case, noise: &Noise| {
        let task = Task { case, noise, segments: &found.places.training, free: &found.free };
        task.spread(&found.fit.theta, found.free.len()).map(|s| s.sd).unwrap_or_else(|| vec![None; found.free.len()])
    };
    let (sd_before, sd_after) = (sds(first, before, &first.noise), sds(last, after, &last.noise));
    let one = |(k, &i): (usize, &usize)| {
        let unknown = &before.unknowns[i];
        let same = |&(_, &j): &(usize, &usize)| {
            let other = &after.unknowns[j];
            other.name == unknown.name && other.group == unknown.group
        };
        let (l, &j) = last.free.iter().enumerate().find(same)?;
        let of = unknown.group.as_ref().map(|g| format!(" ({g})")).unwrap_or_default();
        Some(Shift {
            name: format!("{}{of}", unknown.name),
            unit: unknown.unit.clone(),
            before: first.fit.theta[i],
            after: last.fit.theta[j],
            before_sd: sd_before[k],
            after_sd: sd_after[l],
        })
    };
    first.free.iter().enumerate().filter_map(one).collect()
}

fn held_against(
    stand: &Stand,
    found: &Found,
    case: &Case,
    located: Vec<Located>,
    candidates: &[Candidate],
    subject: &Subject,
    progress: &dyn Fn(&str),
) -> Result<Round, Errors> {
    let settings = subject.settings;
    progress(&format!("screening {} candidates", candidates.len()));
    let ground = screen::Ground {
        case,
        noise: &found.noise,
        method: &stand.method,
        theta: &found.fit.theta,
        segments: &found.places.training,
        free: &found.free,
    };
    let screening = screen(&ground, candidates)?;
    let best = best_of_surrogates(&screening, settings.surrogates, settings.seed);
    let limit = if best.is_empty() { 0.0 } else { quantile(&best, settings.quantile) };
    let mut judged: Vec<Judged> = candidates.iter().zip(&screening.screened).map(|(c, s)| screened(c, s, limit)).collect();
    let mut order: Vec<usize> = (0..judged.len()).filter(|&i| judged[i].score > limit).collect();
    order.sort_by(|&a, &b| judged[b].score.total_cmp(&judged[a].score));
    let ground = refit::Ground {
        stand,
        prepared: &found.prepared,
        case,
        noise: &found.noise,
        places: &found.places,
        fit: &found.fit,
        frozen: &found.frozen,
    };
    let mut passing = Vec::new();
    for &i in order.iter().take(settings.refits) {
        progress(&format!("refitting {}", judged[i].name));
        let one = refit(&ground, &candidates[i], &judged[i].screened.at)?;
        let judged = &mut judged[i];
        let Some(one) = one else {
            (judged.standing, judged.why) = (Standing::FitFailed, "its model does not run over all maneuvers".into());
            continue;
        };
        let held_out: f64 = one.held_out.iter().map(|g| g.realised).sum();
        judged.evidence = one.gain - luck(judged.screened.taken.max(fitted_count(&one))) + held_out;
        judged.refit = Some(one);
        match objection(judged, settings) {
            Some((standing, why)) => (judged.standing, judged.why) = (standing, why),
            None => passing.push(i),
        }
    }
    let class = class(&judged, &passing, settings);
    for &i in &passing {
        let evidence = judged[i].evidence;
        let words = format!("evidence {evidence:.1} in log-likelihood");
        let standing = match class.iter().position(|&c| c == i) {
            Some(0) => Standing::Chosen,
            Some(_) => Standing::Alike,
            None => Standing::Beaten,
        };
        (judged[i].standing, judged[i].why) = (standing, words);
    }
    Ok(Round { limit, judged, class, located })
}

fn fitted_count(refit: &super::Refit) -> usize {
    refit.values.iter().filter(|v| !v.held).count()
}

fn screened(candidate: &Candidate, screened: &Screened, limit: f64) -> Judged {
    let score = screened.gain - luck(screened.taken);
    let (standing, why) = if screened.silent {
        (Standing::Silent, "nothing in these flights moves it".to_string())
    } else if screened.taken == 0 {
        (Standing::Absorbed, format!("imitated by {}", crate::config::list(&screened.absorbed_by)))
    } else if score > limit {
        (Standing::NotRefitted, format!("gains {:.1}, others gain more", screened.gain))
    } else {
        (Standing::Luck, format!("gains {:.1}", screened.gain))
    };
    Judged {
        name: candidate.name.clone(),
        effect: candidate.effect.clone(),
        family: candidate.family,
        sentence: candidate.sentence.clone(),
        signature: candidate.signature.clone(),
        separate: candidate.separate.clone(),
        screened: screened.clone(),
        score,
        refit: None,
        evidence: f64::NAN,
        standing,
        why,
    }
}
