//! The verb status: a pipeline file comes in; what a run would do and why goes out, in lines or as
//! JSON.

use super::args::{Form, PipelineArgs};
use super::run::out_folder;
use super::summary::count;
use super::words::{End, document, say, warn};
use crate::error::Errors;
use crate::pipeline::{self, Assessment, Limits, Plan, Source, State, Store};
use serde::Serialize;

/// What a run would do.
#[derive(Serialize)]
struct Answer {
    /// How many units of work it would do.
    to_run: usize,
    /// How many more at most: those that read what it would make, where that comes out as another.
    may_run: usize,
    /// Flights whose logs would be simulated.
    to_simulate: Vec<String>,
    /// The pipelines whose results are taken.
    taken: Vec<Taken>,
    units: Vec<UnitState>,
    /// Units that are no longer part of the campaign: what they made would be removed.
    gone: Vec<Gone>,
    /// What is not asked for, in words.
    left_out: Vec<String>,
}

#[derive(Serialize)]
struct Taken {
    pipeline: String,
    /// Values that it does not have.
    lacking: Vec<String>,
    /// How many units of it would be run first, at most.
    to_run: usize,
}

#[derive(Serialize)]
struct UnitState {
    stage: &'static str,
    unit: String,
    /// `fresh`, `stale`, `missing` or `blocked`.
    state: &'static str,
    reasons: Vec<String>,
}

#[derive(Serialize)]
struct Gone {
    stage: String,
    unit: String,
}

/// `koehler status` and `koehler run --dry-run`
pub fn status(args: &PipelineArgs, limits: &Limits, form: Form) -> Result<End, Errors> {
    let store = Store::look(&out_folder(args))?;
    let plan = Plan::read_with(&args.pipeline, |settings| settings.keep(&store))?;
    limits.check(&plan)?;
    let answer = answer(&plan, &store, limits)?;
    match form.json {
        true => document(&answer)?,
        false => lines(&answer),
    }
    Ok(End::Complete)
}

fn answer(plan: &Plan, store: &Store, limits: &Limits) -> Result<Answer, Errors> {
    let simulation = plan.simulation.as_ref();
    if let Some(warning) = simulation.and_then(super::simulate::outdated) {
        warn(&warning);
    }
    let missing = simulation.map(|s| s.missing.clone()).unwrap_or_default();
    let taken: Vec<Taken> = plan.sources.iter().map(taken).collect::<Result<_, Errors>>()?;
    let states = pipeline::status_within(plan, store, limits)?;
    let gone = pipeline::gone(plan, store).into_iter();
    let flights = &plan.campaign.flights;
    let of_all =
        |count: fn(&[Assessment]) -> usize| states.iter().map(|(_, all)| count(all)).sum::<usize>();
    Ok(Answer {
        to_run: taken.iter().filter(|taken| taken.to_run > 0).count() + of_all(to_run),
        may_run: of_all(may_run),
        to_simulate: missing.into_iter().filter(|flight| limits.has(flight)).collect(),
        taken,
        units: states
            .iter()
            .flat_map(|(stage, all)| all.iter().map(|a| state(stage.name, a, flights)))
            .collect(),
        gone: gone
            .map(|record| Gone { stage: record.stage.clone(), unit: record.unit.clone() })
            .collect(),
        left_out: limits.words(plan),
    })
}

/// What a pipeline whose results are taken lacks, and what of it a run would make first.
fn taken(source: &Source) -> Result<Taken, Errors> {
    let store = Store::look(&pipeline::out_folder(&source.pipeline))?;
    let plan = Plan::read_with(&source.pipeline, |settings| settings.keep(&store))?;
    let states = pipeline::status(&plan, &store)?;
    Ok(Taken {
        pipeline: source.pipeline.display().to_string(),
        lacking: source.lacking.0.iter().map(|e| e.what.clone()).collect(),
        to_run: states.iter().map(|(_, all)| to_run(all) + may_run(all)).sum(),
    })
}

fn to_run(all: &[Assessment]) -> usize {
    let is_run =
        |a: &&Assessment| matches!(a.state, State::New | State::Stale(_) | State::Failed(_));
    all.iter().filter(is_run).count()
}

/// How many are run if what they read comes out as another.
fn may_run(all: &[Assessment]) -> usize {
    all.iter().filter(|a| matches!(a.state, State::Waits(_))).count()
}

fn state(stage: &'static str, a: &Assessment, flights: &[String]) -> UnitState {
    let (state, reasons) = match &a.state {
        State::Fresh => ("fresh", Vec::new()),
        State::New => ("missing", vec!["never run".to_string()]),
        State::Stale(reasons) => ("stale", pipeline::causes(reasons, flights)),
        State::Waits(reasons) => ("stale", reasons.clone()),
        State::Failed(why) => ("stale", vec![why.clone()]),
        State::Blocked(what) => ("blocked", vec![what.clone()]),
    };
    UnitState { stage, unit: a.unit.name.clone(), state, reasons }
}

fn lines(answer: &Answer) {
    for flight in &answer.to_simulate {
        say(&format!("{:<12} {flight:<20} missing: would be simulated", "log"));
    }
    answer.taken.iter().for_each(taken_lines);
    for UnitState { stage, unit, state, reasons } in &answer.units {
        if reasons.is_empty() {
            say(&format!("{stage:<12} {unit:<20} {state}"));
        }
        for why in reasons {
            say(&format!("{stage:<12} {unit:<20} {state}: {why}"));
        }
    }
    for Gone { stage, unit } in &answer.gone {
        say(&format!(
            "{stage:<12} {unit:<20} no longer part of the campaign: its outputs would be removed"
        ));
    }
    answer.left_out.iter().for_each(|words| say(words));
    let is_fresh = answer.gone.is_empty() && answer.left_out.is_empty();
    say(&match (answer.to_run, answer.may_run) {
        (0, 0) if is_fresh => "everything is fresh: a run would do nothing".to_string(),
        (n, more) => format!("a run would do {} of work{}", count(n, "unit"), at_most(more)),
    });
}

fn at_most(more: usize) -> String {
    match more {
        0 => String::new(),
        n => format!(", and up to {n} more where what they read comes out as another"),
    }
}

fn taken_lines(taken: &Taken) {
    let (name, aircraft) = (&taken.pipeline, "aircraft");
    taken.lacking.iter().for_each(|what| say(&format!("{aircraft:<12} {what}")));
    if taken.to_run > 0 {
        let units = count(taken.to_run, "unit");
        say(&format!(
            "{aircraft:<12} {name}: stale: a run would make it first, {units} of work, and what its values change after it"
        ));
    } else if taken.lacking.is_empty() {
        say(&format!("{aircraft:<12} {name}: fresh"));
    }
}
