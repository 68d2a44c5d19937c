//! Koehler on many machines: the arguments of `koehler` come in, with `scheduler` and `worker` besides;
//! work goes to other processes where `--cluster` says so.
//!
//! A run hands its jobs to an engine ([`engine`]). It sends the items of a job as a table, in one
//! query ([`query`], [`plan`]), to a scheduler ([`scheduler`], which lets nothing else in: [`guard`]).
//! Workers ([`worker`]) ask the scheduler for parts of the table and call one function over its rows
//! ([`stage`]), which looks at what is asked and does it ([`desk`]). What travels is in [`row`].

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo
    )
)]

pub mod args;
pub mod desk;
pub mod engine;
pub mod guard;
pub mod identity;
pub mod link;
pub mod logged;
pub mod plan;
pub mod query;
pub mod roots;
pub mod row;
pub mod sandbox;
pub mod scheduler;
pub mod stage;
pub mod tls;
pub mod worker;

use args::{Cli, Verb};
use clap::Parser;
use koehler::cli::cluster::Asked;
use koehler::engine::{Engine, Threads};
use koehler::error::Result;
use std::ffi::OsString;
use std::process::ExitCode;

/// The exit code where nothing could be done.
const FAILED: u8 = 2;

/// Runs the command of this process.
pub fn main() -> ExitCode {
    let args: Vec<OsString> = std::env::args_os().collect();
    let mut words = args.iter().skip(1).filter_map(|arg| arg.to_str());
    let verb = words.find(|word| !word.starts_with('-')).unwrap_or_default();
    if ["scheduler", "worker", "code"].contains(&verb) {
        return served(Cli::parse_from(args).verb);
    }
    let asked = koehler::cli::cluster::asked(&args);
    let Some(asked) = asked else {
        return koehler::cli::main_with(&[("threads", &Threads)], args.into_iter());
    };
    match cluster(&asked) {
        Ok(cluster) => {
            let engines: [(&str, &dyn Engine); 2] = [("cluster", &cluster), ("threads", &Threads)];
            koehler::cli::main_with(&engines, args.into_iter())
        }
        Err(e) => failed(&e),
    }
}

fn failed(error: &koehler::error::Error) -> ExitCode {
    eprintln!("error: {error}");
    ExitCode::from(FAILED)
}

fn served(verb: Verb) -> ExitCode {
    let ended = match &verb {
        Verb::Code => {
            println!("{}", koehler::engine::CODE);
            Ok(())
        }
        Verb::Scheduler(args) => {
            logged::begin(args.link.verbose);
            scheduler::run(args)
        }
        Verb::Worker(args) => {
            logged::begin(args.link.verbose);
            worker::run(args)
        }
    };
    ended.map_or_else(|e| failed(&e), |()| ExitCode::SUCCESS)
}

/// The engine that a run asks for.
fn cluster(asked: &Asked) -> Result<engine::Cluster> {
    let certificates = asked.tls.as_deref().map(tls::Tls::read).transpose()?;
    let (host, _) = link::host_port(&asked.address)?;
    tls::guarded(host, certificates.as_ref(), asked.insecure)?;
    let client = query::Client::new(&asked.address, certificates.as_ref());
    let client = client.map_err(|e| koehler::error::Error::new(format!("cannot start: {e}")))?;
    engine::Cluster::new(client, &asked.address, &asked.out, asked.quiet)
}
