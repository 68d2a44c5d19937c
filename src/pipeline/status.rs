//! What a run would do: the state of every unit, and what is no longer part of the campaign.

use super::assess::{Assessment, Content, Contents, State, assess, contents_after, lost};
use super::limits::Limits;
use super::origin::Origin;
use super::own::{own_parts, own_tables};
use super::plan::Plan;
use super::provenance::Provenance;
use super::store::Store;
use crate::error::Result;
use crate::stage::Stage;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Records of units that are no longer part of the campaign.
pub fn gone(plan: &Plan, store: &Store) -> Vec<Arc<Provenance>> {
    let of = |s: &Stage| {
        (s.units)(&plan.campaign)
            .into_iter()
            .map(|u| (s.name.to_string(), u.name))
            .collect::<Vec<_>>()
    };
    let wanted: BTreeSet<(String, String)> = plan.campaign.stages.iter().flat_map(of).collect();
    store
        .records()
        .into_iter()
        .filter(|r| !wanted.contains(&(r.stage.clone(), r.unit.clone())))
        .collect()
}

/// The state of every unit, without running anything.
///
/// # Errors
/// A log or an output file is there and cannot be read.
pub fn status(plan: &Plan, store: &Store) -> Result<Vec<(&'static Stage, Vec<Assessment>)>> {
    status_within(plan, store, &Limits::default())
}

/// The same of what a part of a run would take.
///
/// # Errors
/// As `status`.
pub fn status_within(
    plan: &Plan,
    store: &Store,
    limits: &Limits,
) -> Result<Vec<(&'static Stage, Vec<Assessment>)>> {
    let mut contents = Contents::new();
    let mut all = Vec::new();
    let mut fresh = Some((Vec::new(), Vec::new()));
    let filed = Origin::read(store).map(|origin| origin.tables).unwrap_or_default();
    let (of_flights, of_campaign) = limits.stages(plan);
    for stage in of_flights.iter().chain(of_campaign) {
        if stage.reads_records {
            match &fresh {
                Some((notes, records)) => {
                    for own in own_tables(notes, records) {
                        contents.insert(own.path(), Content::Hash(own.hash(&filed)?));
                    }
                }
                None => {
                    let of = own_parts(&plan.campaign).into_iter();
                    contents.extend(
                        of.map(|path| (path, Content::Changing("an earlier stage".into()))),
                    );
                }
            }
        }
        let mut units = (stage.units)(&plan.campaign);
        units.retain(|unit| limits.has(unit.flight()) || unit.flight().is_empty());
        let mut of_stage = assess(plan, store, &contents, stage, units)?;
        limits.anew(plan, stage, &mut of_stage);
        let lost = if stage.reads_log { lost(plan, store, &mut of_stage) } else { BTreeSet::new() };
        for a in &of_stage {
            // What others go on without is not there for them.
            if !lost.contains(&a.unit.name) {
                contents_after(stage, a, &mut contents);
            }
            match (&mut fresh, &a.state, &a.record) {
                (Some((notes, records)), State::Fresh, Some(record)) => {
                    notes.extend(record.notes.iter().cloned());
                    records.push(record.clone());
                }
                (Some((notes, _)), State::Failed(_), Some(record)) if !record.notes.is_empty() => {
                    notes.extend(record.notes.iter().cloned());
                }
                (_, State::Blocked(_), _) => {}
                _ => fresh = None,
            }
        }
        all.push((stage, of_stage));
    }
    Ok(all)
}
