//! `[[curve]]` of the pipeline file comes in; its checked settings with the equation as a model of its own, or the
//! mistakes, go out.

use super::prediction::{self, Prediction, Wanted};
use crate::config;
use crate::model::{Model, Parameter, Scope};
use crate::stage::check::{Columns, Given, agree};
use crate::stage::estimate;
use crate::stage::kind::Known;
use crate::stage::told::Told;
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::LazyLock;

/// The stage's name, and its key in the pipeline file.
pub const NAME: &str = "curve";

/// Equations of a model with the values of an estimate, over a range of one of its inputs, with 95% bands: rows of the
/// table `curves`.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Name in the table; that of the estimate unless given.
    #[serde(default)]
    pub name: Option<String>,
    /// The `[[estimate]]` that has the values.
    pub estimate: String,
    /// Equations of its model, of inputs, constants and parameters alone.
    pub equations: Vec<String>,
    /// Unit of the equations where dimensions alone do not tell it: `"rad"` for angles.
    #[serde(default)]
    pub unit: Option<String>,
    /// The input along which they are drawn.
    pub along: String,
    /// Its least and largest value, SI.
    pub range: [f64; 2],
    /// Points from one to the other.
    #[serde(default = "default_points")]
    #[schemars(range(min = 2, max = 10000))]
    pub points: usize,
    /// The other inputs that the equations depend on, SI: one curve for each entry.
    #[serde(default)]
    pub at: Vec<IndexMap<String, f64>>,
    /// Parameters that have a value of their own in every flight or segment, an error of a sensor for
    /// example: what they are on the curves, SI.
    #[serde(default)]
    pub hold: IndexMap<String, f64>,
    /// A file (CSV) of what is predicted of the equations, by a wind tunnel for example: its rows are held against the
    /// curves in the table `predictions`.
    #[serde(default)]
    pub prediction: Option<String>,
}

fn default_points() -> usize {
    41
}

impl Settings {
    pub fn name(&self) -> String {
        self.name.clone().unwrap_or_else(|| self.estimate.clone())
    }

    /// The values of the input along which the equations are drawn.
    pub fn abscissae(&self) -> Vec<f64> {
        let [from, to] = self.range;
        (0..self.points)
            .map(|k| from + (to - from) * k as f64 / (self.points as f64 - 1.0))
            .collect()
    }

    /// The other inputs, one curve for each; one without any where there are none.
    pub fn all_at(&self) -> &[IndexMap<String, f64>] {
        static NONE: LazyLock<IndexMap<String, f64>> = LazyLock::new(IndexMap::new);
        if self.at.is_empty() { std::slice::from_ref(&NONE) } else { &self.at }
    }
}

/// A checked `[[curve]]`.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    /// Place of the estimate in the list of estimates.
    pub estimate: usize,
    /// The equations as outputs of a model without states.
    pub model: Model,
    /// Parameters that the estimate holds, and at what.
    pub held: IndexMap<String, f64>,
    /// The levels for each of which parameters of the equations have a value.
    pub levels: Option<Levels>,
    pub prediction: Option<Prediction>,
}

/// Levels of a condition (`levels` of the estimate).
#[derive(Debug, Clone)]
pub struct Levels {
    pub name: String,
    pub unit: String,
    pub values: Vec<f64>,
}

impl Config {
    /// Every level; none, once, where nothing has a value for each.
    pub fn levels_or_none(&self) -> Vec<Option<f64>> {
        match &self.levels {
            Some(levels) => levels.values.iter().copied().map(Some).collect(),
            None => vec![None],
        }
    }

    /// Unit of the input along which the equations are drawn.
    pub fn unit_along(&self) -> &str {
        unit_of(&self.model, &self.settings.along)
    }

    /// `eta_k = 0.0175 rad`
    pub fn label(&self, level: Option<f64>, at: &IndexMap<String, f64>) -> String {
        let level = self.levels.iter().filter_map(|l| Some((&l.name[..], level?, &l.unit[..])));
        let at = at.iter().map(|(name, value)| (&name[..], *value, unit_of(&self.model, name)));
        let one = |(name, value, unit): (&str, f64, &str)| {
            format!("{name} = {value} {unit}").trim_end_matches([' ', '-']).to_string()
        };
        level.chain(at).map(one).collect::<Vec<_>>().join(", ")
    }
}

