//! An output folder comes in; every file of its last run that is not as it was recorded goes out.

use super::files;
use super::hashed;
use super::journal;
use super::origin::{Origin, folder};
use super::provenance::LOG;
use super::store::Store;
use crate::error::Result;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What is wrong with a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Fault {
    /// Its bytes have another hash than the record says.
    Differs,
    /// It is recorded and not there.
    Missing,
    /// It is in the output folder and no record names it.
    Unknown,
    /// It is there and cannot be read.
    Unreadable,
}

/// A file that is not as it was recorded.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Unlike {
    pub fault: Fault,
    /// The file, as this command can open it.
    pub path: String,
    /// What made it or used it.
    pub role: String,
}

/// What came of holding the files of a run against their records.
#[derive(Debug, Default, Serialize)]
pub struct Verified {
    /// How many files were as recorded.
    pub sound: usize,
    /// The others, in order of their paths.
    pub faults: Vec<Unlike>,
}

/// A file and what is known of it.
struct Recorded {
    hash: String,
    role: String,
}

/// Reads every file of the last run of a pipeline file and holds it against its recorded hash: none
/// is taken on trust because its size and time are as they were.
///
/// # Errors
/// There is no output folder, or an earlier program wrote it.
pub fn verify(store: &Store, pipeline: &Path) -> Result<Verified> {
    let origin = Origin::wanted(store)?;
    let recorded = recorded(store, &origin, pipeline);
    let mut verified = Verified::default();
    for (path, known) in &recorded {
        match fault(path, &known.hash) {
            None => verified.sound += 1,
            Some(fault) => verified.faults.push(Unlike {
                fault,
                path: path.display().to_string(),
                role: known.role.clone(),
            }),
        }
    }
    let is_known = |path: &PathBuf| recorded.contains_key(path) || is_journal(store, path);
    let unknown = files::all(store.root()).into_iter().filter(|path| !is_known(path));
    verified.faults.extend(unknown.map(|path| Unlike {
        fault: Fault::Unknown,
        path: path.display().to_string(),
        role: "no record names it".to_string(),
    }));
    verified.faults.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(verified)
}

/// Whether a file is what a run tells of its times, which no record names.
fn is_journal(store: &Store, path: &Path) -> bool {
    path.parent() == Some(store.root()) && journal::is_ours(path)
}

/// Every file that the records name.
fn recorded(store: &Store, origin: &Origin, pipeline: &Path) -> BTreeMap<PathBuf, Recorded> {
    let folder = folder(pipeline);
    let mut all = BTreeMap::new();
    let mut put = |path: PathBuf, hash: &String, role: String| {
        all.insert(path, Recorded { hash: hash.clone(), role });
    };
    for (path, hash) in &origin.settings {
        put(folder.join(path), hash, "settings".to_string());
    }
    for (path, filed) in &origin.tables {
        put(store.path(path), &filed.hash, "made by the pipeline itself".to_string());
    }
    for record in store.records() {
        let log = origin.logs.get(&record.unit);
        if let (Some(hash), Some(path)) = (record.ingredients.get(LOG), log) {
            put(folder.join(path), hash, format!("log of flight {}", record.unit));
        }
        for (path, hash) in &record.outputs {
            put(store.path(path), hash, format!("made by {} of {}", record.stage, record.unit));
        }
    }
    all
}

fn fault(path: &Path, hash: &str) -> Option<Fault> {
    if !path.exists() {
        return Some(Fault::Missing);
    }
    match hashed::hash(path) {
        Err(_) => Some(Fault::Unreadable),
        Ok(found) => (found != hash).then_some(Fault::Differs),
    }
}
