//! The command line: arguments come in; verbs do the work; this is the one place that prints errors
//! and decides the exit code.

mod diagnose;
mod progress;
mod run;
mod schema;
mod simulate;
mod summary;
mod text;
mod verdict;

use crate::engine::{Engine, Threads};
use crate::error::Errors;
use crate::log;
use clap::{Args, Parser, Subcommand};
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

/// Flight-test logs in, identified aircraft models with honest uncertainty out.
#[derive(Debug, Parser)]
#[command(name = "koehler", version, after_help = text::EXAMPLES, after_long_help = text::LONG)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Run a campaign: from logs (simulated first where there are none) to tables and a report
    #[command(after_help = text::RUN)]
    Run(RunArgs),
    /// Hold models against the flights: where are they wrong, and which missing effect explains it?
    #[command(after_help = text::DIAGNOSE)]
    Diagnose(DiagnoseArgs),
    /// Tell what a run would do and why: fresh, stale or missing
    #[command(after_help = text::STATUS)]
    Status(PipelineArgs),
    /// Check all configuration files of a campaign, and that its logs have the topics, fields and
    /// units they name
    #[command(after_help = text::CHECK)]
    Check {
        /// The pipeline file
        pipeline: PathBuf,
    },
    /// Show what is in a log: topics, fields, rates, gaps, ranges
    Inspect {
        /// An MCAP log
        log: PathBuf,
    },
    /// Write a starter campaign folder from logs: a channel map to be completed, with candidates
    /// named in comments
    #[command(after_help = text::INIT)]
    Init {
        /// MCAP logs of the campaign
        #[arg(required = true)]
        logs: Vec<PathBuf>,
        /// Folder to write
        #[arg(long, default_value = "campaign")]
        out: PathBuf,
    },
    /// Turn text columns into an MCAP log, as a small description file says
    #[command(after_help = text::IMPORT)]
    Import {
        /// The description file
        description: PathBuf,
        /// The log to write, if another than the description says
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Simulate a campaign into MCAP logs
    #[command(after_help = text::SIMULATE)]
    Simulate {
        /// The campaign file
        campaign: PathBuf,
        /// Write again the logs that are there already
        #[arg(long)]
        force: bool,
        /// Number of threads [default: one per core]
        #[arg(long, value_name = "N")]
        jobs: Option<usize>,
    },
    /// Print the JSON Schema of a configuration file, or write all of them, for editors
    #[command(after_help = text::SCHEMA)]
    Schema {
        /// Which file: pipeline, channels, aircraft, campaign, model, import
        file: Option<String>,
        /// Folder to write all schemas to
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

#[derive(Debug, Args)]
struct PipelineArgs {
    /// The pipeline file
    pipeline: PathBuf,
    /// Output folder [default: out/ beside pipeline.toml, out/NAME/ beside NAME.toml]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct RunArgs {
    #[command(flatten)]
    files: PipelineArgs,
    /// Number of threads; the tables are the same bytes for any number [default: one per core]
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// What does the work, for programs that bring engines of their own
    #[arg(long, value_name = "NAME", hide = true)]
    engine: Option<String>,
    /// Tell what would be run and why, and run nothing
    #[arg(long)]
    dry_run: bool,
}

#[derive(Debug, Args)]
struct DiagnoseArgs {
    #[command(flatten)]
    files: PipelineArgs,
    /// Estimates whose models are diagnosed [default: those of the [[diagnose]] sections, or all]
    #[arg(long, value_name = "NAME")]
    estimate: Vec<String>,
    /// A folder with effects of your own, relative to the pipeline file
    #[arg(long, value_name = "DIR")]
    effects: Vec<String>,
    /// Hold the parameters of the models at their values: their errors can be found then
    #[arg(long)]
    predicted: bool,
    /// Number of threads; the tables are the same bytes for any number [default: one per core]
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// What does the work, for programs that bring engines of their own
    #[arg(long, value_name = "NAME", hide = true)]
    engine: Option<String>,
}

/// How a command ended, where it did not fail outright.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum End {
    Complete,
    /// A diagnosis found that something is missing in a model: exit code 3.
    Found,
    /// Results are there, and something asked for is missing: exit code 1.
    Partial,
}

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
        Verb::Import { description, out } => {
            let done: Vec<String> = log::import::run(&description, out.as_deref())?
                .iter()
                .map(|one| one.to_string())
                .collect();
            shown(&done.join("\n"))
        }
        Verb::Simulate { campaign, force, jobs } => simulate::simulate(&campaign, force, jobs),
        Verb::Schema { file, out } => schema::schema(file.as_deref(), out.as_deref()),
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

/// Prints what a verb has to say.
fn shown(text: &str) -> Result<End, Errors> {
    say(text.trim_end());
    Ok(End::Complete)
}

/// The one place that prints errors.
fn print_errors(errors: &Errors) {
    for error in &errors.0 {
        eprintln!("error: {error}");
    }
    if errors.0.len() > 1 {
        eprintln!("{} errors", errors.0.len());
    }
}

/// Prints a line to standard output; a reader who has closed the pipe wants no more.
fn say(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Does `work` on `jobs` threads.
fn on_threads<T: Send>(jobs: Option<usize>, work: impl FnOnce() -> T + Send) -> Result<T, Errors> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(jobs.unwrap_or(0))
        .build()
        .map_err(|e| crate::error::Error::new(format!("cannot start the threads: {e}")))?;
    Ok(pool.install(work))
}
