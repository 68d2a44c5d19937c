//! What a command says: lines and errors in, standard output, standard error and the way it ended
//! out. The one place that prints errors.

use crate::error::{Error, Errors};
use std::borrow::Cow;
use std::sync::atomic::{AtomicU8, Ordering};

/// How much is said besides answers, warnings and errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Volume {
    Quiet,
    /// Standard output belongs to a JSON document.
    Document,
    Usual,
    Verbose,
}

// That of the command that runs: every line would have to be handed it otherwise.
static VOLUME: AtomicU8 = AtomicU8::new(Volume::Usual as u8);

impl Volume {
    /// Makes it that of this process.
    pub fn set(self) {
        VOLUME.store(self as u8, Ordering::Relaxed);
    }

    /// Whether so much is said.
    pub fn is_heard(self) -> bool {
        self as u8 <= VOLUME.load(Ordering::Relaxed)
    }
}

/// How a command ended, where it did not fail outright.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum End {
    Complete,
    /// A diagnosis found that something is missing in a model: exit code 3.
    Found,
    /// Results are there, and something asked for is missing; or files are not as recorded, or runs
    /// differ: exit code 1.
    Partial,
}

impl End {
    /// The exit code.
    pub fn code(self) -> u8 {
        match self {
            End::Complete => 0,
            End::Partial => 1,
            End::Found => 3,
        }
    }
}

/// Prints what a verb has to say.
pub fn shown(text: &str) -> Result<End, Errors> {
    say(text.trim_end());
    Ok(End::Complete)
}

/// Prints what a verb has to say as one JSON document.
///
/// # Errors
/// It cannot be written as JSON.
pub fn document<T: serde::Serialize>(what: &T) -> Result<(), Errors> {
    let text = serde_json::to_string_pretty(what)
        .map_err(|e| Error::new(format!("cannot write the answer as JSON: {e}")))?;
    say(&text);
    Ok(())
}

/// The one place that prints errors.
pub fn print_errors(errors: &Errors) {
    for error in &errors.0 {
        aside(&format!("error: {error}"));
    }
    if errors.0.len() > 1 {
        aside(&format!("{} errors", errors.0.len()));
    }
}

/// Prints a line about what a command does or has done, for a person who watches.
pub fn tell(line: &str) {
    if Volume::Usual.is_heard() {
        say(line);
    }
}

/// Prints what may be of interest and is no mistake.
pub fn note(text: &str) {
    if Volume::Document.is_heard() {
        aside(&format!("note: {text}"));
    }
}

/// Prints what is likely to be a mistake and stops nothing.
pub fn warn(text: &str) {
    aside(&format!("warning: {text}"));
}

/// Prints a line of what is asked for by `--verbose` alone.
pub fn detail(line: &str) {
    if Volume::Verbose.is_heard() {
        aside(line);
    }
}

/// Prints an answer to standard output, however quiet; a reader who has closed the pipe wants no more.
pub fn say(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{}", plain(line));
}

/// Prints a line to standard error; where nobody can read it, the work goes on.
pub fn aside(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{}", plain(line));
}

/// Text without what a terminal would obey: names that came out of a log or a file may hold anything.
pub fn plain(text: &str) -> Cow<'_, str> {
    // Marks that turn the direction of writing show another text than there is.
    let turns = |c: char| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let obeyed = |c: char| c.is_control() && !matches!(c, '\n' | '\t') || turns(c);
    if !text.contains(obeyed) {
        return Cow::Borrowed(text);
    }
    let shown = |c: char| if obeyed(c) { c.escape_unicode().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(shown).collect())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_a_terminal_obeys_nothing_that_is_said() {
        assert_eq!(plain("/t\u{1b}[2J\u{7}\r\u{9b}"), "/t\\u{1b}[2J\\u{7}\\u{d}\\u{9b}");
        assert_eq!(plain("a\u{202e}b"), "a\\u{202e}b");
        let sound = "flight-1:\tα = 3°\n    help";
        assert!(matches!(plain(sound), Cow::Borrowed(text) if text == sound));
    }
}
