//! A diagnosis in; its tables out.

use super::{Outcome, comparison, left, words};
use crate::diagnose::{Finding, Gain, Judged, Round, Varying, Vote, Weighed};
use crate::error::Result;
use crate::table::Table;

pub fn all(outcome: &Outcome) -> Result<Vec<(&'static str, Table)>> {
    Ok(vec![
        ("findings", findings(outcome)?),
        ("candidates", candidates(outcome)?),
        ("imitations", imitations(outcome)?),
        ("additions", additions(outcome)?),
        ("held_out", held_out(outcome)?),
        ("located", located(outcome)?),
        ("gaps", comparison::gaps(outcome)?),
        ("relations", comparison::relations(outcome)?),
        ("driven", comparison::driven(outcome)?),
        ("equation_errors", comparison::equation_errors(outcome)?),
        ("closures", comparison::closures(outcome)?),
        ("shifts", comparison::shifts(outcome)?),
        ("overlays", comparison::overlays(outcome)?),
        ("votes", votes(outcome)?),
        ("varying", varying(outcome)?),
        ("unexplained", left::unexplained(outcome)?),
        ("turbulence", left::turbulence(outcome)?),
    ])
}

/// The lines added to the model; no row where there are none.
pub fn next_models(outcome: &Outcome, estimate: &str, added: &str) -> Result<Table> {
    let lines = [added].into_iter().filter(|lines| !lines.is_empty());
    Table::build("next_models")
        .repeat("diagnosis", &outcome.config.name())
        .repeat("estimate", estimate)
        .repeat("next", &outcome.config.settings.next())
        .strings("added", lines)
        .finish()
}

/// One effect of a finding's class.
struct Member<'a> {
    /// Number of the round that tested it, from 1.
    number: usize,
    round: &'a Round,
    judged: &'a Judged,
    added: bool,
    finding: &'a Finding,
}

fn members<'a>(outcome: &'a Outcome) -> Vec<Member<'a>> {
    let d = &outcome.diagnosis;
    let of = |finding: &'a Finding| -> Vec<Member<'a>> {
        let Some(round) = d.rounds.get(finding.round) else { return Vec::new() };
        let member = |&c: &usize| {
            let judged = round.judged.get(c)?;
            let added = c == finding.added;
            Some(Member { number: finding.round + 1, round, judged, added, finding })
        };
        finding.class.iter().filter_map(member).collect()
    };
    d.findings.iter().flat_map(of).collect()
}

/// One row for the verdict, then one per effect named, class by class.
fn findings(outcome: &Outcome) -> Result<Table> {
    let d = &outcome.diagnosis;
    let members = members(outcome);
    let n = members.len() + 1;
    let number = |first: f64, of: fn(&Member) -> f64| -> Vec<f64> {
        std::iter::once(first).chain(members.iter().map(of)).collect()
    };
    let text = |of: fn(&Member) -> String| -> Vec<Option<String>> {
        std::iter::once(None).chain(members.iter().map(|m| Some(of(m)))).collect()
    };
    let sentence = |m: &Member| {
        let (j, limit) = (m.judged, m.round.limit);
        let (values, meaning) = (words::values(j), words::meaning(j));
        format!("{}: {values}{meaning}; {}.", j.sentence, words::evidence(j, limit))
    };
    let sentences = std::iter::once(words::verdict(outcome)).chain(members.iter().map(sentence));
    let held: Vec<&str> = outcome
        .names
        .iter()
        .zip(&outcome.rule.held_out)
        .filter(|(_, h)| **h)
        .map(|(n, _)| n.as_str())
        .collect();
    Table::build("findings")
        .repeat("diagnosis", &outcome.config.name())
        .repeat("model", outcome.model)
        .i64("number", (0..n as i64).collect::<Vec<_>>())
        .repeat("verdict", d.verdict.as_str())
        .bools("complete", vec![d.complete; n])
        .opt_i64(
            "round",
            std::iter::once(None)
                .chain(members.iter().map(|m| Some(m.number as i64)))
                .collect::<Vec<_>>(),
        )
        .opt_strings("candidate", text(|m| m.judged.name.clone()))
        .opt_strings("effect", text(|m| m.judged.effect.clone()))
        .opt_strings("family", text(|m| m.judged.family.name().to_string()))
        .opt_strings("role", text(|m| if m.added { "added" } else { "alike" }.to_string()))
        .f64("gain", number(f64::NAN, |m| m.judged.refit.as_ref().map_or(f64::NAN, |r| r.gain)))
        .f64("limit", number(d.rounds.first().map_or(f64::NAN, |r| r.limit), |m| m.round.limit))
        .f64("held_out_predicted", number(f64::NAN, |m| in_sum(m.judged, |g| g.predicted)))
        .f64("held_out_realised", number(f64::NAN, |m| in_sum(m.judged, |g| g.realised)))
        .opt_i64("chosen", counts(outcome, &members, |chosen, _| chosen))
        .opt_i64("votes", counts(outcome, &members, |_, cast| cast))
        .strings("text", sentences)
        .repeat("held_out", &format!("{}: {}", outcome.rule.words, held.join(" ")))
        .finish()
}

