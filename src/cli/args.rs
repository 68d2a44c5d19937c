//! The arguments of the command line, as people write them.

use super::machines::{ClusterArgs, Handed};
use super::text;
use super::words::Volume;
use crate::pipeline::Limits;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Flight-test logs in, identified aircraft models with honest uncertainty out.
#[derive(Debug, Parser)]
#[command(name = "koehler", version, after_help = text::EXAMPLES, after_long_help = text::LONG)]
pub struct Cli {
    #[command(subcommand)]
    pub verb: Verb,
    /// Say nothing but answers, warnings and errors
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say each unit of work as it is done
    #[arg(short, long, global = true)]
    pub verbose: bool,
}

impl Cli {
    /// How much is said.
    pub fn volume(&self) -> Volume {
        match (self.quiet, self.verb.is_json(), self.verbose) {
            (true, ..) => Volume::Quiet,
            (_, true, _) => Volume::Document,
            (.., true) => Volume::Verbose,
            _ => Volume::Usual,
        }
    }
}

#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Run a campaign: from logs (simulated first where there are none) to tables and a report
    #[command(after_help = text::RUN)]
    Run(RunArgs),
    /// Hold models against the flights: where are they wrong, and which missing effect explains it?
    #[command(after_help = text::DIAGNOSE)]
    Diagnose(DiagnoseArgs),
    /// Tell what a run would do and why: fresh, stale or missing
    #[command(after_help = text::STATUS)]
    Status {
        #[command(flatten)]
        files: PipelineArgs,
        #[command(flatten)]
        form: Form,
    },
    /// Say why units are fresh, stale or missing; of a setting that changed the old and the new value
    #[command(after_help = text::EXPLAIN)]
    Explain {
        /// The pipeline file
        pipeline: PathBuf,
        /// A stage, as `status` names it in its first column [default: all]
        stage: Option<String>,
        /// A flight, an estimate, `campaign`: what `status` names in its second column [default: all]
        unit: Option<String>,
        /// Output folder [default: out/ beside pipeline.toml, out/NAME/ beside NAME.toml]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Compare the results of two runs: values and lines that moved by more than 2 sd, other verdicts
    #[command(after_help = text::DIFF)]
    Diff {
        /// Output folder of the first run, or its pipeline file
        #[arg(value_name = "RUN")]
        first: PathBuf,
        /// That of the second
        #[arg(value_name = "RUN")]
        second: PathBuf,
        #[command(flatten)]
        form: Form,
    },
    /// Ask the tables of a run with a query in SQL
    #[command(after_help = text::SQL)]
    Sql {
        /// Output folder of the run, or its pipeline file
        run: PathBuf,
        /// One SELECT over the tables of the run, by their names
        query: String,
        /// Answer in CSV
        #[arg(long, conflicts_with = "json")]
        csv: bool,
        #[command(flatten)]
        form: Form,
    },
    /// Say which logs, stages, settings and program a table or the report was made from
    #[command(after_help = text::LINEAGE)]
    Lineage {
        /// A file of an output folder, or the folder of a table
        file: PathBuf,
        #[command(flatten)]
        form: Form,
    },
    /// Remove what an output folder keeps that no unit of the campaign needs
    #[command(after_help = text::GC)]
    Gc {
        #[command(flatten)]
        files: PipelineArgs,
        /// Say what would be removed, and remove nothing
        #[arg(long)]
        dry_run: bool,
    },
    /// Hold every file of a run (tables, report, logs, settings) against its recorded hash
    #[command(after_help = text::VERIFY)]
    Verify {
        #[command(flatten)]
        files: PipelineArgs,
        #[command(flatten)]
        form: Form,
    },
    /// Check all configuration files of a campaign, and that its logs have the topics, fields and
    /// units they name
    #[command(after_help = text::CHECK)]
    Check {
        /// The pipeline file
        pipeline: PathBuf,
        /// Number of threads [default: one per core]
        #[arg(long, value_name = "N")]
        jobs: Option<usize>,
        #[command(flatten)]
        form: Form,
    },
    /// Show what is in a log: topics, fields, rates, gaps, ranges
    #[command(after_help = text::INSPECT)]
    Inspect {
        /// An MCAP log
        log: PathBuf,
        #[command(flatten)]
        form: Form,
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
    /// Turn text columns, MAT files, Parquet or ULog into MCAP logs, as a small description file says
    #[command(after_help = text::IMPORT)]
    Import {
        /// The description file
        description: PathBuf,
        /// The log to write, if another than the description says
        #[arg(long)]
        out: Option<PathBuf>,
        /// Write over files that are no logs written by koehler (never over an input)
        #[arg(long)]
        force: bool,
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
    /// Rank input designs: fly each with a campaign's truth, record it with its sensors, estimate,
    /// and compare what was learnt
    #[command(after_help = text::DESIGN)]
    Design {
        /// The study file
        study: PathBuf,
        /// Output folder [default: out/NAME/ beside NAME.toml]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Number of threads; the table is the same bytes for any number [default: one per core]
        #[arg(long, value_name = "N")]
        jobs: Option<usize>,
        /// Take an output folder that has files of others
        #[arg(long)]
        force: bool,
    },
    /// Print the JSON Schema of a configuration file, or write all of them, for editors
    #[command(after_help = text::SCHEMA)]
    Schema {
        /// Which file: pipeline, channels, aircraft, campaign, design, model, import, effect, tolerances
        file: Option<String>,
        /// Folder to write all schemas to
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Write over files that are not these schemas
        #[arg(long)]
        force: bool,
    },
    /// Hand out the work of runs with --cluster to workers (needs koehler-cluster)
    #[command(disable_help_flag = true)]
    Scheduler(Handed),
    /// Do work that a scheduler hands out (needs koehler-cluster)
    #[command(disable_help_flag = true)]
    Worker(Handed),
}

impl Verb {
    /// Whether the answer is to be a JSON document.
    pub fn is_json(&self) -> bool {
        match self {
            Verb::Run(args) => args.form.json,
            Verb::Status { form, .. }
            | Verb::Check { form, .. }
            | Verb::Inspect { form, .. }
            | Verb::Diff { form, .. }
            | Verb::Sql { form, .. }
            | Verb::Lineage { form, .. }
            | Verb::Verify { form, .. } => form.json,
            _ => false,
        }
    }
}

#[derive(Debug, Args)]
pub struct PipelineArgs {
    /// The pipeline file
    pub pipeline: PathBuf,
    /// Output folder [default: out/ beside pipeline.toml, out/NAME/ beside NAME.toml]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// In which form a command answers.
#[derive(Debug, Clone, Copy, Args)]
pub struct Form {
    /// Answer with one JSON document on standard output
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    pub files: PipelineArgs,
    /// Number of threads; the tables are the same bytes for any number [default: one per core]
    #[arg(long, value_name = "N")]
    pub jobs: Option<usize>,
    /// What does the work, for programs that bring engines of their own
    #[arg(long, value_name = "NAME", hide = true)]
    pub engine: Option<String>,
    #[command(flatten)]
    pub cluster: ClusterArgs,
    /// Tell what would be run and why, and run nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Run this stage and those behind it again, fresh or not
    #[arg(long, value_name = "STAGE")]
    pub from: Option<String>,
    /// End after this stage; those behind it are left as they are
    #[arg(long, value_name = "STAGE")]
    pub until: Option<String>,
    /// Take this flight alone through the stages of single flights (repeat it for several); what takes
    /// all flights together is left as it is
    #[arg(long, value_name = "NAME")]
    pub flight: Vec<String>,
    #[command(flatten)]
    pub form: Form,
    /// Take an output folder that has files of others: those of the names of results are removed
    #[arg(long)]
    pub force: bool,
}

impl RunArgs {
    /// A run of everything.
    pub fn of(files: PipelineArgs, jobs: Option<usize>) -> RunArgs {
        RunArgs {
            files,
            jobs,
            engine: None,
            cluster: ClusterArgs::default(),
            dry_run: false,
            from: None,
            until: None,
            flight: Vec::new(),
            form: Form { json: false },
            force: false,
        }
    }

    /// The part of the run that is wanted.
    pub fn limits(&self) -> Limits {
        Limits { from: self.from.clone(), until: self.until.clone(), flights: self.flight.clone() }
    }
}

#[derive(Debug, Args)]
pub struct DiagnoseArgs {
    #[command(flatten)]
    pub files: PipelineArgs,
    /// Estimates whose models are diagnosed [default: those of the [[diagnose]] sections, or all]
    #[arg(long, value_name = "NAME")]
    pub estimate: Vec<String>,
    /// A folder with effects of your own, relative to the pipeline file
    #[arg(long, value_name = "DIR")]
    pub effects: Vec<String>,
    /// Hold the parameters of the models at their values: their errors can be found then
    #[arg(long)]
    pub predicted: bool,
    /// Number of threads; the tables are the same bytes for any number [default: one per core]
    #[arg(long, value_name = "N")]
    pub jobs: Option<usize>,
    /// What does the work, for programs that bring engines of their own
    #[arg(long, value_name = "NAME", hide = true)]
    pub engine: Option<String>,
    #[command(flatten)]
    pub cluster: ClusterArgs,
    /// Take an output folder that has files of others: those of the names of results are removed
    #[arg(long)]
    pub force: bool,
}
