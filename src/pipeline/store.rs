//! The output folder: records, tables and pages go in atomically, and come out as bytes; one run at
//! a time.

use super::files::{self, UNFINISHED, entries, make_parent, name, remove_file};
use super::hashed::cannot;
use super::hashing::write_table;
use super::memo::Memo;
use super::provenance::{Provenance, hash_bytes};
use super::records::Records;
use crate::error::{Error, Place, Result};
use crate::guard::{self, MARK};
use crate::report::is_of_report;
use crate::stage::Part;
use crate::table::{self, SCHEMA_VERSION, Table, Unfinished, Want, write_atomic};
use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// Where a pipeline's results go unless a command says otherwise: `out/` beside `pipeline.toml`;
/// pipelines of other names beside it keep theirs apart, in `out/<name>/`.
pub fn out_folder(pipeline: &Path) -> PathBuf {
    let out = pipeline.parent().unwrap_or_else(|| Path::new("")).join("out");
    let name = pipeline.file_stem().filter(|name| *name != "pipeline");
    name.map_or_else(|| out.clone(), |name| out.join(name))
}

/// The form of the records that this program writes. It reads those of form 2 as well, which had a
/// file for every unit, and of form 1, which have no values of settings either; their folders do not
/// say their form.
const FORM: u32 = 3;

/// An output folder.
#[derive(Debug)]
pub struct Store {
    root: PathBuf,
    pub memo: Memo,
    records: Records,
}

/// Held while a run writes into an output folder.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

impl Store {
    /// The output folder at `root`, which need not exist yet: nothing is written by opening it.
    pub fn open(root: &Path) -> Store {
        let mark = root.join(MARK);
        Store {
            root: root.to_path_buf(),
            memo: Memo::read(&mark.join("memo.json")),
            records: Records::at(mark),
        }
    }

    /// The same for a run that will write: the folder has to be one of ours, or new, or empty, unless
    /// `force` says that files of others may go.
    ///
    /// # Errors
    /// It has files of others, or records or tables that only a later program reads.
    pub fn claim(root: &Path, force: bool) -> Result<Store> {
        guard::folder(root, force)?;
        Store::look(root)
    }

    /// The same for reading alone.
    ///
    /// # Errors
    /// It has records of a form, or tables of a version, that only a later program reads.
    pub fn look(root: &Path) -> Result<Store> {
        let store = Store::open(root);
        readable(&root.join(MARK).join("records.jsonl"))?;
        if let Ok(said) = std::fs::read_to_string(store.tables_path()) {
            let place = Place::file(store.tables_path().to_string_lossy());
            table::known(&said, "the tables of this output folder have")
                .map_err(|e| Error { place: Some(place), ..e })?;
        }
        let path = store.form_path();
        let said = std::fs::read_to_string(&path).unwrap_or_else(|_| "1".into());
        match said.trim().parse::<u32>() {
            Ok(form) if form <= FORM => Ok(store),
            _ => Err(Error::at(
                Place::file(path.to_string_lossy()),
                format!(
                    "the records of this output folder have form {}; this program reads 1 to {FORM}",
                    said.trim()
                ),
            )
            .help("a later koehler wrote them: use that one, or another folder with --out")),
        }
    }

    fn form_path(&self) -> PathBuf {
        self.root.join(MARK).join("form")
    }

    /// Where the version of the tables stands, for programs that come upon the folder; those of
    /// programs before the first version say none.
    fn tables_path(&self) -> PathBuf {
        self.root.join(MARK).join("tables")
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    pub fn path(&self, relative: &str) -> PathBuf {
        self.root.join(relative)
    }

    /// Takes the folder for this run.
    ///
    /// # Errors
    /// Another run holds it, or the folder cannot be made.
    pub fn lock(&self) -> Result<Lock> {
        let path = self.root.join(MARK).join("lock");
        make_parent(&path)?;
        let file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&path)
            .map_err(|e| cannot("open", &path, &e))?;
        match file.try_lock() {
            Ok(()) => {
                // Another run may have written since they were read; those of an earlier form are
                // taken over before the folder says that it has this one.
                self.records.refresh();
                self.records.settle()?;
                self.put(&format!("{MARK}/form"), format!("{FORM}\n").as_bytes())?;
                self.put(&format!("{MARK}/tables"), format!("{SCHEMA_VERSION}\n").as_bytes())?;
                Ok(Lock { _file: file })
            }
            Err(std::fs::TryLockError::WouldBlock) => {
                Err(Error::new(format!("another run is writing into {}", self.root.display()))
                    .help("wait for it to end, or give this run its own folder with --out"))
            }
            Err(std::fs::TryLockError::Error(e)) => Err(cannot("lock", &path, &e)),
        }
    }

