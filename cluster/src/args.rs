//! The arguments of the two verbs that other machines run, as people write them.

use crate::tls::Tls;
use clap::{Args, Parser, Subcommand};
use koehler::error::Result;
use std::path::PathBuf;

/// Koehler on many machines.
#[derive(Debug, Parser)]
#[command(name = "koehler-cluster", version)]
pub struct Cli {
    #[command(subcommand)]
    pub verb: Verb,
}

#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Hand out the work of runs (`koehler run --cluster`) to workers
    Scheduler(SchedulerArgs),
    /// Do work that a scheduler hands out
    Worker(WorkerArgs),
    /// Print the code version, which all processes of a cluster share
    Code,
}

#[derive(Debug, Args)]
pub struct Link {
    /// Certificates of mutual TLS: a folder with ca.pem, member.pem and member.key
    #[arg(long, value_name = "DIR")]
    pub tls: Option<PathBuf>,
    /// Take an address that others reach without TLS: they can have any work done
    #[arg(long)]
    pub insecure: bool,
    /// Say what the engine says of its own work, on standard error
    #[arg(short, long)]
    pub verbose: bool,
}

impl Link {
    /// The certificates, where there are some.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn certificates(&self) -> Result<Option<Tls>> {
        self.tls.as_deref().map(Tls::read).transpose()
    }
}

#[derive(Debug, Args)]
pub struct SchedulerArgs {
    /// Where it listens
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:50050")]
    pub listen: String,
    #[command(flatten)]
    pub link: Link,
}

#[derive(Debug, Args)]
pub struct WorkerArgs {
    /// The scheduler whose work it does
    #[arg(value_name = "HOST:PORT")]
    pub scheduler: String,
    /// Where results are fetched from; port 0 is any free one
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub listen: String,
    /// Under which name others reach this machine [default: the address it listens on]
    #[arg(long, value_name = "HOST")]
    pub host: Option<String>,
    /// A folder with logs and pipeline files, read alone (repeat it for several)
    #[arg(long, value_name = "DIR")]
    pub data: Vec<PathBuf>,
    /// The folder that output folders are in: the only one it writes to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of threads [default: one per core]
    #[arg(long, value_name = "N")]
    pub jobs: Option<usize>,
    /// Memory for what is kept between items, MiB
    #[arg(long, value_name = "MIB", default_value_t = 1024)]
    pub keep: usize,
    #[command(flatten)]
    pub link: Link,
}
