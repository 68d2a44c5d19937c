//! Signals of a flight come in; the flight path, and the sensor errors it needed, go out.

use super::{Campaign, Inputs, Note, Output, Per, Read, Severity, Stage, Unit, said, series, slice_of};
use crate::config::{Doc, nearest};
use crate::error::{Error, Errors, Result};
use crate::model::{Constants, Model, Quantity};
use crate::reconstruct::{self, FlightPath};
use crate::table::{Table, schema};
use crate::units::Unit as PhysicalUnit;
use indexmap::IndexMap;
use serde_json::{Value, json};

pub use crate::reconstruct::Settings;

pub const STAGE: Stage = Stage {
    name: "reconstruct",
    about: "reconstruct the flight path",
    per: Per::Flight,
    wanted: |campaign| campaign.reconstruct.is_some(),
    writes: &["flightpath", "biases"],
    reads: |_, unit| Read::flight(&["signals"], &unit.name),
    reads_log: false,
    slice,
    run,
};

/// The fragment with the kinematic equations.
const KINEMATICS: &str = "kinematics";

/// The checked settings of this stage.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    pub model: Model,
}

impl Config {
    /// Checks the settings against the kinematic model and the signals, given with their SI units.
    ///
    /// # Errors
    /// Constants that the aircraft file lacks, names that are not of the model, inputs without a signal, units that do not agree.
    pub fn new(settings: Settings, constants: &Constants, signals: &IndexMap<String, String>, doc: &Doc) -> std::result::Result<Config, Errors> {
        let model = Model::embedded(KINEMATICS, constants)?;
        let place = |e: Error| Error { place: e.place.or_else(|| Some(doc.place("reconstruct"))), ..e };
        let checked = reconstruct::check(&model, &settings).map_err(|errors| Errors(errors.0.into_iter().map(place).collect()));
        let mut errors = Errors::default();
        errors.take(checked);
        for input in &model.inputs {
            agree(input, &settings, signals, doc, true, &mut errors);
        }
        for output in &model.outputs {
            agree(output, &settings, signals, doc, false, &mut errors);
        }
        let names = model.outputs.iter().map(|o| settings.signals.get(&o.name).unwrap_or(&o.name));
        if !names.into_iter().any(|name| signals.contains_key(name)) {
            let known: Vec<&str> = model.outputs.iter().map(|o| o.name.as_str()).collect();
            let what = "no signal of the channel map measures an output of the kinematic model";
            errors.push(doc.error("reconstruct", what).help(format!("it can be compared with {}", known.join(", "))));
        }
        errors.or(Config { settings, model })
    }
}

/// Checks that the signal of one quantity of the model is there, where it must be, and in the same unit.
fn agree(quantity: &Quantity, settings: &Settings, signals: &IndexMap<String, String>, doc: &Doc, needed: bool, errors: &mut Errors) {
    let mapped = settings.signals.get(&quantity.name);
    let name = mapped.unwrap_or(&quantity.name);
    let key = if mapped.is_some() { format!("reconstruct.signals.{}", quantity.name) } else { "reconstruct".to_string() };
    match signals.get(name) {
        Some(unit) => {
            let dim = |text: &str| PhysicalUnit::parse(text).ok().map(|u| u.dim);
            if dim(unit) != dim(&quantity.unit) {
                errors.push(doc.error(&key, format!("signal \"{name}\" is in {unit}, the kinematic model needs {}", quantity.unit)));
            }
        }
        None if needed || mapped.is_some() => {
            let near = nearest(name, signals.keys().map(String::as_str)).map(|n| format!("did you mean \"{n}\"? ")).unwrap_or_default();
            let what = format!("the kinematic model needs the signal \"{name}\" ({}), and the channel map has none", quantity.doc);
            errors.push(doc.error(&key, what).help(format!("{near}map it in the channel map, or name another under [reconstruct.signals]")));
        }
        None => {}
    }
}

fn slice(campaign: &Campaign, _: &Unit) -> Value {
    let Some(config) = &campaign.reconstruct else { return Value::Null };
    let mut slice = slice_of(&config.settings);
    if let Some(entries) = slice.as_object_mut() {
        entries.insert("model".into(), said(&config.model));
    } else {
        slice = json!({ "settings": slice, "model": said(&config.model) });
    }
    slice
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = &campaign.reconstruct else { return Ok(Output::default()) };
    let signals = series(inputs.of("signals", &unit.name)?)?;
    let path = reconstruct::reconstruct(&config.model, |name| signals.get(name).copied(), &config.settings)?;
    let flightpath = flightpath(&unit.name, &config.model, &path)?;
    let notes = notes(&unit.name, &path, flightpath.rows());
    Ok(Output { tables: vec![("flightpath", flightpath), ("biases", biases(&unit.name, &path)?)], files: Vec::new(), notes })
}

/// The path where there is one; times without a path have no row.
fn flightpath(flight: &str, model: &Model, path: &FlightPath) -> Result<Table> {
    let rows: Vec<usize> = (0..path.t.len()).filter(|k| path.outputs.iter().all(|column| column[*k].is_finite())).collect();
    let pick = |column: &[f64]| rows.iter().map(|k| column[*k]).collect::<Vec<f64>>();
    let mut table = Table::build("flightpath").repeat("flight", flight).f64("t_s", pick(&path.t));
    for column in schema("flightpath")?.columns.iter().filter(|c| !["flight", "t_s"].contains(&c.name.as_str())) {
        if let Some(values) = model.output(&column.name).and_then(|i| path.outputs.get(i)) {
            table = table.f64(&column.name, pick(values));
        } else if rows.is_empty() {
            table = table.f64(&column.name, Vec::new());
        }
    }
    table.finish()
}

fn biases(flight: &str, path: &FlightPath) -> Result<Table> {
    let mut all: Vec<_> = path.biases.iter().collect();
    all.sort_by_key(|b| (b.window, &b.parameter));
    Table::build("biases")
        .repeat("flight", flight)
        .i64("window", all.iter().map(|b| b.window as i64).collect::<Vec<_>>())
        .f64("t_start_s", all.iter().map(|b| b.t_start_s).collect::<Vec<_>>())
        .f64("t_end_s", all.iter().map(|b| b.t_end_s).collect::<Vec<_>>())
        .strings("parameter", all.iter().map(|b| &b.parameter))
        .strings("unit", all.iter().map(|b| &b.unit))
        .f64("value", all.iter().map(|b| b.value).collect::<Vec<_>>())
        .f64("sd", all.iter().map(|b| b.sd.unwrap_or(f64::NAN)).collect::<Vec<_>>())
        .finish()
}

fn notes(flight: &str, path: &FlightPath, rows: usize) -> Vec<Note> {
    let note = |severity: Severity, text: String| {
        let (flight, stage, subject) = (flight.to_string(), STAGE.name.to_string(), "flightpath".to_string());
        Note { flight, stage, severity, subject, count: 1, text }
    };
    let mut notes: Vec<Note> = path.notes.iter().map(|text| note(Severity::Warning, text.clone())).collect();
    if rows == 0 {
        notes.push(note(Severity::Missing, "no flight path could be reconstructed".to_string()));
    }
    notes
}
