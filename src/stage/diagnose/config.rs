//! A `[[diagnose]]` of the pipeline file comes in; its checked settings with the effects that it may
//! name, or the mistakes, go out.

use crate::diagnose;
use crate::diagnose::effect::{self, Context, Effect};
use crate::error::{Error, Place};
use crate::estimate::By;
use crate::model::Model;
use crate::stage::check::{Given, folders};
use crate::stage::kind::{Campaign, Known};
use crate::stage::slice::slice_of;
use crate::stage::{Told, estimate};
use crate::units::Unit;
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// The name of the stage, and of its key in the pipeline file.
pub const NAME: &str = "diagnose";

/// One estimate's model held against the flights: where is it wrong, and what is missing?
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Name in the tables; that of the estimate unless given.
    #[serde(default)]
    pub name: Option<String>,
    /// Name of the `[[estimate]]`: its model, its maneuvers and its method. Effects are looked for
    /// over all maneuvers at once; what is estimated per maneuver or flight (`group`) stays so, or
    /// is a line where a `[[fit]]` says so.
    pub estimate: String,
    /// A folder of effects of your own, or several, searched besides the library; relative to the
    /// pipeline file.
    #[serde(default, deserialize_with = "one_or_several")]
    #[schemars(with = "estimate::Used")]
    pub effects: Vec<String>,
    /// What plays a role that effects speak of, where the model's names do not tell:
    /// `control = ["eta"]`.
    #[serde(default)]
    pub roles: IndexMap<String, Vec<String>>,
    /// How the diagnosis is run.
    #[serde(default)]
    pub method: diagnose::Settings,
    /// Whether the estimate is run again with what was added; its rows are named after the
    /// diagnosis, with `.next` behind.
    #[serde(default = "default_rerun")]
    pub rerun: bool,
    /// Whether `koehler run` makes it. Without, only `koehler diagnose` does, because it takes long,
    /// and a run keeps it as long as nothing behind it changes.
    #[serde(default = "default_run")]
    pub run: bool,
    /// A command asked for it, not the pipeline file, which cannot say so.
    #[serde(default)]
    #[schemars(skip)]
    pub asked: bool,
    /// It is kept as long as it is fresh, and not run; the pipeline file cannot say so either.
    #[serde(default)]
    #[schemars(skip)]
    pub idle: bool,
}

fn default_rerun() -> bool {
    true
}

fn default_run() -> bool {
    true
}

fn one_or_several<'de, D: Deserializer<'de>>(given: D) -> Result<Vec<String>, D::Error> {
    estimate::Used::deserialize(given).map(|used| used.names().to_vec())
}

impl Settings {
    pub fn name(&self) -> String {
        self.name.clone().unwrap_or_else(|| self.estimate.clone())
    }

    /// Without who asked for it, and when it is run: what its results depend on.
    pub fn plain(&self) -> Settings {
        Settings { run: true, asked: false, idle: false, ..self.clone() }
    }

    /// Name of the estimate with what was added.
    pub fn next(&self) -> String {
        format!("{}.next", self.name())
    }

    /// The diagnosis of an estimate by default settings, as a command asks for it.
    pub fn of(estimate: &str) -> Settings {
        Settings {
            name: None,
            estimate: estimate.to_string(),
            effects: Vec::new(),
            roles: IndexMap::new(),
            method: diagnose::Settings::default(),
            rerun: default_rerun(),
            run: default_run(),
            asked: true,
            idle: false,
        }
    }
}

/// Adds the diagnoses that a command asked for earlier and whose results are in the output folder:
/// they are kept as long as they are fresh. One whose name the pipeline file gives away, or whose
/// estimate is gone, is not; nor one that the pipeline file leaves to commands and says otherwise
/// now.
pub fn again(told: &mut Value, earlier: Vec<Value>, estimates: &[String]) {
    let Ok(mut all) = serde_json::from_value::<Vec<Settings>>(told.take()) else { return };
    for kept in earlier.into_iter().filter_map(|value| serde_json::from_value(value).ok()) {
        let kept = Settings { asked: true, idle: true, ..kept };
        let known = estimates.contains(&kept.estimate);
        let same = |d: &Settings| !d.run && slice_of(&d.plain()) == slice_of(&kept.plain());
        if known && all.iter().all(|d| d.name() != kept.name() || same(d)) {
            all.retain(|d| d.name() != kept.name());
            all.push(kept);
        }
    }
    *told = slice_of(&all);
}

