//! A file of an output folder comes in; the stages, settings and logs it was made from go out, as the
//! records tell them.

use super::origin::Origin;
use super::provenance::{LOG, PROGRAM, Provenance};
use super::store::Store;
use crate::error::{Error, Place, Result};
use crate::guard::MARK;
use crate::stage::{Part, STAGES};
use serde::Serialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Where a file comes from.
#[derive(Debug, Serialize)]
pub struct Lineage {
    /// The file, or each part of a table's folder, with the hash that is recorded.
    pub files: BTreeMap<String, String>,
    /// What made them and what that read, in the order of a run.
    pub stages: Vec<Step>,
    pub logs: Vec<Log>,
    /// Name of the pipeline file, and every settings file of the last run with its hash.
    pub pipeline: String,
    pub settings: BTreeMap<String, String>,
    /// What was made from another state of a table than is there now.
    pub outdated: Vec<String>,
}

/// Units of a stage that were run by one program with the same settings.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Step {
    pub stage: String,
    pub units: Vec<String>,
    /// Version of the program; none where it did not say.
    pub version: Option<String>,
    /// Hash of what the stage is made from.
    pub code: String,
    /// Values of the settings; none where an earlier program kept none.
    pub settings: Option<BTreeMap<String, Value>>,
}

/// A log, and what was read of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Log {
    pub flight: String,
    pub path: Option<String>,
    pub hash: String,
    /// Signals and samples of all of them that were kept, first and last time, s; none without the
    /// table `channels`.
    pub kept: Option<Kept>,
}

/// What was kept of a log.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Kept {
    pub signals: usize,
    pub samples: i64,
    pub from_s: f64,
    pub to_s: f64,
}

/// The output folder that a file stands in, and its path in there.
///
/// # Errors
/// It is not there, or in no output folder.
fn placed(file: &Path) -> Result<(PathBuf, String)> {
    let at = |what: String| Error::at(Place::file(file.to_string_lossy()), what);
    let path = file.canonicalize().map_err(|e| {
        at(format!("cannot find the file: {e}")).help(
            "name a table or a file of an output folder, as out/fits or out/report/index.html",
        )
    })?;
    let root = path.ancestors().skip(1).find(|folder| folder.join(MARK).is_dir());
    let relative = root.and_then(|root| path.strip_prefix(root).ok());
    match (root, relative) {
        (Some(root), Some(relative)) => {
            Ok((root.to_path_buf(), relative.to_string_lossy().replace('\\', "/")))
        }
        _ => Err(at(format!("no folder above it is an output folder (none has {MARK}/)"))
            .help("name a table or the report in the folder that a run wrote")),
    }
}

/// Where a table, a part of one, or a page comes from.
///
/// # Errors
/// It is in no output folder; no record names it; an earlier program wrote the folder.
pub fn lineage(file: &Path) -> Result<Lineage> {
    let (root, path) = placed(file)?;
    let store = Store::look(&root)?;
    let origin = Origin::wanted(&store)?;
    let records = store.records();
    let is_meant = |other: &String| *other == path || other.starts_with(&format!("{path}/"));
    let own = origin.tables.iter().map(|(path, filed)| (path, &filed.hash));
    let outputs = records.iter().flat_map(|record| &record.outputs).chain(own);
    let files: BTreeMap<String, String> = outputs
        .filter(|(path, _)| is_meant(path))
        .map(|(path, hash)| (path.clone(), hash.clone()))
        .collect();
    if files.is_empty() {
        let what = "no record names this file";
        return Err(Error::at(Place::file(file.to_string_lossy()), what)
            .help("the last run did not make it; `koehler verify PIPELINE` names all such files"));
    }
    let history = History { records: &records, origin: &origin, makers: makers(&records) };
    let (all, outdated) = history.of(&files);
    let stages = steps(&all);
    let logs = all.iter().filter_map(|record| log(&store, &origin, record)).collect();
    Ok(Lineage {
        files,
        stages,
        logs,
        pipeline: origin.pipeline.clone(),
        settings: origin.settings.clone(),
        outdated,
    })
}

