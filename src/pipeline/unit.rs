//! A unit of a stage as a function: a plan and the names of what the unit reads come in, its tables,
//! files and notes go out, wherever it is run.

use super::made::Made;
use super::plan::Plan;
use crate::engine::{Blobs, Function, Kept, Key, Said, Source, decode, encode};
use crate::error::{Error, Place, Result};
use crate::stage::{Inputs, Part, Unit};
use crate::table::{Table, Want};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Runs one unit of a stage.
pub struct UnitOfStage;

/// What all units of a run have in common.
pub struct Work<'a> {
    pub plan: &'a Plan,
    /// The output folder, which holds the tables.
    pub folder: &'a Path,
    /// The plan was read again by another process than the one that runs it.
    pub elsewhere: bool,
}

impl<'a> Work<'a> {
    /// The log of a flight; elsewhere it has to be the same one.
    fn log(&self, flight: &str, key: &str) -> Result<&'a Path> {
        let log = self.plan.log(flight)?;
        if let Some(missing) = &log.missing {
            return Err(missing.clone());
        }
        let path = &log.path;
        if self.elsewhere && super::hashed::hash(path)? != key {
            return Err(Error::new(format!("{} is another log here", path.display())));
        }
        Ok(path)
    }
}

/// One unit, and what it reads.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Item {
    pub stage: String,
    pub unit: Unit,
    pub tables: Vec<Needed>,
    /// Content key of the flight's log, for a stage that reads it; the plan says where it is.
    pub log: Option<String>,
    /// The flight whose log it is besides.
    pub twin: Option<String>,
}

/// A part of a table that a unit reads.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Needed {
    pub table: String,
    pub part: Part,
    /// Content key of its file.
    pub key: String,
}

impl Needed {
    /// What the table is kept under. Files of two flights may be alike to the byte and are two
    /// tables.
    pub fn place(&self) -> Key {
        place(&self.part.path(&self.table), &self.key)
    }

    fn path(&self, folder: &Path) -> PathBuf {
        folder.join(self.part.path(&self.table))
    }

    /// That its file is the one that is meant.
    fn check(&self, folder: &Path) -> Result<()> {
        let path = self.path(folder);
        match super::hashed::hash(&path)? == self.key {
            true => Ok(()),
            false => Err(Error::new(format!("{} was changed meanwhile", path.display()))),
        }
    }

    fn read(&self, folder: &Path, want: Want) -> Result<Table> {
        let path = self.path(folder);
        let file = File::open(&path)
            .map_err(|e| Error::new(format!("cannot read {}: {e}", path.display())))?;
        Table::part_of_parquet(&self.table, file, self.part.folder(), want)
            .map_err(|e| Error { place: Some(Place::file(path.to_string_lossy())), ..e })
    }
}

/// What a table is kept under: its file, relative to the output folder, and the hash of its bytes.
pub fn place(path: &str, hash: &str) -> Key {
    Key(format!("{path} {hash}"))
}

/// Hash of everything that units take from a plan: flights, channel map, and of every unit of every
/// stage its place, what it reads and the configuration it sees.
fn fingerprint(plan: &Plan) -> Key {
    let campaign = &plan.campaign;
    let mut text = format!("{:?}\n{}\n", campaign.flights, campaign.channels.doc.text());
    for stage in campaign.stages {
        for unit in (stage.units)(campaign) {
            let (reads, slice) = ((stage.reads)(campaign, &unit), (stage.slice)(campaign, &unit));
            text += &format!("{} {} {unit:?} {reads:?} {slice}\n", stage.name, stage.code());
        }
    }
    Key::of(text.as_bytes())
}

impl Function for UnitOfStage {
    const NAME: &'static str = "unit of a stage";
    const VERSION: u32 = 1;
    type Parameters<'a> = Work<'a>;
    type Item = Item;
    type Output = Made;

