//! The records of an output folder: one file, a line of JSON per unit. A run adds a line for each unit
//! that it makes, and puts the file in order at its end.
//!
//! The last line of a unit counts. A line that cannot be read (a program was stopped while it wrote it)
//! counts as absent, and the unit is made again. A file for every unit, as forms 1 and 2 had, took a
//! thousand flights two seconds to be read.

use super::files::{self, entries, listed, make_parent};
use super::hashed::cannot;
use super::provenance::Provenance;
use crate::error::{Error, Result};
use crate::table::write_atomic;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

/// A unit by its stage and its name.
type At = (String, String);

/// The records of a folder, read when they are first asked for.
#[derive(Debug)]
pub struct Records {
    /// The hidden folder that they stand in.
    mark: PathBuf,
    state: Mutex<Option<State>>,
}

#[derive(Debug)]
struct State {
    all: BTreeMap<At, Arc<Provenance>>,
    /// The file, where a line was added.
    file: Option<File>,
    /// Whether the file is another one than `all` in order.
    disordered: bool,
    /// Whether the file ends within a line.
    torn: bool,
}

/// A line that says that a unit has no record any more.
#[derive(Serialize, Deserialize)]
struct Gone {
    gone: At,
}

/// A line of the file.
enum Line {
    Made(Box<Provenance>),
    Gone(At),
    Unreadable,
}

impl Line {
    fn of(text: &[u8]) -> Line {
        if let Ok(record) = serde_json::from_slice::<Provenance>(text) {
            return Line::Made(Box::new(record));
        }
        serde_json::from_slice::<Gone>(text).map_or(Line::Unreadable, |line| Line::Gone(line.gone))
    }
}

impl Records {
    /// Those of the folder with this hidden folder; nothing is read yet.
    pub fn at(mark: PathBuf) -> Records {
        Records { mark, state: Mutex::new(None) }
    }

    fn path(&self) -> PathBuf {
        self.mark.join("records.jsonl")
    }

    fn held(&self) -> MutexGuard<'_, Option<State>> {
        self.state.lock().unwrap_or_else(|p| p.into_inner())
    }

    /// What to do with the records, read where they are not yet.
    fn with<T>(&self, to: impl FnOnce(&mut State) -> T) -> T {
        // They are read side by side, by threads that may take up work that asks for a record as well:
        // the lock is never held meanwhile.
        let is_read = self.held().is_some();
        let read = (!is_read).then(|| State::read(&self.mark, &self.path()));
        let mut held = self.held();
        if held.is_none() {
            *held = read;
        }
        to(held.get_or_insert_with(|| State::read(&self.mark, &self.path())))
    }

    /// The record of the last run of a stage for a unit.
    pub fn get(&self, stage: &str, unit: &str) -> Option<Arc<Provenance>> {
        self.with(|state| state.all.get(&(stage.to_string(), unit.to_string())).cloned())
    }

    /// Every record, by stage and unit.
    pub fn all(&self) -> Vec<Arc<Provenance>> {
        self.with(|state| state.all.values().cloned().collect())
    }

    /// Files a record. It is on the disk when this returns.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn put(&self, record: Arc<Provenance>) -> Result<()> {
        let line = line(&*record)?;
        self.with(|state| {
            state.add(&self.path(), line)?;
            state.all.insert((record.stage.clone(), record.unit.clone()), record);
            Ok(())
        })
    }

    /// Removes a record.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn remove(&self, stage: &str, unit: &str) -> Result<()> {
        let at = (stage.to_string(), unit.to_string());
        self.with(|state| {
            if state.all.contains_key(&at) {
                state.add(&self.path(), line(&Gone { gone: at.clone() })?)?;
                state.all.remove(&at);
            }
            Ok(())
        })
    }

    /// Forgets what was read, and reads it again when it is asked for: another run may have written.
    pub fn refresh(&self) {
        *self.held() = None;
    }

    /// Puts the file in order: a line for each unit, by stage and unit. Records of an earlier form go
    /// into it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn settle(&self) -> Result<()> {
        if self.with(|state| state.disordered) {
            let lines: Result<Vec<Vec<u8>>> =
                self.all().par_iter().map(|record| line(&**record)).collect();
            write_atomic(&self.path(), &lines?.concat())?;
            self.with(|state| {
                state.file = None;
                (state.disordered, state.torn) = (false, false);
            });
        }
        for path in earlier(&self.mark) {
            files::remove_file(&path)?;
            // Its folder goes with the last one.
            path.parent().map(std::fs::remove_dir);
        }
        Ok(())
    }
}

