//! A plan and the records of its run come in; the optional signals that flights lack in which stages miss
//! something go out, in words.
//!
//! That a log may lack a signal makes its absence a warning at the first stage. What follows from it is met
//! stages later, in other words.

use super::flights::read;
use crate::config::list;
use crate::error::Result;
use crate::pipeline::{Plan, Store, named};
use crate::stage::{Part, Severity};
use indexmap::IndexMap;
use std::collections::{BTreeMap, BTreeSet};

/// A line for each set of signals, with the flights that lack them and the stages.
///
/// # Errors
/// A table cannot be read back.
pub fn lines(plan: &Plan, store: &Store) -> Result<Vec<String>> {
    let needed = needed(plan);
    let mut alike: IndexMap<(Vec<String>, Vec<&str>), Vec<String>> = IndexMap::new();
    for (flight, stages) in missing(plan, store).into_iter().filter(|_| !needed.is_empty()) {
        let lacking = without_sample(store, &flight, &needed)?;
        if !lacking.is_empty() {
            alike.entry((lacking, stages)).or_default().push(flight);
        }
    }
    let line = |((signals, stages), flights): ((Vec<String>, Vec<&str>), Vec<String>)| {
        format!("{}: no sample in {}; missed by {}", list(&signals), named(&flights), list(&stages))
    };
    Ok(alike.into_iter().map(line).collect())
}

/// Optional signals that a stage asks for.
fn needed(plan: &Plan) -> BTreeSet<String> {
    let campaign = &plan.campaign;
    let mut names: BTreeSet<String> = campaign.derive.inputs.iter().cloned().collect();
    if let Some(path) = &campaign.reconstruct {
        let known = &path.settings.method.signals;
        let inputs = path.model.inputs.iter();
        names.extend(inputs.map(|input| known.get(&input.name).unwrap_or(&input.name).clone()));
    }
    let searched = campaign.segment.iter().flat_map(|segment| &segment.settings.input);
    names.extend(searched.map(|input| input.signal.clone()));
    for estimate in &campaign.estimates {
        names.extend(estimate.columns());
        names.extend(estimate.outputs.iter().map(|scored| scored.measured.clone()));
    }
    let signals = &campaign.channels.map.signal;
    names.retain(|name| signals.get(name).is_some_and(|signal| signal.optional));
    names
}

/// The stages that have no result of a flight, or miss something in it, by flight.
fn missing(plan: &Plan, store: &Store) -> BTreeMap<String, Vec<&'static str>> {
    let mut all: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    let stages = plan.campaign.stages.iter();
    for stage in stages.filter(|stage| !stage.reads_log && !stage.reads_records) {
        let mut add = |flight: &str| {
            let of = all.entry(flight.to_string()).or_default();
            if of.last() != Some(&stage.name) {
                of.push(stage.name);
            }
        };
        for unit in (stage.units)(&plan.campaign) {
            let record = store.record(stage.name, &unit.name);
            if record.as_ref().is_none_or(|record| record.error.is_some()) {
                add(unit.flight());
            }
            let notes = record.iter().flat_map(|record| &record.notes);
            notes.filter(|n| n.severity == Severity::Missing).for_each(|note| add(&note.flight));
        }
    }
    all.remove("");
    all
}

/// Those of the signals of which a flight that was read has no sample.
fn without_sample(store: &Store, flight: &str, of: &BTreeSet<String>) -> Result<Vec<String>> {
    let Some(channels) = read(store, "channels", Part::Flight(flight.to_string()))? else {
        return Ok(Vec::new());
    };
    let rows = channels.strings("signal")?.into_iter().zip(channels.i64("count")?);
    let lacking = rows.filter(|(signal, count)| **count == 0 && of.contains(*signal));
    Ok(lacking.map(|(signal, _)| signal.to_string()).collect())
}