fn unit_of<'m>(model: &'m Model, input: &str) -> &'m str {
    model.inputs.iter().find(|q| q.name == input).map_or("-", |q| q.unit.as_str())
}

/// Checks all `[[curve]]` and keeps what can be drawn.
pub fn check(told: &mut Told, known: &mut Known) {
    let Some(all) = told.get::<Vec<Settings>>(NAME).cloned() else { return };
    let Known { given, estimates, columns, .. } = known;
    let checked = given.entries(NAME, all, Settings::name, |given, key, s| {
        let Some(index) = estimates.names.iter().position(|name| *name == s.estimate) else {
            given.unknown(&format!("{key}.estimate"), "[[estimate]]", &s.estimate, estimates.names);
            return None;
        };
        let base = estimates.checked.get(index)?.as_ref()?;
        let before = given.errors.0.len();
        range((given, key), &s);
        let model = equations((given, key), &s, &base.model);
        inputs((given, key), &s, &base.model, model.as_ref());
        let method = &base.settings.method;
        let free = |name: &String, fixed: bool| {
            let free = method.free.as_ref().map_or(!fixed, |free| free.contains(name));
            free && !method.fixed.contains(name)
        };
        let mut held = s.hold.clone();
        let names: Vec<&str> =
            base.model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
        for name in s.hold.keys().filter(|name| !names.contains(&name.as_str())) {
            given.unknown(&format!("{key}.hold.{name}"), "parameter of the model", name, &names);
        }
        for p in &base.model.parameters {
            let name = &p.quantity.name;
            if held.contains_key(name) {
                continue;
            }
            if !free(name, p.fixed) {
                held.insert(name.clone(), method.starts.get(name).copied().unwrap_or(p.start));
            }
        }
        let used = |p: &&Parameter| {
            let name = &p.quantity.name;
            !held.contains_key(name) && model.as_ref().is_some_and(|m| m.uses(name))
        };
        let used: Vec<&Parameter> = base.model.parameters.iter().filter(used).collect();
        let levels = levels((given, key), &base.settings, &used, columns);
        let prediction = match &model {
            Some(model) => predicted((given, key), &s, model, levels.as_ref()),
            None => None,
        };
        (given.errors.0.len() == before).then_some(Config {
            settings: s,
            estimate: index,
            model: model?,
            held,
            levels,
            prediction,
        })
    });
    told.keep(NAME, checked.into_iter().flatten().collect::<Vec<Config>>());
}

/// The condition for whose levels parameters have a value each; every one of them has a value for each level of one
/// condition, or one for all.
fn levels(
    (given, key): (&mut Given, &str),
    base: &estimate::Settings,
    used: &[&Parameter],
    columns: &Columns,
) -> Option<Levels> {
    let mut found: Option<Levels> = None;
    for p in used {
        let name = &p.quantity.name;
        let scope = base.method.per.get(name).map(|per| Scope::parse(per));
        let scope = scope.unwrap_or(p.scope.clone());
        let values = base.levels.get(scope.name()).filter(|_| matches!(scope, Scope::Column(_)));
        match (scope.name(), values) {
            ("campaign", _) => {}
            (column, Some(values)) if found.as_ref().is_none_or(|l| l.name == column) => {
                let unit = columns.unit(column).unwrap_or_default();
                found = Some(Levels { name: column.into(), unit, values: values.clone() });
            }
            (column, _) => {
                let what = format!("\"{name}\" has several values, one per {column}");
                let help = "a curve needs one value of every parameter, or one for each of the `levels` of one condition";
                given.push(&format!("{key}.equations"), what, help);
            }
        }
    }
    found
}

