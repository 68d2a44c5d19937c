//! A plan and its output folder come in; the files that no unit of the plan needs go out, to be
//! removed.

use super::files;
use super::own::own_parts;
use super::plan::Plan;
use super::provenance::Provenance;
use super::status::gone;
use super::store::Store;
use crate::error::Result;
use crate::stage::{NOTES, STAGES_TABLE};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// A file that nothing needs.
#[derive(Debug, Clone, PartialEq)]
pub struct Unneeded {
    pub path: PathBuf,
    pub bytes: u64,
    pub why: String,
}

/// The files of an output folder that no unit of the plan needs, in order of their paths: what units
/// made that are no longer part of the campaign, and what runs left that were stopped. Files of others are none of these.
pub fn unneeded(plan: &Plan, store: &Store) -> Vec<Unneeded> {
    let gone = gone(plan, store);
    let is_gone = |r: &Provenance| gone.iter().any(|g| (&g.stage, &g.unit) == (&r.stage, &r.unit));
    let records = store.records();
    let kept = records.iter().filter(|record| !is_gone(record));
    let known: BTreeSet<String> = kept
        .flat_map(|record| record.outputs.keys().cloned())
        .chain(own_parts(&plan.campaign))
        .collect();
    let mut all = BTreeMap::new();
    for path in store.leftovers(&tables(plan), &known) {
        all.insert(store.path(&path), "left by a run that was stopped".to_string());
    }
    for record in &gone {
        let why = format!("{} of {} is no longer part of the campaign", record.stage, record.unit);
        for path in record.outputs.keys().filter(|path| !known.contains(*path)) {
            all.insert(store.path(path), why.clone());
        }
    }
    all.into_iter().filter_map(|(path, why)| file(path, why)).collect()
}

/// Removes such files, folders that are empty then, and the records of units that the plan has no more.
///
/// # Errors
/// One cannot be removed.
pub fn remove(plan: &Plan, store: &Store, unneeded: &[Unneeded]) -> Result<()> {
    for file in unneeded {
        match file.path.strip_prefix(store.root()) {
            Ok(relative) => store.remove(&relative.to_string_lossy())?,
            Err(_) => files::remove_file(&file.path)?,
        }
    }
    gone(plan, store).iter().try_for_each(|record| store.remove_record(record))?;
    store.settle()
}

/// The tables that a run of this plan writes.
pub fn tables(plan: &Plan) -> BTreeSet<&'static str> {
    let written = plan.campaign.stages.iter().flat_map(|stage| stage.writes).copied();
    written.chain([NOTES, STAGES_TABLE]).collect()
}

/// None where the file is not there.
fn file(path: PathBuf, why: String) -> Option<Unneeded> {
    let bytes = path.symlink_metadata().ok()?.len();
    Some(Unneeded { path, bytes, why })
}
