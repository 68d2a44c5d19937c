//! What a unit made, or had made before, comes in; files in the output folder, and the record of it,
//! go out.

use super::{Outcome, Run};
use crate::error::{Errors, Result};
use crate::pipeline::assess::{Assessment, Content, State};
use crate::pipeline::made::{Product, Sheet};
use crate::pipeline::own::{Filed, Own, failure_note, own_tables};
use crate::pipeline::owners::Owners;
use crate::pipeline::provenance::{Provenance, VERSION};
use crate::pipeline::unit::keep;
use crate::stage::{Part, Stage, Unit};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

impl Run<'_> {
    /// What becomes of a unit that is not run.
    pub(super) fn spared(&self, a: &Assessment, owners: &Owners) -> Result<Outcome> {
        match (&a.state, &a.record) {
            (State::Blocked(what), record) => {
                self.give_up(a, &BTreeMap::new(), owners)?;
                record.iter().try_for_each(|record| self.store.remove_record(record))?;
                Ok(Outcome::Blocked(record.as_ref().map(|_| what.clone())))
            }
            (_, None) => Ok(Outcome::Blocked(None)),
            (_, Some(record)) => Ok(Outcome::Fresh(self.with_settings(a, record)?)),
        }
    }

    /// The record of a fresh unit. One of an earlier program is given the values of its settings:
    /// their hashes say that they are these.
    pub(super) fn with_settings(
        &self,
        a: &Assessment,
        record: &Arc<Provenance>,
    ) -> Result<Arc<Provenance>> {
        if record.settings.is_some() {
            return Ok(Arc::clone(record));
        }
        let settings = Some(a.ingredients.settings.clone());
        let record = Arc::new(Provenance { settings, ..Provenance::clone(record) });
        self.store.put_record(Arc::clone(&record))?;
        Ok(record)
    }

    /// Removes what a unit made earlier and does not make now.
    fn give_up(
        &self,
        a: &Assessment,
        made: &BTreeMap<String, String>,
        owners: &Owners,
    ) -> Result<()> {
        let earlier = a.record.iter().flat_map(|earlier| earlier.outputs.keys());
        earlier
            .filter(|path| !made.contains_key(*path) && owners.leave(path, &a.unit))
            .try_for_each(|path| self.store.remove(path))
    }

    /// Files what a unit made, and its record.
    pub(super) fn filed(
        &self,
        stage: &Stage,
        a: &Assessment,
        made: std::result::Result<Product, Errors>,
        owners: &Owners,
    ) -> Result<Outcome> {
        let mut record = Provenance {
            stage: stage.name.to_string(),
            unit: a.unit.name.clone(),
            key: a.ingredients.key(stage.name, &a.unit.name),
            ingredients: a.ingredients.hashes.clone(),
            outputs: BTreeMap::new(),
            notes: Vec::new(),
            error: None,
            asked: (stage.asked)(&self.plan.campaign, &a.unit),
            settings: Some(a.ingredients.settings.clone()),
            version: Some(VERSION.to_string()),
        };
        let failed = match made {
            Ok(product) => {
                self.file(&a.unit, product, &mut record)?;
                None
            }
            Err(errors) => {
                record.error = Some(errors.to_string());
                let said = errors.0.iter().map(|e| failure_note(stage, &a.unit, e));
                record.notes = said.collect();
                Some(errors)
            }
        };
        self.give_up(a, &record.outputs, owners)?;
        let record = Arc::new(record);
        self.store.put_record(Arc::clone(&record))?;
        Ok(failed.map_or_else(|| Outcome::Ran(record), Outcome::Failed))
    }

    /// Writes a unit's outputs and enters them in its record.
    fn file(&self, unit: &Unit, product: Product, record: &mut Provenance) -> Result<()> {
        for (name, sheet) in product.tables {
            let path = unit.part.path(name);
            let hash = match sheet {
                Sheet::File(bytes) => self.store.put(&path, &bytes)?,
                Sheet::Table(table) => {
                    let hash = self.store.put_table(&path, &table)?;
                    keep(&self.kept, &path, &hash, table);
                    hash
                }
            };
            record.outputs.insert(path, hash);
        }
        for (path, bytes) in product.files {
            let hash = self.store.put(&path, &bytes)?;
            record.outputs.insert(path, hash);
        }
        record.notes = product.notes;
        // Whatever a unit of one flight says is about that flight.
        let silent = record.notes.iter_mut().filter(|note| note.flight.is_empty());
        silent.for_each(|note| note.flight = unit.flight().to_string());
        Ok(())
    }

    /// Writes those of the pipeline's own tables, notes and provenance so far, that a stage shows; all
    /// of them where nothing is to be shown.
    pub(super) fn file_own_tables(&mut self, stage: &Stage) -> Result<()> {
        let unit = (stage.units)(&self.plan.campaign).into_iter().next();
        let reads = unit.map(|unit| (stage.reads)(&self.plan.campaign, &unit));
        let is_shown = |own: &Own| {
            reads.as_ref().is_none_or(|reads| reads.iter().any(|read| read.table == own.name()))
        };
        let mut shown = own_tables(&self.result.notes, &self.records);
        shown.retain(is_shown);
        // Of a flight that has no notes any more there is no part.
        let mut earlier = std::mem::take(&mut self.own);
        let names: BTreeSet<&str> = shown.iter().map(Own::name).collect();
        let is_filed =
            |path: &str| Part::of_path(path).is_some_and(|(table, _)| names.contains(table));
        self.own = earlier.extract_if(.., |path, _| !is_filed(path)).collect();
        for own in shown {
            let (path, of) = (own.path(), Some(own.of()));
            let hash = match earlier.get(&path).filter(|filed| filed.of == of) {
                Some(filed) if self.is_there(&path, &filed.hash)? => filed.hash.clone(),
                _ => {
                    let table = own.table()?;
                    let hash = self.store.put_table(&path, &table)?;
                    keep(&self.kept, &path, &hash, table);
                    hash
                }
            };
            self.contents.insert(path.clone(), Content::Hash(hash.clone()));
            self.own.insert(path, Filed { hash, of });
        }
        Ok(())
    }

    /// Whether a file of the output folder has these bytes.
    fn is_there(&self, path: &str, hash: &str) -> Result<bool> {
        Ok(self.store.memo.hash(&self.store.path(path))?.as_deref() == Some(hash))
    }
}
