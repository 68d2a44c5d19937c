//! What a command asks of other machines comes in; the program that works with them,
//! `koehler-cluster`, is started in this one's place, or its absence is said.

use super::args::{Cli, Verb};
use super::machines::ClusterArgs;
use crate::engine::CODE;
use crate::error::{Error, Result};
use clap::Parser;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;

/// The program that brings the engine.
const PROGRAM: &str = "koehler-cluster";
/// The name of its engine.
pub(super) const ENGINE: &str = "cluster";

/// What a run asks of a cluster.
#[derive(Debug, Clone, PartialEq)]
pub struct Asked {
    /// Host and port of the scheduler.
    pub address: String,
    /// Folder of certificates.
    pub tls: Option<PathBuf>,
    /// Whether it may do without.
    pub insecure: bool,
    /// The output folder of the run.
    pub out: PathBuf,
    /// Whether nothing but answers, warnings and errors is said.
    pub quiet: bool,
}

/// What these arguments (a command's name, then its arguments) ask of a cluster; none where they ask
/// for nothing, or are wrong.
pub fn asked(args: &[OsString]) -> Option<Asked> {
    let cli = Cli::try_parse_from(args).ok()?;
    let quiet = cli.quiet || cli.verb.is_json();
    let (cluster, files) = match cli.verb {
        Verb::Run(args) if !args.dry_run => (args.cluster, args.files),
        Verb::Diagnose(args) => (args.cluster, args.files),
        _ => return None,
    };
    let out = super::run::out_folder(&files);
    let ClusterArgs { cluster, tls, insecure } = cluster;
    Some(Asked { address: cluster?, tls, insecure, out, quiet })
}

/// Whether a command is for the other program.
pub(super) fn is_for_another(verb: &Verb) -> bool {
    match verb {
        Verb::Run(args) => args.cluster.cluster.is_some() && !args.dry_run,
        Verb::Diagnose(args) => args.cluster.cluster.is_some(),
        Verb::Scheduler(_) | Verb::Worker(_) => true,
        _ => false,
    }
}

/// Starts the other program in the place of this one, with the same arguments. Returns where it
/// cannot, or how it ended.
///
/// # Errors
/// It is not there, or made from other sources.
pub(super) fn hand_over(args: &[OsString]) -> Result<std::process::ExitCode> {
    let program = found()?;
    let mut command = Command::new(&program);
    command.args(args.iter().skip(1));
    #[cfg(unix)]
    let ended = Err(std::os::unix::process::CommandExt::exec(&mut command));
    #[cfg(not(unix))]
    let ended = command.status();
    let failed = |e| Error::new(format!("cannot start {}: {e}", program.display()));
    let status: std::process::ExitStatus = ended.map_err(failed)?;
    Ok(std::process::ExitCode::from(status.code().map_or(2, |code| code as u8)))
}

/// The other program, beside this one or on the path, which has to be made from the same sources.
fn found() -> Result<PathBuf> {
    let name = format!("{PROGRAM}{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe().ok().and_then(|exe| Some(exe.parent()?.to_path_buf()));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut places = beside.into_iter().chain(std::env::split_paths(&path));
    let program = places.find_map(|folder| Some(folder.join(&name)).filter(|path| path.is_file()));
    let build = format!(
        "build it from the sources of this koehler with `cargo build --profile cluster --package {PROGRAM}` and put target/cluster/{PROGRAM} beside it"
    );
    let Some(program) = program else {
        let none = format!("there is no {PROGRAM} beside this program or on PATH");
        return Err(Error::new(none).help(build));
    };
    let output = Command::new(&program).arg("code").output();
    let failed = |e| Error::new(format!("cannot start {}: {e}", program.display()));
    let code = String::from_utf8_lossy(&output.map_err(failed)?.stdout).trim().to_string();
    if code != CODE {
        let other = format!("{} is made from other sources than this program", program.display());
        return Err(Error::new(format!(
            "{other}: its code version is {code:?}, here it is {CODE:?}"
        ))
        .help(build));
    }
    Ok(program)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(args: &[&str]) -> Option<Asked> {
        let args: Vec<OsString> = ["koehler"].iter().chain(args).map(OsString::from).collect();
        asked(&args)
    }

    #[test]
    fn a_run_asks_for_a_cluster_where_it_names_one() {
        assert_eq!(of(&["run", "a/pipeline.toml"]), None);
        assert_eq!(of(&["run", "a/pipeline.toml", "--tls", "t"]), None);
        let some = of(&["run", "a/pipeline.toml", "--cluster=n:1", "-q"]).expect("asked for");
        assert_eq!((some.address.as_str(), some.quiet), ("n:1", true));
        assert_eq!(some.out, PathBuf::from("a/out"));
        let some = of(&["diagnose", "a/b.toml", "--cluster", "n:1", "--out", "o"]);
        assert_eq!(some.map(|some| some.out), Some(PathBuf::from("o")));
    }
}
