//! A `[[fit]]` of the pipeline file comes in; its checked settings, or the mistakes, go out.

use crate::fit;
use crate::model::{Parameter, Scope};
use crate::stage::check::{Columns, Given};
use crate::stage::estimate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Straight lines through the estimates per maneuver.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Name of the fit; `<estimate>-<against>` unless given.
    #[serde(default)]
    pub name: Option<String>,
    /// Name of the `[[estimate]]`, which must give these parameters one value per maneuver.
    pub estimate: String,
    /// Parameters of its model, each of which gets a line.
    pub parameters: Vec<String>,
    /// Column of the samples table whose mean in the quiet time before the maneuver is the
    /// abscissa.
    pub against: String,
    /// Confidence level of the bands.
    #[serde(default = "default_level")]
    pub level: f64,
    /// Points of each band, from the smallest to the largest abscissa; at most 10000.
    #[serde(default = "default_points")]
    #[schemars(range(max = 10000))]
    pub points: usize,
    /// A parameter that one maneuver tells no better than this (sd over value, the median of all) is
    /// called poorly determined.
    #[serde(default = "default_poor")]
    pub poor: f64,
    /// How a line is fitted.
    #[serde(default)]
    pub method: fit::Settings,
}

fn default_level() -> f64 {
    0.95
}

fn default_points() -> usize {
    61
}

fn default_poor() -> f64 {
    0.05
}

/// The checked settings of one fit.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    /// Place of the estimate in the list of estimates.
    pub estimate: usize,
    /// SI units of the parameters, in the order of the settings.
    pub units: Vec<String>,
    /// SI unit of the abscissa.
    pub unit_x: String,
}

impl Config {
    /// Checks the settings of one fit, which stand at `key`, against the estimates (their names, and
    /// what is checked of them) and the columns; none where they have mistakes that matter to it.
    pub fn read(
        settings: Settings,
        (given, key): (&mut Given, &str),
        (names, estimates): (&[String], &[Option<estimate::Config>]),
        columns: &Columns,
    ) -> Option<Config> {
        let Some(index) = names.iter().position(|name| *name == settings.estimate) else {
            given.unknown(&format!("{key}.estimate"), "[[estimate]]", &settings.estimate, names);
            return None;
        };
        if !(settings.level > 0.0 && settings.level < 1.0) {
            given.push(
                &format!("{key}.level"),
                format!("a confidence level is between 0 and 1, not {}", settings.level),
                "95% is 0.95",
            );
        }
        if !(settings.poor > 0.0) {
            given.push(
                &format!("{key}.poor"),
                format!("what is poor is a positive share, not {}", settings.poor),
                "a twentieth is 0.05",
            );
        }
        let unit_x = given.look_up(columns, &settings.against, "column", &format!("{key}.against"));
        let estimate = estimates.get(index)?.as_ref()?;
        let each = estimate.settings.group == estimate::Group::Segment;
        if estimate.settings.input.is_none() {
            given.push(
                &format!("{key}.estimate"),
                format!(
                    "estimate \"{}\" does not give one estimate per maneuver",
                    settings.estimate
                ),
                "a line goes through estimates per maneuver: give it `input`",
            );
        }
        let mut units = Vec::new();
        for (i, name) in settings.parameters.iter().enumerate() {
            let known: Vec<&str> =
                estimate.model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
            match estimate.model.parameters.iter().find(|p| p.quantity.name == *name) {
                Some(parameter) if each || scope(parameter, estimate) == Scope::Segment => {
                    units.push(parameter.quantity.unit.clone());
                }
                Some(_) => given.push(
                    &format!("{key}.parameters.{i}"),
                    format!("\"{name}\" has one value for several maneuvers"),
                    "a line goes through values per maneuver: say per = \"segment\" in the model file, or group = \"segment\" in the estimate",
                ),
                None => {
                    let key = format!("{key}.parameters.{i}");
                    given.unknown(&key, "parameter of the model", name, &known);
                }
            }
        }
        let complete = units.len() == settings.parameters.len();
        complete.then_some(Config { settings, estimate: index, units, unit_x: unit_x? })
    }

    pub fn name(&self) -> String {
        self.settings.name()
    }
}

/// Where one value of a parameter holds: as the estimate says, or else the model file.
fn scope(parameter: &Parameter, estimate: &estimate::Config) -> Scope {
    let told = estimate.settings.method.per.get(&parameter.quantity.name);
    told.map_or_else(|| parameter.scope.clone(), |per| Scope::parse(per))
}

impl Settings {
    /// Name of the fit.
    pub fn name(&self) -> String {
        self.name.clone().unwrap_or_else(|| format!("{}-{}", self.estimate, self.against))
    }
}
