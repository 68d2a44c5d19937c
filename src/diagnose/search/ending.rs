//! The base, and the base with everything that was named, in; what is left of the gap with it, and the
//! verdict, out.

use super::judged::{Judged, Round, Standing};
use super::surrogate::times;
use super::turbulence::turbulence;
use super::unphysical::{turned, unphysical};
use super::unseen::missed;
use super::verdict::{Diagnosis, Finding, Verdict};
use crate::diagnose::base::found::{Found, values};
use crate::diagnose::base::stand::Stand;
use crate::diagnose::gap::comparison::comparison;
use crate::diagnose::gap::left::left;
use crate::diagnose::gap::varying::varying;
use crate::diagnose::residual::located::locate;
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
    let located = locate(&case, &last.noise, &last.places, &|s| last.theta(s), settings);
    out.values = values(&case, stand, &last.fit.theta);
    out.located = located.into_iter().filter(|l| l.is_real()).collect();
    out.missed = missed(last, &case, settings);
    out.varying = varying(last, &case, subject);
    out.comparison = comparison(subject, base, last)?;
    out.turned = turned(&out.comparison.shifts, &settings.thresholds);
    out.unphysical = unphysical(last, &settings.thresholds);
    out.complete = out.located.is_empty()
        && out.doubts.is_empty()
        && out.missed.is_empty()
        && out.unphysical.is_empty();
    out.verdict = verdict(out, doubted, &settings.thresholds);
    out.left = left(last);
    if out.left.iter().any(|l| l.adequacy.is_poor()) && out.verdict != Verdict::Located {
        progress("more than noise is left: does turbulence account for it?");
        let turbulence = turbulence(subject, stand, last, &out.left);
        // Beside a name gusts may be left that last, which noise on the rates does not account for;
        // but nothing that goes with an input.
        out.verdict = match (&turbulence.objection, &out.verdict) {
            (None, Verdict::NothingMissing) => Verdict::ButTurbulence,
            (Some(_), Verdict::NothingMissing) => Verdict::Located,
            (_, named) if turbulence.with_input.is_none() => named.clone(),
            _ => Verdict::Located,
        };
        out.complete &= turbulence.objection.is_none();
        out.turbulence = Some(turbulence);
    }
    Ok(())
}

/// `doubted`: evidence of what explains something and is contradicted. Like what is left it must be
/// little beside what is named: a name given while more than that is not understood would be one
/// among other things that are wrong.
fn verdict(out: &Diagnosis, doubted: f64, thresholds: &Thresholds) -> Verdict {
    let judged = |f: &Finding| out.rounds.get(f.round).and_then(|r| r.judged.get(f.added));
    let explained: f64 = out.findings.iter().filter_map(judged).map(|j| j.evidence).sum();
    let left = out.located.iter().map(|l| l.gain + l.held_out.max(0.0)).fold(doubted, f64::max);
    if out.findings.is_empty() {
        let much = |r: &Round, j: &Judged| {
            times(thresholds.shown_factor, r.limit, j.screened.taken, thresholds)
        };
        let shows = |r: &Round| {
            r.judged.iter().any(|j| j.standing == Standing::Faint || j.score > much(r, j))
        };
        let shown = out.rounds.first().is_some_and(shows);
        return if out.complete && !shown { Verdict::NothingMissing } else { Verdict::Located };
    }
    let alone = |f: &Finding| f.class.len() == 1;
    match left > thresholds.rest_share * explained || !out.unphysical.is_empty() {
        true => Verdict::Located,
        false if out.findings.iter().all(alone) => Verdict::Named,
        false => Verdict::OneOfThese,
    }
}
