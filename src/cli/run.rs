//! The verbs run, status and check: a pipeline file comes in, tables or words about them go out.

use super::args::{PipelineArgs, RunArgs};
use super::progress::Bars;
use super::summary;
use super::words::{End, on_threads, print_errors, say};
use crate::config;
use crate::engine::Engine;
use crate::error::Errors;
use crate::pipeline::{self, Assessment, Plan, Source, State, Store, Summaries};
use crate::stage::Unit;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// `koehler check`
pub fn check(pipeline: &Path) -> Result<End, Errors> {
    let plan = Plan::read(pipeline)?;
    let seen = pipeline::summaries(&plan);
    said(&seen);
    for source in &plan.sources {
        source.lacking.0.iter().for_each(|e| eprintln!("note: {}; a run makes it first", e.what));
    }
    let mut errors = seen.mistakes;
    errors.0.extend(seen.unreadable.0);
    errors.or(())?;
    let campaign = &plan.campaign;
    let mut there = vec![
        summary::count(campaign.flights.len(), "flight"),
        summary::count(campaign.estimates.len(), "estimate"),
        summary::count(campaign.fits.len(), "fit"),
    ];
    // The lists of stages that have a key of their own.
    for stage in campaign.stages.iter().filter(|stage| stage.key.is_some()) {
        let units = (stage.units)(campaign);
        let listed = units.first().is_some_and(|unit| *unit != Unit::campaign()[0]);
        if listed {
            there.push(format!("{} [[{}]]", units.len(), stage.name));
        }
    }
    say(&format!("{}: no mistakes found; {}", pipeline.display(), there.join(", ")));
    let later = plan.logs.len() - seen.looked_at - seen.without.len();
    let later =
        if later > 0 { format!("; {later} more to be simulated first") } else { String::new() };
    say(&format!(
        "topics, fields and units of the channel map are those of {}{later}",
        summary::count(seen.looked_at, "log")
    ));
    Ok(End::Complete)
}

/// Says what is no mistake of the configuration: units that cannot be compared, logs without a
/// summary.
fn said(seen: &Summaries) {
    seen.remarks.iter().for_each(|remark| eprintln!("note: {remark}"));
    if !seen.without.is_empty() {
        eprintln!(
            "note: not checked before they are read, because they have no summary section at their end (cut off, or their recorder \
             writes none): {}",
            config::list(&seen.without)
        );
    }
}

/// Holds the channel map against all logs before work starts. Where no log fits, that is a mistake
/// of the configuration; where some do, the others are named, and their flights will have no
/// results.
///
/// # Errors
/// No log fits: every mistake.
pub(super) fn look_at_logs(plan: &Plan) -> Result<(), Errors> {
    let seen = pipeline::summaries(plan);
    said(&seen);
    if seen.hopeless() {
        return Err(seen.mistakes);
    }
    seen.mistakes
        .0
        .iter()
        .for_each(|mistake| eprintln!("warning: no results of this flight: {mistake}"));
    Ok(())
}

/// `koehler run`
pub fn run(args: &RunArgs, engine: &dyn Engine) -> Result<End, Errors> {
    let begin = Instant::now();
    let out = out_folder(&args.files);
    let store = Store::claim(&out, args.force)?;
    let read = || Plan::read_with(&args.files.pipeline, |settings| settings.keep(&store));
    let (plan, end) = planned(read, args.jobs, engine)?;
    let _lock = store.lock()?;
    let bars = Bars::new();
    let result = on_threads(args.jobs, || -> Result<_, Errors> {
        if let Some(simulation) = &plan.simulation {
            super::simulate::make(simulation)?;
        }
        look_at_logs(&plan)?;
        Ok(pipeline::run(&plan, &store, engine, &|event| bars.hear(event))?)
    })??;
    print_errors(&result.errors);
    if result.nothing_done() {
        let seconds = begin.elapsed().as_secs_f64();
        say(&format!("nothing to do: every stage is fresh ({seconds:.2} s)"));
    }
    summary::print(&plan, &store, &out, (&result, &bars.seconds()))?;
    Ok(if result.complete() { end } else { End::Partial.max(end) })
}

