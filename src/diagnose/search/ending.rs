//! The base, and the base with everything that was named, in; what is left of the gap with it, and the
//! verdict, out.

use super::answering::answering;
use super::judged::{Judged, Round, Standing};
use super::surrogate::times;
use super::turbulence::turbulence;
use super::unphysical::{turned, unphysical};
use super::unseen::missed;
use super::verdict::{Diagnosis, Finding, Verdict};
use crate::diagnose::base::found::{Found, values};
use crate::diagnose::base::stand::Stand;
use crate::diagnose::gap::before_after::Shift;
use crate::diagnose::gap::comparison::comparison;
use crate::diagnose::gap::left::left;
use crate::diagnose::gap::varying::varying;
use crate::diagnose::subject::Subject;
use crate::diagnose::thresholds::Thresholds;
use crate::error::Errors;

/// Says in `out` how a search ends: `stand` and `last` are the base with what was named, `base` without;
/// `doubted` is the evidence for what is in the model and not believed.
///
/// # Errors
/// None that the base itself would not have.
pub fn ended(
    out: &mut Diagnosis,
    subject: &Subject,
    (stand, base, last): (&Stand, &Found, &Found),
    doubted: f64,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<(), Errors> {
    let (case, settings) = (last.case(), subject.settings);
    // What takes small movements out of a record leaves some of its noise, which is not what more of it
    // would be: what that does is known of the model without.
    out.after = match is_of_records(out) || out.added.is_empty() {
        true => out.before.clone(),
        false => answering(stand, last, settings),
    };
    out.values = values(&case, stand, &last.fit.theta);
    out.missed = missed(last, &case, settings);
    out.varying = varying(last, &case, subject);
    out.comparison = comparison(subject, base, last)?;
    out.turned = turned(&out.comparison.shifts, &settings.thresholds);
    out.unphysical = unphysical(last, &settings.thresholds);
    out.unsettled = unsettled(out, &settings.thresholds);
    out.complete = out.located().next().is_none()
        && out.doubts.is_empty()
        && out.unsettled.is_empty()
        && out.missed.is_empty()
        && out.unphysical.is_empty();
    out.verdict = verdict(out, doubted, &settings.thresholds);
    let but_records = is_but_records(out, &settings.thresholds);
    let is_located = out.verdict == Verdict::Located;
    let refuted = is_located && is_refuted(out, &settings.thresholds);
    out.left = left(last);
    let is_poor = out.left.iter().any(|l| l.adequacy.is_poor());
    if !is_poor && but_records {
        out.verdict = Verdict::ButRecords;
    } else if refuted || is_poor && (!is_located || but_records) {
        progress("does turbulence account for what is left?");
        let turbulence = turbulence(subject, stand, last, &out.left);
        // Beside a name gusts may be left that last, which noise on the rates does not account for;
        // but nothing that goes with an input.
        out.verdict = match (&turbulence.objection, &out.verdict) {
            (None, Verdict::NothingMissing) => Verdict::ButTurbulence,
            (None, _) if but_records || refuted => Verdict::ButTurbulence,
            (Some(_), Verdict::NothingMissing) => Verdict::Located,
            (_, named) if turbulence.with_input.is_none() => named.clone(),
            _ => Verdict::Located,
        };
        out.complete &= turbulence.objection.is_none();
        out.turbulence = Some(turbulence);
    }
    Ok(())
}

/// Whether all that was found is small movements that records of inputs show and that did not happen,
/// in all maneuvers (a finding) or in some (a doubt), and no parameter moves by more than
/// `record_sds` when those found are taken out: the model itself lacks nothing then.
///
/// Nothing else shows with all of them in place, or what shows without them is contradicted.
fn is_but_records(out: &Diagnosis, thresholds: &Thresholds) -> bool {
    let found = is_of_records(out) && out.doubts.iter().all(|(name, _)| out.is_of_record(name));
    let else_nothing =
        out.located().next().is_none() && out.missed.is_empty() && out.unphysical.is_empty();
    let last = out.rounds.iter().rfind(|round| !round.strict);
    let in_place = |round: &&Round| {
        let is_in = |name: &String| round.base.contains(name);
        let named = |f: &Finding| is_in(&out.rounds[f.round].judged[f.added].name);
        out.findings.iter().all(named) && out.doubts.iter().all(|(name, _)| is_in(name))
    };
    let quiet = last.filter(in_place).is_some_and(|round| !shows(round, thresholds))
        || out.rounds.first().is_some_and(|round| is_contradicted(round, &REFUSED, thresholds));
    let moves = |s: &Shift| is_moved(s, thresholds.record_sds);
    found && else_nothing && quiet && !out.comparison.shifts.iter().any(moves)
}

/// Whether nothing was found, and all that shows on the training maneuvers is contradicted, or held-out ones cannot tell: what gusts do goes with
/// anything, a little, for a while.
fn is_refuted(out: &Diagnosis, thresholds: &Thresholds) -> bool {
    let found_nothing = out.findings.is_empty() && out.complete;
    let refused: Vec<Standing> = REFUSED.into_iter().chain([Standing::Untold]).collect();
    let refuted = |round: &Round| is_contradicted(round, &refused, thresholds);
    found_nothing && out.rounds.first().is_some_and(refuted)
}

/// Whether all that was found, be it doubted, is noise of records.
fn is_of_records(out: &Diagnosis) -> bool {
    let noise = |f: &Finding| {
        let judged = |round: &Round| f.class.iter().all(|&c| round.judged[c].noise);
        out.rounds.get(f.round).is_some_and(judged)
    };
    let doubted = out.doubts.iter().filter(|(name, _)| out.is_of_record(name)).count();
    out.findings.iter().all(noise) && out.findings.len() + doubted > 0
}

/// What held-out maneuvers or physics contradict.
const REFUSED: [Standing; 3] = [Standing::HeldOut, Standing::Inconsistent, Standing::Bounds];

/// Whether all that shows in a round was refused in one of these ways, or is noise of a record.
fn is_contradicted(round: &Round, refused: &[Standing], thresholds: &Thresholds) -> bool {
    let contradicted = |j: &Judged| refused.contains(&j.standing) || j.is_of_record();
    round.judged.iter().filter(|j| is_shown(j, round, thresholds)).all(contradicted)
}

/// What gains more than chance in the last round of all candidates and could not be fitted.
fn unsettled(out: &Diagnosis, thresholds: &Thresholds) -> Vec<String> {
    let Some(round) = out.rounds.iter().rfind(|round| !round.strict) else { return Vec::new() };
    let failed =
        |j: &&Judged| j.standing == Standing::FitFailed && stands_out(j, round, thresholds);
    let words = |j: &Judged| {
        format!(
            "{} gains {:.1} by screening, where chance gives {:.1}, and its full fit did not settle",
            j.name, j.score, round.limit
        )
    };
    round.judged.iter().filter(failed).map(words).chain(out.beside.iter().cloned()).collect()
}

/// Whether a parameter moves by more than so many of its sd.
fn is_moved(shift: &Shift, sds: f64) -> bool {
    let by = (shift.after - shift.before).abs();
    shift.before_sd.is_some_and(|sd| by > sds * sd)
}

/// Whether any candidate of a round shows.
fn shows(round: &Round, thresholds: &Thresholds) -> bool {
    round.judged.iter().any(|j| is_shown(j, round, thresholds))
}

/// Whether a candidate gains more than chance and is too faint for a name, or was not asked further.
fn is_shown(j: &Judged, round: &Round, thresholds: &Thresholds) -> bool {
    j.standing == Standing::Faint || stands_out(j, round, thresholds)
}

/// Whether a candidate gains more by screening than chance gives.
fn stands_out(j: &Judged, round: &Round, thresholds: &Thresholds) -> bool {
    j.score > times(thresholds.shown_factor, round.limit, j.screened.taken, thresholds)
}

/// `doubted`: evidence of what explains something and is contradicted. Like what is left it must be
/// little beside what is named: a name given while more than that is not understood would be one
/// among other things that are wrong.
fn verdict(out: &Diagnosis, doubted: f64, thresholds: &Thresholds) -> Verdict {
    let judged = |f: &Finding| out.rounds.get(f.round).and_then(|r| r.judged.get(f.added));
    let explained: f64 = out.findings.iter().filter_map(judged).map(|j| j.evidence).sum();
    let left = out.located().map(|l| l.gain + l.held_out.max(0.0)).fold(doubted, f64::max);
    if out.findings.is_empty() {
        let shown = out.rounds.first().is_some_and(|round| shows(round, thresholds));
        return if out.complete && !shown { Verdict::NothingMissing } else { Verdict::Located };
    }
    let alone = |f: &Finding| f.class.len() == 1;
    match left > thresholds.rest_share * explained || !out.unphysical.is_empty() {
        true => Verdict::Located,
        false if out.findings.iter().all(alone) => Verdict::Named,
        false => Verdict::OneOfThese,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parameter_moves_by_more_than_its_uncertainty() {
        let shift = |after: f64, before_sd: Option<f64>| Shift {
            name: "M_q".into(),
            unit: "1/s".into(),
            before: -1.5,
            after,
            before_sd,
            after_sd: None,
        };
        assert!(is_moved(&shift(-1.14, Some(0.1)), 3.0) && is_moved(&shift(-1.86, Some(0.1)), 3.0));
        assert!(!is_moved(&shift(-1.24, Some(0.1)), 3.0));
        // Of what the flights do not determine nothing is said.
        assert!(!is_moved(&shift(9.0, None), 3.0));
    }
}
