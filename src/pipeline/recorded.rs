//! An output folder comes in; which files of its tables are results of a run goes out.

use super::origin::Origin;
use super::store::Store;
use crate::stage::{NOTES, STAGES, STAGES_TABLE};
use std::collections::BTreeSet;

/// The files of tables that records name.
pub struct Recorded {
    named: BTreeSet<String>,
    /// Tables whose files have to be named.
    tables: BTreeSet<&'static str>,
}

impl Recorded {
    /// Those of an output folder.
    pub fn of(store: &Store) -> Recorded {
        let origin = Origin::read(store);
        let mut tables: BTreeSet<&str> = STAGES.iter().flat_map(|s| s.writes).copied().collect();
        // What the pipeline itself writes is named by a run that has ended.
        tables.extend([NOTES, STAGES_TABLE].into_iter().filter(|_| origin.is_some()));
        let of_units = store.records().into_iter().flat_map(|record| record.outputs.clone());
        let own = origin.into_iter().flat_map(|origin| origin.tables.into_keys());
        Recorded { named: of_units.map(|(path, _)| path).chain(own).collect(), tables }
    }

    /// Whether a file of a table, by its path relative to the output folder, is a result: a record names it, or
    /// its table is none of a pipeline's, as that of a study of designs.
    pub fn has(&self, path: &str) -> bool {
        let table = path.split_once('/').map_or(path, |(table, _)| table);
        self.named.contains(path) || !self.tables.contains(table)
    }
}
