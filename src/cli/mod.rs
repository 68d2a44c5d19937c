//! The command line: arguments come in; verbs do the work; the exit code goes out.

mod args;
mod design;
mod diagnose;
mod progress;
mod run;
mod schema;
mod simulate;
mod summary;
mod text;
mod verdict;
mod words;

use crate::engine::{Engine, Threads};
use crate::error::Errors;
use crate::log;
use args::{Cli, Verb};
use clap::Parser;
use std::ffi::OsString;
use std::process::ExitCode;
use words::{End, print_errors, shown};

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
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(e) => {
            // A closed pipe is no reason to complain about help that nobody reads.
            let _ = e.print();
            return if e.use_stderr() { ExitCode::from(2) } else { ExitCode::SUCCESS };
        }
    };
    match dispatch(cli.verb, engines) {
        Ok(End::Complete) => ExitCode::SUCCESS,
        Ok(End::Found) => ExitCode::from(3),
        Ok(End::Partial) => ExitCode::from(1),
        Err(errors) => {
            print_errors(&errors);
            ExitCode::from(2)
        }
    }
}

fn dispatch(verb: Verb, engines: &[(&str, &dyn Engine)]) -> Result<End, Errors> {
    match verb {
        Verb::Run(args) if args.dry_run => run::status(&args.files),
        Verb::Run(args) => run::run(&args, chosen(engines, args.engine.as_deref())?),
        Verb::Diagnose(args) => diagnose::diagnose(&args, chosen(engines, args.engine.as_deref())?),
        Verb::Status(args) => run::status(&args),
        Verb::Check { pipeline } => run::check(&pipeline),
        Verb::Inspect { log } => shown(&log::inspect::run(&log)?),
        Verb::Init { logs, out } => shown(&log::starter::run(&logs, &out)?),
        Verb::Import { description, out, force } => {
            let (done, errors) = log::import::run(&description, out.as_deref(), force)?;
            for one in &done {
                let note = |note: &String| eprintln!("note: {}: {note}", one.input.display());
                one.notes.iter().for_each(note);
            }
            let lines: Vec<String> = done.iter().map(|one| one.to_string()).collect();
            if !lines.is_empty() {
                shown(&lines.join("\n"))?;
            }
            errors.or(End::Complete)
        }
        Verb::Simulate { campaign, force, jobs } => simulate::simulate(&campaign, force, jobs),
        Verb::Design { study, out, jobs, force } => design::design(&study, out, jobs, force),
        Verb::Schema { file, out, force } => schema::schema(file.as_deref(), out.as_deref(), force),
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