    fn run(work: &Work, item: &Item, source: &Source) -> Result<Made> {
        // Who watches hears that it has begun.
        (source.tell)(Said::Step(0, 1));
        let campaign = &work.plan.campaign;
        let known = campaign.stages.iter().find(|stage| stage.name == item.stage);
        let stage = known.ok_or_else(|| Error::new(format!("no stage \"{}\"", item.stage)))?;
        if let Some(twin) = &item.twin {
            let name = &item.unit.name;
            let what = format!("the log of {name} is that of {twin}, byte for byte");
            return Err(Error::new(what)
                .help("take one of the two out of the campaign: a flight that is there twice counts twice"));
        }
        let log = match &item.log {
            Some(key) => Some(work.log(&item.unit.name, key)?),
            None => None,
        };
        let mut tables = BTreeMap::new();
        for needed in &item.tables {
            let name = crate::table::schema(&needed.table)?.name.as_str();
            tables.insert((name, needed.part.clone()), needed);
        }
        let table = |name, part: &Part, want: Want| {
            let needed = tables.get(&(name, part.clone()));
            let needed = needed.ok_or_else(|| Error::new(format!("no {}", part.words(name))))?;
            let read = |want| needed.read(work.folder, want);
            if want.is_all() {
                let whole = || needed.check(work.folder).and_then(|()| read(want));
                let table = source.kept.get_sized(&needed.place(), whole, Table::bytes)?;
                return Ok(Table::clone(&table));
            }
            // Many units look for their rows and columns in one file, each for others.
            let place = Key(format!("{} file", needed.place().0));
            source.kept.get(&place, || needed.check(work.folder))?;
            read(want)
        };
        let inputs = Inputs {
            parts: tables.keys().cloned().collect(),
            table: &table,
            log,
            progress: &|done, of| (source.tell)(Said::Step(done, of)),
            tell: &|text| (source.tell)(Said::Words(text.to_string())),
            engine: source.engine,
            kept: source.kept,
        };
        Ok(Made::here((stage.run)(campaign, &item.unit, &inputs)))
    }

    fn pack(work: &Work, _: &dyn Blobs) -> Result<Vec<u8>> {
        let absolute = |path: &Path| {
            std::path::absolute(path)
                .map_err(|e| Error::new(format!("cannot find {}: {e}", path.display())))
        };
        encode(&Packed {
            pipeline: absolute(&work.plan.pipeline)?,
            folder: absolute(work.folder)?,
            fingerprint: fingerprint(work.plan),
            told: serde_json::to_string(&work.plan.told).map_err(|e| Error::new(e.to_string()))?,
        })
    }

    fn lend(bytes: &[u8], source: &Source, to: &mut dyn FnMut(&Work) -> Result<()>) -> Result<()> {
        let packed: Packed = decode(bytes)?;
        let plan = source.kept.get(&Key::of(bytes), || packed.plan())?;
        to(&Work { plan: &plan, folder: &packed.folder, elsewhere: true })
    }
}

/// The plan by the files it is made from, and what a command changed in it.
#[derive(Serialize, Deserialize)]
struct Packed {
    pipeline: PathBuf,
    folder: PathBuf,
    /// Of the plan: files may have changed meanwhile, or be others.
    fingerprint: Key,
    /// What is said under the names of stages, as JSON: a command may have changed it.
    told: String,
}

impl Packed {
    fn plan(&self) -> Result<Plan> {
        let told = serde_json::from_str(&self.told).map_err(|e| Error::new(e.to_string()))?;
        let changed = |settings: &mut super::Settings| settings.told = told;
        let plan =
            Plan::read_with(&self.pipeline, changed).map_err(|e| Error::new(e.to_string()))?;
        match fingerprint(&plan) == self.fingerprint {
            true => Ok(plan),
            false => {
                Err(Error::new(format!("{} says something else here", self.pipeline.display())))
            }
        }
    }
}

/// Keeps a table where a unit that reads it finds it.
pub fn keep(kept: &Kept, path: &str, hash: &str, table: Table) {
    let bytes = table.bytes();
    kept.put(place(path, hash), Arc::new(table), bytes);
}
