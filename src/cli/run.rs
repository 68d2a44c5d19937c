//! The verbs run, status and check: a pipeline file comes in, tables or words about them go out.

use super::args::{PipelineArgs, RunArgs};
use super::progress::Bars;
use super::summary;
use super::words::{End, on_threads, print_errors, say};
use crate::config;
use crate::engine::Engine;
use crate::error::Errors;
use crate::pipeline::{self, Assessment, Plan, State, Store, Summaries};
use crate::stage::Unit;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// `koehler check`
pub fn check(pipeline: &Path) -> Result<End, Errors> {
    let plan = Plan::read(pipeline)?;
    let seen = pipeline::summaries(&plan);
    said(&seen);
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
    let store = Store::open(&out);
    let plan = Plan::read_with(&args.files.pipeline, |settings| settings.keep(&store))?;
    let _lock = store.lock()?;
    let bars = Bars::new();
    let result = on_threads(args.jobs, || -> Result<_, Errors> {
        if let Some(simulation) = &plan.simulation {
            super::simulate::make(simulation, false)?;
        }
        look_at_logs(&plan)?;
        Ok(pipeline::run(&plan, &store, engine, &|event| bars.hear(event))?)
    })??;
    print_errors(&result.errors);
    if result.nothing_done() {
        let seconds = begin.elapsed().as_secs_f64();
        say(&format!("nothing to do: every stage is fresh ({seconds:.2} s)"));
    }
    summary::print(&plan, &store, &out, &result)?;
    Ok(if result.complete() { End::Complete } else { End::Partial })
}

/// `koehler status` and `koehler run --dry-run`
pub fn status(args: &PipelineArgs) -> Result<End, Errors> {
    let store = Store::open(&out_folder(args));
    let plan = Plan::read_with(&args.pipeline, |settings| settings.keep(&store))?;
    if let Some(simulation) = &plan.simulation {
        for flight in &simulation.missing {
            say(&format!("{:<12} {:<20} missing: would be simulated", "log", flight));
        }
    }
    let mut to_run = 0;
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

/// `out/` beside `pipeline.toml`; pipelines of other names beside it keep their results apart, in
/// `out/<name>/`.
pub(super) fn out_folder(args: &PipelineArgs) -> PathBuf {
    let out = args.pipeline.parent().unwrap_or_else(|| Path::new("")).join("out");
    let name = args.pipeline.file_stem().filter(|name| *name != "pipeline");
    args.out.clone().unwrap_or_else(|| name.map_or_else(|| out.clone(), |name| out.join(name)))
}
