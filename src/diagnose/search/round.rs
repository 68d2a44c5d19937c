//! A fitted base and candidates in; all of them screened, the best refitted and judged, out.

use super::by_noise::by_noise;
use super::decide::{Distance, class, distances, is_faint, objection};
use super::fits::Fits;
use super::ground;
use super::judged::Standing;
use super::judged::{Judged, Round};
use super::refit;
use super::screen::screen;
use super::surrogate::{best_of_surrogates, chance};
use super::tried::{Reference, Screened};
use crate::diagnose::base::found::Found;
use crate::diagnose::base::stand::Stand;
use crate::diagnose::effect::Candidate;
use crate::diagnose::settings::Settings;
use crate::diagnose::subject::Subject;
use crate::error::Errors;
use crate::estimate::{Case, Segment};
use crate::math::quantile;
use crate::model::Scope;
use std::borrow::Cow;

/// Screens all candidates, refits and judges the best. Chance gives at least `least`: fewer
/// candidates may take part than one of them was found among. `tested`: the one that the round is
/// about; none where the best of all is looked for. `fits`: those that were made before.
///
/// # Errors
/// A candidate's model does not fit the settings of the base's estimation.
pub fn held_against(
    stand: &Stand,
    found: &Found,
    case: &Case,
    (candidates, least, tested): (&[Candidate], f64, Option<&str>),
    (subject, fits): (&Subject, &Fits),
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Round, Errors> {
    let settings = subject.settings;
    progress(&format!("screening {} candidates", candidates.len()));
    let of: Vec<&Segment> = found.prepared.used.iter().map(|&s| &subject.segments[s]).collect();
    let ground = ground::Ground {
        of: &of,
        seed: settings.seed,
        thresholds: &settings.thresholds,
        case,
        noise: &found.noise,
        method: &stand.method,
        theta: &found.fit.theta,
        segments: &found.places.training,
        free: &found.free,
    };
    let screening = screen(&ground, candidates)?;
    let part: Vec<bool> = candidates.iter().map(takes_part).collect();
    let best = best_of_surrogates(&screening, &part, settings);
    let limit = least.max(if best.is_empty() { 0.0 } else { quantile(&best, settings.quantile) });
    let mut judged: Vec<Judged> = candidates
        .iter()
        .zip(&screening.screened)
        .map(|(c, s)| screened(c, s, limit, settings))
        .collect();
    let best = judged.iter().map(|j| j.score).fold(0.0, f64::max);
    // Less than a share of the best one's score is not made up for by a full fit.
    let worth = limit.max(settings.thresholds.refit_share * best);
    let mut order: Vec<usize> = (0..judged.len()).filter(|&i| judged[i].score > worth).collect();
    order.sort_by(|&a, &b| judged[b].score.total_cmp(&judged[a].score));
    let ground = refit::Ground {
        stand,
        prepared: &found.prepared,
        case,
        noise: &found.noise,
        places: &found.places,
        fit: &found.fit,
        frozen: &found.frozen,
        thresholds: &settings.thresholds,
    };
    let (mut passing, mut refused) = (Vec::new(), None);
    let refits = order.len().min(settings.refits);
    progress(&match order.first() {
        Some(&best) => {
            let best = &judged[best];
            format!(
                "{} comes furthest, {:.1} where chance gives {limit:.1}; {refits} are fitted in full",
                best.name, best.score
            )
        }
        None => format!("nothing gains more than chance, {limit:.1}"),
    });
    order.truncate(refits);
    let referenced = |&i: &usize| referenced(&candidates[i], stand, &judged[i].screened.references);
    let tried: Vec<Cow<Candidate>> = order.iter().map(referenced).collect::<Result<_, _>>()?;
    let starts = order.iter().map(|&i| &judged[i].screened.at[..]);
    let asked: Vec<(&Candidate, &[f64])> = tried.iter().map(|c| &**c).zip(starts).collect();
    let begun = |candidate: &Candidate| progress(&format!("{} is fitted in full", candidate.name));
    let fits = fits.of(found, &ground, &asked, &begun)?;
    for ((&i, candidate), one) in order.iter().zip(&tried).zip(fits) {
        let judged = &mut judged[i];
        let Some((one, left)) = one else {
            (judged.standing, judged.why) =
                (Standing::FitFailed, "its model does not run over all maneuvers".into());
            continue;
        };
        let held_out: f64 = one.held_out.iter().map(|g| g.realised).sum();
        judged.evidence = one.gain
            - chance(
                judged.screened.taken.max(fitted_count(&one)),
                settings.thresholds.false_alarm,
            )
            + held_out;
        judged.refit = Some(one);
        let faint =
            || is_faint(judged, limit, &settings.thresholds).map(|why| (Standing::Faint, why));
        let mut against = objection(judged, settings).or_else(faint);
        if let (None, Some(refit)) = (&against, &judged.refit) {
            against = by_noise(&ground, candidate, refit)?.map(|why| (Standing::ByNoise, why));
        }
        match against {
            Some((standing, why)) => {
                (judged.standing, judged.why) = (standing, why);
                if Some(&judged.name[..]) == tested {
                    refused = Some(left);
                }
            }
            None => passing.push((i, left)),
        }
    }
    let without = refit::left_by_base(&ground);
    for (i, left) in &passing {
        judged[*i].instead = refused.as_ref().map(|refused| refit::shared(&without, refused, left));
    }
    // Of a test of one effect only what explains the same takes part.
    let this = passing.iter().position(|(i, _)| Some(&judged[*i].name[..]) == tested);
    if let Some(this) = this {
        let (tested, with) = passing[this].clone();
        let share = settings.thresholds.replaces;
        let (alike, others): (Vec<_>, Vec<_>) = passing
            .into_iter()
            .partition(|p| p.0 == tested || refit::shared(&without, &with, &p.1) > share);
        for (i, _) in others {
            let words = format!("evidence {:.1}; it explains something else", judged[i].evidence);
            (judged[i].standing, judged[i].why) = (Standing::Beaten, words);
        }
        passing = alike;
    }
    let distances = distances(&judged, &without, &passing, settings);
    let class = class(&judged, &distances);
    for Distance { at: i, less, margin, replaces } in distances {
        let mut words = format!("evidence {:.1} in log-likelihood", judged[i].evidence);
        if less > 0.0 {
            words += &format!(
                ", {less:.1} less than the best one's; {margin:.1} less distinguishes them"
            );
        }
        if !replaces {
            words += "; it explains something else";
        }
        judged[i].replaces = replaces;
        let standing = match class.iter().position(|&c| c == i) {
            Some(0) => Standing::Chosen,
            Some(_) => Standing::Alike,
            None => Standing::Beaten,
        };
        (judged[i].standing, judged[i].why) = (standing, words);
    }
    Ok(Round { limit, judged, class, base: Vec::new(), strict: false })
}

/// A candidate whose sizes that differ by a column stay at null at these values of it.
///
/// # Errors
/// As `Candidate::held_in`.
pub fn referenced<'c>(
    candidate: &'c Candidate,
    stand: &Stand,
    references: &[Reference],
) -> Result<Cow<'c, Candidate>, Errors> {
    let mut held = Cow::Borrowed(candidate);
    for Reference { size, value } in references {
        held = Cow::Owned(held.held_in(&stand.model, *size, value)?);
    }
    Ok(held)
}

