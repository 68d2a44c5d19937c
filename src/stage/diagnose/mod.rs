//! Maneuvers of all flights and the library of effects come in; what one estimate's model lacks,
//! and the amended model file, go out.

mod comparison;
mod config;
mod left;
mod outcome;
pub(super) mod recommended;
mod tables;
mod words;

use super::estimate::{self, Group, ready};
use super::{Campaign, Inputs, Key, Note, Output, Read, Severity, Stage, Unit, said, slice_of};
use crate::diagnose::effect::{self, Context};
use crate::diagnose::{self, Base, Claim, Diagnosis, Fitted, Judged, Rule, Subject, Verdict};
use crate::error::Errors;
use crate::estimate::{SEGMENT, Segment};
use crate::model::Model;
use crate::noise::Modelled;
use indexmap::IndexMap;
use serde_json::{Value, json};
use std::collections::BTreeMap;

use config::NAME;
pub use config::{Config, Settings, all};
use outcome::Outcome;

pub const STAGE: Stage = Stage {
    name: NAME,
    about: "diagnose models",
    key: Some(Key::of::<Vec<Settings>>()),
    check: config::check,
    again: config::again,
    units: |campaign| Unit::entries(all(campaign).iter().map(Config::name)),
    writes: &[
        "findings",
        "candidates",
        "imitations",
        "additions",
        "held_out",
        "located",
        "gaps",
        "relations",
        "driven",
        "equation_errors",
        "closures",
        "shifts",
        "overlays",
        "votes",
        "varying",
        "unexplained",
        "turbulence",
        "next_models",
        "recommended",
    ],
    reads,
    slice,
    run,
    asked,
    idle,
    ..Stage::PLAIN
};

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let Some((config, base)) = parts(campaign, unit) else { return Value::Null };
    let effects: Vec<Value> = config
        .effects
        .iter()
        .map(|e| json!({ "name": e.name, "file": slice_of(&e.file) }))
        .collect();
    json!({
        "settings": slice_of(&config.settings.plain()),
        "estimate": slice_of(&base.settings),
        "left_out": ready::left_out(base, campaign),
        "model": said(&base.model),
        "effects": effects,
        "lines": slice_of(&lines(campaign, config).map(|l| [l.parameter, l.against, l.unit]).collect::<Vec<_>>()),
    })
}

/// What a command asked for, and not the pipeline file.
fn asked(campaign: &Campaign, unit: &Unit) -> Option<Value> {
    let config = all(campaign).get(unit.index).filter(|d| d.settings.asked)?;
    serde_json::to_value(config.settings.plain()).ok()
}

fn idle(campaign: &Campaign, unit: &Unit) -> Option<&'static str> {
    all(campaign)
        .get(unit.index)
        .is_some_and(|d| d.settings.idle)
        .then_some("it is not asked for now, and what it was made from has changed: `koehler diagnose` makes it anew")
}

fn parts<'a>(campaign: &'a Campaign, unit: &Unit) -> Option<(&'a Config, &'a estimate::Config)> {
    let config = all(campaign).get(unit.index)?;
    Some((config, campaign.estimates.get(config.estimate)?))
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    parts(campaign, unit).map(|(_, base)| estimate::tables_read(base, campaign)).unwrap_or_default()
}

/// The lines that the pipeline fits through the estimates.
fn lines<'a>(campaign: &'a Campaign, config: &'a Config) -> impl Iterator<Item = Fitted> + 'a {
    let of = |fit: &'a super::fit::Config| {
        let (against, unit) = (&fit.settings.against, &fit.unit_x);
        let line = |name: &String| Fitted {
            parameter: name.clone(),
            against: against.clone(),
            unit: unit.clone(),
        };
        fit.settings.parameters.iter().map(line)
    };
    campaign.fits.iter().filter(|fit| fit.estimate == config.estimate).flat_map(of)
}

