//! Signals of a flight come in; the flight path, and the sensor errors it needed, go out.

use super::{Campaign, Channels, Inputs, Note, Output, Read, Severity, Stage, Unit, slice_of};
use crate::config::Doc;
use crate::error::{Error, Errors};
use crate::model::{Constants, Model, Quantity};
use crate::reconstruct::taken::{self, Apart, Taken};
use crate::reconstruct::{self, FlightPath};
use crate::table::Table;
use crate::units;
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

pub const STAGE: Stage = Stage {
    name: "reconstruct",
    about: "reconstruct the flight path",
    units: |campaign| {
        if campaign.reconstruct.is_some() { Unit::flights(campaign) } else { Vec::new() }
    },
    writes: &["flightpath", "biases", "consistency", "pathmatch"],
    reads: |_, unit| Read::flight(&["signals"], &unit.name),
    slice,
    run,
    ..Stage::PLAIN
};

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

/// Files an error where a signal's dimension is not the model's.
fn same(
    errors: &mut Errors,
    (doc, channels): (&Doc, &Channels),
    name: &str,
    unit: &str,
    wanted: &str,
) {
    if let (Ok(has), Ok(wants)) = (units::Unit::parse(unit), units::Unit::parse(wanted))
        && has.dim != wants.dim
    {
        let what = format!("signal \"{name}\" is in {unit}, the kinematic model wants {wanted}");
        let place = channels.doc.place(&format!("signal.{name}.unit"));
        let help = format!(
            "correct its unit at {place}, or name another signal under [reconstruct.method.signals]"
        );
        errors.push(doc.error("reconstruct", what).help(help));
    }
}

fn slice(campaign: &Campaign, _: &Unit) -> Value {
    let of = |config: &Config| serde_json::json!({ "settings": slice_of(&config.settings), "model": super::said(&config.model) });
    campaign.reconstruct.as_ref().map(of).unwrap_or_default()
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> Result<Output, Errors> {
    let Some(config) = &campaign.reconstruct else { return Ok(Output::default()) };
    let signals = super::series(inputs.of("signals", &unit.name)?)?;
    let path = reconstruct::reconstruct(
        &config.model,
        |name| signals.get(name).copied(),
        &config.settings.method,
    )?;
    let note = |severity, subject: &str, count, text: &str| Note {
        flight: unit.name.clone(),
        stage: STAGE.name.to_string(),
        severity,
        subject: subject.to_string(),
        count,
        text: text.to_string(),
    };
    let of_path = path.notes.iter().map(|n| {
        let severity = if n.missing { Severity::Missing } else { Severity::Warning };
        note(severity, &n.subject, n.count, &n.text)
    });
    let notes = config
        .apart
        .iter()
        .map(|text| note(Severity::Info, "flightpath", 1, text))
        .chain(of_path)
        .collect();
    let tables = vec![
        ("flightpath", flightpath(&unit.name, &config.model, &path)?),
        ("biases", biases(&unit.name, &path)?),
        ("consistency", consistency(&unit.name, &path)?),
        ("pathmatch", pathmatch(&unit.name, &config.model, &path)?),
    ];
    Ok(Output { tables, files: Vec::new(), notes })
}

/// The columns of the flight path that the kinematic model has as outputs, where there is a path.
fn flightpath(flight: &str, model: &Model, path: &FlightPath) -> crate::error::Result<Table> {
    let kept: Vec<usize> = (0..path.t.len())
        .filter(|&k| path.outputs.iter().any(|column| column[k].is_finite()))
        .collect();
    let pick = |values: &[f64]| -> Vec<f64> { kept.iter().map(|&k| values[k]).collect() };
    let mut table = Table::build("flightpath").repeat("flight", flight).f64("t_s", pick(&path.t));
    for column in crate::table::schema("flightpath")?
        .columns
        .iter()
        .filter(|c| !["flight", "t_s"].contains(&c.name.as_str()))
    {
        let (name, from) = match column.name.strip_suffix("_sd") {
            Some(name) => (name, &path.sd),
            None => (column.name.as_str(), &path.outputs),
        };
        let values = model.output(name).and_then(|k| from.get(k));
        table =
            table.f64(&column.name, values.map_or_else(|| vec![f64::NAN; kept.len()], |v| pick(v)));
    }
    table.finish()
}

fn biases(flight: &str, path: &FlightPath) -> crate::error::Result<Table> {
    let rows = &path.biases;
    Table::build("biases")
        .repeat("flight", flight)
        .i64("window", rows.iter().map(|b| b.window as i64).collect::<Vec<_>>())
        .f64("t_start_s", rows.iter().map(|b| b.t_start_s).collect::<Vec<_>>())
        .f64("t_end_s", rows.iter().map(|b| b.t_end_s).collect::<Vec<_>>())
        .strings("parameter", rows.iter().map(|b| &b.parameter))
        .strings("unit", rows.iter().map(|b| &b.unit))
        .f64("value", rows.iter().map(|b| b.value).collect::<Vec<_>>())
        .f64("sd", rows.iter().map(|b| b.sd.unwrap_or(f64::NAN)).collect::<Vec<_>>())
        .finish()
}

fn consistency(flight: &str, path: &FlightPath) -> crate::error::Result<Table> {
    let rows = &path.checks;
    let numbers =
        |f: fn(&reconstruct::consistency::Row) -> f64| rows.iter().map(f).collect::<Vec<_>>();
    Table::build("consistency")
        .repeat("flight", flight)
        .strings("channel", rows.iter().map(|r| &r.channel))
        .strings("check", rows.iter().map(|r| r.check))
        .f64("value", numbers(|r| r.value))
        .f64("low", numbers(|r| r.low))
        .f64("high", numbers(|r| r.high))
        .strings("unit", rows.iter().map(|r| &r.unit))
        .strings("verdict", rows.iter().map(|r| r.verdict))
        .strings("text", rows.iter().map(|r| &r.text))
        .finish()
}

fn pathmatch(flight: &str, model: &Model, path: &FlightPath) -> crate::error::Result<Table> {
    let mut compared: Vec<_> =
        path.compared.iter().map(|c| (&model.outputs[c.output], c)).collect();
    compared.sort_by(|a, b| a.0.name.cmp(&b.0.name));
    let numbers = |f: fn(&reconstruct::Compared) -> &Vec<f64>| {
        compared.iter().flat_map(|c| f(c.1)).copied().collect::<Vec<_>>()
    };
    let texts = |f: fn(&Quantity) -> &String| {
        compared.iter().flat_map(move |c| c.1.t.iter().map(move |_| f(c.0)))
    };
    Table::build("pathmatch")
        .repeat("flight", flight)
        .strings("channel", texts(|q| &q.name))
        .strings("unit", texts(|q| &q.unit))
        .f64("t_s", numbers(|c| &c.t))
        .f64("measured", numbers(|c| &c.measured))
        .f64("reconstructed", numbers(|c| &c.reconstructed))
        .finish()
}