/// The record of what made a part, by the part in words as ingredients name it.
fn makers(records: &[Arc<Provenance>]) -> BTreeMap<String, (usize, &String)> {
    let mut all = BTreeMap::new();
    for (i, record) in records.iter().enumerate() {
        for (path, hash) in &record.outputs {
            if let Some((table, part)) = Part::of_path(path) {
                all.insert(part.words(table), (i, hash));
            }
        }
    }
    all
}

struct History<'a> {
    records: &'a [Arc<Provenance>],
    origin: &'a Origin,
    makers: BTreeMap<String, (usize, &'a String)>,
}

impl<'a> History<'a> {
    /// The records behind these files in the order of a run, and what is outdated among them.
    fn of(&self, files: &BTreeMap<String, String>) -> (Vec<&'a Provenance>, Vec<String>) {
        let makes =
            |record: &Provenance| record.outputs.keys().any(|path| files.contains_key(path));
        let mut open: Vec<usize> = self.of_records(makes);
        // The pipeline's own tables tell of all units.
        if self.origin.tables.keys().any(|path| files.contains_key(path)) {
            open = self.of_records(|_| true);
        }
        let (mut seen, mut outdated) = (BTreeSet::new(), Vec::new());
        while let Some(i) = open.pop() {
            let Some(record) = self.records.get(i).filter(|_| seen.insert(i)) else { continue };
            for (name, hash) in &record.ingredients {
                let Some((maker, now)) = self.makers.get(name) else { continue };
                open.push(*maker);
                if *now != hash {
                    outdated.push(format!(
                        "{} of {} was made from another state of {name} than is there now",
                        record.stage, record.unit
                    ));
                }
            }
        }
        let record = |i: &usize| self.records.get(*i).map(Arc::as_ref);
        let mut all: Vec<&Provenance> = seen.iter().filter_map(record).collect();
        all.sort_by_key(|record| STAGES.iter().position(|stage| stage.name == record.stage));
        (all, outdated)
    }

    fn of_records(&self, is: impl Fn(&Provenance) -> bool) -> Vec<usize> {
        let all = self.records.iter().enumerate();
        all.filter(|(_, record)| is(record)).map(|(i, _)| i).collect()
    }
}

/// The records by stage, those of the same program and settings together.
fn steps(records: &[&Provenance]) -> Vec<Step> {
    let mut all: Vec<Step> = Vec::new();
    for record in records {
        let step = Step {
            stage: record.stage.clone(),
            units: Vec::new(),
            version: record.version.clone(),
            code: record.ingredients.get(PROGRAM).cloned().unwrap_or_default(),
            settings: record.settings.clone(),
        };
        let is_alike = |known: &&mut Step| Step { units: Vec::new(), ..(**known).clone() } == step;
        match all.iter_mut().find(is_alike) {
            Some(known) => known.units.push(record.unit.clone()),
            None => all.push(Step { units: vec![record.unit.clone()], ..step }),
        }
    }
    all
}

/// The log of a unit that read one.
fn log(store: &Store, origin: &Origin, record: &Provenance) -> Option<Log> {
    let hash = record.ingredients.get(LOG)?.clone();
    let path = origin.logs.get(&record.unit).cloned();
    Some(Log { flight: record.unit.clone(), path, hash, kept: kept(store, &record.unit) })
}

fn kept(store: &Store, flight: &str) -> Option<Kept> {
    let table = store.table("channels", &Part::Flight(flight.to_string())).ok()?;
    let least = |of: &[f64]| of.iter().copied().fold(f64::NAN, f64::min);
    let most = |of: &[f64]| of.iter().copied().fold(f64::NAN, f64::max);
    Some(Kept {
        signals: table.rows(),
        samples: table.i64("count").ok()?.iter().sum(),
        from_s: least(table.f64("t_first_s").ok()?),
        to_s: most(table.f64("t_last_s").ok()?),
    })
}