fn fitted_count(refit: &refit::Refit) -> usize {
    refit.values.iter().filter(|v| !v.held).count()
}

/// What has a value for every maneuver can be fitted to a held-out one, and so never confirmed by
/// it: it is told, and takes no part.
fn takes_part(candidate: &Candidate) -> bool {
    candidate.added.iter().all(|a| a.scope != Scope::Segment)
}

/// By what a candidate is imitated, and what would tell.
fn imitated(candidate: &Candidate, screened: &Screened) -> String {
    let names: Vec<&str> = screened.imitators.iter().map(|i| i.name.as_str()).collect();
    let by = match names.is_empty() {
        true => "what has a value of its own in every maneuver".to_string(),
        false => crate::config::list(&names),
    };
    let tells = match candidate.separate.is_empty() {
        true => String::new(),
        false => format!("; what would tell: {}", candidate.separate.trim_end_matches('.')),
    };
    format!("imitated by {by}{tells}")
}

fn screened(candidate: &Candidate, screened: &Screened, limit: f64, settings: &Settings) -> Judged {
    let own = !takes_part(candidate);
    let score = if own {
        0.0
    } else {
        screened.gain - chance(screened.taken, settings.thresholds.false_alarm)
    };
    let (standing, why) = if own {
        let why = format!(
            "gains {:.1} with a value for every maneuver, which held-out ones cannot confirm",
            screened.gain
        );
        (Standing::Unidentifiable, why)
    } else if screened.silent {
        (Standing::Silent, "nothing in these flights moves it".to_string())
    } else if !screened.gain.is_finite() {
        (Standing::Silent, "the model with it does not run over these flights".to_string())
    } else if screened.taken == 0 {
        (Standing::Collinear, imitated(candidate, screened))
    } else if score > limit {
        (Standing::NotRefitted, format!("gains {:.1}, others gain more", screened.gain))
    } else if screened.imitators.is_empty() {
        (Standing::Chance, format!("gains {:.1}", screened.gain))
    } else {
        let why = format!("gains {:.1}; {}", screened.gain, imitated(candidate, screened));
        (Standing::Collinear, why)
    };
    Judged {
        name: candidate.name.clone(),
        effect: candidate.effect.clone(),
        family: candidate.family,
        series: candidate.series,
        noise: candidate.noise,
        sentence: candidate.sentence.clone(),
        signature: candidate.signature.clone(),
        separate: candidate.separate.clone(),
        screened: screened.clone(),
        score,
        refit: None,
        evidence: f64::NAN,
        instead: None,
        replaces: false,
        standing,
        why,
    }
}
