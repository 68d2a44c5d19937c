//! A plan and an output folder come in; why units are fresh, stale or missing goes out: one line per
//! cause, settings with their old and new values.

use super::assess::{Assessment, State};
use super::plan::Plan;
use super::provenance::{Ingredients, LOG, PLACE, PROGRAM, Provenance, Reason};
use super::status::{gone, status};
use super::store::Store;
use super::values::{changes, shown};
use crate::config::list;
use crate::error::{Error, Errors};
use crate::stage::{NOTES, STAGES_TABLE, Stage};
use std::collections::{BTreeMap, BTreeSet};

/// The state of units of a stage that are in it for the same causes.
#[derive(Debug, Clone, PartialEq)]
pub struct Explained {
    pub stage: String,
    pub units: Vec<String>,
    /// `fresh`, `stale`, `missing`, `blocked` or `gone`.
    pub state: &'static str,
    /// One line each.
    pub causes: Vec<String>,
    /// Where units wait for others: those at the beginning of the chain, and why they are run.
    pub roots: Vec<Explained>,
}

/// Characters of a value that are shown where its old one is not known.
const SHOWN: usize = 120;

/// The units of a plan with their states, in the order of a run.
type States = Vec<(&'static Stage, Vec<Assessment>)>;

/// A unit by the places of its stage and of itself.
type At = (usize, usize);

/// Explains the units of a stage, one unit of it, or (of no stage) all of them.
///
/// # Errors
/// There is no such stage or unit; a log or an output file is there and cannot be read.
pub fn explain(
    plan: &Plan,
    store: &Store,
    stage: Option<&str>,
    unit: Option<&str>,
) -> std::result::Result<Vec<Explained>, Errors> {
    let states = status(plan, store)?;
    let is_asked = |of: &str, name: &str| {
        stage.is_none_or(|stage| stage == of) && unit.is_none_or(|unit| is_of(unit, name))
    };
    let tree = Tree::of(plan, &states);
    let mut all = Vec::new();
    for (i, (of, assessments)) in states.iter().enumerate() {
        for (j, a) in
            assessments.iter().enumerate().filter(|(_, a)| is_asked(of.name, &a.unit.name))
        {
            all.push(tree.explained((i, j), one(of, a)));
        }
    }
    let gone = gone(plan, store).into_iter().filter(|r| is_asked(&r.stage, &r.unit));
    all.extend(gone.map(|record| Explained {
        stage: record.stage.clone(),
        units: vec![record.unit.clone()],
        state: "gone",
        causes: vec!["no longer part of the campaign: a run removes what it made".to_string()],
        roots: Vec::new(),
    }));
    match all.is_empty() {
        true => Err(no_such(&states, stage, unit).into()),
        false => Ok(together(all)),
    }
}

/// Whether a unit is the one named, or what a flight has of it.
fn is_of(named: &str, unit: &str) -> bool {
    unit.strip_prefix(named).is_some_and(|rest| rest.is_empty() || rest.starts_with(" of "))
}

/// Which name there is not, and which there are.
fn no_such(states: &States, stage: Option<&str>, unit: Option<&str>) -> Error {
    let of = states.iter().find(|(of, _)| Some(of.name) == stage);
    match (of, unit) {
        (Some((of, assessments)), Some(unit)) if !assessments.is_empty() => {
            let names: Vec<&str> = assessments.iter().map(|a| a.unit.name.as_str()).collect();
            Error::new(format!("{} is not run for \"{unit}\"", of.name))
                .help(format!("it is run for {}", list(&names)))
        }
        (Some((of, _)), _) => {
            Error::new(format!("this campaign has nothing for {} to do", of.name))
        }
        (None, _) => {
            let names: Vec<&str> = states.iter().map(|(of, _)| of.name).collect();
            Error::new(format!("there is no stage \"{}\"", stage.unwrap_or_default()))
                .help(format!("the stages are {}", list(&names)))
        }
    }
}

/// Units that follow each other and have the same causes become one.
fn together(all: Vec<Explained>) -> Vec<Explained> {
    let mut joined: Vec<Explained> = Vec::new();
    for next in all {
        match joined.last_mut() {
            Some(last)
                if (&last.stage, last.state, &last.causes, &last.roots)
                    == (&next.stage, next.state, &next.causes, &next.roots) =>
            {
                last.units.extend(next.units);
            }
            _ => joined.push(next),
        }
    }
    joined
}

/// A unit by itself.
fn one(stage: &Stage, a: &Assessment) -> Explained {
    let (state, causes) = match (&a.state, &a.record) {
        (State::Fresh, Some(record)) => ("fresh", fresh(&a.ingredients, record)),
        (State::Fresh, None) => ("fresh", Vec::new()),
        (State::New, _) => ("missing", vec!["never run here".to_string()]),
        (State::Stale(reasons), record) => {
            let words = |reason| stale(reason, &a.ingredients, record.as_deref());
            ("stale", reasons.iter().flat_map(words).collect())
        }
        (State::Waits(reasons), _) => ("stale", reasons.clone()),
        (State::Failed(why), _) => ("stale", vec![why.clone()]),
        (State::Blocked(what), _) => ("blocked", vec![what.clone()]),
    };
    Explained {
        stage: stage.name.to_string(),
        units: vec![a.unit.name.clone()],
        state,
        causes,
        roots: Vec::new(),
    }
}

/// What was compared and found to be as it was.
fn fresh(now: &Ingredients, record: &Provenance) -> Vec<String> {
    let others = [PROGRAM, PLACE, LOG];
    let is_table = |name: &&str| !others.contains(name) && !now.settings.contains_key(*name);
    let tables = now.hashes.keys().map(String::as_str).filter(is_table).count();
    let by = record.version.as_ref().map_or(String::new(), |v| format!(" (koehler {v} ran it)"));
    let many = |n: usize, one: &str, more: &str| match n {
        1 => format!("{one} is as it was"),
        n => format!("{n} {more} are as they were"),
    };
    let mut all = vec![
        format!("the program of this stage is as it was{by}"),
        many(now.settings.len(), "its setting", "settings"),
    ];
    all.extend(now.hashes.contains_key(LOG).then(|| "the log is as it was".to_string()));
    all.extend(
        (tables > 0).then(|| many(tables, "the table that it reads", "tables that it reads")),
    );
    all.push(many(record.outputs.len(), "the file that it made", "files that it made"));
    all
}

/// Why a unit is run again, in one line or in one per value that changed.
fn stale(reason: &Reason, now: &Ingredients, record: Option<&Provenance>) -> Vec<String> {
    let old = record.and_then(|record| record.settings.as_ref());
    let is_setting = |name: &String| {
        now.settings.contains_key(name) || old.is_some_and(|old| old.contains_key(name))
    };
    match reason {
        Reason::New(name) | Reason::Changed(name) | Reason::Gone(name) if is_setting(name) => {
            let Some(old) = old else {
                let value = now.settings.get(name).map_or(String::new(), |v| shown(v, SHOWN));
                return vec![format!(
                    "{reason}: it is {value} now; what it was is not known, because an earlier koehler kept no values"
                )];
            };
            let changes = changes(old.get(name), now.settings.get(name));
            changes.iter().map(|change| format!("{name}{change}")).collect()
        }
        Reason::Changed(name) if name == PROGRAM => vec![program(record)],
        other => vec![other.to_string()],
    }
}

fn program(record: Option<&Provenance>) -> String {
    let by = record.and_then(|record| record.version.as_ref());
    let by = by.map_or(String::new(), |version| format!(" (koehler {version} ran it)"));
    format!(
        "the program changed: the sources of this stage, a dependency or the compiler is another{by}"
    )
}

/// Which unit makes what another reads.
struct Tree<'a> {
    plan: &'a Plan,
    states: &'a States,
    writers: BTreeMap<String, At>,
}

