//! Estimates with their correlations come in; equations of the model over a range of conditions, with the bands that
//! the covariance of the estimates makes, go out.

mod config;

use super::validate::correlated;
use super::{
    Campaign, Inputs, Key, Note, Output, Part, Read, Severity, Stage, Unit, said, slice_of,
};
use crate::dynamics::{Directions, Propagator, Record};
use crate::error::{Errors, Result};
use crate::math::distribution::INTERVAL_95;
use crate::table::Table;
use config::{Config, NAME, Settings};
use indexmap::IndexMap;
use serde_json::{Value, json};

pub const STAGE: Stage = Stage {
    name: NAME,
    about: "draw equations with their bands",
    key: Some(Key::of::<Vec<Settings>>()),
    check: config::check,
    units: |campaign| Unit::entries(all(campaign).iter().map(|c| c.settings.name())),
    writes: &["curves"],
    reads,
    slice,
    run,
    ..Stage::PLAIN
};

/// The curves of a campaign.
fn all(campaign: &Campaign) -> &[Config] {
    campaign.told.get::<Vec<Config>>(STAGE.name).map(Vec::as_slice).unwrap_or_default()
}

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let Some(config) = all(campaign).get(unit.index) else { return Value::Null };
    json!({
        "settings": slice_of(&config.settings),
        "model": said(&config.model),
        "held": slice_of(&config.held),
    })
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let Some(config) = all(campaign).get(unit.index) else { return Vec::new() };
    let part = |table| Read { table, part: Part::Number(config.estimate), optional: true };
    ["estimates", "correlations"].map(part).to_vec()
}

/// A point of a curve.
struct Point {
    group: String,
    equation: usize,
    label: String,
    x: f64,
    value: f64,
    sd: f64,
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = all(campaign).get(unit.index) else { return Ok(Output::default()) };
    let (mut points, mut notes) = (Vec::new(), Vec::new());
    let number = Part::Number(config.estimate);
    let tables = [inputs.get("estimates", number.clone()), inputs.get("correlations", number)];
    let mut groups: Vec<&str> = Vec::new();
    if let [Some(estimates), _] = tables {
        groups = estimates.strings("group")?;
        groups.dedup();
    }
    if groups.is_empty() {
        notes.push(missing(config, "there are no estimates"));
    }
    for group in groups {
        match values(config, group, tables)? {
            Ok(known) => points.extend(drawn(config, group, &known)?),
            Err(why) => notes.push(missing(config, &why)),
        }
    }
    Ok(Output { tables: vec![("curves", table(config, &points)?)], files: Vec::new(), notes })
}

fn missing(config: &Config, why: &str) -> Note {
    Note {
        flight: String::new(),
        stage: NAME.to_string(),
        severity: Severity::Missing,
        subject: config.settings.name(),
        count: 1,
        text: format!("no curve of {}: {why}", config.settings.name()),
    }
}

/// Values of all parameters of the model, and the covariance `[n][n]` of those that are estimated.
struct Values {
    parameters: Vec<f64>,
    estimated: Vec<usize>,
    covariance: Vec<f64>,
}

/// The values of a group of the estimate; why there are none, in words.
fn values(
    config: &Config,
    group: &str,
    [estimates, correlations]: [Option<&Table>; 2],
) -> Result<std::result::Result<Values, String>> {
    let Some(table) = estimates else { return Ok(Err("there are no estimates".into())) };
    let (names, groups) = (table.strings("parameter")?, table.strings("group")?);
    let (of, stops) = (table.opt_strings("of")?, table.strings("stop")?);
    let (found, sds) = (table.f64("value")?, table.f64("sd")?);
    let mut values =
        Values { parameters: Vec::new(), estimated: Vec::new(), covariance: Vec::new() };
    let mut rows: Vec<usize> = Vec::new();
    for (place, p) in config.model.parameters.iter().enumerate() {
        let name = &p.quantity.name;
        let row =
            (0..names.len()).find(|&i| names[i] == name && groups[i] == group && of[i].is_none());
        let value = match (config.held.get(name), row) {
            (Some(held), _) => *held,
            (None, Some(i)) if stops[i] == "converged" && found[i].is_finite() => {
                values.estimated.push(place);
                rows.push(i);
                found[i]
            }
            (None, Some(i)) => return Ok(Err(format!("the estimate ended with \"{}\"", stops[i]))),
            (None, None) if config.model.uses(name) => {
                return Ok(Err(format!("the estimate has no single value of {name}")));
            }
            (None, None) => p.start,
        };
        values.parameters.push(value);
    }
    let n = rows.len();
    values.covariance = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let between = match correlations {
                Some(correlations) => correlated(table, correlations, [rows[i], rows[j]])?,
                None if i == j => sds[rows[i]] * sds[rows[i]],
                None => 0.0,
            };
            // What is held has no standard deviation.
            let between = if between.is_finite() { between } else { 0.0 };
            (values.covariance[i * n + j], values.covariance[j * n + i]) = (between, between);
        }
    }
    Ok(Ok(values))
}

