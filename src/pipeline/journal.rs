//! What a run tells while it works comes in; a file of what each unit took, and of what became of it,
//! goes out. The one place of an output folder where there are times.
//!
//! It is no result: nothing reads it, no hash covers it, and a run that cannot write it goes on.

use super::result::{Ended, Event};
use super::store::Store;
use crate::error::{Error, Errors, Result};
use crate::guard;
use crate::stage::{Note, Severity};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::sync::{Mutex, MutexGuard};
use std::time::Instant;

/// Its name in the output folder.
pub const NAME: &str = "log.txt";

/// How its first line begins, by which it is known to be ours.
const FIRST: &str = "# koehler ";

/// The file of one run, written as the run goes.
pub struct Journal {
    begun: Instant,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// None where it cannot be written any more.
    file: Option<File>,
    /// Why not.
    lost: Option<Error>,
    /// The stage that runs, and since when, s.
    stage: Option<(&'static str, f64)>,
    /// Since when each of its units runs, s.
    units: BTreeMap<String, f64>,
    /// In the order in which the stages first came.
    totals: Vec<(&'static str, Total)>,
}

/// What the units of a stage came to.
#[derive(Default)]
struct Total {
    /// Time that passed, and that of all units together, s.
    seconds: [f64; 2],
    /// How many were made, kept, failed and blocked.
    counts: [usize; 4],
}

impl Journal {
    /// Writes the first lines over those of the last run; `words` say what was begun when. Where
    /// that cannot be, it keeps nothing, and says so at its end.
    pub fn begin(store: &Store, words: &str, begun: Instant) -> Journal {
        let mut state = State::default();
        match create(&store.path(NAME)) {
            Ok(file) => state.file = Some(file),
            Err(e) => state.lost = Some(e),
        }
        state.line(&format!("{FIRST}{}, {words}", env!("CARGO_PKG_VERSION")));
        state.line("# begin, s  seconds  stage of unit: what became of it");
        Journal { begun, state: Mutex::new(state) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|p| p.into_inner())
    }

    /// Seconds since the command began.
    fn now(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// Files an event of the run.
    pub fn hear(&self, event: &Event) {
        let now = self.now();
        let mut state = self.state();
        match event {
            Event::Stage { stage, .. } => {
                state.stage = Some((stage.name, now));
                state.units.clear();
            }
            Event::Step { unit, .. } => {
                state.units.entry(unit.name.clone()).or_insert(now);
            }
            Event::Told { unit, text } => {
                state.units.entry(unit.name.clone()).or_insert(now);
                let stage = state.stage.map_or("", |(stage, _)| stage);
                state.entry(now, None, &format!("{stage} of {}: {text}", unit.name));
            }
            Event::Unit { unit, ended } => state.unit(&unit.name, now, ended),
            Event::End => {
                if let Some((stage, since)) = state.stage.take() {
                    state.total(stage).seconds[0] += now - since;
                }
            }
        }
    }

    /// Does what a run does besides its units, and files how long it took.
    ///
    /// # Errors
    /// Those of the work.
    pub fn timed<T>(
        &self,
        what: &str,
        work: impl FnOnce() -> std::result::Result<T, Errors>,
    ) -> std::result::Result<T, Errors> {
        let since = self.now();
        let done = work();
        let became = if done.is_ok() { "done" } else { "failed" };
        self.state().entry(since, Some(self.now() - since), &format!("{what}: {became}"));
        done
    }

    /// Files how the run ended: the time of each stage, and in words how. Gives why something is
    /// not in the file, if so.
    pub fn end(&self, how: std::result::Result<bool, &Errors>) -> Option<Error> {
        let now = self.now();
        let mut state = self.state();
        state.totals();
        match how {
            Ok(true) => state.entry(now, None, "ended: everything asked for is there"),
            Ok(false) => state.entry(now, None, "ended: something is missing, or a problem"),
            Err(errors) => {
                state.entry(now, None, "ended: nothing more could be done");
                state.errors(errors);
            }
        }
        state.lost.take()
    }
}

/// The file, empty, in the place of the last run's.
fn create(path: &Path) -> Result<File> {
    guard::file(path, &[], false, foreign)?;
    File::create(path).map_err(|e| super::hashed::cannot("write", path, &e))
}

/// Whether a file is a journal that a run wrote.
pub fn is_ours(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name == NAME) && foreign(path).is_none()
}

/// What a file is that is no journal.
fn foreign(path: &Path) -> Option<String> {
    let mut first = String::new();
    let read = File::open(path).and_then(|file| BufReader::new(file).read_line(&mut first));
    let ours = read.is_ok() && (first.is_empty() || first.starts_with(FIRST));
    (!ours).then(|| "no log of a run".to_string())
}

impl State {
    /// Writes a line at once, so that it is there when a run is stopped. A full disk stops no run.
    fn line(&mut self, text: &str) {
        let written = self.file.as_mut().map(|file| file.write_all(format!("{text}\n").as_bytes()));
        if let Some(Err(e)) = written {
            self.file = None;
            self.lost = Some(Error::new(format!("cannot write {NAME}: {e}")));
        }
    }

    fn entry(&mut self, begin: f64, seconds: Option<f64>, text: &str) {
        let seconds = seconds.map_or(String::new(), |s| format!("{s:.3}"));
        self.line(&format!("{begin:10.3} {seconds:>8}  {}", text.replace('\n', " ")));
    }

    fn unit(&mut self, name: &str, now: f64, ended: &Ended) {
        let stage = self.stage.map_or("", |(stage, _)| stage);
        let begin = self.units.remove(name).unwrap_or(now);
        let (i, became) = match ended {
            Ended::Made(_) => (0, "made".to_string()),
            Ended::Kept(_) => (1, "kept".to_string()),
            Ended::Failed(_) => (2, "failed".to_string()),
            Ended::Blocked(why) => (3, format!("blocked, {why}")),
        };
        let total = self.total(stage);
        total.counts[i] += 1;
        total.seconds[1] += now - begin;
        self.entry(begin, Some(now - begin), &format!("{stage} of {name}: {became}"));
        match ended {
            Ended::Made(notes) | Ended::Kept(notes) => {
                notes.iter().for_each(|note| self.note(note));
            }
            Ended::Failed(errors) => self.errors(errors),
            Ended::Blocked(_) => {}
        }
    }

    fn note(&mut self, note: &Note) {
        let kind = match note.severity {
            Severity::Info => "note",
            Severity::Warning => "warning",
            Severity::Problem => "problem",
            Severity::Missing => "missing",
        };
        self.aside(&format!("{kind}: {}", note.text));
    }

    fn errors(&mut self, errors: &Errors) {
        errors.0.iter().for_each(|e| self.aside(&format!("error: {e}")));
    }

    /// What belongs to the line before.
    fn aside(&mut self, text: &str) {
        self.line(&format!("{:21}{}", "", text.replace('\n', " ")));
    }

    fn total(&mut self, stage: &'static str) -> &mut Total {
        let at = self.totals.iter().position(|(known, _)| *known == stage);
        let at = at.unwrap_or_else(|| {
            self.totals.push((stage, Total::default()));
            self.totals.len() - 1
        });
        &mut self.totals[at].1
    }

    fn totals(&mut self) {
        self.line("# seconds  of units  made  kept  failed  blocked  stage");
        for (stage, total) in std::mem::take(&mut self.totals) {
            let ([passed, all], [made, kept, failed, blocked]) = (total.seconds, total.counts);
            self.line(&format!(
                "{passed:9.3} {all:9.3} {made:5} {kept:5} {failed:7} {blocked:8}  {stage}"
            ));
        }
    }
}