    /// The record of the last run of a stage for a unit; an unreadable one counts as absent.
    pub fn record(&self, stage: &str, unit: &str) -> Option<Arc<Provenance>> {
        self.records.get(stage, unit)
    }

    /// Every record in the folder, by stage and unit.
    pub fn records(&self) -> Vec<Arc<Provenance>> {
        self.records.all()
    }

    /// Files a record. It is written after the outputs it names, so that a run that is stopped
    /// leaves nothing half-made that would pass for fresh.
    pub fn put_record(&self, record: Arc<Provenance>) -> Result<()> {
        self.records.put(record)
    }

    /// Removes a record and every output it names.
    pub fn forget(&self, record: &Provenance) -> Result<()> {
        for output in record.outputs.keys() {
            self.remove(output)?;
        }
        self.remove_record(record)
    }

    /// Removes a record alone.
    pub fn remove_record(&self, record: &Provenance) -> Result<()> {
        self.records.remove(&record.stage, &record.unit)
    }

    /// Writes an output file and returns the hash of its bytes. A file that holds these bytes
    /// already is left alone.
    pub fn put(&self, relative: &str, bytes: &[u8]) -> Result<String> {
        let path = self.path(relative);
        let hash = hash_bytes(bytes);
        if self.memo.hash(&path)? != Some(hash.clone()) {
            write_atomic(&path, bytes)?;
        }
        Ok(hash)
    }

    /// Writes a table piece by piece, as `put`.
    pub fn put_table(&self, relative: &str, table: &Table) -> Result<String> {
        let path = self.path(relative);
        let mut file = Unfinished::beside(&path)?;
        let hash = write_table(table, file.0.as_file_mut(), &path)?;
        if self.memo.hash(&path)? != Some(hash.clone()) {
            file.finish(&path)?;
        }
        Ok(hash)
    }

    /// Reads a part of a table back.
    ///
    /// # Errors
    /// The file is not there, or is no part of this table.
    pub fn table(&self, name: &str, part: &Part) -> Result<Table> {
        table::read_file(&self.path(&part.path(name)), name, part.folder())
    }

    /// These columns of a part of a table.
    ///
    /// # Errors
    /// As `table`.
    pub fn columns(&self, name: &str, part: &Part, own: &[&str]) -> Result<Table> {
        let own: Vec<String> = own.iter().map(ToString::to_string).collect();
        let want = Want { own: Some(&own), ..Want::default() };
        table::read_wanted(&self.path(&part.path(name)), name, part.folder(), want)
    }

    /// Removes an output file, and its folder where that is empty now.
    pub fn remove(&self, relative: &str) -> Result<()> {
        if !Path::new(relative).components().all(|c| matches!(c, Component::Normal(_))) {
            return Ok(());
        }
        let path = self.path(relative);
        remove_file(&path)?;
        let mut folder = path.parent();
        while let Some(f) = folder.filter(|f| *f != self.root && f.starts_with(&self.root)) {
            if std::fs::remove_dir(f).is_err() {
                break;
            }
            folder = f.parent();
        }
        Ok(())
    }

    /// Removes what runs left in the named tables that were stopped.
    pub fn sweep(&self, tables: &BTreeSet<&str>, known: &BTreeSet<String>) -> Result<()> {
        self.leftovers(tables, known).iter().try_for_each(|path| self.remove(path))
    }

    /// The part files of the named tables and the pages that no record knows, and unfinished files
    /// wherever they are: leftovers of a run that was stopped. Relative to the folder.
    pub fn leftovers(&self, tables: &BTreeSet<&str>, known: &BTreeSet<String>) -> Vec<String> {
        let mut left = BTreeSet::new();
        for table in tables {
            let mut parts = Vec::new();
            for (path, is_folder) in files::listed(&self.root.join(table)) {
                if is_folder { parts.extend(entries(&path)) } else { parts.push(path) }
            }
            for path in parts {
                let name = name(&path);
                let is_part = name.starts_with("part-") && name.ends_with(".parquet");
                left.extend(self.relative(&path).filter(|r| is_part && !known.contains(r)));
            }
        }
        let every = files::all(&self.root).into_iter().chain(files::in_the_mark(&self.root));
        for path in every {
            let begun = name(&path).starts_with(UNFINISHED);
            let is_left = |path: &String| begun || (is_of_report(path) && !known.contains(path));
            left.extend(self.relative(&path).filter(is_left));
        }
        left.into_iter().collect()
    }

