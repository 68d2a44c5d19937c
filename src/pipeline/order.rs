//! The order of a run: a campaign and its stages in; which stages a flight goes through by itself,
//! and which flights do so together, out.
//!
//! Tables of one flight are large, and what the campaign as a whole needs of them is small. So a few
//! flights go through all stages of their own before the next ones are begun, and what a later stage
//! needs of a flight it reads again. Memory does not grow with the number of flights.

use crate::stage::{Campaign, Stage};

/// Flights that are under way at a time, per thread: two, so that a thread that is done with the
/// shorter one has another.
const PER_THREAD: usize = 2;

/// Memory for tables that later stages need not read back, bytes.
pub const KEPT_BYTES: usize = 512 << 20;

/// How many of the stages, from the first on, are run for single flights, and need no other flight's
/// records.
pub fn of_flights(campaign: &Campaign, stages: &[Stage]) -> usize {
    let is = |stage: &&Stage| {
        !stage.reads_records
            && (stage.units)(campaign).iter().all(|unit| unit.part.flight().is_some())
    };
    stages.iter().take_while(is).count()
}

/// The flights that go through their own stages together, by `threads` threads.
pub fn blocks(flights: &[String], threads: usize) -> impl Iterator<Item = &[String]> {
    flights.chunks(PER_THREAD * threads.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Plan;
    use std::path::Path;

    #[test]
    fn flights_go_through_their_own_stages_two_per_thread() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
        let plan = Plan::read(&folder.join("citation/pipeline.toml")).expect("a plan");
        let campaign = &plan.campaign;
        let own = &campaign.stages[..of_flights(campaign, campaign.stages)];
        let names: Vec<&str> = own.iter().map(|stage| stage.name).collect();
        assert_eq!(names, ["ingest", "reconstruct", "derive", "segment"]);
        let blocks: Vec<&[String]> = blocks(&campaign.flights, 2).collect();
        assert!(blocks.iter().all(|block| block.len() <= 4));
        assert_eq!(blocks.concat(), campaign.flights);
    }
}