/// How often each member of a class was chosen, of how many votes; none for the verdict.
fn counts(
    outcome: &Outcome,
    members: &[Member],
    which: fn(usize, usize) -> usize,
) -> Vec<Option<i64>> {
    let of = |m: &Member| {
        let count = &m
            .finding
            .stability
            .count(&m.round.judged[m.finding.added].name, &outcome.config.settings.method);
        let rival = count.rivals.iter().find(|r| r.0 == m.judged.name).map_or(0, |r| r.1);
        let own = if m.added { count.own } else { rival };
        Some(which(own, count.cast) as i64)
    };
    std::iter::once(None).chain(members.iter().map(of)).collect()
}

/// What every other choice of the maneuvers chose, for each effect that came out of the search.
fn votes(outcome: &Outcome) -> Result<Table> {
    let d = &outcome.diagnosis;
    let name = |f: &Finding| d.rounds.get(f.round)?.judged.get(f.added).map(|j| j.name.clone());
    let found = d.findings.iter().filter_map(|f| Some((name(f)?, &f.stability)));
    let unstable = d.unstable.iter().map(|(name, stability)| (name.clone(), stability));
    let all: Vec<_> = found.chain(unstable).collect();
    let rows: Vec<_> =
        all.iter().flat_map(|(name, s)| s.votes.iter().map(move |vote| (name, vote))).collect();
    let own = |of: fn(&Weighed) -> f64| -> Vec<f64> {
        let one = |(name, vote): &(&String, &Vote)| {
            vote.weighed.iter().find(|w| w.name == **name).map_or(f64::NAN, of)
        };
        rows.iter().map(one).collect()
    };
    Table::build("votes")
        .repeat("diagnosis", &outcome.config.name())
        .strings("candidate", rows.iter().map(|r| r.0))
        .strings("variant", rows.iter().map(|r| &r.1.variant))
        .opt_strings("chosen", rows.iter().map(|r| r.1.chosen.as_deref()))
        .f64("evidence", own(|w| w.evidence))
        .f64("predicted", own(|w| w.predicted))
        .finish()
}

/// Parameters of the base that differ from maneuver to maneuver.
fn varying(outcome: &Outcome) -> Result<Table> {
    let all = &outcome.diagnosis.varying;
    let number = |of: fn(&Varying) -> f64| all.iter().map(of).collect::<Vec<f64>>();
    Table::build("varying")
        .repeat("diagnosis", &outcome.config.name())
        .strings("parameter", all.iter().map(|v| &v.parameter))
        .strings("unit", all.iter().map(|v| &v.unit))
        .strings("with", all.iter().map(|v| &v.with))
        .f64("spread", number(|v| v.spread))
        .f64("gain", number(|v| v.gain))
        .f64("limit", number(|v| v.limit))
        .f64("held_out", number(|v| v.held_out))
        .finish()
}

/// Over the held-out maneuvers.
fn in_sum(judged: &Judged, of: fn(&Gain) -> f64) -> f64 {
    judged.refit.as_ref().map_or(f64::NAN, |r| r.held_out.iter().map(of).sum())
}

