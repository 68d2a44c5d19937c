//! What a command says: lines and errors in, standard output, standard error and the way it ended
//! out. The one place that prints errors.

use crate::error::{Error, Errors};

/// How a command ended, where it did not fail outright.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum End {
    Complete,
    /// A diagnosis found that something is missing in a model: exit code 3.
    Found,
    /// Results are there, and something asked for is missing: exit code 1.
    Partial,
}

/// Prints what a verb has to say.
pub fn shown(text: &str) -> Result<End, Errors> {
    say(text.trim_end());
    Ok(End::Complete)
}

/// The one place that prints errors.
pub fn print_errors(errors: &Errors) {
    for error in &errors.0 {
        eprintln!("error: {error}");
    }
    if errors.0.len() > 1 {
        eprintln!("{} errors", errors.0.len());
    }
}

/// Prints a line to standard output; a reader who has closed the pipe wants no more.
pub fn say(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Does `work` on `jobs` threads.
pub fn on_threads<T: Send>(
    jobs: Option<usize>,
    work: impl FnOnce() -> T + Send,
) -> Result<T, Errors> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(jobs.unwrap_or(0))
        .build()
        .map_err(|e| Error::new(format!("cannot start the threads: {e}")))?;
    Ok(pool.install(work))
}
