//! The verbs run and check: a pipeline file comes in, tables or words about them go out.

use super::args::{Form, PipelineArgs, RunArgs};
use super::progress::Bars;
use super::ran::Ran;
use super::summary;
use super::words::{End, Volume, document, note, on_threads, print_errors, say, tell, warn};
use crate::config;
use crate::engine::Engine;
use crate::error::{Error, Errors};
use crate::pipeline::{self, Event, Journal, Limits, Plan, RunResult, Store, Summaries};
use crate::stage::Unit;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a check has counted.
#[derive(Serialize)]
struct Checked {
    /// None here: where there are mistakes, they are the answer.
    errors: [(); 0],
    flights: usize,
    estimates: usize,
    fits: usize,
    /// How many entries the lists of stages have that have a key of their own.
    lists: BTreeMap<&'static str, usize>,
    logs_looked_at: usize,
    logs_to_simulate: usize,
    /// Names of logs about which nothing is known before they are read.
    logs_without_summary: Vec<String>,
    remarks: Vec<Error>,
    exit_code: u8,
}

/// `koehler check`
pub fn check(pipeline: &Path, jobs: Option<usize>, form: Form) -> Result<End, Errors> {
    let plan = Plan::read(pipeline)?;
    let seen = on_threads(jobs, || plan.summaries())?;
    said(&seen);
    for source in &plan.sources {
        source.lacking.0.iter().for_each(|e| note(&format!("{}; a run makes it first", e.what)));
    }
    let mut errors = plan.missing();
    errors.0.extend(seen.mistakes.0.iter().cloned());
    errors.0.extend(seen.unreadable.0.iter().cloned());
    errors.or(())?;
    let checked = checked(&plan, seen);
    match form.json {
        true => document(&checked)?,
        false => counted(pipeline, &checked),
    }
    Ok(End::Complete)
}

fn checked(plan: &Plan, seen: Summaries) -> Checked {
    let campaign = &plan.campaign;
    let with_key = campaign.stages.iter().filter(|stage| stage.key.is_some());
    let listed = with_key.map(|stage| (stage.name, (stage.units)(campaign)));
    // Units of flights are no entries of a list, nor is the campaign.
    let is_list = |(_, units): &(&str, Vec<Unit>)| {
        units.first().is_some_and(|unit| {
            unit.part.number().is_some() && Some(unit) != Unit::campaign().first()
        })
    };
    Checked {
        errors: [],
        flights: campaign.flights.len(),
        estimates: campaign.estimates.len(),
        fits: campaign.fits.len(),
        lists: listed.filter(is_list).map(|(name, units)| (name, units.len())).collect(),
        logs_looked_at: seen.looked_at,
        logs_to_simulate: plan.logs.len() - seen.looked_at - seen.without.len(),
        logs_without_summary: seen.without,
        remarks: seen.remarks,
        exit_code: End::Complete.code(),
    }
}

fn counted(pipeline: &Path, checked: &Checked) {
    let mut there = vec![
        summary::count(checked.flights, "flight"),
        summary::count(checked.estimates, "estimate"),
        summary::count(checked.fits, "fit"),
    ];
    there.extend(checked.lists.iter().map(|(name, n)| format!("{n} [[{name}]]")));
    say(&format!("{}: no mistakes found; {}", pipeline.display(), there.join(", ")));
    let later = match checked.logs_to_simulate {
        0 => String::new(),
        n => format!("; {n} more to be simulated first"),
    };
    say(&format!(
        "topics, fields and units of the channel map are those of {}{later}",
        summary::count(checked.logs_looked_at, "log")
    ));
}

/// Says what is no mistake of the configuration: units that cannot be compared, logs without a
/// summary.
fn said(seen: &Summaries) {
    seen.remarks.iter().for_each(|remark| note(&remark.to_string()));
    if !seen.without.is_empty() {
        note(&format!(
            "not checked before they are read, because they have no sound summary section at their end (cut off, or their recorder \
             writes none): {}",
            config::list(&seen.without)
        ));
    }
}

