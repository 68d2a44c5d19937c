//! The arguments that have to do with other machines, as people write them.

use clap::Args;
use std::ffi::OsString;
use std::path::PathBuf;

/// Other machines that do the work.
#[derive(Debug, Default, Args)]
pub struct ClusterArgs {
    /// Let the workers of this scheduler do the work (needs koehler-cluster; docs/cluster.md)
    #[arg(long, value_name = "HOST:PORT", conflicts_with = "engine")]
    pub cluster: Option<String>,
    /// Certificates of mutual TLS with them: a folder with ca.pem, member.pem and member.key
    #[arg(long, value_name = "DIR", requires = "cluster")]
    pub tls: Option<PathBuf>,
    /// Take a scheduler that others reach without TLS
    #[arg(long, requires = "cluster")]
    pub insecure: bool,
}

/// What the other program does with its arguments.
#[derive(Debug, Args)]
pub struct Handed {
    /// Its arguments
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    rest: Vec<OsString>,
}