/// Every candidate of every round.
fn rows<'a>(outcome: &'a Outcome) -> Vec<(usize, &'a Round, &'a Judged)> {
    let rounds = outcome.diagnosis.rounds.iter().enumerate();
    rounds.flat_map(|(i, round)| round.judged.iter().map(move |j| (i + 1, round, j))).collect()
}

fn candidates(outcome: &Outcome) -> Result<Table> {
    let rows = rows(outcome);
    let number = |of: &dyn Fn(&Round, &Judged) -> f64| {
        rows.iter().map(|(_, round, j)| of(round, j)).collect::<Vec<f64>>()
    };
    Table::build("candidates")
        .repeat("diagnosis", &outcome.config.name())
        .i64("round", rows.iter().map(|r| r.0 as i64).collect::<Vec<_>>())
        .bools("strict", rows.iter().map(|r| r.1.strict).collect::<Vec<_>>())
        .strings("base", rows.iter().map(|r| r.1.base.join(" ")))
        .strings("candidate", rows.iter().map(|r| &r.2.name))
        .strings("effect", rows.iter().map(|r| &r.2.effect))
        .strings("family", rows.iter().map(|r| r.2.family.name()))
        .strings("sentence", rows.iter().map(|r| &r.2.sentence))
        .strings("standing", rows.iter().map(|r| r.2.standing.as_str()))
        .strings("why", rows.iter().map(|r| &r.2.why))
        .f64("left", number(&|_, j| j.screened.left))
        .f64("screened", number(&|_, j| j.screened.gain))
        .f64("score", number(&|_, j| j.score))
        .f64("limit", number(&|round, _| round.limit))
        .f64("gain", number(&|_, j| j.refit.as_ref().map_or(f64::NAN, |r| r.gain)))
        .f64("evidence", number(&|_, j| j.evidence))
        .f64(
            "consistency",
            number(&|_, j| {
                j.refit.as_ref().and_then(|r| r.heterogeneity).map_or(f64::NAN, |c| c.p)
            }),
        )
        .f64(
            "scatter",
            number(&|_, j| {
                j.refit.as_ref().and_then(|r| r.heterogeneity).map_or(f64::NAN, |c| c.share)
            }),
        )
        .finish()
}

/// What the base's parameters take over of the candidates that they imitate.
fn imitations(outcome: &Outcome) -> Result<Table> {
    let all = rows(outcome);
    let rows: Vec<_> = all
        .iter()
        .flat_map(|(round, _, j)| j.screened.imitators.iter().map(move |i| (*round, *j, i)))
        .collect();
    Table::build("imitations")
        .repeat("diagnosis", &outcome.config.name())
        .i64("round", rows.iter().map(|r| r.0 as i64).collect::<Vec<_>>())
        .strings("candidate", rows.iter().map(|r| &r.1.name))
        .f64("left", rows.iter().map(|r| r.1.screened.left).collect::<Vec<_>>())
        .strings("parameter", rows.iter().map(|r| &r.2.name))
        .strings("unit", rows.iter().map(|r| &r.2.unit))
        .f64("shift", rows.iter().map(|r| r.2.shift).collect::<Vec<_>>())
        .strings("separate", rows.iter().map(|r| &r.1.separate))
        .finish()
}

/// Whether a candidate of a round (from 1) is one that the verdict names, in the round that tested
/// it with everything else in place.
fn is_found(outcome: &Outcome, round: usize, judged: &Judged) -> bool {
    let d = &outcome.diagnosis;
    let same = |f: &crate::diagnose::Finding| {
        f.round + 1 == round
            && d.rounds
                .get(f.round)
                .and_then(|r| r.judged.get(f.added))
                .is_some_and(|j| j.name == judged.name)
    };
    d.is_named() && d.findings.iter().any(same)
}

