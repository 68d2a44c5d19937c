//! Effect files (`*.toml`) in; checked candidate effects with their names, ready to be bound to a
//! model, out.

use std::collections::BTreeMap;
use std::path::Path;

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fill;
use super::roles;
use crate::config::{self, Doc};
use crate::error::{Error, Errors, Place};
use crate::model::file::{ConstantFull, State, Value};

include!(concat!(env!("OUT_DIR"), "/effects.rs"));

/// A candidate effect (`<name>.toml`): what a model may lack, written for any model. `{name}`
/// stands for what is bound to a role or for the full name of a parameter, equation or state of the
/// effect.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EffectFile {
    /// The sentence that names the effect.
    pub title: String,
    /// What kind of thing it is.
    pub family: Family,
    /// It is a term of a series, which names no cause: an effect that does and explains as much is told first.
    #[serde(default)]
    pub series: bool,
    /// Effects with the same word here are forms of one cause (a delay of constant time, of constant
    /// distance, a lag): once one is in a model, the others are not added for the same thing.
    #[serde(default)]
    pub form: Option<String>,
    /// It takes noise out of a record. No filter takes out all of it and nothing else, and what it mistakes goes with
    /// what it takes out: gains on held-out maneuvers are less than predicted, and scatter more.
    #[serde(default)]
    pub noise: bool,
    /// What it does to a flight: how a person recognises it.
    pub signature: String,
    /// Effects that look alike.
    #[serde(default)]
    pub rivals: Vec<String>,
    /// The maneuver that distinguishes it from its rivals.
    #[serde(default)]
    pub separate: String,
    /// Where the equations come from.
    #[serde(default)]
    pub source: String,
    /// A role of which the model must have nothing: another effect is for models that have it.
    #[serde(default)]
    pub unless: Option<String>,
    /// Roles that the model must fill: a name of the effect's own, and the role.
    pub bind: IndexMap<String, Bind>,
    /// What the effect adds to what can be estimated.
    pub parameters: IndexMap<String, Size>,
    /// Numbers with a unit that the lines need.
    #[serde(default)]
    pub constants: IndexMap<String, ConstantFull>,
    /// Named expressions.
    #[serde(default)]
    pub equations: IndexMap<String, String>,
    /// States of the effect.
    #[serde(default)]
    pub states: IndexMap<String, State>,
    /// Terms added to what is bound: `"{moment}" = "{C}*{control}^2"`.
    #[serde(default)]
    pub add: IndexMap<String, String>,
    /// What everything else reads instead of what is bound: `"{control}" = "{control} +
    /// {k}*(lag({control}, {T}) - {control})"`.
    #[serde(default)]
    pub replace: IndexMap<String, String>,
}

/// Kinds of effects.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize, JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Family {
    Sensor,
    Actuator,
    Mechanical,
    Aerodynamic,
    Configuration,
    Wind,
}

impl Family {
    pub fn name(self) -> &'static str {
        match self {
            Family::Sensor => "sensor",
            Family::Actuator => "actuator",
            Family::Mechanical => "mechanical",
            Family::Aerodynamic => "aerodynamic",
            Family::Configuration => "configuration",
            Family::Wind => "wind",
        }
    }
}

/// What a name of the effect stands for.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Bind {
    /// A role (`docs/effects.md` has the list).
    Role(String),
    /// A role with a number for models that have nothing of it.
    Or(BindOr),
    /// Everything of a role at once: the lines that name it are repeated for each.
    All(BindAll),
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BindOr {
    pub role: String,
    /// The value of a constant that stands in where the model has nothing of that role.
    pub or: f64,
    /// Its SI unit.
    pub unit: String,
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BindAll {
    /// The role.
    pub all: String,
}

impl Bind {
    pub fn role(&self) -> &str {
        match self {
            Bind::Role(role) | Bind::Or(BindOr { role, .. }) | Bind::All(BindAll { all: role }) => {
                role
            }
        }
    }
}

/// A parameter of an effect: a size, which has a null value, or a shape (a delay, a threshold),
/// which has starts.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Size {
    /// Name in the model; without it the effect's own name with that of what is bound.
    pub name: Option<String>,
    /// SI unit; `{control}` stands for the unit of what is bound.
    pub unit: String,
    /// Value of a size at which the model is as it was, whatever the shapes are.
    pub null: Option<f64>,
    /// Value at which a size is held once the effect is in the model: 1 for a switch between with
    /// and without.
    pub hold: Option<f64>,
    /// Values of a size at which it is tried, for an effect of which the derivative at null says
    /// nothing (a little friction slows what moves, more of it holds): the screening takes the
    /// difference of two responses over their distance. Those of several sizes go together.
    #[serde(default)]
    pub steps: Vec<f64>,
    /// A shape is one of its starts, the best one, and not estimated: for what the data choose
    /// without telling it exactly.
    #[serde(default)]
    pub chosen: bool,
    /// Values of a shape that are tried; those of several shapes go together, the first with the
    /// first.
    #[serde(default)]
    pub starts: Vec<f64>,
    /// Starts, bounds and typical value are multiples of the half range of what is bound to this
    /// name in the data.
    pub of: Option<String>,
    /// Starts are counted from the middle of the range of what is bound to this name; known better
    /// than that range, it is determined.
    pub about: Option<String>,
    /// Starts, bounds and typical value are divided by the middle of the range of what is bound to
    /// this name, or by the number that stands in for it: the time of a distance at the airspeed
    /// flown.
    pub over: Option<String>,
    /// Physical bounds.
    pub min: Option<f64>,
    pub max: Option<f64>,
    /// A step that is worth seeing.
    pub typical: Option<f64>,
    /// "campaign" or "segment", as in a model.
    #[serde(default = "campaign")]
    pub per: String,
    /// A constant of the aircraft that the estimate must agree with.
    pub near: Option<Near>,
    #[serde(default)]
    pub doc: String,
}