impl Tree<'_> {
    fn of<'a>(plan: &'a Plan, states: &'a States) -> Tree<'a> {
        let mut writers = BTreeMap::new();
        for (i, (stage, assessments)) in states.iter().enumerate() {
            for (j, a) in assessments.iter().enumerate() {
                writers.extend(stage.writes.iter().map(|t| (a.unit.part.path(t), (i, j))));
            }
        }
        Tree { plan, states, writers }
    }

    fn get(&self, (i, j): At) -> Option<(&'static Stage, &Assessment)> {
        let (stage, assessments) = self.states.get(i)?;
        Some((*stage, assessments.get(j)?))
    }

    /// The units that make what this one reads and are not fresh.
    fn above(&self, at: At) -> Vec<At> {
        let Some((stage, a)) = self.get(at) else { return Vec::new() };
        let mut all = BTreeSet::new();
        for read in (stage.reads)(&self.plan.campaign, &a.unit) {
            if [NOTES, STAGES_TABLE].contains(&read.table) {
                let earlier = self.writers.values().filter(|other| other.0 < at.0);
                all.extend(earlier.copied());
            } else {
                all.extend(self.writers.get(&read.part.path(read.table)).copied());
            }
        }
        let works = |at: &At| self.get(*at).is_some_and(|(_, a)| a.state != State::Fresh);
        all.into_iter().filter(works).collect()
    }

    /// A unit with what it waits for: that it does says nothing more then.
    fn explained(&self, at: At, alone: Explained) -> Explained {
        let state = self.get(at).map(|(_, a)| &a.state);
        let roots = match state {
            Some(State::Waits(_) | State::Stale(_)) => self.roots(at),
            _ => Vec::new(),
        };
        let only_waits = matches!(state, Some(State::Waits(_))) && !roots.is_empty();
        let causes = if only_waits { Vec::new() } else { alone.causes };
        Explained { causes, roots, ..alone }
    }

    /// Of all units that one waits for, over others, those that are run for causes of their own.
    fn roots(&self, at: At) -> Vec<Explained> {
        let (mut seen, mut open) = (BTreeSet::new(), self.above(at));
        while let Some(next) = open.pop() {
            if seen.insert(next) {
                open.extend(self.above(next));
            }
        }
        let has_cause = |at: &&At| match self.get(**at).map(|(_, a)| &a.state) {
            Some(State::Stale(_)) => true,
            // That it was never run is the cause only where nothing before it is in its way.
            Some(State::New) => self.above(**at).is_empty(),
            _ => false,
        };
        let roots = seen.iter().filter(has_cause).filter_map(|at| self.get(*at));
        together(roots.map(|(stage, a)| one(stage, a)).collect())
    }
}

/// Units in words, cut where there are many: `flight-1, flight-2 and 16 more`.
pub fn named(units: &[String]) -> String {
    const NAMED: usize = 4;
    let shown = units.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ");
    match units.len().saturating_sub(NAMED) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}
