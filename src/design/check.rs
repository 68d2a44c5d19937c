//! A study file and what it names in; the mistakes that its schema cannot find, at their places, out.

use super::prepared::Prepared;
use super::rows::{Design, SEARCHED};
use super::settings::{Estimate, Settings};
use super::watch::{Limits, watched};
use crate::config::Doc;
use crate::error::Errors;
use crate::estimate;
use crate::model::Model;
use crate::simulate::{Campaign, Shape};
use crate::stage::Channels;
use crate::stage::check::{Columns, agree, drivers, unknown};
use crate::table::check_flight;
use indexmap::IndexMap;

/// Signals, names and numbers of the designs.
pub fn designs(settings: &Settings, designs: &[Design], doc: &Doc) -> Errors {
    let mut errors = Errors::default();
    for (i, row) in settings.row.iter().enumerate() {
        let key = format!("row.{i}");
        if !designs.iter().any(|d| d.key == key) {
            errors
                .push(doc.error(&key, format!("an empty list stands for no design: {}", row.kind)));
        }
    }
    if settings.row.is_empty() {
        errors.push(doc.error("row", "the study has no design").help("add one: [[row]]"));
    }
    // what a search finds has its name in the table
    let mut names: Vec<&str> = if settings.optimise { vec![SEARCHED] } else { Vec::new() };
    for design in designs {
        let mistakes = Shape::of(&design.maneuver).err().unwrap_or_default();
        for (key, what) in mistakes {
            let error = doc.error(&format!("{}.{key}", design.key), what);
            // Combinations of one entry share its mistakes.
            if !errors.0.contains(&error) {
                errors.push(error);
            }
        }
        if design.repeats == 0 {
            let what = "a design is flown once or more often, not 0 times";
            errors.push(doc.error(&format!("{}.repeats", design.key), what));
        }
        let name = &design.name;
        let at = format!("{}.name", design.key);
        if let Err(e) = check_flight(name) {
            errors.push(doc.error(&at, format!("\"{name}\" is no name of a design: {}", e.what)));
        }
        if names.contains(&name.as_str()) {
            errors.push(doc.error(&at, format!("the name \"{name}\" is taken")));
        }
        names.push(name);
    }
    errors
}

/// Names of the truth model.
pub fn against_truth(settings: &Settings, campaign: &Campaign, doc: &Doc) -> Errors {
    let (mut errors, model) = (Errors::default(), &campaign.model);
    let drive = &campaign.settings.drive;
    let inputs: Vec<&str> = model.inputs.iter().map(|q| q.name.as_str()).collect();
    let roles = [&drive.speed, &drive.altitude, &drive.hold, &drive.turbulence];
    let driven = roles.into_iter().flatten().chain(&drive.noise).chain(drive.constant.keys());
    if !inputs.contains(&settings.input.as_str()) {
        errors.push(unknown(doc, "input", "input of the truth model", &settings.input, &inputs));
    } else if driven.into_iter().any(|name| *name == settings.input) {
        let what = format!("the campaign's [drive] drives \"{}\" already", settings.input);
        errors.push(doc.error("input", what));
    }
    let constants: Vec<&str> = model.constants.iter().map(|c| c.quantity.name.as_str()).collect();
    for name in settings.truth.0.keys().filter(|name| !constants.contains(&name.as_str())) {
        let kind = "constant of the truth model";
        errors.push(unknown(doc, &format!("truth.{name}"), kind, name, &constants));
    }
    let signals = model.outputs.iter().chain(&model.inputs);
    let signals: Vec<&str> = signals.map(|q| q.name.as_str()).collect();
    let mut known = |key: String, name: &str| {
        if !signals.contains(&name) {
            let kind = "output or input of the truth model";
            errors.push(unknown(doc, &key, kind, name, &signals));
        }
    };
    for (parameter, name) in &settings.true_values {
        known(format!("true_values.{parameter}"), name);
    }
    for (key, name, _) in watched(&settings.watch, &Limits::default()) {
        if let Some(name) = name {
            known(format!("watch.{key}"), name);
        }
    }
    errors
}

/// Topics and fields that the channel map names and the study uses.
pub fn recorded(
    settings: &Settings,
    campaign: &Campaign,
    channels: &Channels,
    doc: &Doc,
) -> Errors {
    let mut errors = Errors::default();
    for (name, signal) in &channels.map.signal {
        let topic = campaign.settings.topics.get(&signal.topic);
        if topic.is_some_and(|t| t.fields.contains_key(&signal.field)) {
            continue;
        }
        let what = format!(
            "the signal \"{name}\" of {} is field \"{}\" of topic \"{}\", which the campaign {} does not record",
            settings.channels, signal.field, signal.topic, settings.campaign
        );
        errors.push(doc.error("channels", what));
    }
    errors
}

