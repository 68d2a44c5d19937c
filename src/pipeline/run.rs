//! The run: a plan and an output folder come in; stale units are run, those of a few flights at a
//! time and then those of the campaign stage by stage, in parallel, where the engine says; tables
//! go out.

mod filing;

use super::assess::{Assessment, Content, Contents, State, assess};
use super::gc;
use super::limits::Limits;
use super::made::Made;
use super::order;
use super::origin::Origin;
use super::own::{Filed, failure_note};
use super::owners::Owners;
use super::plan::Plan;
use super::provenance::Provenance;
use super::result::{Ended, Event, RunResult, StageResult, Watch};
use super::status::gone;
use super::store::Store;
use super::unit::{Item, Needed, UnitOfStage, Work};
use crate::engine::{self, Engine, Here, Kept, Said};
use crate::error::{Error, Errors, Result};
use crate::stage::{Read, Stage, Unit};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};

/// The state of a run while it goes through the stages.
struct Run<'a> {
    plan: &'a Plan,
    limits: &'a Limits,
    store: &'a Store,
    engine: &'a dyn Engine,
    watch: Watch<'a>,
    contents: Contents,
    /// Tables of this run: later stages need not read them back.
    kept: Kept,
    /// Records of the units that succeeded.
    records: Vec<Arc<Provenance>>,
    /// The pipeline's own tables.
    own: BTreeMap<String, Filed>,
    result: RunResult,
}

/// What became of one unit.
enum Outcome {
    Fresh(Arc<Provenance>),
    Ran(Arc<Provenance>),
    Failed(Errors),
    /// Not run; why, where earlier outputs were removed.
    Blocked(Option<String>),
}

/// Runs what is not fresh of a part of a campaign; what is left out stays as it is. The caller holds
/// the folder's lock.
///
/// # Errors
/// The output folder cannot be read or written. What fails inside a stage does not stop the others
/// and is in the result.
pub fn run(
    plan: &Plan,
    store: &Store,
    engine: &dyn Engine,
    watch: Watch,
    limits: &Limits,
) -> Result<RunResult> {
    let mut run = Run {
        plan,
        limits,
        store,
        engine,
        watch,
        contents: Contents::new(),
        kept: Kept::at_most(order::KEPT_BYTES),
        records: Vec::new(),
        own: Origin::read(store).map(|origin| origin.tables).unwrap_or_default(),
        result: RunResult::default(),
    };
    run.remove_what_is_gone()?;
    let (of_flights, of_campaign) = limits.stages(plan);
    run.flights(of_flights)?;
    for stage in of_campaign {
        if stage.reads_records {
            run.file_own_tables(stage)?;
        }
        let taken = run.stage(stage, None)?;
        run.settle(stage, taken);
    }
    run.sweep()?;
    store.settle()?;
    Origin::of(plan, std::mem::take(&mut run.own)).keep(store)?;
    run.result.files = run.contents.into_keys().collect();
    Ok(run.result)
}

