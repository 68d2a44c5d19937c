//! A diagnosis in; what a person should know of it, in words, out.

use super::{Outcome, left};
use crate::diagnose::effect::Family;
use crate::diagnose::{
    Channel, Diagnosis, Finding, Judged, Missed, Round, Standing, Trouble, Value, Verdict,
};
use crate::math::digits;
use crate::math::distribution::INTERVAL_95;

/// Why there is no verdict.
pub fn trouble(trouble: &Trouble) -> &str {
    match trouble {
        Trouble::Base(why) | Trouble::Segments(why) => why,
    }
}

/// `C_m_eta_lag = 0.279 +- 0.002 1/rad`, `d_C_m in flight f3 (flight f1: 0) = 0.012 +- 0.001`
pub fn value(v: &Value) -> String {
    let unit = if v.unit == "-" { String::new() } else { format!(" {}", v.unit) };
    if !v.is_determined {
        return format!("{} not determined (best at {}{unit})", v.name, digits(v.value));
    }
    let sd = v.sd.map(|sd| format!(" +- {}", digits(INTERVAL_95 * sd))).unwrap_or_default();
    let check = v
        .check
        .as_ref()
        .map(|(text, expected, _)| format!(" ({text} = {})", digits(*expected)))
        .unwrap_or_default();
    let of = v.of.as_ref().map(|of| match &v.from {
        Some(from) => format!(" in {of} ({} {from}: {})", of.column, digits(v.null.unwrap_or(0.0))),
        None => format!(" in {of}"),
    });
    let of = of.unwrap_or_default();
    format!("{}{of} = {}{sd}{unit}{check}", v.name, digits(v.value))
}

/// The estimated parameters of a candidate, with 95% intervals.
pub fn values(judged: &Judged) -> String {
    let all = judged.refit.iter().flat_map(|r| &r.values).filter(|v| !v.held);
    all.map(value).collect::<Vec<_>>().join(", ")
}

/// What the estimated parameters of a candidate are, in brackets.
pub fn meaning(judged: &Judged) -> String {
    let all = judged.refit.iter().flat_map(|r| &r.values);
    let said = all.filter(|v| !v.held && !v.doc.is_empty());
    let words: Vec<String> = said.map(|v| format!("{}: {}", v.name, v.doc)).collect();
    if words.is_empty() { String::new() } else { format!(" ({})", words.join(", ")) }
}

/// One candidate's evidence in words.
pub fn evidence(judged: &Judged, limit: f64) -> String {
    let Some(refit) = &judged.refit else { return judged.why.clone() };
    let realised: f64 = refit.held_out.iter().map(|g| g.realised).sum();
    let predicted: f64 = refit.held_out.iter().map(|g| g.predicted).sum();
    let less = if judged.standing == Standing::Alike {
        format!("; {}", judged.why)
    } else {
        String::new()
    };
    format!(
        "log-likelihood gains {} on the training maneuvers (null maximum, 99%: {}), and {} on the held-out ones, where {} is predicted{less}",
        digits(refit.gain),
        digits(limit),
        digits(realised),
        digits(predicted)
    )
}

/// Where an added block comes from, for a comment in the model file.
pub fn provenance(outcome: &Outcome, judged: &Judged, limit: f64) -> String {
    format!(
        "{}\nFound by the diagnosis \"{}\": {}; {}.",
        judged.sentence,
        outcome.config.name(),
        values(judged),
        evidence(judged, limit)
    )
}

/// The verdict in a few sentences, and what errors of the data alone would explain.
pub fn verdict(outcome: &Outcome) -> String {
    let base = if outcome.base.is_empty() {
        String::new()
    } else {
        format!(" Parameters are taken as the pipeline estimates them: {}.", outcome.base)
    };
    format!("{}{}{base}", missing(outcome), data_first(&outcome.diagnosis))
}

