//! The pipeline file `pipeline.toml`: what is done with a campaign's logs, stage by stage.

use super::record::PLACE;
use super::store::Store;
use crate::stage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What is done with a campaign's logs, stage by stage. Paths are relative to this file.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// One line that says what the campaign is about; the title of the report.
    pub title: String,
    /// Constants of the aircraft (areas, arms, inertias), for the models that declare them.
    #[serde(default)]
    pub aircraft: Option<String>,
    /// The channel map: which topic and field of a log is which signal.
    pub channels: String,
    /// The logs: paths or patterns such as "logs/*.mcap", absolute ones as well; one that begins with "$NAME/" lies in the folder that this variable of the
    /// environment names. The flight's id is the file's name without its ending.
    pub logs: Vec<String>,
    /// A campaign file that simulates the logs that are not there yet. Logs that are there are data: after a change of the campaign file,
    /// `koehler simulate --force` makes them anew.
    #[serde(default)]
    pub simulate: Option<String>,
    /// Flight-path reconstruction; left out, there is none.
    #[serde(default)]
    pub reconstruct: Option<stage::reconstruct::Settings>,
    /// The uniform grid and the signals derived on it.
    pub derive: stage::derive::Settings,
    /// Maneuvers searched for; left out, there are none.
    #[serde(default)]
    pub segment: Option<stage::segment::Settings>,
    /// Estimates: one model each, over the maneuvers of one input.
    #[serde(default)]
    pub estimate: Vec<stage::estimate::Settings>,
    /// Straight lines through the estimates.
    #[serde(default)]
    pub fit: Vec<stage::fit::Settings>,
    /// Models held against the flights: where are they wrong, what is missing?
    #[serde(default)]
    pub diagnose: Vec<stage::diagnose::Settings>,
    /// The report; left out, there is none.
    #[serde(default)]
    pub report: Option<stage::report::Settings>,
}

impl Settings {
    /// Adds the diagnoses that a command asked for earlier and whose results are in the output folder: they are kept as long as they are
    /// fresh. One whose name the pipeline file gives away, or whose estimate is gone, is not.
    pub fn keep(&mut self, store: &Store) {
        let place = |record: &super::record::Record| record.ingredients.get(PLACE).and_then(|p| p.parse::<usize>().ok());
        let mut records: Vec<_> = store.records().into_iter().filter(|r| r.stage == stage::diagnose::STAGE.name).collect();
        records.sort_by_key(place);
        let earlier = records.into_iter().filter_map(|r| serde_json::from_value(r.asked?).ok());
        for kept in earlier.map(|settings| stage::diagnose::Settings { asked: true, idle: true, ..settings }) {
            let known = self.estimate.iter().any(|e| e.name() == kept.estimate);
            if known && self.diagnose.iter().all(|d| d.name() != kept.name()) {
                self.diagnose.push(kept);
            }
        }
    }
}