impl Run<'_> {
    /// Takes the flights through the stages of their own, a few at a time. What came of it is told
    /// stage by stage: in the same order however many go together.
    fn flights(&mut self, stages: &'static [Stage]) -> Result<()> {
        let mut taken: Vec<Vec<(Unit, Outcome)>> = stages.iter().map(|_| Vec::new()).collect();
        let wide = self.engine.wide().unwrap_or_else(engine::threads);
        for block in order::blocks(&self.limits.flights(self.plan), wide) {
            for (stage, taken) in stages.iter().zip(&mut taken) {
                taken.extend(self.stage(stage, Some(block))?);
            }
        }
        stages.iter().zip(taken).for_each(|(stage, taken)| self.settle(stage, taken));
        Ok(())
    }

    /// Runs the units of a stage, of these flights alone where there are some; what came of each.
    fn stage(
        &mut self,
        stage: &'static Stage,
        flights: Option<&[String]>,
    ) -> Result<Vec<(Unit, Outcome)>> {
        let mut units = (stage.units)(&self.plan.campaign);
        units.retain(|unit| {
            flights.is_none_or(|flights| flights.iter().any(|id| id == unit.flight()))
        });
        let mut assessments = assess(self.plan, self.store, &self.contents, stage, units)?;
        self.limits.anew(self.plan, stage, &mut assessments);
        if assessments.is_empty() {
            return Ok(Vec::new());
        }
        let to_run: Vec<&Assessment> = assessments.iter().filter(|a| self.is_run(a)).collect();
        (self.watch)(Event::Stage { stage, to_run: to_run.len(), flights });
        let owners = Owners::of(stage, &assessments);
        // What is taken away goes first: its place may be another unit's now.
        let mut outcomes: Vec<Option<Outcome>> = assessments
            .iter()
            .map(|a| if self.is_run(a) { Ok(None) } else { self.spared(a, &owners).map(Some) })
            .collect::<Result<_>>()?;
        for (a, outcome) in assessments.iter().zip(&outcomes) {
            self.tell_spared(a, outcome.as_ref());
        }
        let ran = self.ran(stage, &to_run, &owners)?;
        let left = outcomes.iter_mut().filter(|outcome| outcome.is_none());
        left.zip(ran).for_each(|(outcome, ran)| *outcome = Some(ran));
        (self.watch)(Event::End);
        let units = assessments.iter().map(|a| a.unit.clone());
        let taken: Vec<(Unit, Outcome)> =
            units.zip(outcomes).filter_map(|(unit, outcome)| Some((unit, outcome?))).collect();
        taken.iter().for_each(|(_, outcome)| self.know(outcome));
        Ok(taken)
    }

    /// Later stages find what a unit has made.
    fn know(&mut self, outcome: &Outcome) {
        if let Outcome::Fresh(record) | Outcome::Ran(record) = outcome {
            let made = record.outputs.iter();
            self.contents
                .extend(made.map(|(path, hash)| (path.clone(), Content::Hash(hash.clone()))));
        }
    }

    /// Files what became of the units of a stage in the run's result.
    fn settle(&mut self, stage: &Stage, taken: Vec<(Unit, Outcome)>) {
        if taken.is_empty() {
            return;
        }
        let mut counts = StageResult { name: stage.name, ran: 0, fresh: 0, failed: 0, blocked: 0 };
        for (unit, outcome) in taken {
            self.take(stage, &unit, outcome, &mut counts);
        }
        self.result.stages.push(counts);
    }

    /// Whether a unit is run: it is neither blocked nor fresh.
    fn is_run(&self, a: &Assessment) -> bool {
        match a.state {
            State::Blocked(_) => false,
            State::Fresh => a.record.is_none(),
            _ => true,
        }
    }

    /// Tells what becomes of a unit that is not run.
    fn tell_spared(&self, a: &Assessment, outcome: Option<&Outcome>) {
        let ended = match (outcome, &a.state) {
            (Some(Outcome::Fresh(record)), _) => Ended::Kept(&record.notes),
            (Some(Outcome::Blocked(_)), State::Blocked(why)) => Ended::Blocked(why),
            _ => return,
        };
        (self.watch)(Event::Unit { unit: &a.unit, ended });
    }

    /// Runs units, and files what each of them made as soon as it is there.
    fn ran(&self, stage: &Stage, units: &[&Assessment], owners: &Owners) -> Result<Vec<Outcome>> {
        let items: Vec<Item> =
            units.iter().map(|a| self.item(stage, &a.unit)).collect::<Result<_>>()?;
        let outcomes: Vec<OnceLock<Result<Outcome>>> =
            units.iter().map(|_| OnceLock::new()).collect();
        let hear = |i: usize, said: Said| {
            let unit = &units[i].unit;
            (self.watch)(match &said {
                Said::Step(done, of) => Event::Step { unit, done: *done, of: *of },
                Said::Words(text) => Event::Told { unit, text },
            });
        };
        let here = Here { engine: self.engine, kept: &self.kept, hear: &hear };
        let work = Work { plan: self.plan, folder: self.store.root(), elsewhere: false };
        let take = |i: usize, made: Result<Made>| {
            let made = made.map_or_else(|e| Err(e.into()), |made| made.0);
            let filed = self.filed(stage, units[i], made, owners);
            let stopped =
                filed.as_ref().map_or_else(|e| Errors::from(e.clone()), |_| Errors::default());
            let ended = match &filed {
                Ok(Outcome::Ran(record)) => Ended::Made(&record.notes),
                Ok(Outcome::Failed(errors)) => Ended::Failed(errors),
                _ => Ended::Failed(&stopped),
            };
            (self.watch)(Event::Unit { unit: &units[i].unit, ended });
            drop(outcomes[i].set(filed));
        };
        match stage.spreads {
            true => engine::each_here::<UnitOfStage>(&here, &work, &items, &take),
            false => engine::each::<UnitOfStage>(&here, &work, &items, &take),
        }
        let missing = || Err(Error::new(format!("a unit of {} was not done", stage.name)));
        outcomes.into_iter().map(|outcome| outcome.into_inner().unwrap_or_else(missing)).collect()
    }

    /// A unit with what it reads.
    fn item(&self, stage: &Stage, unit: &Unit) -> Result<Item> {
        let needed = |read: Read| match self.contents.get(&read.part.path(read.table)) {
            Some(Content::Hash(hash)) => {
                Some(Needed { table: read.table.into(), part: read.part, key: hash.clone() })
            }
            _ => None,
        };
        let log = match stage.reads_log {
            true => Some(self.plan.log_hash(self.store, &unit.name)?.unwrap_or_default()),
            false => None,
        };
        let twin = log.as_ref().and_then(|_| self.plan.twin(self.store, &unit.name)).cloned();
        Ok(Item {
            twin,
            stage: stage.name.to_string(),
            unit: unit.clone(),
            tables: (stage.reads)(&self.plan.campaign, unit)
                .into_iter()
                .filter_map(needed)
                .collect(),
            log,
        })
    }

    /// Files what became of a unit in the run's result.
    fn take(&mut self, stage: &Stage, unit: &Unit, outcome: Outcome, counts: &mut StageResult) {
        match outcome {
            Outcome::Fresh(record) => {
                counts.fresh += 1;
                self.keep(record);
            }
            Outcome::Ran(record) => {
                counts.ran += 1;
                self.keep(record);
            }
            Outcome::Failed(errors) => {
                counts.failed += 1;
                self.result.notes.extend(errors.0.iter().map(|e| failure_note(stage, unit, e)));
                self.result.errors.0.extend(errors.0);
            }
            Outcome::Blocked(removed) => {
                counts.blocked += 1;
                self.result
                    .removed
                    .extend(removed.map(|why| format!("{} of {}: {why}", stage.name, unit.name)));
            }
        }
    }

    fn keep(&mut self, record: Arc<Provenance>) {
        self.result.notes.extend(record.notes.iter().cloned());
        self.records.push(record);
    }

    /// Removes the outputs of flights, estimates, fits and stages that are no longer part of the
    /// campaign.
    fn remove_what_is_gone(&mut self) -> Result<()> {
        for record in gone(self.plan, self.store) {
            self.store.forget(&record)?;
            self.result.removed.push(format!(
                "{} of {}, no longer part of the campaign",
                record.stage, record.unit
            ));
        }
        Ok(())
    }

    fn sweep(&self) -> Result<()> {
        let mut known: BTreeSet<String> = self.contents.keys().cloned().collect();
        if self.limits.leave_out() {
            let records = self.store.records();
            known.extend(records.iter().flat_map(|record| record.outputs.keys().cloned()));
            known.extend(self.own.keys().cloned());
        }
        self.store.sweep(&gc::tables(self.plan), &known)
    }
}
