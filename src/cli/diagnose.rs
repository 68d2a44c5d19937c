//! The verb diagnose: a pipeline file comes in; what its models lack goes out, in words, as tables,
//! and as the exit code.

use super::args::DiagnoseArgs;
use super::progress::Bars;
use super::run::{Work, out_folder, planned};
use super::words::{End, print_errors, say, tell};
use super::{summary, verdict};
use crate::diagnose::Base;
use crate::engine::Engine;
use crate::error::{Error, Errors, Result};
use crate::pipeline::{Limits, Plan, Settings, Store};
use crate::stage::{Note, diagnose};
use crate::table::Table;
use std::time::Instant;

/// The stages of a diagnosis, whose warnings are printed.
const OWN: [&str; 2] = [diagnose::STAGE.name, crate::stage::rerun::STAGE.name];

/// `koehler diagnose`
pub fn diagnose(args: &DiagnoseArgs, engine: &dyn Engine) -> std::result::Result<End, Errors> {
    let begin = Instant::now();
    let out = out_folder(&args.files);
    let store = Store::claim(&out, args.force)?;
    let read = || Plan::read_with(&args.files.pipeline, |settings| ask(settings, args, &store));
    let (plan, mut end) = planned(read, args.jobs, engine)?;
    if diagnose::all(&plan.campaign).is_empty() {
        return Err(Error::new(
            "the pipeline file has no [[estimate]], so there is no model to diagnose",
        )
        .into());
    }
    let _lock = store.lock()?;
    let work = Work {
        command: "diagnose",
        begin,
        plan: &plan,
        store: &store,
        engine,
        limits: &Limits::default(),
        jobs: args.jobs,
    };
    let result = work.done(&Bars::new())?;
    print_errors(&result.errors);
    result.removed.iter().for_each(|unit| tell(&format!("removed: {unit}")));
    // Of what a diagnosis stands on only what makes the exit code 1 is named.
    let (own, before): (Vec<Note>, Vec<Note>) =
        result.notes.iter().cloned().partition(|note| OWN.contains(&note.stage.as_str()));
    summary::failing(&before);
    summary::notes(&own);
    end = if result.complete() { end } else { End::Partial.max(end) };
    for (i, diagnosis) in
        diagnose::all(&plan.campaign).iter().enumerate().filter(|(_, d)| !d.settings.idle)
    {
        let Some(findings) = verdict::part(&store, "findings", i)? else {
            end = End::Partial;
            continue;
        };
        told(&diagnosis.name(), &findings)?;
        let again = plan.campaign.estimates.len() + i;
        let next = diagnosis.settings.next();
        let file = format!("models/{next}.model.toml");
        if result.files.contains(&file) {
            say(&format!("  next model: {}", out.join(file).display()));
        }
        if let Some(estimates) = verdict::part(&store, "estimates", again)? {
            say(&format!("  {}", verdict::again(&next, &estimates)?));
        }
        verdict::of(&store, &plan, i)?.into_iter().flatten().for_each(|line| say(&line));
        end = if end == End::Partial { end } else { verdict::end(&findings)?.max(end) };
    }
    let report = "report/index.html";
    if result.files.iter().any(|file| file == report) {
        tell(&format!("\nreport: {}", out.join(report).display()));
    }
    tell(&format!("tables: {}", out.display()));
    Ok(end)
}

/// The diagnoses that the command asks for: of the estimates it names, else those of the pipeline
/// file, else one per estimate. All others that there are, in the pipeline file or from an earlier
/// command, are left as they are.
fn ask(settings: &mut Settings, args: &DiagnoseArgs, store: &Store) {
    let name = diagnose::STAGE.name;
    let Some(said) = settings.read::<Vec<diagnose::Settings>>(name) else { return };
    let wanted: Vec<String> = match (args.estimate.is_empty(), said.is_empty()) {
        (false, _) => args.estimate.clone(),
        (true, true) => {
            settings.estimate.iter().map(crate::stage::estimate::Settings::name).collect()
        }
        (true, false) => said.iter().map(|d| d.estimate.clone()).collect(),
    };
    settings.keep(store);
    let Some(mut all) = settings.read::<Vec<diagnose::Settings>>(name) else { return };
    // What the pipeline file leaves to this command is asked for as it says.
    all.retain(|d| d.run);
    for name in &wanted {
        let left = said.iter().filter(|d| !d.run && d.estimate == *name);
        let mut fresh: Vec<diagnose::Settings> =
            left.map(|d| diagnose::Settings { asked: true, ..d.plain() }).collect();
        if fresh.is_empty() {
            fresh.push(diagnose::Settings::of(name));
        }
        let said = all.iter().any(|d| !d.asked && d.estimate == *name);
        for fresh in fresh {
            match all.iter_mut().find(|d| d.asked && d.name() == fresh.name()) {
                Some(earlier) => *earlier = fresh,
                None if said => {}
                None => all.push(fresh),
            }
        }
    }
    for d in &mut all {
        d.idle = !wanted.contains(&d.estimate);
        if !d.idle {
            d.effects.extend(args.effects.iter().cloned());
            d.method.base = if args.predicted { Base::Predicted } else { d.method.base };
        }
    }
    settings.write(name, &all);
}

/// Prints the findings of one diagnosis.
fn told(name: &str, findings: &Table) -> Result<()> {
    let texts = findings.strings("text")?;
    let (candidates, roles) = (findings.opt_strings("candidate")?, findings.opt_strings("role")?);
    say(&format!("\n{name}"));
    for ((text, candidate), role) in texts.iter().zip(candidates).zip(roles) {
        let or = if role == Some("alike") { "  or " } else { "" };
        match candidate {
            Some(candidate) => say(&format!("  {or}{candidate}: {text}")),
            None => say(&format!("  {text}")),
        }
    }
    let held_out = findings.strings("held_out")?;
    held_out.first().into_iter().for_each(|words| say(&format!("  held out: {words}")));
    Ok(())
}