/// Holds the channel map against all logs before work starts. Where no log fits, that is a mistake
/// of the configuration; where some do, the others are named, and their flights will have no
/// results.
///
/// # Errors
/// No log fits: every mistake.
fn look_at_logs(plan: &Plan) -> Result<(), Errors> {
    let seen = plan.summaries();
    said(&seen);
    if seen.hopeless() {
        return Err(seen.mistakes);
    }
    seen.mistakes
        .0
        .iter()
        .for_each(|mistake| warn(&format!("no results of this flight: {mistake}")));
    Ok(())
}

/// `koehler run`
pub fn run(args: &RunArgs, engine: &dyn Engine) -> Result<End, Errors> {
    let begin = Instant::now();
    let limits = args.limits();
    let out = out_folder(&args.files);
    let store = Store::claim(&out, args.force)?;
    let read = || {
        let plan = Plan::read_with(&args.files.pipeline, |settings| settings.keep(&store))?;
        limits.check(&plan)?;
        Ok(plan)
    };
    let (mut plan, end) = planned(read, args.jobs, engine)?;
    let _lock = store.lock()?;
    let bars = Bars::new();
    let left_out = limits.words(&plan);
    let flights = limits.flights(&plan);
    plan.simulation = plan.simulation.take().and_then(|s| s.for_flights(&flights));
    let work = Work {
        command: "run",
        begin,
        plan: &plan,
        store: &store,
        engine,
        limits: &limits,
        jobs: args.jobs,
    };
    let result = work.done(&bars)?;
    print_errors(&result.errors);
    let end = if result.complete() { end } else { End::Partial.max(end) };
    let ran = Ran { result: &result, seconds: &bars.seconds(), left_out: &left_out };
    if args.form.json {
        document(&ran.answer(&out, end))?;
        return Ok(end);
    }
    if result.nothing_done() {
        let fresh = if left_out.is_empty() { "every stage" } else { "what is asked for" };
        let seconds = begin.elapsed().as_secs_f64();
        tell(&format!("nothing to do: {fresh} is fresh ({seconds:.2} s)"));
    }
    if Volume::Usual.is_heard() {
        summary::print(&plan, &store, &out, &ran)?;
    } else if !Volume::Document.is_heard() {
        summary::notes(&result.notes);
    }
    Ok(end)
}

/// What a command runs, and how.
pub(super) struct Work<'a> {
    pub command: &'static str,
    /// When the command began.
    pub begin: Instant,
    pub plan: &'a Plan,
    pub store: &'a Store,
    pub engine: &'a dyn Engine,
    pub limits: &'a Limits,
    pub jobs: Option<usize>,
}

impl Work<'_> {
    /// Makes the logs that are missing and runs what is not fresh, watched by the bars and by the
    /// journal of the run, which ends however the run does.
    ///
    /// # Errors
    /// No log fits; the output folder cannot be read or written.
    pub fn done(&self, bars: &Bars) -> Result<RunResult, Errors> {
        let words = format!("{} of {}", self.command, self.plan.pipeline.display());
        let journal = Journal::begin(self.store, &words, self.begin);
        let hear = |event: Event| {
            journal.hear(&event);
            bars.hear(event);
        };
        let result = on_threads(self.jobs, || {
            if let Some(simulation) = &self.plan.simulation {
                journal.timed("simulate", || super::simulate::make(simulation))?;
            }
            journal.timed("look at the logs", || look_at_logs(self.plan))?;
            Ok(pipeline::run(self.plan, self.store, self.engine, &hear, self.limits)?)
        });
        let result = result.flatten();
        let lost = journal.end(result.as_ref().map(RunResult::complete));
        lost.iter().for_each(|e| warn(&format!("this run keeps no whole log of its times: {e}")));
        result
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
        tell(&format!("{}: its results are taken", source.pipeline.display()));
        let files = PipelineArgs { pipeline: source.pipeline.clone(), out: None };
        end = end.max(run(&RunArgs::of(files, jobs), engine)?);
        tell("");
    }
    let plan = read()?;
    pipeline::lacking(&plan.sources).or(())?;
    Ok((plan, end))
}
