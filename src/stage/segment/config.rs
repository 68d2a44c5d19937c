//! `[segment]` of the pipeline file comes in; its checked settings, or the mistakes, go out.

use crate::error::{Error, Errors, Place};
use crate::segment::{self, Edits};
use crate::stage::check::{Columns, Given};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maneuvers searched for.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// The inputs in which maneuvers are searched.
    pub input: Vec<InputSettings>,
    /// Maneuvers included, excluded or moved by hand, each with a reason that stays in the table.
    #[serde(default)]
    pub edits: Edits,
}

/// One input in which multisteps (3211, 2211, 211, doublet, step) or sweeps are searched.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InputSettings {
    /// Name in the segments table and in `[[estimate]]`; the signal's name unless given.
    #[serde(default)]
    pub name: Option<String>,
    /// The signal searched, commanded or measured: one of the channel map, or a column of the
    /// samples table.
    pub signal: String,
    /// Whether a flight without a maneuver in this input is as it should be.
    #[serde(default)]
    pub optional: bool,
    /// How maneuvers are found.
    #[serde(default)]
    pub method: segment::Settings,
}

impl InputSettings {
    pub fn name(&self) -> &str {
        self.name.as_deref().unwrap_or(&self.signal)
    }
}

/// The checked settings of this stage.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    /// Where the edits stand in the pipeline file.
    pub edits: Place,
}

impl Config {
    /// Checks the settings against the flights and the columns.
    pub fn read(
        settings: Settings,
        given: &mut Given,
        flights: &[String],
        columns: &Columns,
    ) -> Config {
        let edits = given.doc.place("segment.edits");
        given.errors.0.extend(check(&settings, flights, &edits).0);
        for (i, input) in settings.input.iter().enumerate() {
            let key = format!("segment.input.{i}.signal");
            given.look_up(columns, &input.signal, "signal or column", &key);
        }
        Config { settings, edits }
    }
}

/// Checks what the schema cannot: names given twice, edits that point nowhere.
pub fn check(settings: &Settings, flights: &[String], edits: &Place) -> Errors {
    let mut errors = Errors::default();
    let names: Vec<String> = settings.input.iter().map(|i| i.name().to_string()).collect();
    for (i, name) in names.iter().enumerate() {
        if names[..i].contains(name) {
            errors.push(
                Error::at(edits.clone(), format!("two inputs have the name \"{name}\""))
                    .help("give each its own `name`"),
            );
        }
    }
    // Which flights there are is not known where the logs have mistakes of their own.
    let named: Vec<String> =
        if flights.is_empty() { of_edits(&settings.edits) } else { Vec::new() };
    let flights = if flights.is_empty() { &named } else { flights };
    errors.take(settings.edits.check(flights, &names, edits));
    errors
}

/// The flights that edits name.
fn of_edits(edits: &Edits) -> Vec<String> {
    let included = edits.include.iter().map(|e| &e.flight);
    let excluded = edits.exclude.iter().map(|e| &e.flight);
    included.chain(excluded).chain(edits.moves.iter().map(|e| &e.flight)).cloned().collect()
}
