//! A pipeline file comes in; it is planned (every mistake of every file is found first), then run
//! stage by stage as far as not fresh.

mod assess;
mod causes;
mod diff;
mod explain;
mod files;
mod gc;
mod hashed;
mod hashing;
mod journal;
mod limits;
mod lineage;
mod made;
mod memo;
mod order;
mod origin;
mod own;
mod owners;
mod plan;
mod provenance;
mod recorded;
mod records;
mod result;
mod run;
mod settings;
mod simulate;
mod status;
mod store;
mod unit;
mod values;
mod verify;

use crate::engine::Served;

pub use assess::{Assessment, State};
pub use causes::causes;
pub use diff::{Difference, Kind, Side, diff};
pub use explain::{Explained, explain, named};
pub use gc::{remove, unneeded};
pub use journal::Journal;
pub use limits::Limits;
pub use lineage::{Lineage, lineage};
pub use plan::{FlightLog, Plan, Source, Summaries, lacking};
pub use recorded::Recorded;
pub use result::{Ended, Event, RunResult, StageResult, Watch};
pub use run::run;
pub use settings::Settings;
pub use simulate::Simulation;
pub use status::{gone, status, status_within};
pub use store::{Lock, Store, out_folder};
use unit::UnitOfStage;
pub use values::shown;
pub use verify::{Fault, Verified, verify};

/// All work that an engine may move elsewhere.
pub const FUNCTIONS: &[Served] =
    &[Served::of::<UnitOfStage>(), Served::of::<crate::estimate::NormalEquations>()];
