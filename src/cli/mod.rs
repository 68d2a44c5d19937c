//! The command line: arguments come in; verbs do the work; the exit code goes out.

mod allocator;
mod args;
pub mod cluster;
mod design;
mod diagnose;
mod diff;
mod flights;
mod lacking;
mod left;
mod lineage;
mod machines;
mod progress;
mod provenance;
mod ran;
mod run;
mod schema;
mod simulate;
mod sql;
mod status;
mod summary;
mod text;
mod verdict;
mod words;

use crate::engine::{Engine, Threads};
use crate::error::Errors;
use crate::log;
use crate::pipeline::Limits;
use args::{Cli, Form, PipelineArgs, Verb};
use clap::Parser;
use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use words::{End, document, note, print_errors, shown, tell};

/// The exit code where nothing could be done.
const FAILED: u8 = 2;

/// Runs the command of this process, with threads.
pub fn main() -> ExitCode {
    main_with(&[("threads", &Threads)], std::env::args_os())
}

/// Runs a command (its name, then its arguments) with these engines by name; the first one does the
/// work unless `--engine` names another.
pub fn main_with(
    engines: &[(&str, &dyn Engine)],
    args: impl Iterator<Item = OsString>,
) -> ExitCode {
    allocator::give_back();
    let args: Vec<OsString> = args.collect();
    let cli = match Cli::try_parse_from(&args) {
        Ok(cli) => cli,
        Err(e) => {
            let printed = e.print();
            if e.use_stderr() {
                return ExitCode::from(FAILED);
            }
            words::written(printed.and_then(|()| std::io::stdout().flush()));
            return heard(ExitCode::SUCCESS);
        }
    };
    cli.volume().set();
    let is_json = cli.verb.is_json();
    let brought = engines.iter().any(|(name, _)| *name == cluster::ENGINE);
    let ended = match cluster::is_for_another(&cli.verb) && !brought {
        true => cluster::hand_over(&args).map_err(Errors::from),
        false => dispatch(cli.verb, engines).map(|end| ExitCode::from(end.code())),
    };
    heard(ended.unwrap_or_else(|errors| failed(&errors, is_json)))
}

/// Says why nothing could be done.
fn failed(errors: &Errors, is_json: bool) -> ExitCode {
    print_errors(errors);
    if is_json {
        let answer = serde_json::json!({ "errors": errors, "exit_code": FAILED });
        document(&answer).unwrap_or_else(|e| print_errors(&e));
    }
    ExitCode::from(FAILED)
}

/// How a command ends that would end like this: as failed where what it had to say could not be written.
fn heard(code: ExitCode) -> ExitCode {
    match words::unsaid() {
        Some(error) => {
            print_errors(&error.into());
            ExitCode::from(FAILED)
        }
        None => code,
    }
}

fn dispatch(verb: Verb, engines: &[(&str, &dyn Engine)]) -> Result<End, Errors> {
    match verb {
        Verb::Run(args) if args.dry_run => status::status(&args.files, &args.limits(), args.form),
        Verb::Run(args) => run::run(&args, chosen(engines, args.engine.as_deref())?),
        Verb::Diagnose(args) => diagnose::diagnose(&args, chosen(engines, args.engine.as_deref())?),
        Verb::Status { files, form } => status::status(&files, &Limits::default(), form),
        Verb::Explain { pipeline, stage, unit, out } => {
            let files = PipelineArgs { pipeline, out };
            provenance::explain(&files, stage.as_deref(), unit.as_deref())
        }
        Verb::Diff { first, second, form } => diff::diff(&first, &second, form),
        Verb::Lineage { file, form } => lineage::lineage(&file, form),
        Verb::Sql { run, query, csv, form } => sql::sql(&run, &query, sql::Rows::of(csv, form)),
        Verb::Gc { files, dry_run } => provenance::gc(&files, dry_run),
        Verb::Verify { files, form } => provenance::verify(&files, form),
        Verb::Check { pipeline, jobs, form } => run::check(&pipeline, jobs, form),
        Verb::Inspect { log, form } => inspect(&log, form),
        Verb::Init { logs, out } => shown(&log::starter::run(&logs, &out)?),
        Verb::Import { description, out, force } => {
            let (done, errors) = log::import::run(&description, out.as_deref(), force)?;
            for one in &done {
                let said = |text: &String| note(&format!("{}: {text}", one.input.display()));
                one.notes.iter().for_each(said);
            }
            let lines: Vec<String> = done.iter().map(|one| one.to_string()).collect();
            if !lines.is_empty() {
                tell(&lines.join("\n"));
            }
            errors.or(End::Complete)
        }
        Verb::Simulate { campaign, force, jobs } => simulate::simulate(&campaign, force, jobs),
        Verb::Design { study, out, jobs, force } => design::design(&study, out, jobs, force),
        // Handed over before, or asked of a program that brings an engine: it knows them itself.
        Verb::Scheduler(_) | Verb::Worker(_) => {
            Err(crate::error::Error::new("this is a command of its own: name it first").into())
        }
        Verb::Schema { file, out, force } => schema::schema(file.as_deref(), out.as_deref(), force),
    }
}

/// `koehler inspect`
fn inspect(path: &Path, form: Form) -> Result<End, Errors> {
    let survey = log::inspect::survey(path)?;
    match form.json {
        true => document(&survey).map(|()| End::Complete),
        false => shown(&survey.to_string()),
    }
}

/// The engine of this name, or the first.
fn chosen<'a>(
    engines: &[(&str, &'a dyn Engine)],
    name: Option<&str>,
) -> Result<&'a dyn Engine, Errors> {
    let named = |(known, _): &&(&str, _)| name.is_none_or(|name| name == *known);
    let names: Vec<&str> = engines.iter().map(|(name, _)| *name).collect();
    engines.iter().find(named).map(|(_, engine)| *engine).ok_or_else(|| {
        let wanted = name.unwrap_or("to work with");
        crate::error::Error::new(format!("there is no engine {wanted}"))
            .help(format!("there is {}", crate::config::list(&names)))
            .into()
    })
}
