//! Estimates with their correlations come in; equations of the model over a range of conditions, with the bands that
//! the covariance of the estimates makes, go out, and where a prediction of them lies beside these.

mod compared;
mod config;
mod family;
mod points;
mod prediction;
mod tables;
mod values;

use super::estimate::{reads_of, ready};
use super::{Campaign, Inputs, Key, Note, Output, Read, Severity, Stage, Unit, said, slice_of};
use crate::error::{Errors, Result};
use compared::Against;
use config::{Config, NAME, Settings};
use family::families;
use points::points;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use values::values;

pub const STAGE: Stage = Stage {
    name: NAME,
    about: "draw equations with their bands",
    key: Some(Key::of::<Vec<Settings>>()),
    check: config::check,
    units: |campaign| Unit::entries(all(campaign).iter().map(|c| c.settings.name())),
    writes: &["curves", "predictions", "unpredicted"],
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
    let base = campaign.estimates.get(config.estimate).filter(|_| config.prediction.is_some());
    json!({
        "settings": slice_of(&config.settings),
        "model": said(&config.model),
        "held": slice_of(&config.held),
        "levels": format!("{:?}", config.levels),
        "prediction": format!("{:?}", config.prediction),
        "flown": base.map(|base| json!([slice_of(&base.settings), ready::left_out(base, campaign)])),
    })
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let Some(config) = all(campaign).get(unit.index) else { return Vec::new() };
    let tables = ["estimates", "correlations", "budget"];
    let mut reads = reads_of(&tables, campaign, config.estimate);
    if config.prediction.is_some() {
        let flown = ["signals", "samples", "segments", "conditions"];
        reads.extend(Read::flights(&flown, campaign));
    }
    reads
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = all(campaign).get(unit.index) else { return Ok(Output::default()) };
    let get = |table| inputs.numbered(table, config.estimate);
    let tables = [get("estimates")?, get("correlations")?, get("budget")?];
    let tables = tables.each_ref().map(Option::as_ref);
    let mut groups: Vec<&str> = Vec::new();
    if let [Some(estimates), ..] = tables {
        groups = estimates.strings("group")?;
        groups.dedup();
    }
    let mut notes = Vec::new();
    if groups.is_empty() {
        notes.push(note(config, Severity::Missing, missing(config, "there are no estimates")));
    }
    let flown = flown(config, campaign, inputs)?;
    let (mut drawn, mut against) = (Vec::new(), Vec::new());
    for family in families(config, &groups) {
        let level = family.level.map(|level| level.to_string());
        let known = match values(config, (family.group, level.as_deref()), tables)? {
            Ok(known) => known,
            Err(why) => {
                notes.push(note(config, Severity::Missing, missing(config, &why)));
                continue;
            }
        };
        let at = |x: &[f64]| points(config, &known, family.at, x);
        if let Some(prediction) = &config.prediction {
            let range = flown.get(&level.unwrap_or_default()).copied();
            against.extend(compared::all(config, (&family, prediction), range, &at)?);
        }
        let all = at(&config.settings.abscissae())?;
        drawn.extend(
            all.into_iter().map(|point| (family.group.to_string(), family.label.clone(), point)),
        );
    }
    notes.extend(
        against
            .iter()
            .filter_map(|one: &Against| one.note(config))
            .map(|(severity, text)| note(config, severity, text)),
    );
    notes.dedup();
    Ok(Output { tables: tables::all(config, &drawn, &against)?, files: Vec::new(), notes })
}

/// The range of the input along which curves are drawn in the maneuvers of the estimate, by level; only where a
/// prediction is held against it.
fn flown(
    config: &Config,
    campaign: &Campaign,
    inputs: &Inputs,
) -> Result<BTreeMap<String, [f64; 2]>> {
    let mut ranges: BTreeMap<String, [f64; 2]> = BTreeMap::new();
    let Some(base) =
        campaign.estimates.get(config.estimate).filter(|_| config.prediction.is_some())
    else {
        return Ok(ranges);
    };
    let (place, n) = (base.model.input(&config.settings.along), base.model.inputs.len());
    let Some(place) = place else { return Ok(ranges) };
    for one in ready::of(base, campaign, inputs, &mut Vec::new())? {
        let level = config.levels.as_ref().and_then(|l| one.labelled.labels.get(&l.name)).cloned();
        let values = one.labelled.record.inputs.iter().skip(place).step_by(n.max(1));
        let range = ranges.entry(level.unwrap_or_default()).or_insert([f64::NAN; 2]);
        values.for_each(|x| *range = [range[0].min(*x), range[1].max(*x)]);
    }
    Ok(ranges)
}

fn missing(config: &Config, why: &str) -> String {
    format!("no curve of {}: {why}", config.settings.name())
}

fn note(config: &Config, severity: Severity, text: String) -> Note {
    Note {
        flight: String::new(),
        stage: NAME.to_string(),
        severity,
        subject: config.settings.name(),
        count: 1,
        text,
    }
}
