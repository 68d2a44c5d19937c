//! `[[curve]]` of the pipeline file comes in; its checked settings with the equation as a model of its own, or the
//! mistakes, go out.

use crate::model::{Model, Scope};
use crate::stage::check::{Given, agree};
use crate::stage::kind::Known;
use crate::stage::told::Told;
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
}

fn default_points() -> usize {
    41
}

impl Settings {
    pub fn name(&self) -> String {
        self.name.clone().unwrap_or_else(|| self.estimate.clone())
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
}

/// Checks all `[[curve]]` and keeps what can be drawn.
pub fn check(told: &mut Told, known: &mut Known) {
    let Some(all) = told.get::<Vec<Settings>>(NAME).cloned() else { return };
    let Known { given, estimates, .. } = known;
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
            } else if p.scope != Scope::Campaign && model.as_ref().is_some_and(|m| m.uses(name)) {
                let what = format!("\"{name}\" has several values, one per {}", p.scope.name());
                given.push(
                    &format!("{key}.equations"),
                    what,
                    "a curve needs one value of every parameter",
                );
            }
        }
        (given.errors.0.len() == before).then_some(Config {
            settings: s,
            estimate: index,
            model: model?,
            held,
        })
    });
    told.keep(NAME, checked.into_iter().flatten().collect::<Vec<Config>>());
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
    if !names.contains(&s.along.as_str()) {
        given.unknown(&format!("{key}.along"), "input of the model", &s.along, &names);
    }
    for (i, at) in s.at.iter().enumerate() {
        for name in at.keys().filter(|name| !names.contains(&name.as_str())) {
            given.unknown(&format!("{key}.at.{i}.{name}"), "input of the model", name, &names);
        }
    }
    let Some(model) = model else { return };
    let needed: Vec<&str> = names.iter().filter(|name| model.reads(name)).copied().collect();
    let empty = IndexMap::new();
    let all = if s.at.is_empty() { std::slice::from_ref(&empty) } else { &s.at[..] };
    for (i, at) in all.iter().enumerate() {
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
