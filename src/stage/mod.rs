//! The stages: tables and a slice of the checked configuration come in, tables come out. No stage
//! opens a path.
//!
//! [`STAGES`] is the one list of them, in the order in which they run. Adding a stage is adding a
//! file here and a line there.

mod channels;
pub mod check;
mod correlations;
mod inputs;
mod kind;
mod notes;
mod slice;
mod told;

pub mod curve;
pub mod derive;
pub mod diagnose;
pub mod estimate;
pub mod figure;
pub mod fit;
pub mod ingest;
pub mod page;
pub mod reconstruct;
pub mod repeats;
pub mod report;
pub mod rerun;
pub mod review;
pub mod segment;
pub mod validate;

pub use channels::Channels;
pub use inputs::{Inputs, Output, Part};
pub use kind::{Campaign, Check, Known, Named, Read, Stage, Unit, code};
pub use notes::{NOTES, Note, STAGES_TABLE, Severity, notes_table};
pub use told::{Key, Told};

use inputs::series;
use slice::{said, slice_of, taken};

/// The stages in the order in which they run.
pub const STAGES: &[Stage] = &[
    ingest::STAGE,
    reconstruct::STAGE,
    derive::STAGE,
    segment::STAGE,
    estimate::STAGE,
    review::STAGE,
    repeats::STAGE,
    fit::STAGE,
    curve::STAGE,
    validate::STAGE,
    diagnose::STAGE,
    rerun::STAGE,
    figure::STAGE,
    page::STAGE,
    report::STAGE,
];