    fn relative(&self, path: &Path) -> Option<String> {
        let relative = path.strip_prefix(&self.root).ok()?;
        Some(relative.to_string_lossy().replace('\\', "/"))
    }

    /// Ends a run's writing: the records in order, and the memory of content hashes.
    pub fn settle(&self) -> Result<()> {
        self.records.settle()?;
        match self.memo.bytes() {
            Some(bytes) => write_atomic(&self.root.join(MARK).join("memo.json"), &bytes),
            None => Ok(()),
        }
    }
}

/// Whether the file of the records can be read, or is not there. One that is there and cannot be is not the
/// same as none: everything would be made again, and nothing would be said.
///
/// # Errors
/// It cannot be read.
fn readable(path: &Path) -> Result<()> {
    let opened = File::open(path).and_then(|file| file.metadata());
    let why = match opened {
        Ok(about) if about.is_file() => return Ok(()),
        Ok(_) => "it is no file".to_string(),
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(e) => e.to_string(),
    };
    let what = format!("the records of this output folder cannot be read: {why}");
    Err(Error::at(Place::file(path.to_string_lossy()), what).help(
        "make it readable; or remove it, and everything is made again; or take another folder with --out",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_run_is_refused_while_the_first_one_writes() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let store = Store::open(dir.path());
        let first = store.lock().expect("free");
        assert!(store.lock().is_err());
        drop(first);
        assert!(store.lock().is_ok());
    }

    #[test]
    fn fault_records_that_cannot_be_read_are_not_the_same_as_none() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        assert!(Store::look(dir.path()).is_ok(), "none yet");
        let path = dir.path().join(MARK).join("records.jsonl");
        std::fs::create_dir_all(&path).expect("a folder in its place");
        for opened in [Store::look(dir.path()), Store::claim(dir.path(), true)] {
            let e = opened.expect_err("refused").to_string();
            assert!(
                e.contains("records.jsonl: the records of this output folder cannot be read"),
                "{e}"
            );
        }
        std::fs::remove_dir(&path).expect("removed");
        std::fs::write(&path, b"").expect("written");
        assert!(Store::look(dir.path()).is_ok(), "readable");
    }

    #[test]
    fn leftovers_go_and_other_files_stay() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let store = Store::open(dir.path());
        store.put("signals/flight=a/part-0.parquet", b"kept").expect("written");
        store.put("signals/flight=b/part-0.parquet", b"left over").expect("written");
        store.put("signals/flight=a/.unfinished-1", b"half").expect("written");
        store.put("signals/readme.txt", b"somebody's").expect("written");
        store.put(".koehler/derive/.unfinished-2", b"half").expect("written");
        store.put("report/flights/a.html", b"kept").expect("written");
        store.put("report/flights/b.html", b"left over").expect("written");
        store.put("report/mine.html", b"somebody's").expect("written");
        let known = ["signals/flight=a/part-0.parquet", "report/flights/a.html"].map(String::from);
        let known = BTreeSet::from(known);
        store.sweep(&BTreeSet::from(["signals"]), &known).expect("swept");
        assert!(store.path("signals/flight=a/part-0.parquet").exists());
        assert!(!store.path("signals/flight=a/.unfinished-1").exists());
        assert!(!store.path(".koehler/derive/.unfinished-2").exists());
        assert!(!store.path("signals/flight=b").exists());
        assert!(store.path("signals/readme.txt").exists());
        assert!(store.path("report/flights/a.html").exists());
        assert!(!store.path("report/flights/b.html").exists());
        assert!(store.path("report/mine.html").exists());
    }

    #[test]
    fn nothing_outside_the_folder_is_removed() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let outside = dir.path().join("precious.txt");
        std::fs::write(&outside, b"keep").expect("written");
        let store = Store::open(&dir.path().join("out"));
        store.remove("../precious.txt").expect("ignored");
        assert!(outside.exists());
    }
}