/// The error of a sensor or of the recording that comes furthest in the last round of all
/// candidates, with everything in place that was added before; nothing where the flights could show
/// none.
fn data_first(d: &Diagnosis) -> String {
    let last = d.rounds.iter().rfind(|r| !r.strict);
    let judged = last.map(|r| &r.judged[..]).unwrap_or_default();
    let beside = last
        .filter(|r| !r.base.is_empty())
        .map(|r| format!(", beside {}", r.base.join(" and ")))
        .unwrap_or_default();
    let shown = |j: &&Judged| {
        j.family == Family::Sensor && !matches!(j.standing, Standing::Collinear | Standing::Silent)
    };
    // Those that were refitted before those that were only screened.
    let far =
        |j: &Judged| if j.evidence.is_finite() { (true, j.evidence) } else { (false, j.score) };
    let order =
        |a: &&Judged, b: &&Judged| far(a).0.cmp(&far(b).0).then(far(a).1.total_cmp(&far(b).1));
    let tried = judged.iter().filter(shown).count();
    let furthest = judged.iter().filter(shown).max_by(order);
    let outcome = |j: &Judged| {
        let (standing, why) = (j.standing.as_str(), &j.why);
        format!(
            " Data first: of {tried} errors of sensors and recording{beside}, {} comes furthest: {standing} ({why}).",
            j.name
        )
    };
    furthest.map(outcome).unwrap_or_default()
}

/// A held-out maneuver that shows what no other does.
fn missed(outcome: &Outcome, m: &Missed) -> String {
    let name = outcome.names.get(m.segment).map_or("", String::as_str);
    if !m.per_sample.is_finite() {
        return format!("{name} was held out, and the model does not run over it");
    }
    let (is, limit) = (digits(m.per_sample), digits(m.limit));
    format!(
        "{name} was held out and is missed by more than any maneuver of the training ({is} per whitened sample, {limit} at most expected)"
    )
}

fn missing(outcome: &Outcome) -> String {
    let d = &outcome.diagnosis;
    let classes = || counted(d.findings.iter().map(|f| class(outcome, f)));
    let (left, evidence) = (unexplained(outcome), left::evidence(d));
    let rest = if left.is_empty() { String::new() } else { format!(" It is not all: {left}.") };
    let rest = rest + &left::accounted(d).unwrap_or_default();
    match &d.verdict {
        Verdict::NothingMissing => "Nothing is missing that these flights could show.".into(),
        Verdict::ButRecords => {
            format!("Nothing is missing but noise of records: {}.", records(outcome))
        }
        Verdict::ButTurbulence if !d.findings.is_empty() || !d.doubts.is_empty() => {
            format!("{} Besides: {}.", left::but_turbulence(d), records(outcome))
        }
        Verdict::ButTurbulence => left::but_turbulence(d),
        Verdict::Named | Verdict::OneOfThese => {
            let turned = match d.turned.is_empty() {
                true => String::new(),
                false => format!(
                    " From the fit to the training maneuvers without it to that with it {}: is that what it should be?",
                    d.turned.join(", ")
                ),
            };
            format!("The model lacks (+- is 95%): {}.{rest}{turned}", classes())
        }
        Verdict::Located if !d.findings.is_empty() => {
            let what = if left.is_empty() { left } else { format!(": {left}") };
            format!(
                "{evidence}Something is missing that no effect of the library is trusted to explain{what}. {} (+- is 95%): {}.",
                smaller(&d.comparison.channels),
                classes()
            )
        }
        Verdict::Located if left.is_empty() => {
            format!(
                "{evidence}Something is missing, and no effect of the library passes: {}.",
                best(d)
            )
        }
        Verdict::Located => format!(
            "{evidence}Something is missing that no effect of the library is trusted to explain: {left}."
        ),
        Verdict::None(why) => format!("No verdict: {}.", trouble(why)),
    }
}

/// What additions do to held-out maneuvers. A gain in likelihood is one of residuals made white: where noise
/// is slow, their size says something else.
fn smaller(channels: &[Channel]) -> &'static str {
    let of_all = |c: &&Channel| c.held_out && c.segment.is_none() && c.output.is_some();
    let whole: Vec<&Channel> = channels.iter().filter(of_all).collect();
    match whole.is_empty() || whole.iter().any(|c| c.after.rms < c.before.rms) {
        true => "It is made smaller by",
        false => {
            "Only the fast part of it is made smaller, and no output of the held-out maneuvers comes closer as a whole, by"
        }
    }
}