/// A physical cross-check.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Near {
    /// Role of the constant.
    pub role: String,
    /// Largest relative difference.
    pub within: f64,
}

fn campaign() -> String {
    "campaign".to_string()
}

/// A checked effect file.
#[derive(Debug, Clone)]
pub struct Effect {
    /// The file's name without `.toml`.
    pub name: String,
    pub file: EffectFile,
    /// Where it stands; none for one of the library.
    pub place: Option<String>,
}

/// The library of the program, then the files of the folders; a file of a name that is known
/// already takes its place.
///
/// # Errors
/// Every mistake of every file; folders that cannot be read.
pub fn load(folders: &[&Path]) -> Result<Vec<Effect>, Errors> {
    let mut errors = Errors::default();
    let mut found: BTreeMap<String, Effect> = BTreeMap::new();
    for (name, text) in EMBEDDED {
        found.extend(
            errors
                .take(parse(name, &format!("<effects/{name}>"), text))
                .map(|e| (e.name.clone(), e)),
        );
    }
    for folder in folders {
        let Some(paths) = errors.take(files(folder)) else { continue };
        if paths.is_empty() {
            let what = "there is no effect file (*.toml) in this folder";
            errors.push(Error::at(Place::file(folder.to_string_lossy()), what));
        }
        for path in paths {
            let name =
                path.file_stem().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let read = config::read_text(&path).map_err(Errors::from);
            let place = path.to_string_lossy().into_owned();
            let effect = read.and_then(|text| parse(&name, &place, &text));
            let effect = effect.map(|effect| Effect { place: Some(place), ..effect });
            found.extend(errors.take(effect).map(|e| (e.name.clone(), e)));
        }
    }
    check_rivals(&found, &mut errors);
    errors.or(found.into_values().collect())
}

/// Rivals of effects of the user's own are effects.
fn check_rivals(found: &BTreeMap<String, Effect>, errors: &mut Errors) {
    for (effect, place) in found.values().filter_map(|e| Some((e, e.place.as_ref()?))) {
        for rival in effect.file.rivals.iter().filter(|rival| !found.contains_key(*rival)) {
            let what = format!("`rivals`: there is no effect \"{rival}\"");
            let near = config::nearest(rival, found.keys().map(String::as_str));
            let error = Error::at(Place::file(place), what);
            errors.push(match near {
                Some(near) => error.help(format!("did you mean \"{near}\"?")),
                None => error,
            });
        }
    }
}

