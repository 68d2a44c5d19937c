//! A pipeline file comes in, stage by stage; the mistakes in what it says, at their places, go out.

mod columns;
mod drivers;
mod unknown;

use crate::config::Doc;
use crate::error::{Error, Errors};
use crate::model::{Constants, Model};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use columns::{Columns, Found};
pub use drivers::{Unlike, agree, driver, drivers, keys_are_known};
pub use unknown::unknown;

/// What a stage's settings are checked with, and the mistakes found so far.
#[derive(Debug)]
pub struct Given {
    /// The pipeline file: it says where a key stands.
    pub doc: Doc,
    /// Its folder: paths are relative to it.
    pub folder: PathBuf,
    /// The constants of the aircraft; none where their file has mistakes.
    pub aircraft: Option<Constants>,
    pub errors: Errors,
    /// The model files read so far, by path; none for one with mistakes, which are said once.
    models: BTreeMap<PathBuf, Option<Model>>,
}

impl Given {
    /// Nothing is known yet but the pipeline file.
    pub fn new(doc: Doc, folder: PathBuf) -> Given {
        let (errors, models) = (Errors::default(), BTreeMap::new());
        Given { doc, folder, aircraft: None, errors, models }
    }

    /// A path of the pipeline file.
    pub fn path(&self, relative: &str) -> PathBuf {
        self.folder.join(relative)
    }

    /// Files an error at a key of the pipeline file.
    pub fn push(&mut self, key: &str, what: impl Into<String>, help: &str) {
        let error = self.doc.error(key, what);
        self.errors.push(if help.is_empty() { error } else { error.help(help) });
    }

    /// Files an error: there is no such name among those known.
    pub fn unknown<S: AsRef<str>>(&mut self, key: &str, kind: &str, name: &str, known: &[S]) {
        self.errors.push(unknown(&self.doc, key, kind, name, known));
    }

    /// The unit of a column; files an error where there is no column of this name.
    pub fn look_up(
        &mut self,
        columns: &Columns,
        name: &str,
        kind: &str,
        key: &str,
    ) -> Option<String> {
        columns.look_up(name, kind, &self.doc, key, &mut self.errors)
    }

    /// Reports a file that is not there at the place that names it, which is where the mistake is.
    pub fn names_a_file(&mut self, key: &str, relative: &str) -> bool {
        let path = self.path(relative);
        let there = path.is_file();
        if !there {
            self.push(
                key,
                format!("there is no file {}", path.display()),
                "paths are relative to the folder of the pipeline file",
            );
        }
        there
    }

    /// A model file; none where it has mistakes, or the constants have.
    pub fn model(&mut self, key: &str, relative: &str) -> Option<Model> {
        if !self.names_a_file(key, relative) {
            return None;
        }
        let path = self.path(relative);
        let constants = self.aircraft.as_ref()?;
        if let Some(read) = self.models.get(&path) {
            return read.clone();
        }
        let model = self.errors.take(Model::load(&path, constants));
        self.models.insert(path, model.clone());
        model
    }

    /// Checks the entries of a list of the pipeline file, each of which has a name of its own.
    pub fn entries<S, C>(
        &mut self,
        list: &str,
        entries: Vec<S>,
        name: impl Fn(&S) -> String,
        read: impl Fn(&mut Given, &str, S) -> Option<C>,
    ) -> Vec<Option<C>> {
        let mut names: Vec<String> = Vec::new();
        let mut checked = Vec::new();
        for (i, settings) in entries.into_iter().enumerate() {
            let key = format!("{list}.{i}");
            self.new_name(&key, &name(&settings), &mut names);
            checked.push(read(self, &key, settings));
        }
        checked
    }

    /// Checks that a name is new and safe in a file's name.
    fn new_name(&mut self, key: &str, name: &str, names: &mut Vec<String>) {
        let clean = !name.is_empty()
            && name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))
            && !name.starts_with('.');
        if !clean {
            self.push(
                &format!("{key}.name"),
                format!("\"{name}\" is no name"),
                "use letters, digits, '.', '_' and '-'",
            );
        }
        if names.iter().any(|n| n == name) {
            self.push(
                &format!("{key}.name"),
                format!("the name \"{name}\" is taken"),
                "give it another `name`",
            );
        }
        names.push(name.to_string());
    }
}

/// A mistake without a place, as one of this key.
pub fn placed(doc: &Doc, key: &str, error: Error) -> Error {
    let here = doc.error(key, error.what);
    match error.help {
        Some(help) => here.help(help),
        None => here,
    }
}

/// The folders that a list of the pipeline file names; a mistake for each that is not there.
pub fn folders(given: &mut Given, key: &str, relative: &[String]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for (i, name) in relative.iter().enumerate() {
        let folder = given.path(name);
        if Path::is_dir(&folder) {
            found.push(folder);
        } else {
            given.push(
                &format!("{key}.{i}"),
                format!("there is no folder {}", folder.display()),
                "",
            );
        }
    }
    found
}
