//! The verb simulate: a campaign file comes in, MCAP logs of its flights go out.

use super::summary;
use super::words::{End, on_threads, say};
use crate::error::Errors;
use crate::pipeline::Simulation;
use std::io::IsTerminal;
use std::path::Path;

/// `koehler simulate`
pub fn simulate(campaign: &Path, force: bool, jobs: Option<usize>) -> Result<End, Errors> {
    let simulation = Simulation::read(campaign)?;
    if simulation.missing.is_empty() && !force {
        say("all logs are there already; --force writes them again");
        return Ok(End::Complete);
    }
    on_threads(jobs, || make(&simulation, force))??;
    Ok(End::Complete)
}

/// Simulates the flights whose logs are not there, or all of them, and says so.
pub fn make(simulation: &Simulation, all: bool) -> Result<(), Errors> {
    let n = if all { simulation.logs().len() } else { simulation.missing.len() };
    let spinner = std::io::stderr().is_terminal().then(|| {
        let spinner = indicatif::ProgressBar::new_spinner();
        spinner.set_message(format!("simulating {}", summary::count(n, "flight")));
        spinner.enable_steady_tick(std::time::Duration::from_millis(200));
        spinner
    });
    let flown = simulation.fly(all, &|_| {});
    if let Some(spinner) = spinner {
        spinner.finish_and_clear();
    }
    for f in flown? {
        let maneuvers = summary::count(f.maneuvers, "maneuver");
        say(&format!(
            "simulated {}: {:.0} s, {maneuvers}, {} messages in {}",
            f.flight,
            f.duration_s,
            f.messages,
            f.log.display()
        ));
    }
    Ok(())
}