fn files(folder: &Path) -> Result<Vec<std::path::PathBuf>, Error> {
    let failed = |e: std::io::Error| {
        Error::new(format!("{}: cannot read the folder of effects: {e}", folder.display()))
    };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|e| e == "toml") {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// One effect from text.
///
/// # Errors
/// Every mistake of the file.
pub fn parse(name: &str, place: &str, text: &str) -> Result<Effect, Errors> {
    let (file, doc) = config::parse::<EffectFile>(place, text)?;
    let mut errors = Errors::default();
    check_binds(&file, &doc, &mut errors);
    check_placeholders(&file, &doc, &mut errors);
    check_states(&file, &doc, &mut errors);
    check_sizes(&file, &doc, &mut errors);
    errors.or(Effect { name: name.to_string(), file, place: None })
}

fn check_binds(file: &EffectFile, doc: &Doc, errors: &mut Errors) {
    for (key, bind) in &file.bind {
        if !roles::exists(bind.role()) {
            let known = roles::names().join(", ");
            let what = format!("there is no role \"{}\"", bind.role());
            errors.push(doc.error(&format!("bind.{key}"), what).help(format!("roles: {known}")));
        }
    }
    if let Some(role) = file.unless.as_ref().filter(|role| !roles::exists(role)) {
        errors.push(doc.error("unless", format!("there is no role \"{role}\"")));
    }
    if file.add.is_empty() && file.replace.is_empty() {
        errors.push(doc.error("", "an effect adds to something or replaces something"));
    }
}

fn check_placeholders(file: &EffectFile, doc: &Doc, errors: &mut Errors) {
    let own = |key: &str| {
        file.bind.contains_key(key)
            || file.parameters.contains_key(key)
            || file.equations.contains_key(key)
            || file.states.contains_key(key)
            || file.constants.contains_key(key)
    };
    let bound = |key: &str| file.bind.contains_key(key.split('.').next().unwrap_or(key));
    let mut check = |path: String, text: &str, known: &dyn Fn(&str) -> bool| {
        for key in fill::placeholders(text) {
            if !known(&key) {
                errors.push(doc.error(&path, format!("\"{{{key}}}\" is not bound here")));
            }
        }
    };
    for (key, text) in
        [("title", &file.title), ("signature", &file.signature), ("separate", &file.separate)]
    {
        check(key.to_string(), text, &bound);
    }
    let expression = |key: &str| own(key) || bound(key);
    for (section, lines) in [("add", &file.add), ("replace", &file.replace)] {
        for (target, text) in lines {
            check(format!("{section}.{target}"), target, &bound);
            check(format!("{section}.{target}"), text, &expression);
        }
    }
    for (key, text) in &file.equations {
        check(format!("equations.{key}"), text, &expression);
    }
    for (key, state) in &file.states {
        check(format!("states.{key}.rate"), &state.rate, &expression);
        check(format!("states.{key}.unit"), &state.unit, &bound);
        let values = [
            ("start", Some(&state.start)),
            ("min", state.min.as_ref()),
            ("max", state.max.as_ref()),
            ("rate_max", state.rate_max.as_ref()),
            ("friction", state.friction.as_ref()),
        ];
        for (field, value) in values {
            if let Some(Value::Text(text)) = value {
                check(format!("states.{key}.{field}"), text, &expression);
            }
        }
    }
    for (key, size) in &file.parameters {
        check(format!("parameters.{key}.unit"), &size.unit, &bound);
        check(format!("parameters.{key}.name"), size.name.as_deref().unwrap_or(""), &bound);
    }
}

/// Noise drives a model as a whole, which is then filtered: no effect adds it to one that is not.
fn check_states(file: &EffectFile, doc: &Doc, errors: &mut Errors) {
    for (key, state) in &file.states {
        let given = [("noise", &state.noise), ("start_sd", &state.start_sd)];
        for (field, _) in given.into_iter().filter(|(_, value)| value.is_some()) {
            let what = format!("a state of an effect has no {field}");
            let help =
                "put a gust into the model itself ([[use]]), and estimate it by filter error";
            errors.push(doc.error(&format!("states.{key}.{field}"), what).help(help));
        }
    }
}

fn check_sizes(file: &EffectFile, doc: &Doc, errors: &mut Errors) {
    for (key, size) in &file.parameters {
        let mut wrong = |what: &str| {
            errors.push(doc.error(&format!("parameters.{key}"), format!("\"{key}\": {what}")))
        };
        if size.null.is_none() && size.starts.is_empty() && size.near.is_none() {
            wrong("a size has a null value, a shape has starts");
        }
        if size.hold.is_some() && size.null.is_none() {
            wrong("only a size is held");
        }
        if size.chosen && size.null.is_some() {
            wrong("only a shape is chosen among its starts");
        }
        if !size.steps.is_empty() && size.null.is_none() {
            wrong("only a size has steps; a shape has starts");
        }
        if size.steps.iter().any(|step| size.null == Some(*step)) {
            wrong("a step is not null");
        }
        let (min, max) = (size.min.unwrap_or(f64::NEG_INFINITY), size.max.unwrap_or(f64::INFINITY));
        let starts = if size.about.is_some() { &[][..] } else { &size.starts };
        if size
            .null
            .iter()
            .chain(&size.hold)
            .chain(&size.steps)
            .chain(starts)
            .any(|v| !(min <= *v && *v <= max))
        {
            wrong("null, hold, steps and starts lie within the bounds");
        }
        if size.of.iter().chain(&size.about).any(|of| !file.bind.contains_key(of)) {
            wrong("`of` and `about` are names of something bound");
        }
        let stands_in = |over| matches!(file.bind.get(over), Some(Bind::Or(with)) if with.or > 0.0);
        if size.over.as_ref().is_some_and(|over| !stands_in(over)) {
            wrong("what `over` names is bound with a positive number that stands in for it (`or`)");
        }
        if size.near.as_ref().is_some_and(|near| !roles::exists(&near.role)) {
            wrong("`near` is a role of a constant");
        }
    }
    if file.parameters.values().all(|p| p.null.is_none()) {
        errors.push(
            doc.error(
                "parameters",
                "an effect has at least one size: a parameter with a null value",
            ),
        );
    }
}