/// The points of all curves of a group.
fn drawn(config: &Config, group: &str, values: &Values) -> Result<Vec<Point>> {
    let (s, model) = (&config.settings, &config.model);
    let directions = Directions { parameters: values.estimated.clone(), starts: Vec::new() };
    let propagator = Propagator::new(model, directions)?;
    let (n, ny, nd) = (s.points, model.outputs.len(), values.estimated.len());
    let x = |k: usize| s.range[0] + (s.range[1] - s.range[0]) * k as f64 / (n as f64 - 1.0);
    let empty = IndexMap::new();
    let all = if s.at.is_empty() { std::slice::from_ref(&empty) } else { &s.at[..] };
    let mut points = Vec::new();
    for at in all {
        let input = |k: usize, name: &str| match name == s.along {
            true => x(k),
            false => at.get(name).copied().unwrap_or(0.0),
        };
        let row = |k: usize| model.inputs.iter().map(move |q| input(k, &q.name));
        let inputs = (0..n).flat_map(row).collect();
        let record = Record { dt: 1.0, n, inputs, ..Default::default() };
        let grid = propagator.run(&values.parameters, &[], &record, true);
        let label: Vec<String> =
            at.iter().map(|(name, value)| label(model, name, *value)).collect();
        for equation in 0..ny {
            for k in 0..n {
                let slopes = &grid.dy[(k * ny + equation) * nd..][..nd];
                points.push(Point {
                    group: group.to_string(),
                    equation,
                    label: label.join(", "),
                    x: x(k),
                    value: grid.y[k * ny + equation],
                    sd: quadratic(&values.covariance, slopes).max(0.0).sqrt(),
                });
            }
        }
    }
    Ok(points)
}

/// `eta_k = 0.0175 rad`
fn label(model: &crate::model::Model, name: &str, value: f64) -> String {
    let unit = model.inputs.iter().find(|q| q.name == name).map_or("", |q| q.unit.as_str());
    format!("{name} = {value} {unit}").trim_end_matches([' ', '-']).to_string()
}

/// `g' C g`
fn quadratic(covariance: &[f64], g: &[f64]) -> f64 {
    let rows = covariance.chunks_exact(g.len().max(1)).zip(g);
    rows.map(|(row, gi)| gi * row.iter().zip(g).map(|(c, gj)| c * gj).sum::<f64>()).sum()
}

fn table(config: &Config, points: &[Point]) -> Result<Table> {
    let (s, model) = (&config.settings, &config.model);
    let unit_x = model.inputs.iter().find(|q| q.name == s.along).map_or("-", |q| q.unit.as_str());
    let number = |of: fn(&Point) -> f64| points.iter().map(of).collect::<Vec<f64>>();
    Table::build("curves")
        .repeat("curve", &s.name())
        .repeat("model", &s.estimate)
        .strings("group", points.iter().map(|p| &p.group))
        .strings("equation", points.iter().map(|p| &model.outputs[p.equation].name))
        .strings("unit", points.iter().map(|p| &model.outputs[p.equation].unit))
        .strings("at", points.iter().map(|p| &p.label))
        .repeat("input", &s.along)
        .repeat("unit_x", unit_x)
        .f64("x", number(|p| p.x))
        .f64("value", number(|p| p.value))
        .f64("sd", number(|p| p.sd))
        .f64("lower", number(|p| p.value - INTERVAL_95 * p.sd))
        .f64("upper", number(|p| p.value + INTERVAL_95 * p.sd))
        .finish()
}
