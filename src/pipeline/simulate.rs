//! The simulated campaign behind a pipeline file, and which of its flights have no log yet.

use crate::config;
use crate::error::Errors;
use crate::simulate::{Campaign, Flown, Settings};
use std::path::{Path, PathBuf};

/// A checked campaign file, and which of its flights have no log or an outdated one.
#[derive(Debug)]
pub struct Simulation {
    campaign: Campaign,
    /// Flights whose logs are asked for and that are not there.
    pub missing: Vec<String>,
    /// Flights whose logs were simulated from another state of the campaign than it is in now.
    pub outdated: Vec<String>,
}

impl Simulation {
    /// Reads and checks a campaign file with the model and the constants it names.
    ///
    /// # Errors
    /// Every mistake in any of them.
    pub fn read(path: &Path) -> Result<Simulation, Errors> {
        let campaign = Campaign::load(path)?;
        let of = |ids: Vec<&str>| ids.into_iter().map(str::to_string).collect();
        let (missing, outdated) = (of(campaign.missing()), of(campaign.outdated()));
        Ok(Simulation { campaign, missing, outdated })
    }

    /// Whether all logs of a campaign are there and the truth they were simulated from is not:
    /// there is nothing left to simulate, and an analysis needs nothing but logs.
    pub fn is_over(path: &Path) -> bool {
        let Ok((settings, _)) = config::load::<Settings>(path) else { return false };
        let folder = path.parent().unwrap_or_else(|| Path::new(""));
        let log = |id: &String| folder.join(&settings.logs).join(format!("{id}.mcap"));
        !folder.join(&settings.truth).is_file()
            && settings.flights.keys().all(|id| log(id).is_file())
    }

    /// The log of every flight of the campaign.
    pub fn logs(&self) -> Vec<(String, PathBuf)> {
        self.campaign
            .flights()
            .into_iter()
            .map(|id| (id.to_string(), self.campaign.log_path(id)))
            .collect()
    }

    /// With only those flights that a pipeline asks for; none where there is nothing to simulate and
    /// nothing to say.
    pub fn for_flights(mut self, wanted: &[String]) -> Option<Simulation> {
        self.missing.retain(|id| wanted.contains(id));
        self.outdated.retain(|id| wanted.contains(id));
        (!self.missing.is_empty() || !self.outdated.is_empty()).then_some(self)
    }

    /// Simulates the named flights in parallel; `done` hears of each one.
    ///
    /// # Errors
    /// A flight cannot be trimmed or flown, or a file cannot be written: every one of them.
    pub fn fly(
        &self,
        ids: &[String],
        done: &(dyn Fn(&Flown) + Sync),
    ) -> Result<Vec<Flown>, Errors> {
        let ids: Vec<&str> = ids.iter().map(String::as_str).collect();
        self.campaign.fly_all(&ids, done)
    }
}
