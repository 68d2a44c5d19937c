//! A pipeline file comes in; it is planned (every mistake of every file is found first), then run
//! stage by stage as far as not fresh.

mod assess;
mod mapped;
mod plan;
mod provenance;
mod run;
mod settings;
mod simulate;
mod store;
mod summaries;
mod unit;

mod memo;

use crate::engine::Served;

pub use assess::{Assessment, State};
pub use plan::{FlightLog, Plan};
pub use run::{Event, RunResult, StageResult, Watch, gone, run, status};
pub use settings::Settings;
pub use simulate::Simulation;
pub use store::{Lock, Store};
pub use summaries::{Summaries, summaries};
use unit::UnitOfStage;

/// All work that an engine may move elsewhere.
pub const FUNCTIONS: &[Served] =
    &[Served::of::<UnitOfStage>(), Served::of::<crate::estimate::NormalEquations>()];
