//! `[[validate]]` of the pipeline file comes in; its checked settings, with where every value comes
//! from, or the mistakes, go out.

use super::source::{self, Source};
use crate::estimate::Shifts;
use crate::stage::check::Given;
use crate::stage::estimate::chosen::Range;
use crate::stage::estimate::{self, Group, Used};
use crate::stage::told::{Known, Told};
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A model with values that are held, run through maneuvers that were not used to find them. Only
/// initial states and zero shifts of sensors are estimated.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Name in the tables; `<estimate>-validation` unless given.
    #[serde(default)]
    pub name: Option<String>,
    /// Name of the `[[estimate]]` whose values are held; what is not said here is as it says.
    pub estimate: String,
    /// Names of `[[fit]]`s: each of their parameters has, in every maneuver, the value of its line
    /// at the condition of that maneuver.
    #[serde(default)]
    pub lines: Vec<String>,
    /// Another model than that of the estimate, for example a nonlinear one. Nothing about the names
    /// in it is taken from the estimate then: its `inputs`, `held`, `outputs`, `unscored`,
    /// `initial` and `shifts` are those given here.
    #[serde(default)]
    pub model: Option<String>,
    /// Where parameters of the model have their values from, if not from the one of their own name:
    /// a parameter of the estimate or of a line, or a line's own `"C_h_delta.slope"` and
    /// `"C_h_delta.intercept"`.
    #[serde(default)]
    pub take: IndexMap<String, String>,
    /// Name of the `[[segment.input]]` whose maneuvers are used, or several; `input = []`: whole
    /// records.
    #[serde(default)]
    pub input: Option<Used>,
    /// Flights used, with `*` for any characters; empty for all.
    #[serde(default)]
    pub flights: Vec<String>,
    /// Flights or maneuvers left out of them, with `*` for any characters.
    #[serde(default)]
    pub except: Vec<String>,
    /// By condition, the range (SI) that its mean in the quiet time before a maneuver must be in.
    #[serde(default, rename = "where")]
    pub conditions: IndexMap<String, Range>,
    /// Kinds of maneuvers used; empty for all kinds.
    #[serde(default)]
    pub kinds: Option<Vec<String>>,
    /// Time before the first step that belongs to the segment, s.
    #[serde(default)]
    pub pre_s: Option<f64>,
    /// Time after the last step that belongs to the segment, s.
    #[serde(default)]
    pub post_s: Option<f64>,
    /// Columns of the samples table for the model's inputs, where the names differ.
    #[serde(default)]
    pub inputs: IndexMap<String, String>,
    /// Inputs of the model that are held over a maneuver at the mean of a column before it.
    #[serde(default)]
    pub held: IndexMap<String, String>,
    /// Signals or columns that measure the model's outputs, where the names differ.
    #[serde(default)]
    pub outputs: IndexMap<String, String>,
    /// Outputs of the model that are not looked at.
    #[serde(default)]
    pub unscored: Vec<String>,
    /// States whose initial value is estimated, maneuver by maneuver.
    #[serde(default)]
    pub initial: Vec<String>,
    /// Zero shifts of sensors that are estimated, maneuver by maneuver.
    #[serde(default)]
    pub shifts: Option<Shifts>,
    /// Half-width within which an output is not known, because of friction for example: an output of
    /// the model that gives it, `band = { delta_e = "friction_band" }`.
    #[serde(default)]
    pub band: IndexMap<String, String>,
    /// Share of the samples that must lie within the interval that the model predicts for them, but
    /// for what chance allows (three standard deviations).
    #[serde(default = "default_within")]
    #[schemars(range(min = 0, max = 1))]
    pub within: f64,
    /// Largest inequality coefficient (Theil) of an output that is called good.
    #[serde(default = "default_theil")]
    #[schemars(range(min = 0, max = 1))]
    pub theil: f64,
}

fn default_within() -> f64 {
    0.95
}

fn default_theil() -> f64 {
    0.1
}

impl Settings {
    /// Name in the tables.
    pub fn name(&self) -> String {
        self.name.clone().unwrap_or_else(|| format!("{}-validation", self.estimate))
    }