/// Parameters whose true values are told: some model has them. Nothing is said while a model has
/// mistakes of its own.
pub fn true_values(settings: &Settings, estimates: &[Prepared], doc: &Doc) -> Errors {
    let mut errors = Errors::default();
    if estimates.len() < settings.estimate.len() {
        return errors;
    }
    let names = estimates.iter().flat_map(|e| &e.model.parameters);
    let names: Vec<&str> = names.map(|p| p.quantity.name.as_str()).collect();
    for name in settings.true_values.keys().filter(|name| !names.contains(&name.as_str())) {
        let key = format!("true_values.{name}");
        errors.push(unknown(doc, &key, "parameter of an estimated model", name, &names));
    }
    errors
}

/// What a search needs, and its names.
pub fn search(settings: &Settings, doc: &Doc) -> Errors {
    let mut errors = Errors::default();
    let Some(search) = &settings.search else {
        if settings.optimise {
            let help = "add [search] with `estimate`, `step_s`, `total_s` and `amplitude`";
            errors.push(doc.error("optimise", "nothing says what is searched").help(help));
        }
        return errors;
    };
    let names: Vec<&String> = settings.estimate.keys().collect();
    if !settings.estimate.contains_key(&search.estimate) {
        errors.push(unknown(doc, "search.estimate", "estimate", &search.estimate, &names));
    }
    let [low, high] = search.step_s;
    if !(low > 0.0 && low < high && high.is_finite()) {
        let what = format!("the durations of a step go from {low} s to {high} s");
        let help = "the first is greater than 0 and less than the second";
        errors.push(doc.error("search.step_s", what).help(help));
    } else if search.total_s <= low * f64::from(search.steps) {
        let what = format!(
            "{} steps of {low} s or more do not fit into {} s",
            search.steps, search.total_s
        );
        errors.push(doc.error("search.total_s", what));
    }
    for (key, name, limit) in watched(&settings.watch, &search.limits) {
        let Some(limit) = limit else { continue };
        let at = format!("search.limits.{key}");
        if limit <= 0.0 || !limit.is_finite() {
            errors.push(doc.error(&at, format!("a limit is a positive number, not {limit}")));
        }
        if name.is_none() {
            let help = format!("name the true signal: [watch] {key} = \"...\"");
            errors.push(doc.error(&at, "nothing is watched under this name").help(help));
        }
    }
    errors
}

/// An estimate with the columns and signals that its models ask for.
pub fn estimate(
    (doc, columns, channels): (&Doc, &Columns, &Channels),
    name: &str,
    settings: &Estimate,
    (model, derive): (Model, Option<Model>),
    errors: &mut Errors,
) -> Prepared {
    let key = format!("estimate.{name}");
    for (i, held) in settings.held.iter().enumerate() {
        columns.look_up(held, "signal", doc, &format!("{key}.held.{i}"), errors);
    }
    let none = IndexMap::new();
    let mut derived_from = Vec::new();
    let mut columns = columns.clone();
    if let Some(derive) = &derive {
        let at = format!("{key}.derive");
        if !derive.states.is_empty() {
            let help = "only a model without states can be evaluated sample by sample";
            errors.push(doc.error(&at, "the model of `derive` has states").help(help));
        }
        derived_from = drivers(derive, &none, &columns, doc, &at, errors);
        columns = columns.with_derived(Some(derive));
    }
    let at = format!("{key}.model");
    let inputs = drivers(&model, &none, &columns, doc, &at, errors);
    let mut scored = Vec::new();
    for (i, output) in model.outputs.iter().enumerate() {
        if !channels.map.signal.contains_key(&output.name) {
            continue;
        }
        let unit = channels.unit(&output.name);
        if !agree(&unit, &output.unit) {
            let what = format!(
                "output \"{}\" of the model is in {}, the signal of this name in {unit}",
                output.name, output.unit
            );
            errors.push(doc.error(&at, what));
        }
        scored.push((i, output.name.clone()));
    }
    if scored.is_empty() {
        let help = "the outputs that are signals of the channel map, by name, are scored";
        errors.push(doc.error(&at, "no output of the model is measured").help(help));
    } else if let Err(found) = estimate::estimate_segments(&model, &[], &settings.method) {
        // An estimate over nothing tells what is wrong with the names of its method.
        let at = format!("{key}.method");
        errors.0.extend(found.0.into_iter().map(|e| {
            let here = doc.error(&at, e.what);
            if let Some(help) = e.help { here.help(help) } else { here }
        }));
    }
    let (name, settings) = (name.to_string(), settings.clone());
    Prepared { name, settings, model, derive, inputs, derived_from, scored }
}
