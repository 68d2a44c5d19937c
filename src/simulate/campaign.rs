//! A campaign file in, its flights out: truth, recordings, and logs on disk.

use super::check::{Interface, check};
use super::input::Shape;
use super::recorder::{Recording, record};
use super::settings::{Flight, Settings};
use super::timeline::Timeline;
use super::truth::{Truth, fly};
use super::write::{write_log, write_truth};
use crate::config;
use crate::error::{Error, Errors, Result};
use crate::model::{Constants, Model};
use indexmap::IndexMap;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// What the header of a simulated log names as its writer, before the campaign's state.
const SIMULATED: &str = "koehler, simulated from campaign ";

/// A checked campaign, ready to be flown.
#[derive(Debug, Clone)]
pub struct Campaign {
    pub settings: Settings,
    /// The folder of the campaign file: its paths are relative to it.
    pub folder: PathBuf,
    pub model: Model,
    /// The signals of the maneuvers, by name.
    shapes: IndexMap<String, Shape>,
}

/// What came of one flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Flown {
    pub flight: String,
    pub log: PathBuf,
    pub duration_s: f64,
    pub maneuvers: usize,
    pub messages: usize,
}

impl Campaign {
    /// Reads a campaign file, its truth model and the constants they need.
    ///
    /// # Errors
    /// Every mistake in these files.
    pub fn load(path: &Path) -> std::result::Result<Campaign, Errors> {
        Campaign::load_with(path, &Constants::default())
    }

    /// The same, with other values of constants of the truth model than its files have.
    ///
    /// # Errors
    /// As `load`.
    pub fn load_with(path: &Path, other: &Constants) -> std::result::Result<Campaign, Errors> {
        let (settings, doc) = config::load::<Settings>(path)?;
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        let mut errors = Errors::default();
        let mut constants = Constants::default();
        for file in &settings.constants {
            if let Some((more, _)) = errors.take(config::load::<Constants>(&folder.join(file))) {
                constants.0.extend(more.0);
            }
        }
        constants.0.extend(other.0.clone());
        // A model without all of its constants would only repeat what is wrong with their files.
        let model = if errors.is_empty() {
            let model = errors.take(Model::load(&folder.join(&settings.truth), &constants));
            errors.take(model.iter().try_for_each(|m| m.without_noise("the simulation")));
            model
        } else {
            None
        };
        errors.0.extend(check(&settings, &doc, model.as_ref().map(interface).as_ref()).0);
        let model = errors.or(model)?.unwrap_or_default();
        Ok(Campaign::new(settings, folder, model))
    }

    /// A campaign from parts that have been checked.
    pub fn new(settings: Settings, folder: PathBuf, model: Model) -> Campaign {
        let shapes = settings
            .maneuvers
            .iter()
            .filter_map(|(name, m)| Some((name.clone(), Shape::of(m).ok()?)))
            .collect();
        Campaign { settings, folder, model, shapes }
    }

    /// Ids of the flights in order.
    pub fn flights(&self) -> Vec<&str> {
        self.settings.flights.keys().map(String::as_str).collect()
    }

    /// Where the log of a flight is.
    pub fn log_path(&self, flight: &str) -> PathBuf {
        self.folder.join(&self.settings.logs).join(format!("{flight}.mcap"))
    }

    /// Where the truth of a flight is.
    pub fn truth_path(&self, flight: &str) -> PathBuf {
        self.folder.join(&self.settings.truth_folder).join(format!("{flight}.json"))
    }

    /// Ids of the flights that have no log on disk.
    pub fn missing(&self) -> Vec<&str> {
        self.flights().into_iter().filter(|id| !self.log_path(id).is_file()).collect()
    }

    /// Hash of all that the recording of a flight depends on: what the campaign file says of it, the
    /// truth model and the values of its constants. The log carries it.
    ///
    /// # Errors
    /// There is no such flight.
    pub fn state(&self, id: &str) -> Result<String> {
        let (index, flight) = self.flight(id)?;
        let flown = self.timeline(id)?;
        let turbulent = flight.turbulence > 0.0;
        let mut settings = Settings {
            seed: if turbulent { self.settings.seed } else { 0 },
            sensor_seed: Some(self.sensor_seed()),
            title: String::new(),
            source: String::new(),
            truth: String::new(),
            constants: Vec::new(),
            logs: String::new(),
            truth_folder: String::new(),
            flights: IndexMap::from([(format!("{index} {id}"), flight.clone())]),
            ..self.settings.clone()
        };
        settings.maneuvers.retain(|name, _| flown.maneuvers.iter().any(|m| m.maneuver == *name));
        let constants: Vec<_> =
            self.model.constants.iter().map(|c| (&c.quantity.name, c.value)).collect();
        let all = serde_json::to_vec(&(settings, &self.model.text, constants))
            .map_err(|e| Error::new(format!("the campaign cannot be written: {e}")))?;
        Ok(blake3::hash(&all).to_hex()[..16].to_string())
    }

