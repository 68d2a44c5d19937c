//! A plan and a flight come in; its log, the hash of that, and whose log it is besides, go out.

use super::Plan;
use super::logs::{self, FlightLog};
use super::twins::twins;
use crate::error::{Error, Errors, Result};
use crate::log::look;
use crate::pipeline::simulate::Simulation;
use crate::pipeline::store::Store;

impl Plan {
    /// The log of a flight.
    pub fn log(&self, flight: &str) -> Result<&FlightLog> {
        self.logs
            .iter()
            .find(|l| l.flight == flight)
            .ok_or_else(|| Error::new(format!("flight {flight} has no log")))
    }

    /// Hash of a flight's log; none where the log is still to be simulated, and a word in its place where
    /// it is not there or cannot be read: the stage that reads it then fails for this flight alone.
    pub fn log_hash(&self, store: &Store, flight: &str) -> Result<Option<String>> {
        let is_to_come = |s: &Simulation| s.missing.iter().any(|missing| missing == flight);
        Ok(match store.memo.hash(&self.log(flight)?.path) {
            Ok(None) if self.simulation.as_ref().is_some_and(is_to_come) => None,
            Ok(None) => Some("missing".to_string()),
            Ok(hash) => hash,
            Err(_) => Some("unreadable".to_string()),
        })
    }

    /// Why a flight will have no results, as far as can be seen of its log without reading it whole; none
    /// where nothing speaks against it, or where the log is still to be simulated.
    pub fn lost(&self, store: &Store, flight: &str) -> Option<String> {
        let log = self.log(flight).ok()?;
        if let Some(missing) = &log.missing {
            return Some(missing.what.clone());
        }
        if let Some(twin) = self.twin(store, flight) {
            return Some(format!("its log is that of {twin}, byte for byte"));
        }
        log.path.symlink_metadata().ok()?;
        let channels = &self.campaign.channels;
        match look(&log.path, &channels.map, &channels.doc) {
            Err(e) => Some(e.what),
            Ok(look) => look.mistakes.first().map(|mistake| mistake.of("its log").what),
        }
    }

    /// The logs that the pipeline file names and that are not there.
    pub fn missing(&self) -> Errors {
        logs::missing(&self.logs)
    }

    /// The flight whose log that of another one is, byte for byte.
    pub fn twin(&self, store: &Store, flight: &str) -> Option<&String> {
        self.twins.get_or_init(|| twins(&self.logs, &store.memo)).get(flight)
    }
}
