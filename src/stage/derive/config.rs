//! `[derive]` of the pipeline file comes in; its checked settings with the model and what drives it,
//! or the mistakes, go out.

use crate::model::Model;
use crate::stage::channels::Channels;
use crate::stage::check::{Columns, Given, drivers};
use crate::stage::estimate::Between;
use crate::stage::slice::{said, slice_of};
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// The uniform grid and the signals derived on it: the columns of the samples table.
///
/// They are all signals of the channel map, the reconstructed flight path, and the outputs of the
/// model. Where two have one name, the later one in this order takes the place of the earlier: it
/// is the better knowledge of the same thing.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Rate of the grid, Hz.
    pub rate_hz: f64,
    /// A gap of a signal longer than this many of its usual spacings is masked, not bridged.
    #[serde(default = "default_gap")]
    pub max_gap: f64,
    /// How signals run between their own samples: "linear", "cubic" for smooth measured signals
    /// (lines act on them like a low pass), "hold" for commands that are steps; one for all of them,
    /// or by signal: `interpolation = { command_e = "hold" }` (the others are linear).
    #[serde(default)]
    pub interpolation: Between,
    /// Signals of which the mean over so many seconds about each point is taken, along straight lines
    /// between their samples, instead of their value there. 0 is one step of the grid, for commands
    /// that are logged whenever they change: the time of an edge is then known to a part of a step.
    /// More is for what is held in a test: `averaged = { command = 0.0, V_c = 20.0 }`.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub averaged: IndexMap<String, f64>,
    /// Signals, or columns of the flight path, that are smoothed on the grid, by a cubic fitted to
    /// so many seconds around every point: `smooth = { thrust = 1.0 }`. For what changes slowly and
    /// drives a model, which takes its noise for motion; not for surfaces, whose edges it would
    /// round.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub smooth: IndexMap<String, f64>,
    /// A model file without states: its outputs become columns of the samples table.
    #[serde(default)]
    pub model: Option<String>,
    /// Columns for the inputs of that model, where the names differ:
    /// `input of the model = "column"`.
    #[serde(default)]
    pub inputs: IndexMap<String, String>,
}

fn default_gap() -> f64 {
    5.0
}

/// The checked settings of this stage.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    pub model: Option<Model>,
    /// The column for each input of the model.
    pub inputs: Vec<String>,
}

/// A grid that is finer than this holds no more of any flight, and more than fits into memory.
const FASTEST_HZ: f64 = 10_000.0;

impl Config {
    /// Checks the settings against their model and the columns that there are before, which learn
    /// what was said to be missing; none where the model has mistakes.
    pub fn read(settings: Settings, given: &mut Given, columns: &mut Columns) -> Option<Config> {
        if !(settings.rate_hz > 0.0 && settings.rate_hz <= FASTEST_HZ) {
            given.push(
                "derive.rate_hz",
                format!(
                    "the rate of the grid is a positive number of Hz, {FASTEST_HZ} at most, not {}",
                    settings.rate_hz
                ),
                "",
            );
        }
        for (name, window) in &settings.smooth {
            let key = format!("derive.smooth.{name}");
            if !(*window > 0.0 && *window <= 3600.0) {
                given.push(
                    &key,
                    format!("a signal is smoothed over a positive number of seconds, not {window}"),
                    "",
                );
            }
            if given.look_up(columns, name, "signal or column", &key).is_none() {
                columns.told(name);
            }
        }
        for (name, window) in &settings.averaged {
            let key = format!("derive.averaged.{name}");
            if !(*window >= 0.0 && *window <= 3600.0) {
                let what = format!("a mean is over zero or more seconds, not {window}");
                given.push(&key, what, "0 is one step of the grid");
            }
            if given.look_up(columns, name, "signal", &key).is_none() {
                columns.told(name);
            }
            if settings.interpolation.named().any(|other| other == name) {
                let what = format!("`averaged` and `interpolation` both say how {name} runs");
                given.push(&key, what, "one of them: means follow straight lines between samples");
            }
        }
        for name in settings.interpolation.named() {
            let key = format!("derive.interpolation.{name}");
            if given.look_up(columns, name, "signal", &key).is_none() {
                columns.told(name);
            }
        }
        let model = match &settings.model {
            Some(file) => {
                let model = given.model("derive.model", file)?;
                if !model.states.is_empty() {
                    given.push(
                        "derive.model",
                        "the model of [derive] has states",
                        "only a model without states can be evaluated sample by sample",
                    );
                }
                Some(model)
            }
            None => None,
        };
        let inputs = match &model {
            Some(model) => drivers(
                model,
                &settings.inputs,
                columns,
                &given.doc,
                "derive.inputs",
                &mut given.errors,
            ),
            None => Vec::new(),
        };
        Some(Config { settings, model, inputs })
    }

    pub fn slice(&self, channels: &Channels) -> Value {
        // Units and meanings go along as metadata of the columns.
        let columns: IndexMap<&String, (String, &str)> = channels
            .map
            .signal
            .keys()
            .map(|name| (name, (channels.unit(name), channels.doc(name))))
            .collect();
        let mut slice = slice_of(&self.settings);
        if let Some(entries) = slice.as_object_mut() {
            entries.insert("model".into(), self.model.as_ref().map(said).unwrap_or_default());
            entries.insert("signals".into(), slice_of(&columns));
        }
        slice
    }
}
