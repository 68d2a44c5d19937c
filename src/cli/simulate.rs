//! The verb simulate: a campaign file comes in, MCAP logs of its flights go out.

use super::summary;
use super::words::{End, on_threads, tell, warn};
use crate::error::Errors;
use crate::pipeline::Simulation;
use std::io::IsTerminal;
use std::path::Path;

/// `koehler simulate`
pub fn simulate(campaign: &Path, force: bool, jobs: Option<usize>) -> Result<End, Errors> {
    let simulation = Simulation::read(campaign)?;
    let ids = match force {
        true => simulation.logs().into_iter().map(|(id, _)| id).collect(),
        false => [&simulation.missing[..], &simulation.outdated[..]].concat(),
    };
    if ids.is_empty() {
        tell("all logs are there already, simulated from this campaign; --force writes them again");
        return Ok(End::Complete);
    }
    on_threads(jobs, || fly(&simulation, &ids))??;
    Ok(End::Complete)
}

/// Simulates the flights whose logs are not there, and says which logs are outdated: a pipeline
/// leaves a log that is there as it is.
pub fn make(simulation: &Simulation) -> Result<(), Errors> {
    if let Some(warning) = outdated(simulation) {
        warn(&warning);
    }
    match simulation.missing.is_empty() {
        true => Ok(()),
        false => fly(simulation, &simulation.missing),
    }
}

/// Which logs were simulated from another state of the campaign, and what to do.
pub fn outdated(simulation: &Simulation) -> Option<String> {
    (!simulation.outdated.is_empty()).then(|| {
        format!(
            "the campaign, its truth model or its constants have changed since these logs were \
             simulated: {} (`koehler simulate` writes them again)",
            crate::config::list(&simulation.outdated)
        )
    })
}

fn fly(simulation: &Simulation, ids: &[String]) -> Result<(), Errors> {
    let spinner = std::io::stderr().is_terminal().then(|| {
        let spinner = indicatif::ProgressBar::new_spinner();
        spinner.set_message(format!("simulating {}", summary::count(ids.len(), "flight")));
        spinner.enable_steady_tick(std::time::Duration::from_millis(200));
        spinner
    });
    let flown = simulation.fly(ids, &|_| {});
    if let Some(spinner) = spinner {
        spinner.finish_and_clear();
    }
    for f in flown? {
        let maneuvers = summary::count(f.maneuvers, "maneuver");
        tell(&format!(
            "simulated {}: {:.0} s, {maneuvers}, {} messages in {}",
            f.flight,
            f.duration_s,
            f.messages,
            f.log.display()
        ));
    }
    Ok(())
}