/// Small movements that records of inputs show and that did not happen, and where.
fn records(outcome: &Outcome) -> String {
    let d = &outcome.diagnosis;
    let found = d.findings.iter().map(|f| class(outcome, f));
    let is_noise =
        |name: &str| d.rounds.iter().flat_map(|r| &r.judged).any(|j| j.noise && j.name == name);
    let some = d.doubts.iter().map(|(name, why)| match is_noise(name) {
        true => format!("{name} in some maneuvers only ({why})"),
        false => format!("{name} ({why})"),
    });
    let moved = match d.findings.is_empty() {
        true => "what parameters are without them is not known",
        false => "no parameter moves by three of its sd when they are taken out (+- is 95%)",
    };
    format!("{}; {moved}; smooth or hold what drives the model", counted(found.chain(some)))
}

/// One text as it is, several with their numbers, without a full stop at the end.
fn counted(texts: impl Iterator<Item = String>) -> String {
    let texts: Vec<String> = texts.map(|text| text.trim_end_matches('.').to_string()).collect();
    match &texts[..] {
        [one] => one.clone(),
        several => several
            .iter()
            .enumerate()
            .map(|(i, text)| format!("({}) {text}", i + 1))
            .collect::<Vec<_>>()
            .join("; "),
    }
}

/// What is not explained: the first outputs that still response, what explains something and is not
/// believed, held-out maneuvers that are missed.
fn unexplained(outcome: &Outcome) -> String {
    let d = &outcome.diagnosis;
    let responses = d.located().take(3).map(|l| format!("{} responds to {}", l.output, l.source));
    let doubts =
        d.doubts.iter().map(|(name, why)| format!("{name} would explain part of it, but {why}"));
    let missed = d.missed.iter().map(|m| missed(outcome, m));
    // Where nothing is named the evidence has them; what turbulence accounts for is told by itself.
    let accounted = left::accounted(d).is_some();
    let poor =
        (d.is_named() && !accounted).then(|| left::outputs(d)).filter(|text| !text.is_empty());
    let unphysical = d.unphysical.iter().map(|why| format!("with it {why}, which is not physical"));
    responses
        .chain(doubts)
        .chain(d.unsettled.iter().cloned())
        .chain(unphysical)
        .chain(missed)
        .chain(poor)
        .collect::<Vec<_>>()
        .join("; ")
}

/// The candidate that gains most before anything is added, and why it was not believed.
fn best(d: &Diagnosis) -> String {
    let round = d.rounds.first().map(|r| &r.judged[..]).unwrap_or_default();
    let best = round.iter().max_by(|a, b| a.score.total_cmp(&b.score));
    best.map(|j| format!("{} comes nearest ({})", j.name, j.why)).unwrap_or_default()
}

/// An effect that is missing, with those that are not distinguishable from it.
fn class(outcome: &Outcome, finding: &Finding) -> String {
    let Some(round) = outcome.diagnosis.rounds.get(finding.round) else { return String::new() };
    let all: Vec<&Judged> = finding.class.iter().filter_map(|&c| round.judged.get(c)).collect();
    let often = often(outcome, finding, round);
    match &all[..] {
        [one] => format!("{} ({}{often})", one.sentence, values(one)),
        several => {
            let names: Vec<String> =
                several.iter().map(|j| format!("{} ({})", j.sentence, values(j))).collect();
            let mut separate: Vec<&str> =
                several.iter().map(|j| j.separate.as_str()).filter(|s| !s.is_empty()).collect();
            separate.dedup();
            let fly = if separate.is_empty() {
                String::new()
            } else {
                format!("; to separate them: {}", separate.join(" "))
            };
            format!(
                "one of these, which the flights cannot separate{often}: {}{fly}",
                names.join(" | ")
            )
        }
    }
}

/// `; chosen from 19 of 21 choices of the maneuvers`, with those chosen in its place.
fn often(outcome: &Outcome, finding: &Finding, round: &Round) -> String {
    let Some(name) = round.judged.get(finding.added).map(|j| &j.name) else {
        return String::new();
    };
    let count = finding.stability.count(name, &outcome.config.settings.method);
    let rivals: Vec<String> =
        count.rivals.iter().map(|(name, n)| format!("{name} from {n}")).collect();
    let instead = if rivals.is_empty() {
        String::new()
    } else {
        format!(" ({})", crate::config::list(&rivals))
    };
    format!("; chosen from {} of {} choices of the maneuvers{instead}", count.own, count.cast)
}
