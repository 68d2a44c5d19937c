//! `[reconstruct]` of the pipeline file comes in; its checked settings with the kinematic model, or
//! the mistakes, go out.

use crate::config::Doc;
use crate::error::{Error, Errors};
use crate::model::{Constants, Model};
use crate::reconstruct;
use crate::reconstruct::taken::{self, Apart, Taken};
use crate::stage::channels::Channels;
use crate::stage::check::{Unlike, agree};
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Flight-path reconstruction.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// The embedded kinematic model that is used; by default "kinematics".
    pub fragment: Option<String>,
    /// A kinematic model file beside the pipeline file instead; it can be put together from the
    /// embedded fragments `path_*`.
    pub model: Option<String>,
    /// How the path is found.
    pub method: reconstruct::Settings,
}

impl Settings {
    /// The embedded kinematic model, with the aircraft's constants.
    ///
    /// # Errors
    /// Every mistake of the model, at `[reconstruct]` where it has no place.
    pub fn embedded(&self, constants: &Constants, doc: &Doc) -> Result<Model, Errors> {
        Model::embedded(self.fragment.as_deref().unwrap_or("kinematics"), constants).map_err(
            |mut errors| {
                placed(&mut errors, doc);
                errors
            },
        )
    }
}

/// The checked settings of this stage.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    pub model: Model,
    /// Outputs that are not compared with the signals of their names, in words; none where all are.
    pub apart: Option<String>,
}

impl Config {
    /// Checks the settings against the kinematic model that they name and the signals of the
    /// channel map. Outputs whose signals drive the model, or are given to another output, become
    /// `unscored`.
    ///
    /// # Errors
    /// Every mistake: of the model, of names, of units.
    pub fn new(
        mut settings: Settings,
        model: Model,
        channels: &Channels,
        doc: &Doc,
    ) -> Result<Config, Errors> {
        let signals: &IndexMap<String, String> =
            &channels.map.signal.keys().map(|name| (name.clone(), channels.unit(name))).collect();
        let mut errors = Errors::default();
        errors.take(reconstruct::check(&model, &settings.method));
        let apart = taken::apart(&model, &settings.method, |a, b| channels.same(a, b));
        errors
            .0
            .extend(apart.iter().filter(|a| a.asked).map(|a| itself(&model, &settings, a, doc)));
        settings.method.unscored.extend(apart.iter().map(|a| model.outputs[a.output].name.clone()));
        let apart = (!apart.is_empty()).then(|| taken::words(&model, &apart));
        let signal = |quantity: &str| {
            settings.method.signals.get(quantity).map_or(quantity.to_string(), String::clone)
        };
        for input in &model.inputs {
            let name = signal(&input.name);
            match signals.get(&name) {
                None => errors.push(
                    doc.error("reconstruct", format!("the kinematic model needs the signal \"{name}\" ({})", input.doc))
                        .help("map it in the channel map, or name another one under [reconstruct.method.signals]"),
                ),
                Some(unit) => same(&mut errors, (doc, channels), &name, unit, &input.unit),
            }
        }
        let mut measured = 0;
        for output in
            model.outputs.iter().filter(|output| !settings.method.unscored.contains(&output.name))
        {
            let name = signal(&output.name);
            if let Some(unit) = signals.get(&name) {
                same(&mut errors, (doc, channels), &name, unit, &output.unit);
                measured += 1;
            }
        }
        // An output that is meant for a column of the flight path and does not reach it would be
        // lost in silence.
        let columns = || {
            crate::table::schema("flightpath")
                .into_iter()
                .flat_map(|s| &s.columns)
                .map(|c| c.name.as_str())
        };
        for name in model
            .outputs
            .iter()
            .map(|o| o.name.as_str())
            .filter(|name| columns().all(|c| c != *name))
        {
            if let Some(column) = columns().find(|c| c.to_lowercase() == name.to_lowercase()) {
                let what = format!(
                    "output \"{name}\" of the kinematic model differs from the flight path's \"{column}\" by case only"
                );
                let help = if name == "v" {
                    "the lateral velocity is \"v_body\""
                } else {
                    "call it the same, or something else"
                };
                errors.push(doc.error("reconstruct", what).help(help));
            }
        }
        if measured == 0 {
            let known: Vec<&str> = model.outputs.iter().map(|o| o.name.as_str()).collect();
            errors.push(
                doc.error("reconstruct", "no signal can be compared with the kinematic model")
                    .help(format!("it can be compared with {}", known.join(", "))),
            );
        }
        placed(&mut errors, doc);
        errors.or(Config { settings, model, apart })
    }
}

/// Mistakes without a place are those of `[reconstruct]`.
fn placed(errors: &mut Errors, doc: &Doc) {
    for error in &mut errors.0 {
        error.place.get_or_insert_with(|| doc.place("reconstruct"));
    }
}

/// The mistake of a signal that is mapped both to an input and to an output.
fn itself(model: &Model, settings: &Settings, apart: &Apart, doc: &Doc) -> Error {
    let output = &model.outputs[apart.output].name;
    let signal = settings.method.signals.get(output).map_or("", String::as_str);
    let input = match apart.taken {
        Taken::Input(i) => &model.inputs[i].name,
        Taken::Output(o) => &model.outputs[o].name,
    };
    let what = format!(
        "signal \"{signal}\" is input \"{input}\" of the kinematic model: compared with output \"{output}\" it would be compared with itself"
    );
    doc.error(&format!("reconstruct.method.signals.{output}"), what)
        .help(format!("leave out `{output}`"))
}

/// Files an error where a signal's dimension is not the model's; one without a unit has been told.
fn same(
    errors: &mut Errors,
    (doc, channels): (&Doc, &Channels),
    name: &str,
    unit: &str,
    wanted: &str,
) {
    if !unit.is_empty() && !agree(unit, wanted) {
        let stated = channels.stated(name);
        let by = "the kinematic model";
        let unlike = Unlike { name, unit, wanted, by, stated: stated.as_ref() };
        errors.push(unlike.error(doc.place("reconstruct")));
    }
}