    /// How the maneuvers are run: as in the estimate, but for what is said here, with nothing of the
    /// model free.
    fn run(&self, base: &estimate::Settings) -> estimate::Settings {
        let mut run = base.clone();
        let method = &mut run.method;
        (method.free, method.fixed, method.candidates) = (None, Vec::new(), Vec::new());
        (method.profile, method.priors) = (Vec::new(), false);
        method.per.clear();
        method.start = crate::estimate::StartFrom::Model;
        if let Some(model) = &self.model {
            run.model = model.clone();
            run.unscored = Vec::new();
            [&mut run.inputs, &mut run.held, &mut run.outputs]
                .into_iter()
                .for_each(IndexMap::clear);
            (method.initial, method.shifts) = (Vec::new(), Shifts::default());
            (method.starts, method.floor, method.stabilise) = Default::default();
            run.interpolation = Default::default();
        }
        run.inputs.extend(self.inputs.clone());
        run.held.extend(self.held.clone());
        run.outputs.extend(self.outputs.clone());
        run.unscored.extend(self.unscored.clone());
        // What gives a band is looked at, and measured by nothing.
        run.unscored.extend(self.band.values().cloned());
        method.initial.extend(self.initial.clone());
        method.shifts = self.shifts.clone().unwrap_or_else(|| method.shifts.clone());
        method.shifts.per = "segment".to_string();
        if let Some(input) = &self.input {
            run.input = Some(input.clone()).filter(|used| !used.names().is_empty());
        }
        run.kinds = self.kinds.clone().unwrap_or(run.kinds);
        run.pre_s = self.pre_s.unwrap_or(run.pre_s);
        run.post_s = self.post_s.unwrap_or(run.post_s);
        run.flights = self.flights.clone();
        run.except = self.except.clone();
        run.r#where = self.conditions.clone();
        run.name = Some(self.name());
        run.group = Group::Segment;
        run
    }
}

/// The checked settings of one validation.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    /// Place of the estimate in the list of estimates.
    pub estimate: usize,
    /// Places of the fits in the list of fits.
    pub lines: Vec<usize>,
    /// The model, what drives and measures it, and which maneuvers it is run through.
    pub run: estimate::Config,
    /// Where each parameter that is not fixed by the model's file has its value from.
    pub sources: Vec<(String, Source)>,
}

/// Checks all `[[validate]]` and keeps what can be run.
pub fn check(told: &mut Told, known: &mut Known) {
    let Some(all) = told.get::<Vec<Settings>>(super::STAGE.name).cloned() else { return };
    let Known { given, flights, columns, channels, searched, estimates, fits } = known;
    let checked = given.entries(super::STAGE.name, all, Settings::name, |given, key, s| {
        faults(given, key, &s);
        let Some(index) = estimates.names.iter().position(|name| *name == s.estimate) else {
            let key = format!("{key}.estimate");
            given.unknown(&key, "[[estimate]]", &s.estimate, estimates.names);
            return None;
        };
        let lines: Vec<usize> = s
            .lines
            .iter()
            .enumerate()
            .filter_map(|(i, name)| {
                let place = fits.names.iter().position(|known| known == name);
                if place.is_none() {
                    given.unknown(&format!("{key}.lines.{i}"), "[[fit]]", name, fits.names);
                }
                place
            })
            .collect();
        let base = estimates.checked.get(index)?.as_ref()?;
        let run = s.run(&base.settings);
        let run =
            estimate::Config::read(run, (given, key), (searched, flights), columns, *channels)?;
        let fits: Option<Vec<_>> =
            lines.iter().map(|&i| Some((i, fits.checked.get(i)?.as_ref()?))).collect();
        if lines.len() < s.lines.len() {
            return None;
        }
        bands((given, key), &s, &run);
        let sources = source::find((given, key), &s, base, &fits?, &run.model)?;
        Some(Config { settings: s, estimate: index, lines, run, sources })
    });
    told.keep(super::STAGE.name, checked.into_iter().flatten().collect::<Vec<Config>>());
}

/// What the schema cannot say of numbers.
fn faults(given: &mut Given, key: &str, settings: &Settings) {
    for (name, value) in [("within", settings.within), ("theil", settings.theil)] {
        if !(0.0..=1.0).contains(&value) {
            given.push(
                &format!("{key}.{name}"),
                format!("`{name}` is between 0 and 1, not {value}"),
                "",
            );
        }
    }
}

/// Checks that bands are those of scored outputs, given by outputs in the same unit.
fn bands((given, key): (&mut Given, &str), settings: &Settings, run: &estimate::Config) {
    let outputs = &run.model.outputs;
    let names: Vec<&str> = outputs.iter().map(|o| o.name.as_str()).collect();
    for (output, band) in &settings.band {
        let key = format!("{key}.band.{output}");
        let find = |name: &String| outputs.iter().find(|o| o.name == *name);
        match (find(output), find(band)) {
            (Some(one), Some(half)) if crate::stage::check::agree(&one.unit, &half.unit) => {}
            (Some(one), Some(half)) => given.push(
                &key,
                format!("\"{output}\" is in {}, its band \"{band}\" in {}", one.unit, half.unit),
                "",
            ),
            (None, _) => given.unknown(&key, "output of the model", output, &names),
            (_, None) => given.unknown(&key, "output of the model", band, &names),
        }
    }
}
