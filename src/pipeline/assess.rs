//! Fresh, stale or missing, and why: a plan and the output folder come in, the state of every unit
//! of every stage goes out.

use super::plan::Plan;
use super::provenance::{Ingredients, LOG, PLACE, Provenance, Reason, TWIN};
use super::store::Store;
use crate::error::Result;
use crate::stage::{Stage, Unit};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The state of one unit of a stage.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// Its outputs are what a run would make.
    Fresh,
    /// It was never run here.
    New,
    /// It would be run again: the reasons.
    Stale(Vec<Reason>),
    /// It failed, and what it is made from is as it was: it is tried again, and nothing is counted on
    /// that comes of it. The reason.
    Failed(String),
    /// What it reads is being made anew; whether it is run again depends on what comes out. The
    /// reasons.
    Waits(Vec<String>),
    /// It cannot be run, because something it needs is missing: what.
    Blocked(String),
}

/// Content of a file in the output folder, as far as it is known at this point of a run or of a dry
/// run.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// The hash of its bytes.
    Hash(String),
    /// A run would make it anew; the unit that would.
    Changing(String),
}

/// Contents by path relative to the output folder; an absent path is a file that is not there.
pub type Contents = BTreeMap<String, Content>;

/// The state of a unit and what it would be made from.
#[derive(Debug, Clone)]
pub struct Assessment {
    pub unit: Unit,
    pub state: State,
    pub ingredients: Ingredients,
    pub record: Option<Arc<Provenance>>,
}

/// Holds these units of a stage against the record of its last run, in order of units.
///
/// # Errors
/// A log or an output file is there and cannot be read.
pub fn assess(
    plan: &Plan,
    store: &Store,
    contents: &Contents,
    stage: &Stage,
    units: Vec<Unit>,
) -> Result<Vec<Assessment>> {
    units.into_par_iter().map(|unit| assess_unit(plan, store, contents, stage, unit)).collect()
}

fn assess_unit(
    plan: &Plan,
    store: &Store,
    contents: &Contents,
    stage: &Stage,
    unit: Unit,
) -> Result<Assessment> {
    let campaign = &plan.campaign;
    let record = store.record(stage.name, &unit.name);
    let mut ingredients = Ingredients::new(stage.code(), &(stage.slice)(campaign, &unit));
    if let Some(i) = unit.part.number() {
        ingredients.add(PLACE.into(), i.to_string());
    }
    let mut waits = Vec::new();
    let mut blocked = None;
    if stage.reads_log {
        match plan.log_hash(store, &unit.name)? {
            Some(hash) => ingredients.add(LOG.into(), hash),
            None => waits.push("its log is not there yet".to_string()),
        }
        let twin = plan.twin(store, &unit.name);
        twin.into_iter().for_each(|twin| ingredients.add(TWIN.into(), twin.clone()));
    }
    for read in (stage.reads)(campaign, &unit) {
        let words = read.part.words(read.table);
        match contents.get(&read.part.path(read.table)) {
            Some(Content::Hash(hash)) => ingredients.add(words, hash.clone()),
            Some(Content::Changing(by)) => waits.push(format!("{by} runs first")),
            None if read.optional => {}
            None => blocked = blocked.or(Some(format!("{words} is missing"))),
        }
    }
    // Several tables of one unit are one reason.
    let mut met = BTreeSet::new();
    waits.retain(|why| met.insert(why.clone()));
    let state = match (blocked, &record) {
        (Some(what), _) => State::Blocked(what),
        (None, None) => State::New,
        (None, Some(record)) => compare(store, stage, &unit, &ingredients, record, waits)?,
    };
    let state = match (state, (stage.idle)(campaign, &unit)) {
        (State::New | State::Stale(_) | State::Failed(_), Some(why)) => State::Blocked(why.into()),
        (state, _) => state,
    };
    Ok(Assessment { unit, state, ingredients, record })
}

fn compare(
    store: &Store,
    stage: &Stage,
    unit: &Unit,
    now: &Ingredients,
    record: &Provenance,
    waits: Vec<String>,
) -> Result<State> {
    let mut why = Vec::new();
    let error = record.error.as_ref().map(|error| error.lines().next().unwrap_or_default());
    why.extend(error.map(|error| Reason::Failed(error.to_string())));
    // What is being made anew is no difference yet.
    why.extend(
        now.differences(&record.ingredients)
            .into_iter()
            .filter(|d| waits.is_empty() || !matches!(d, Reason::Gone(_))),
    );
    for (path, hash) in &record.outputs {
        match store.memo.hash(&store.path(path))? {
            None => why.push(Reason::Removed(path.clone())),
            Some(found) if found != *hash => why.push(Reason::Touched(path.clone())),
            Some(_) => {}
        }
    }
    Ok(match (why.is_empty(), waits.is_empty()) {
        (false, true) if why.iter().all(|why| matches!(why, Reason::Failed(_))) => {
            State::Failed(format!("it failed, and is tried again: {}", error.unwrap_or_default()))
        }
        (false, _) => State::Stale(why),
        (true, false) => State::Waits(waits),
        (true, true) if now.key(stage.name, &unit.name) != record.key => {
            State::Stale(vec![Reason::Key])
        }
        (true, true) => State::Fresh,
    })
}

/// The units of which nothing will come, because of the flight's log: each has the reason added.
pub fn lost(plan: &Plan, store: &Store, all: &mut [Assessment]) -> BTreeSet<String> {
    let look = |a: &mut Assessment| {
        let why = match a.state {
            State::New | State::Stale(_) => plan.lost(store, a.unit.flight())?,
            _ => return None,
        };
        if let State::Stale(reasons) = &mut a.state {
            reasons.push(Reason::Fails(why));
        }
        Some(a.unit.name.clone())
    };
    all.par_iter_mut().filter_map(look).collect()
}

/// Adds what a unit's outputs are after this assessment: known where it is fresh, changing where it
/// would run, and not there where it would fail once more.
pub fn contents_after(stage: &Stage, assessment: &Assessment, contents: &mut Contents) {
    match (&assessment.state, &assessment.record) {
        (State::Blocked(_) | State::Failed(_), _) => {}
        (State::Fresh, Some(record)) => {
            contents.extend(
                record
                    .outputs
                    .iter()
                    .map(|(path, hash)| (path.clone(), Content::Hash(hash.clone()))),
            );
        }
        _ => {
            let part = &assessment.unit.part;
            let by = format!("{} of {}", stage.name, assessment.unit.name);
            contents.extend(
                stage.writes.iter().map(|table| (part.path(table), Content::Changing(by.clone()))),
            );
        }
    }
}