/// `koehler status` and `koehler run --dry-run`
pub fn status(args: &PipelineArgs) -> Result<End, Errors> {
    let store = Store::open(&out_folder(args));
    let plan = Plan::read_with(&args.pipeline, |settings| settings.keep(&store))?;
    if let Some(simulation) = &plan.simulation {
        for flight in &simulation.missing {
            say(&format!("{:<12} {:<20} missing: would be simulated", "log", flight));
        }
        if let Some(warning) = super::simulate::outdated(simulation) {
            eprintln!("warning: {warning}");
        }
    }
    let mut to_run = 0;
    for source in &plan.sources {
        to_run += usize::from(tell_source(source)?);
    }
    for (stage, assessments) in pipeline::status(&plan, &store)? {
        for a in &assessments {
            to_run += usize::from(!matches!(a.state, State::Fresh | State::Blocked(_)));
            for line in lines(stage.name, a) {
                say(&line);
            }
        }
    }
    let gone = pipeline::gone(&plan, &store);
    for record in &gone {
        say(&format!(
            "{:<12} {:<20} no longer part of the campaign: its outputs would be removed",
            record.stage, record.unit
        ));
    }
    say(&match (to_run, gone.len()) {
        (0, 0) => "everything is fresh: a run would do nothing".to_string(),
        (1, _) => "a run would do 1 unit of work".to_string(),
        (n, _) => format!("a run would do {n} units of work"),
    });
    Ok(End::Complete)
}

/// Says of a pipeline whose results are taken whether a run would make it first, and why.
fn tell_source(source: &Source) -> Result<bool, Errors> {
    let store = Store::open(&pipeline::out_folder(&source.pipeline));
    let plan = Plan::read_with(&source.pipeline, |settings| settings.keep(&store))?;
    let mut to_run = 0;
    for (_, assessments) in pipeline::status(&plan, &store)? {
        let fresh = |a: &&Assessment| matches!(a.state, State::Fresh | State::Blocked(_));
        to_run += assessments.len() - assessments.iter().filter(fresh).count();
    }
    let name = source.pipeline.display();
    source.lacking.0.iter().for_each(|e| say(&format!("{:<12} {}", "aircraft", e.what)));
    if to_run > 0 {
        let units = summary::count(to_run, "unit");
        say(&format!(
            "{:<12} {name}: stale: a run would make it first, {units} of work, and what its values change after it",
            "aircraft"
        ));
    } else if source.lacking.is_empty() {
        say(&format!("{:<12} {name}: fresh", "aircraft"));
    }
    Ok(to_run > 0)
}

/// One line per reason.
fn lines(stage: &str, a: &Assessment) -> Vec<String> {
    let line = |word: &str, why: &str| format!("{stage:<12} {:<20} {word}{why}", a.unit.name);
    let all = |word: &str, reasons: &[String]| {
        reasons.iter().map(|why| line(word, &format!(": {why}"))).collect()
    };
    match &a.state {
        State::Fresh => vec![line("fresh", "")],
        State::New => vec![line("missing", ": never run")],
        State::Stale(reasons) => all("stale", reasons),
        State::Waits(reasons) => all("stale", reasons),
        State::Blocked(what) => vec![line("blocked", &format!(": {what}"))],
    }
}

/// Where the results go.
pub(super) fn out_folder(args: &PipelineArgs) -> PathBuf {
    args.out.clone().unwrap_or_else(|| pipeline::out_folder(&args.pipeline))
}

/// Reads a plan; where it takes results of other pipelines, these are run first and it is read again
/// with what they have found. How they ended is handed on.
///
/// # Errors
/// Mistakes in any file; a value that the other pipelines do not have although they were run.
pub(super) fn planned(
    read: impl Fn() -> Result<Plan, Errors>,
    jobs: Option<usize>,
    engine: &dyn Engine,
) -> Result<(Plan, End), Errors> {
    let plan = read()?;
    let mut end = End::Complete;
    if plan.sources.is_empty() {
        return Ok((plan, end));
    }
    for source in &plan.sources {
        say(&format!("{}: its results are taken", source.pipeline.display()));
        let files = PipelineArgs { pipeline: source.pipeline.clone(), out: None };
        let args = RunArgs { files, jobs, engine: None, dry_run: false, force: false };
        end = end.max(run(&args, engine)?);
        say("");
    }
    let plan = read()?;
    pipeline::lacking(&plan.sources).or(())?;
    Ok((plan, end))
}