    /// Ids of the flights whose logs were simulated from another state of the campaign than it is
    /// in now. A log that does not say what it was simulated from is not among them.
    pub fn outdated(&self) -> Vec<&str> {
        let other = |id: &str| {
            let written = crate::log::file::writer(&self.log_path(id)).ok().flatten()?;
            Some(written.strip_prefix(SIMULATED)? != self.state(id).ok()?)
        };
        self.flights().into_iter().filter(|id| other(id).unwrap_or(false)).collect()
    }

    fn flight(&self, id: &str) -> Result<(usize, &Flight)> {
        let known = || config::list(&self.flights());
        let found = self.settings.flights.get_full(id).map(|(i, _, flight)| (i, flight));
        found.ok_or_else(|| {
            Error::new(format!("the campaign has no flight \"{id}\"; it has {}", known()))
        })
    }

    /// The timeline of a flight.
    ///
    /// # Errors
    /// There is no such flight.
    pub fn timeline(&self, id: &str) -> Result<Timeline> {
        Ok(Timeline::new(&self.settings, &self.shapes, id, self.flight(id)?.1))
    }

    /// Flies a flight: trimmed at its first test point, then through its timeline.
    ///
    /// # Errors
    /// There is no such flight, no steady flight at its first test point, or the motion diverges.
    pub fn truth(&self, id: &str) -> Result<Truth> {
        let timeline = self.timeline(id)?;
        let (_, flight) = self.flight(id)?;
        let signals = self.model.inputs.iter().map(|input| {
            let signal = timeline.signal(&self.settings, &self.shapes, flight, &input.name);
            signal.ok_or_else(|| {
                Error::new(format!("nothing drives the truth model's input \"{}\"", input.name))
                    .help("name it in [drive]")
            })
        });
        fly(&self.model, &timeline, signals.collect::<Result<Vec<_>>>()?)
    }

    /// Seed of the recorder unless another one is asked for.
    pub fn sensor_seed(&self) -> u64 {
        self.settings.sensor_seed.unwrap_or(self.settings.seed)
    }

    /// Records a flight with the campaign's sensors and random numbers from `seed`.
    ///
    /// # Errors
    /// There is no such flight.
    pub fn record(&self, truth: &Truth, seed: u64) -> Result<Recording> {
        const DAY_S: u64 = 86_400;
        let (index, _) = self.flight(&truth.flight)?;
        let start_s = self.settings.start_unix_s.saturating_add(index as u64 * DAY_S);
        Ok(record(&self.settings, truth, seed, start_s.saturating_mul(1_000_000_000)))
    }

    /// Flies, records and writes one flight: its log and its truth file.
    ///
    /// # Errors
    /// As `truth`; or a file cannot be written.
    pub fn fly(&self, id: &str) -> Result<Flown> {
        let truth = self.truth(id)?;
        let recording = self.record(&truth, self.sensor_seed())?;
        let log = self.log_path(id);
        write_log(&recording, &log, &format!("{SIMULATED}{}", self.state(id)?))?;
        write_truth(&truth, &recording, &self.truth_path(id))?;
        let messages = recording.topics.iter().map(|t| t.log_ns.len()).sum();
        Ok(Flown {
            flight: id.to_string(),
            log,
            duration_s: truth.duration(),
            maneuvers: truth.maneuvers.len(),
            messages,
        })
    }

    /// Flies the given flights in parallel; `done` hears of each one when it is finished. The
    /// result is in the order of `ids`.
    ///
    /// # Errors
    /// What went wrong in each flight that failed; the logs of the others are written.
    pub fn fly_all(
        &self,
        ids: &[&str],
        done: &(dyn Fn(&Flown) + Sync),
    ) -> std::result::Result<Vec<Flown>, Errors> {
        let flown: Vec<Result<Flown>> =
            ids.par_iter().map(|id| self.fly(id).inspect(done)).collect();
        let mut errors = Errors::default();
        let flown = flown
            .into_iter()
            .zip(ids)
            .filter_map(|(f, id)| errors.take(f.map_err(|e| about(id, e))))
            .collect();
        errors.or(flown)
    }
}

fn about(flight: &str, error: Error) -> Error {
    Error { what: format!("{flight}: {}", error.what), ..error }
}

fn interface(model: &Model) -> Interface {
    let names = |list: &[crate::model::Quantity]| {
        list.iter().map(|q| (q.name.clone(), q.unit.clone())).collect()
    };
    Interface { inputs: names(&model.inputs), outputs: names(&model.outputs) }
}

#[cfg(test)]
#[path = "campaign_tests.rs"]
mod tests;

#[cfg(test)]
#[path = "citation_tests.rs"]
mod citation_tests;

#[cfg(test)]
#[path = "ground_tests.rs"]
mod ground_tests;