/// How the estimate comes about; parameters that are held at predictions do not come about.
fn claim(campaign: &Campaign, config: &Config, base: &estimate::Config) -> Claim {
    let apart = match (config.settings.method.base, base.settings.group) {
        (Base::Predicted, _) | (_, Group::All) => None,
        (Base::Estimated, Group::Segment) => Some(SEGMENT.to_string()),
        (Base::Estimated, Group::Flight) => Some("flight".to_string()),
    };
    Claim { apart, lines: lines(campaign, config).collect() }
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> Result<Output, Errors> {
    let Some((config, base)) = parts(campaign, unit) else { return Ok(Output::default()) };
    let mut notes = Vec::new();
    let ready = ready::of(base, campaign, inputs, &mut notes)?;
    notes.iter_mut().for_each(|note| note.stage = STAGE.name.to_string());
    let names: Vec<String> = ready.iter().map(|r| r.segment.clone()).collect();
    let segments: Vec<Segment> = ready.into_iter().map(|r| r.labelled).collect();
    let settings = &config.settings.method;
    let (mut segments, names) = diagnose::cut(segments, names, settings);
    let claim = claim(campaign, config, base);
    let (method, taken) =
        diagnose::together(&base.model, &base.settings.method, &mut segments, &claim)?;
    let rule = diagnose::held_out(&segments, &names, settings);
    let context = context(&config.settings.roles, &base.model, &segments);
    let offer = |model: &Model, wanted: &effect::Wanted| {
        let offer = effect::candidates_of(model, &context, &config.effects, wanted);
        Ok((offer.candidates, offer.skipped.into_iter().map(|s| (s.effect, s.why)).collect()))
    };
    let held_out = &rule.held_out[..];
    let subject = Subject {
        model: &base.model,
        segments: &segments,
        held_out,
        method: &method,
        context: &context,
        settings,
    };
    let diagnosis = diagnose::diagnose(&subject, &offer, inputs.tell)?;
    notes.extend(lost(config, &names, &rule, &diagnosis));
    let outcome = Outcome { config, model: &base.model.name, names, rule, base: taken, diagnosis };
    let mut files = Vec::new();
    let added = added(&outcome, base);
    if !added.is_empty() {
        let text = base.model.own_text().to_string() + &added;
        files.push((
            format!("models/{}.model.toml", outcome.config.settings.next()),
            text.into_bytes(),
        ));
    }
    let mut tables = tables::all(&outcome)?;
    tables.push(("next_models", tables::next_models(&outcome, &base.name(), &added)?));
    if !config.settings.rerun
        && let Some((_, additions)) = tables.iter().find(|(name, _)| *name == "additions")
    {
        tables.push(("recommended", recommended::values(&config.name(), additions, None)?));
    }
    Ok(Output { tables, files, notes })
}

/// What the diagnosis could not do.
fn lost(config: &Config, names: &[String], rule: &Rule, diagnosis: &Diagnosis) -> Vec<Note> {
    let (flight, stage) = (String::new, STAGE.name.to_string());
    let note = |severity, subject: &str, count: usize, text: String| {
        let (stage, subject, count) = (stage.clone(), subject.to_string(), count as u64);
        Note { flight: flight(), stage, severity, subject, count, text }
    };
    let mut notes = Vec::new();
    if let Verdict::None(trouble) = &diagnosis.verdict {
        let text = format!("no verdict: {}", words::trouble(trouble));
        notes.push(note(Severity::Missing, &config.name(), 1, text));
    }
    for name in &rule.unknown {
        let text =
            format!("{name} is to be held out, and no maneuver or flight of that name takes part");
        notes.push(note(Severity::Problem, name, 1, text));
    }
    for left in &diagnosis.left_out {
        let name = names.get(left.segment).map_or("", String::as_str);
        let text = format!(
            "{name} is left out of the diagnosis of {}: {}",
            config.settings.estimate, left.why
        );
        notes.push(note(Severity::Missing, name, 1, text));
    }
    for (output, order) in &diagnosis.unsure_noise {
        let text = match order {
            Some(order) => format!("{output}: {}", Modelled::cut_words(*order)),
            None => format!(
                "{output} takes no part in the diagnosis of {}: the model leaves nothing of it, so its noise is unknown",
                config.settings.estimate
            ),
        };
        let severity = if order.is_some() { Severity::Info } else { Severity::Warning };
        notes.push(note(severity, output, 1, text));
    }
    // Most of a library is about something that a model does not have; the list is for whoever misses
    // one. Effects of the user's own are there to be tried.
    let own = |name: &str| {
        let of = effect::effect_of(name);
        config.effects.iter().any(|e| e.name == of && e.place.is_some())
    };
    let (mine, library): (Vec<_>, Vec<_>) =
        diagnosis.skipped.iter().partition(|(effect, _)| own(effect));
    for (skipped, whose, severity) in
        [(mine, "effects of your own", Severity::Warning), (library, "effects", Severity::Info)]
    {
        if !skipped.is_empty() {
            let each = skipped.iter().map(|(effect, why)| format!("{effect} ({why})"));
            let text = format!("{whose} not tried: {}", each.collect::<Vec<_>>().join("; "));
            notes.push(note(severity, &config.name(), skipped.len(), text));
        }
    }
    notes
}

/// What effects may want to know of the campaign: roles, half range and middle of every input and
/// measured output of the model.
fn context(roles: &IndexMap<String, Vec<String>>, model: &Model, segments: &[Segment]) -> Context {
    let records: Vec<_> = segments.iter().map(|s| &s.record).collect();
    Context { roles: roles.clone(), ..Context::of(model, &records) }
}

/// Everything that was added, as it stands behind the model's own file: one block per effect; empty
/// where nothing was. What makes a gap smaller that is only located is no finding, and a model with
/// it would be wrong in another way.
fn added(outcome: &Outcome, base: &estimate::Config) -> String {
    if !outcome.diagnosis.is_named() {
        return String::new();
    }
    let values: BTreeMap<String, f64> = outcome.diagnosis.values.iter().cloned().collect();
    let mut model = &base.model;
    let mut text = String::new();
    for (candidate, finding) in outcome.diagnosis.added.iter().zip(&outcome.diagnosis.findings) {
        let round = outcome.diagnosis.rounds.get(finding.round);
        let judged = round.and_then(|r| Some((r.judged.get(finding.added)?, r.limit)));
        let provenance =
            judged.map(|(j, limit)| words::provenance(outcome, j, limit)).unwrap_or_default();
        let held = judged.map(|(j, _)| undetermined(j)).unwrap_or_default();
        // Each candidate's base is the model with those before it: its text has their starting
        // values, so blocks are joined by hand.
        let own = model.own_text().len();
        let whole = candidate.text(model, &values, &held, &provenance);
        text += whole.get(own..).unwrap_or_default();
        model = &candidate.model;
    }
    text
}

/// What the flights do not determine of an effect: held where it was found, because an estimation
/// could not move it.
fn undetermined(judged: &Judged) -> Vec<&str> {
    let values = judged.refit.iter().flat_map(|refit| &refit.values);
    values.filter(|v| !v.is_determined).map(|v| v.name.as_str()).collect()
}
