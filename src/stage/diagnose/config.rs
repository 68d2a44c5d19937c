//! A `[[diagnose]]` of the pipeline file comes in; its checked settings with the effects that it may
//! name, or the mistakes, go out.

use crate::diagnose;
use crate::diagnose::effect::{self, Effect};
use crate::model::Model;
use crate::stage::check::{Given, folders};
use crate::stage::estimate;
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};
use std::path::{Path, PathBuf};

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
    /// A command asked for it, not the pipeline file.
    #[serde(skip)]
    pub asked: bool,
    /// It is kept as long as it is fresh, and not run.
    #[serde(skip)]
    pub idle: bool,
}

fn default_rerun() -> bool {
    true
}

fn one_or_several<'de, D: Deserializer<'de>>(given: D) -> Result<Vec<String>, D::Error> {
    estimate::Used::deserialize(given).map(|used| used.names().to_vec())
}

impl Settings {
    pub fn name(&self) -> String {
        self.name.clone().unwrap_or_else(|| self.estimate.clone())
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
            asked: true,
            idle: false,
        }
    }
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
    pub fn read(
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
        roles((given, key), &settings, &base.model);
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
        for (i, name) in
            players.iter().enumerate().filter(|(_, name)| !effect::roles::is_of(model, name))
        {
            let what =
                format!("\"{name}\" is nothing of the model that could play the role \"{role}\"");
            given.push(
                &format!("{key}.roles.{role}.{i}"),
                what,
                "give an input, a state, an equation, a constant, or output(name)",
            );
        }
    }
}
