//! What a command says: lines and errors in, standard output, standard error and the way it ended
//! out. The one place that prints errors.

use crate::error::{Error, Errors};
use std::borrow::Cow;
use std::io::{self, Write};
use std::sync::OnceLock;
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

/// Prints an answer to standard output, however quiet. Where it cannot be written the work goes on,
/// and `unsaid` tells it at the end.
pub fn say(line: &str) {
    written(said(&mut io::stdout().lock(), line));
}

/// Writes a line, all the way to where it goes.
fn said(out: &mut impl Write, line: &str) -> io::Result<()> {
    writeln!(out, "{}", plain(line))?;
    out.flush()
}

// Why an answer could not be written, the first time: every verb would have to hand it on otherwise.
static UNSAID: OnceLock<String> = OnceLock::new();

/// Takes note of what became of a write to standard output.
pub fn written(result: io::Result<()>) {
    if let Some(why) = result.err().as_ref().and_then(lost) {
        // Only the first is of interest: the others follow from it.
        let _ = UNSAID.set(why);
    }
}

/// Why a write lost an answer, in the words of the system; none where a reader has closed the pipe, who
/// wants no more.
fn lost(e: &io::Error) -> Option<String> {
    let text = e.to_string();
    let words = text.split(" (os error").next().unwrap_or_default().to_string();
    (e.kind() != io::ErrorKind::BrokenPipe).then_some(words)
}

/// The error of a command whose answers are not where they were to go; none where they are.
pub fn unsaid() -> Option<Error> {
    let why = UNSAID.get()?;
    Some(Error::new(format!("standard output could not be written: {why}")))
}

/// Prints a line to standard error; where nobody can read it, the work goes on.
pub fn aside(line: &str) {
    let _ = writeln!(io::stderr(), "{}", plain(line));
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

    #[test]
    fn fault_an_answer_is_lost_on_a_full_disk_and_not_on_a_closed_pipe() {
        let full = io::Error::from_raw_os_error(28);
        assert!(!lost(&full).expect("a full disk").contains("os error"));
        assert_eq!(lost(&io::ErrorKind::BrokenPipe.into()), None);
        // What stays in a buffer is not written yet.
        let mut small = [0u8; 3];
        assert!(said(&mut io::BufWriter::new(&mut small[..]), "an answer").is_err());
    }
}