fn additions(outcome: &Outcome) -> Result<Table> {
    let all = rows(outcome);
    let rows: Vec<_> = all
        .iter()
        .flat_map(|(i, _, j)| {
            j.refit.iter().flat_map(move |r| r.values.iter().map(move |v| (*i, *j, v)))
        })
        .collect();
    Table::build("additions")
        .repeat("diagnosis", &outcome.config.name())
        .i64("round", rows.iter().map(|r| r.0 as i64).collect::<Vec<_>>())
        .strings("candidate", rows.iter().map(|r| &r.1.name))
        .strings("standing", rows.iter().map(|r| r.1.standing.as_str()))
        .strings("parameter", rows.iter().map(|r| &r.2.name))
        .opt_strings("of", rows.iter().map(|r| r.2.of.as_ref().map(|of| of.value.clone())))
        .opt_strings("held_in", rows.iter().map(|r| r.2.from.clone()))
        .strings("unit", rows.iter().map(|r| &r.2.unit))
        .f64("value", rows.iter().map(|r| r.2.value).collect::<Vec<_>>())
        .f64("sd", rows.iter().map(|r| r.2.sd.unwrap_or(f64::NAN)).collect::<Vec<_>>())
        .f64("null", rows.iter().map(|r| r.2.null.unwrap_or(f64::NAN)).collect::<Vec<_>>())
        .bools("held", rows.iter().map(|r| r.2.held).collect::<Vec<_>>())
        .bools("determined", rows.iter().map(|r| r.2.is_determined).collect::<Vec<_>>())
        .bools("found", rows.iter().map(|r| is_found(outcome, r.0, r.1)).collect::<Vec<_>>())
        .bools("at_bound", rows.iter().map(|r| r.2.at_bound).collect::<Vec<_>>())
        .f64(
            "expected",
            rows.iter().map(|r| r.2.check.as_ref().map_or(f64::NAN, |c| c.1)).collect::<Vec<_>>(),
        )
        .opt_strings("expected_from", rows.iter().map(|r| r.2.check.as_ref().map(|c| c.0.clone())))
        .finish()
}

fn held_out(outcome: &Outcome) -> Result<Table> {
    let all = rows(outcome);
    let gains = |j: &Judged| -> Vec<(&'static str, Gain)> {
        let of =
            |set: &'static str, gains: &[Gain]| gains.iter().map(|g| (set, *g)).collect::<Vec<_>>();
        j.refit
            .iter()
            .flat_map(|r| [of("training", &r.training), of("held out", &r.held_out)].concat())
            .collect()
    };
    let rows: Vec<_> =
        all.iter().flat_map(|(i, _, j)| gains(j).into_iter().map(move |g| (*i, *j, g))).collect();
    Table::build("held_out")
        .repeat("diagnosis", &outcome.config.name())
        .i64("round", rows.iter().map(|r| r.0 as i64).collect::<Vec<_>>())
        .strings("candidate", rows.iter().map(|r| &r.1.name))
        .strings("standing", rows.iter().map(|r| r.1.standing.as_str()))
        .strings("set", rows.iter().map(|r| r.2.0))
        .strings(
            "segment",
            rows.iter().map(|r| outcome.names.get(r.2.1.segment).map_or("", String::as_str)),
        )
        .f64("predicted", rows.iter().map(|r| r.2.1.predicted).collect::<Vec<_>>())
        .f64("realised", rows.iter().map(|r| r.2.1.realised).collect::<Vec<_>>())
        .finish()
}

fn located(outcome: &Outcome) -> Result<Table> {
    let d = &outcome.diagnosis;
    let before = d.before.iter().map(|l| ("before", l));
    let rows: Vec<_> = before.chain(d.after.iter().map(|l| ("after", l))).collect();
    let number = |of: &dyn Fn(&crate::diagnose::Located) -> f64| {
        rows.iter().map(|r| of(r.1)).collect::<Vec<f64>>()
    };
    Table::build("located")
        .repeat("diagnosis", &outcome.config.name())
        .strings("when", rows.iter().map(|r| r.0))
        .strings("output", rows.iter().map(|r| &r.1.output))
        .strings("source", rows.iter().map(|r| &r.1.source))
        .f64("gain", number(&|l| l.gain))
        .f64("limit", number(&|l| l.limit))
        .f64("held_out", number(&|l| l.held_out))
        .bools("real", rows.iter().map(|r| r.1.is_real()).collect::<Vec<_>>())
        .finish()
}
