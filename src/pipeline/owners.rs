//! The units of a stage come in; which of them a file belongs to goes out.

use super::assess::Assessment;
use crate::stage::{Stage, Unit};
use std::collections::BTreeMap;

/// Which unit of a stage a file belongs to, by its path: what one unit gives up may be another's.
pub struct Owners(BTreeMap<String, String>);

impl Owners {
    pub fn of(stage: &Stage, assessments: &[Assessment]) -> Owners {
        let paths = |unit: &Unit| {
            let (part, name) = (unit.part.clone(), unit.name.clone());
            stage.writes.iter().map(move |table| (part.path(table), name.clone()))
        };
        Owners(assessments.iter().flat_map(|a| paths(&a.unit)).collect())
    }

    /// Whether a unit may remove a file that it made earlier.
    pub fn leave(&self, path: &str, unit: &Unit) -> bool {
        self.0.get(path).is_none_or(|owner| *owner == unit.name)
    }
}
