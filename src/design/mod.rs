//! A study of input designs in; every design flown by a campaign's truth model, recorded by its
//! sensors, estimated, and ranked by the Cramer-Rao bound of what was estimated, out.
//!
//! | file | what it does |
//! |---|---|
//! | `settings` | the study file |
//! | `rows` | designs that a list of the study file stands for |
//! | `study` | the study file with everything it names, checked |
//! | `check` | the mistakes that the schema cannot find |
//! | `columns` | a recording as columns of one grid, as a model asks for them |
//! | `flown` | a design flown: its true signals, how far they went |
//! | `estimated` | one recording of a design, estimated |
//! | `judged` | the estimates of all recordings of a design together; ranks |
//! | `prepared` | an estimate with its models |
//! | `watch` | true signals that are watched, and their limits |
//! | `work` | designs and their recordings, on the threads there are |
//! | `results` | the whole study |
//! | `search` | durations of steps that are better than the designs given |
//! | `tables` | the table `designs` |
//! | `figures` | the page with its figures |

mod check;
mod columns;
mod estimated;
mod figures;
mod flown;
mod judged;
mod prepared;
mod results;
mod rows;
mod search;
mod settings;
mod study;
mod tables;
#[cfg(test)]
mod tests;
mod watch;
mod work;

pub use figures::page;
pub use judged::{Judged, Outcome};
pub use results::{Results, run};
pub use settings::Settings;
pub use study::Study;
pub use tables::designs;