/// What a file predicts of the equations.
fn predicted(
    (given, key): (&mut Given, &str),
    s: &Settings,
    model: &Model,
    levels: Option<&Levels>,
) -> Option<Prediction> {
    let path = s.prediction.as_ref()?;
    let at = format!("{key}.prediction");
    if !given.names_a_file(&at, path) {
        return None;
    }
    let file = given.path(path);
    let text = match config::read_text(&file) {
        Ok(text) => text,
        Err(error) => {
            given.push(&at, format!("{} cannot be read: {}", file.display(), error.what), "");
            return None;
        }
    };
    let mut conditions: Vec<(&str, &str)> = Vec::new();
    conditions.extend(levels.map(|levels| (&levels.name[..], &levels.unit[..])));
    for name in s.at.iter().flat_map(|at| at.keys()) {
        if conditions.iter().all(|(known, _)| known != name) {
            conditions.push((name, unit_of(model, name)));
        }
    }
    let wanted = Wanted {
        along: (&s.along, unit_of(model, &s.along)),
        equations: model.outputs.iter().map(|q| (&q.name[..], &q.unit[..])).collect(),
        conditions,
    };
    given.errors.take(prediction::read(&file.display().to_string(), &text, &wanted))
}

fn range((given, key): (&mut Given, &str), s: &Settings) {
    let [from, to] = s.range;
    if !(from < to && from.is_finite() && to.is_finite()) {
        let what = format!("a range goes from a number to a larger one, not from {from} to {to}");
        given.push(&format!("{key}.range"), what, "");
    }
    if s.equations.is_empty() {
        given.push(&format!("{key}.equations"), "no equation is named", "");
    }
}

/// The model with the equations alone.
fn equations((given, key): (&mut Given, &str), s: &Settings, base: &Model) -> Option<Model> {
    let names: Vec<&String> = base.equations.keys().collect();
    let mut known = true;
    for (i, name) in s.equations.iter().enumerate().filter(|(_, name)| !names.contains(name)) {
        given.unknown(&format!("{key}.equations.{i}"), "equation of the model", name, &names);
        known = false;
    }
    if !known {
        return None;
    }
    match base.of_equations(&s.equations) {
        Ok(mut model) => {
            let outputs = model.outputs.iter_mut();
            for (output, unit) in outputs.zip(s.unit.iter().cycle()) {
                if !agree(unit, &output.unit) {
                    let what = format!(
                        "equation \"{}\" is in {}, not in {unit}",
                        output.name, output.unit
                    );
                    given.push(&format!("{key}.unit"), what, "");
                }
                output.unit.clone_from(unit);
            }
            Some(model)
        }
        Err(error) => {
            let help = error.help.unwrap_or_default();
            given.push(&format!("{key}.equations"), error.what, &help);
            None
        }
    }
}

/// Every input that the equations depend on has a value, and there are no others.
fn inputs((given, key): (&mut Given, &str), s: &Settings, base: &Model, model: Option<&Model>) {
    let names: Vec<&str> = base.inputs.iter().map(|q| q.name.as_str()).collect();
    let before = given.errors.0.len();
    if !names.contains(&s.along.as_str()) {
        given.unknown(&format!("{key}.along"), "input of the model", &s.along, &names);
    }
    for (i, at) in s.at.iter().enumerate() {
        for name in at.keys().filter(|name| !names.contains(&name.as_str())) {
            given.unknown(&format!("{key}.at.{i}.{name}"), "input of the model", name, &names);
        }
    }
    // What is misspelt is what would be missing.
    let Some(model) = model.filter(|_| given.errors.0.len() == before) else { return };
    let needed: Vec<&str> = names.iter().filter(|name| model.reads(name)).copied().collect();
    for (i, at) in s.all_at().iter().enumerate() {
        let missing = |name: &&&str| **name != s.along && !at.contains_key(**name);
        let missing: Vec<&&str> = needed.iter().filter(missing).collect();
        if !missing.is_empty() {
            let key = if s.at.is_empty() { key.to_string() } else { format!("{key}.at.{i}") };
            let what = format!(
                "the equations depend on {}, which has no value",
                crate::config::list(&missing)
            );
            given.push(&key, what, "give it in `at`: one curve for each entry");
        }
    }
}
