//! Signals of a flight come in; the flight path, and the sensor errors it needed, go out.

mod config;

use super::{Campaign, Inputs, Note, Output, Read, Severity, Stage, Unit, slice_of};
use crate::config::list;
use crate::error::{Error, Errors};
use crate::model::{Model, Quantity};
use crate::reconstruct::{self, FlightPath};
use crate::table::Table;
use serde_json::Value;

pub use config::{Config, Settings};

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

fn slice(campaign: &Campaign, _: &Unit) -> Value {
    let of = |config: &Config| serde_json::json!({ "settings": slice_of(&config.settings), "model": super::said(&config.model) });
    campaign.reconstruct.as_ref().map(of).unwrap_or_default()
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> Result<Output, Errors> {
    let Some(config) = &campaign.reconstruct else { return Ok(Output::default()) };
    let method = &config.settings.method;
    let name = |q: &Quantity| method.signals.get(&q.name).unwrap_or(&q.name).clone();
    let names: Vec<String> =
        config.model.inputs.iter().chain(&config.model.outputs).map(name).collect();
    let signals = inputs.signals(&unit.name, &names)?;
    let signals = signals.map_or_else(|| inputs.of("signals", &unit.name), Ok)?;
    let signals = super::series(&signals)?;
    let driving = config.model.inputs.iter().map(name);
    let lacking: Vec<String> =
        driving.filter(|name| !signals.contains_key(name.as_str())).collect();
    if !lacking.is_empty() {
        let what = format!(
            "no flight path: it needs {}, and this flight has no sample of it",
            list(&lacking)
        );
        let help = "the channel map may say that a log may lack it (optional = true): a note of ingest says why it does";
        return Err(Error::new(what).help(help).into());
    }
    let mut path = reconstruct::reconstruct(
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
        ("flightpath", flightpath(&unit.name, &config.model, &mut path)?),
        ("biases", biases(&unit.name, &path)?),
        ("consistency", consistency(&unit.name, &path)?),
        ("pathmatch", pathmatch(&unit.name, &config.model, &path)?),
    ];
    Ok(Output { tables, files: Vec::new(), notes })
}

/// The columns of the flight path that the kinematic model has as outputs, where there is a path.
/// They are most of what a long flight takes: each is handed on, not copied.
fn flightpath(flight: &str, model: &Model, path: &mut FlightPath) -> crate::error::Result<Table> {
    let kept: Vec<usize> = (0..path.t.len())
        .filter(|&k| path.outputs.iter().any(|column| column[k].is_finite()))
        .collect();
    let pick = |values: Vec<f64>| match kept.len() == values.len() {
        true => values,
        false => kept.iter().map(|&k| values[k]).collect(),
    };
    let t = pick(std::mem::take(&mut path.t));
    let mut table = Table::build("flightpath").repeat("flight", flight).f64("t_s", t);
    for column in crate::table::schema("flightpath")?
        .columns
        .iter()
        .filter(|c| !["flight", "t_s"].contains(&c.name.as_str()))
    {
        let (name, from) = match column.name.strip_suffix("_sd") {
            Some(name) => (name, &mut path.sd),
            None => (column.name.as_str(), &mut path.outputs),
        };
        let values = model.output(name).and_then(|k| from.get_mut(k)).map(std::mem::take);
        table = table.f64(&column.name, values.map_or_else(|| vec![f64::NAN; kept.len()], &pick));
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
