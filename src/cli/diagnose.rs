//! The verb diagnose: a pipeline file comes in; what its models lack goes out, in words, as tables, and as the exit code.

use super::progress::Bars;
use super::run::out_folder;
use super::{DiagnoseArgs, End, on_threads, print_errors, say};
use crate::diagnose::Base;
use crate::error::{Error, Errors, Result};
use crate::pipeline::{self, Plan, Settings, Store};
use crate::stage::{Part, diagnose};
use std::collections::BTreeMap;

/// `koehler diagnose`
pub fn diagnose(args: &DiagnoseArgs) -> std::result::Result<End, Errors> {
    let out = out_folder(&args.files);
    let store = Store::open(&out);
    let plan = Plan::read_with(&args.files.pipeline, |settings| ask(settings, args, &store))?;
    if plan.campaign.diagnoses.is_empty() {
        return Err(Error::new("the pipeline file has no [[estimate]], so there is no model to diagnose").into());
    }
    let _lock = store.lock()?;
    let bars = Bars::new();
    let result = on_threads(args.jobs, || -> std::result::Result<_, Errors> {
        if let Some(simulation) = &plan.simulation {
            super::simulate::make(simulation, false)?;
        }
        Ok(pipeline::run(&plan, &store, &|event| bars.hear(event))?)
    })??;
    print_errors(&result.errors);
    result.removed.iter().for_each(|unit| say(&format!("removed: {unit}")));
    let mut end = if result.complete() { End::Complete } else { End::Partial };
    for (i, diagnosis) in plan.campaign.diagnoses.iter().enumerate().filter(|(_, d)| !d.settings.idle) {
        let found = told(&store, &diagnosis.name(), i)?;
        end = if end == End::Partial { end } else { found.max(end) };
        let next = diagnosis.settings.next();
        let file = format!("models/{next}.model.toml");
        if result.files.contains(&file) {
            say(&format!("next model: {}", out.join(file).display()));
        }
        let again = Part::Number(plan.campaign.estimates.len() + i).path("estimates");
        if result.files.contains(&again) {
            say(&format!("estimated with it: {next}, in the tables of estimates and in the report"));
        }
        to_use(&store, i, plan.campaign.estimates.len() + i)?.iter().for_each(|words| say(&format!("use: {words}")));
    }
    let report = "report/index.html";
    if result.files.iter().any(|file| file == report) {
        say(&format!("\nreport: {}", out.join(report).display()));
    }
    say(&format!("tables: {}", out.display()));
    Ok(end)
}

/// The diagnoses that the command asks for: of the estimates it names, else those of the pipeline file, else one per estimate. All others
/// that there are, in the pipeline file or from an earlier command, are left as they are.
fn ask(settings: &mut Settings, args: &DiagnoseArgs, store: &Store) {
    let wanted: Vec<String> = match (args.estimate.is_empty(), settings.diagnose.is_empty()) {
        (false, _) => args.estimate.clone(),
        (true, true) => settings.estimate.iter().map(crate::stage::estimate::Settings::name).collect(),
        (true, false) => settings.diagnose.iter().map(|d| d.estimate.clone()).collect(),
    };
    settings.keep(store);
    for name in &wanted {
        let fresh = diagnose::Settings::of(name);
        match settings.diagnose.iter_mut().find(|d| d.estimate == *name) {
            Some(earlier) if earlier.asked => *earlier = fresh,
            Some(_) => {}
            None => settings.diagnose.push(fresh),
        }
    }
    for d in &mut settings.diagnose {
        d.idle = !wanted.contains(&d.estimate);
        if !d.idle {
            d.effects.extend(args.effects.iter().cloned());
            d.method.base = if args.predicted { Base::Predicted } else { d.method.base };
        }
    }
}

/// The parameters that a diagnosis added, each with the one value to use: `again` is the part of the estimate with the amended model.
fn to_use(store: &Store, index: usize, again: usize) -> Result<Vec<String>> {
    let mut tables = BTreeMap::new();
    for (name, part) in [("findings", index), ("additions", index), ("next_models", index), ("estimates", again)] {
        let part = Part::Number(part);
        if store.path(&part.path(name)).exists() {
            tables.insert(name.to_string(), store.table(name, &part)?);
        }
    }
    // A terminal need not have the sign that the page has.
    Ok(crate::report::values_to_use(&tables).into_iter().map(|words| words.replace('±', "+-")).collect())
}

/// Prints the findings of one diagnosis.
fn told(store: &Store, name: &str, index: usize) -> Result<End> {
    let part = Part::Number(index);
    if !store.path(&part.path("findings")).exists() {
        return Ok(End::Partial);
    }
    let table = store.table("findings", &part)?;
    let (verdicts, texts) = (table.strings("verdict")?, table.strings("text")?);
    let (candidates, roles) = (table.opt_strings("candidate")?, table.opt_strings("role")?);
    let verdict = verdicts.first().copied().unwrap_or_default();
    say(&format!("\n{name}: {}", verdict.to_uppercase()));
    for ((text, candidate), role) in texts.iter().zip(candidates).zip(roles) {
        let or = if role == Some("alike") { "  or " } else { "" };
        match candidate {
            Some(candidate) => say(&format!("  {or}{candidate}: {text}")),
            None => say(&format!("  {text}")),
        }
    }
    let held_out = table.strings("held_out")?;
    held_out.first().into_iter().for_each(|words| say(&format!("  held out: {words}")));
    Ok(if verdict == "nothing missing" { End::Complete } else { End::Found })
}