/// Checks all `[[diagnose]]` and keeps those that can be run, and are: what is left to a command is
/// checked all the same.
pub fn check(told: &mut Told, known: &mut Known) {
    let Some(all) = told.get::<Vec<Settings>>(NAME).cloned() else { return };
    let Known { given, estimates, .. } = known;
    let checked = given.entries(NAME, all, Settings::name, |given, key, settings| {
        Config::read(settings, (given, key), (estimates.names, estimates.checked))
    });
    let run = checked.into_iter().flatten().filter(|config| config.settings.run);
    told.keep(NAME, run.collect::<Vec<Config>>());
}

/// The diagnoses of a campaign.
pub fn all(campaign: &Campaign) -> &[Config] {
    campaign.told.get::<Vec<Config>>(NAME).map(Vec::as_slice).unwrap_or_default()
}

/// The checked settings of one diagnosis.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    /// Place of the estimate in the list of estimates.
    pub estimate: usize,
    pub effects: Vec<Effect>,
}

impl Config {
    /// Checks the settings of one diagnosis, which stand at `key`, against the estimates (their
    /// names, and what is checked of them) and the library of effects; none where they have mistakes
    /// that matter to it.
    fn read(
        settings: Settings,
        (given, key): (&mut Given, &str),
        (names, estimates): (&[String], &[Option<estimate::Config>]),
    ) -> Option<Config> {
        for (name, what) in settings.method.faults() {
            given.push(&format!("{key}.method.{name}"), what, "");
        }
        let Some(index) = names.iter().position(|name| *name == settings.estimate) else {
            given.unknown(&format!("{key}.estimate"), "[[estimate]]", &settings.estimate, names);
            return None;
        };
        let folders = folders(given, &format!("{key}.effects"), &settings.effects);
        let folders: Vec<&Path> = folders.iter().map(PathBuf::as_path).collect();
        let effects = given.errors.take(effect::load(&folders))?;
        let base = estimates.get(index)?.as_ref()?;
        if let Err(error) = base.model.without_noise("a diagnosis") {
            given.push(&format!("{key}.estimate"), error.what, &error.help.unwrap_or_default());
            return None;
        }
        if base.settings.method.by == By::EquationError {
            let what = format!(
                "estimate \"{}\" is by equation error, and a diagnosis looks at the motion",
                settings.estimate
            );
            let help = "name an estimate of the same model by = \"motion\"";
            given.push(&format!("{key}.estimate"), what, help);
            return None;
        }
        let before = given.errors.0.len();
        roles((given, key), &settings, &base.model);
        if given.errors.0.len() == before {
            fit(given, &settings, &effects, &base.model);
        }
        Some(Config { settings, estimate: index, effects })
    }

    pub fn name(&self) -> String {
        self.settings.name()
    }
}

/// Checks that roles are roles, and what plays them is in the model.
fn roles((given, key): (&mut Given, &str), settings: &Settings, model: &Model) {
    let known: Vec<String> = effect::roles::names().iter().map(|name| name.to_string()).collect();
    for (role, players) in &settings.roles {
        if !effect::roles::exists(role) {
            given.unknown(&format!("{key}.roles.{role}"), "role", role, &known);
        }
        for (i, name) in players.iter().enumerate() {
            let at = format!("{key}.roles.{role}.{i}");
            match (effect::roles::unit_in(model, name), effect::roles::unit(role)) {
                (None, _) => given.push(
                    &at,
                    format!(
                        "\"{name}\" is nothing of the model that could play the role \"{role}\""
                    ),
                    "give an input, a state, an equation, a constant, or output(name)",
                ),
                (Some(unit), Some(wanted)) if !is_alike(&unit, wanted) => given.push(
                    &at,
                    format!("{name} has unit {unit}, and \"{role}\" has {wanted}"),
                    &format!("\"{role}\" is {}", effect::roles::meaning(role)),
                ),
                _ => {}
            }
        }
    }
}

/// Whether two units are of one dimension; what cannot be read is not held against anything.
fn is_alike(one: &str, other: &str) -> bool {
    let dim = |unit| Unit::parse(unit).map(|unit| unit.dim);
    !matches!((dim(one), dim(other)), (Ok(one), Ok(other)) if one != other)
}

/// Files what is wrong with effects of the user's own: each has to fit the model that is diagnosed, where the
/// model has what it speaks of.
fn fit(given: &mut Given, settings: &Settings, effects: &[Effect], model: &Model) {
    let context = Context { roles: settings.roles.clone(), ..Context::default() };
    for effect in effects {
        let Some(place) = &effect.place else { continue };
        let useless = effect::useless(model, &context, effect).filter(|skipped| skipped.wrong);
        if let Some(skipped) = useless {
            let what =
                format!("the model {} cannot be had with this effect: {}", model.name, skipped.why);
            given.errors.push(Error::at(Place::file(place), what).help(
                "`add`, `replace`, equations and units of the effect are lines of the model once its names are put in",
            ));
        }
    }
}