impl State {
    fn read(mark: &Path, path: &Path) -> State {
        let of_units = earlier(mark);
        let mut state = State {
            all: BTreeMap::new(),
            file: None,
            disordered: !of_units.is_empty(),
            torn: false,
        };
        let text: Vec<Option<Vec<u8>>> =
            of_units.par_iter().map(|path| std::fs::read(path).ok()).collect();
        let read = |text: &Vec<u8>| Line::of(text);
        let lines: Vec<Line> = text.par_iter().flatten().map(read).collect();
        lines.into_iter().for_each(|line| state.take(line));

        let text = std::fs::read(path).unwrap_or_default();
        state.torn = text.last().is_some_and(|byte| *byte != b'\n');
        let rows: Vec<&[u8]> = text.split(|byte| *byte == b'\n').collect();
        let lines: Vec<Line> =
            rows.par_iter().filter(|row| !row.is_empty()).map(|row| Line::of(row)).collect();
        let before = state.all.len();
        let lines_there = lines.len();
        lines.into_iter().for_each(|line| state.take(line));
        state.disordered |= state.torn || before > 0 || lines_there != state.all.len();
        state
    }

    fn take(&mut self, line: Line) {
        match line {
            Line::Made(record) => {
                let at = (record.stage.clone(), record.unit.clone());
                self.all.insert(at, Arc::new(*record));
            }
            Line::Gone(at) => drop(self.all.remove(&at)),
            Line::Unreadable => {}
        }
    }

    /// Adds a line at the end of the file.
    fn add(&mut self, path: &Path, mut line: Vec<u8>) -> Result<()> {
        if self.file.is_none() {
            make_parent(path)?;
            let file = File::options().create(true).append(true).open(path);
            self.file = Some(file.map_err(|e| cannot("open", path, &e))?);
        }
        if self.torn {
            line.insert(0, b'\n');
        }
        let Some(file) = &mut self.file else { return Ok(()) };
        // Until it is there whole, the file may end anywhere.
        (self.disordered, self.torn) = (true, true);
        let written = file.write_all(&line).and_then(|()| file.sync_data());
        written.map_err(|e| cannot("write", path, &e))?;
        self.torn = false;
        Ok(())
    }
}

fn line(what: &impl Serialize) -> Result<Vec<u8>> {
    let mut text =
        serde_json::to_vec(what).map_err(|e| Error::new(format!("cannot write a record: {e}")))?;
    text.push(b'\n');
    Ok(text)
}

/// The files of records of forms 1 and 2: one per unit, in a folder per stage.
fn earlier(mark: &Path) -> Vec<PathBuf> {
    let is_record = |path: &PathBuf| path.extension().is_some_and(|e| e == "json");
    let folders = listed(mark).into_iter().filter(|(_, is_folder)| *is_folder);
    folders.flat_map(|(stage, _)| entries(&stage)).filter(is_record).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(stage: &str, unit: &str, key: &str) -> Arc<Provenance> {
        Arc::new(Provenance {
            stage: stage.into(),
            unit: unit.into(),
            key: key.into(),
            ingredients: BTreeMap::new(),
            outputs: BTreeMap::new(),
            notes: Vec::new(),
            error: None,
            asked: None,
            settings: None,
            version: None,
        })
    }

    fn keys(records: &Records) -> Vec<String> {
        records.all().iter().map(|record| record.key.clone()).collect()
    }

    #[test]
    fn the_last_line_of_a_unit_counts_and_the_order_of_lines_leaves_no_trace() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let mark = |name: &str| dir.path().join(name);
        let (one, other) = (Records::at(mark("one")), Records::at(mark("other")));
        for r in [record("b", "2", "x"), record("a", "1", "y"), record("b", "1", "z")] {
            one.put(r).expect("written");
        }
        one.put(record("b", "2", "w")).expect("written");
        one.remove("b", "1").expect("written");
        assert_eq!(keys(&Records::at(mark("one"))), ["y", "w"]);
        one.settle().expect("written");
        for r in [record("a", "1", "y"), record("b", "2", "w")] {
            other.put(r).expect("written");
        }
        other.settle().expect("written");
        let bytes = |records: &Records| std::fs::read(records.path()).expect("a file");
        assert_eq!(bytes(&one), bytes(&other));
    }

    #[test]
    fn a_line_that_was_cut_short_is_absent_and_the_next_one_is_not() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let records = || Records::at(dir.path().to_path_buf());
        records().put(record("a", "1", "x")).expect("written");
        records().put(record("a", "2", "y")).expect("written");
        let path = records().path();
        let bytes = std::fs::read(&path).expect("a file");
        std::fs::write(&path, &bytes[..bytes.len() - 9]).expect("written");
        assert_eq!(keys(&records()), ["x"]);
        records().put(record("a", "3", "z")).expect("written");
        assert_eq!(keys(&records()), ["x", "z"]);
        records().settle().expect("written");
        let text = std::fs::read_to_string(&path).expect("a file");
        assert_eq!(text.lines().count(), 2, "{text}");
    }

    #[test]
    fn records_of_an_earlier_form_are_read_and_taken_over() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let records = || Records::at(dir.path().to_path_buf());
        std::fs::create_dir(dir.path().join("fit")).expect("a folder");
        let old = dir.path().join("fit/a.json");
        let text = serde_json::to_string_pretty(&*record("fit", "a", "old")).expect("JSON");
        std::fs::write(&old, text).expect("written");
        assert_eq!(keys(&records()), ["old"]);
        records().settle().expect("written");
        assert!(!old.exists() && !dir.path().join("fit").exists());
        assert_eq!(keys(&records()), ["old"]);
    }
}
