//! A plan and its output folder come in; the files that no unit of the plan needs go out, to be
//! removed.

use super::files;
use super::origin::Origin;
use super::own::own_parts;
use super::plan::Plan;
use super::provenance::Provenance;
use super::status::gone;
use super::store::Store;
use crate::error::Result;
use crate::stage::{NOTES, Part, STAGES_TABLE};
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
    let origin = Origin::read(store);
    let mut all = BTreeMap::new();
    for path in store.leftovers(&tables(plan), &known) {
        let why = notes_of_gone(&path, origin.as_ref());
        all.insert(store.path(&path), why.unwrap_or_else(|| left(&path)));
    }
    for record in &gone {
        let why = format!("{} of {} is no longer part of the campaign", record.stage, record.unit);
        for path in record.outputs.keys().filter(|path| !known.contains(*path)) {
            all.insert(store.path(path), why.clone());
        }
    }
    all.into_iter().filter_map(|(path, why)| file(path, why)).collect()
}

/// Why there are notes that the last run filed of a flight which the plan has no more; none where it filed no
/// such file.
fn notes_of_gone(path: &str, origin: Option<&Origin>) -> Option<String> {
    let origin = origin.filter(|origin| origin.tables.contains_key(path))?;
    let is_of = |flight: &&String| Part::Of(0, flight.to_string()).path(NOTES) == path;
    let flight = origin.logs.keys().find(is_of)?;
    Some(format!("notes on {flight}, which is no longer part of the campaign"))
}

/// Why there is a file that no record names.
fn left(path: &str) -> String {
    let name = path.rsplit('/').next().unwrap_or(path);
    match name.starts_with(files::UNFINISHED) {
        true => "left by a run that was stopped".to_string(),
        false => "no record of a run names it".to_string(),
    }
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
    forget_own(store, unneeded)?;
    store.settle()
}

/// What the pipeline itself had written is not wanted any more where it was removed.
fn forget_own(store: &Store, removed: &[Unneeded]) -> Result<()> {
    let Some(mut origin) = Origin::read(store) else { return Ok(()) };
    let before = origin.tables.len();
    origin.tables.retain(|table, _| removed.iter().all(|file| file.path != store.path(table)));
    if origin.tables.len() == before { Ok(()) } else { origin.keep(store) }
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
