//! What a diagnosis adds to its model, and the maneuvers, come in; the same estimate with the
//! amended model goes out.

use super::diagnose::{self, recommended};
use super::estimate::{self, Config};
use super::{Campaign, Inputs, Output, Part, Read, Severity, Stage, Unit, slice_of};
use crate::diagnose::{Base, free_of_predictions};
use crate::error::{Error, Errors};
use serde_json::{Value, json};

pub const STAGE: Stage = Stage {
    name: "rerun",
    about: "estimate amended models",
    units,
    models,
    writes: &WRITES,
    reads,
    slice,
    run,
    spreads: true,
    ..Stage::PLAIN
};

const ESTIMATED: usize = estimate::STAGE.writes.len();

/// What an estimate writes, and which values are to be used.
const WRITES: [&str; ESTIMATED + 1] = {
    let mut all = ["recommended"; ESTIMATED + 1];
    let mut i = 0;
    while i < ESTIMATED {
        all[i] = estimate::STAGE.writes[i];
        i += 1;
    }
    all
};

/// The estimates that are run again, behind the estimates.
fn units(campaign: &Campaign) -> Vec<Unit> {
    let wanted = diagnose::all(campaign).iter().enumerate().filter(|(_, d)| d.settings.rerun);
    wanted.map(|(i, d)| Unit::entry(campaign.estimates.len() + i, d.settings.next())).collect()
}

/// All amended models are driven like the one that was amended.
fn models(campaign: &Campaign) -> Vec<(String, Vec<String>)> {
    let again = diagnose::all(campaign).iter();
    let base = |d: &diagnose::Config| campaign.estimates.get(d.estimate).map(Config::columns);
    again.filter_map(|d| Some((d.settings.next(), base(d)?))).collect()
}

/// Place of the diagnosis, its name, and the estimate that it is of.
fn parts<'a>(campaign: &'a Campaign, unit: &Unit) -> Option<(usize, &'a Config)> {
    let place = unit.index.checked_sub(campaign.estimates.len())?;
    Some((place, campaign.estimates.get(diagnose::all(campaign).get(place)?.estimate)?))
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let Some((place, base)) = parts(campaign, unit) else { return Vec::new() };
    let told = ["next_models", "shifts", "additions"].map(|table| Read {
        table,
        part: Part::Number(place),
        optional: false,
    });
    estimate::tables_read(base, campaign).into_iter().chain(told).collect()
}

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let Some((place, base)) = parts(campaign, unit) else { return Value::Null };
    let predicted = is_predicted(campaign, place);
    json!({ "name": unit.name, "predicted": predicted, "estimate": slice_of(&base.settings), "model": super::said(&base.model), "left_out": estimate::ready::left_out(base, campaign), "derived": estimate::derived(base, campaign).map(super::said) })
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> Result<Output, Errors> {
    let Some((place, base)) = parts(campaign, unit) else { return Ok(Output::default()) };
    let Some(table) = inputs.get("next_models", Part::Number(place))? else {
        return Ok(Output::default());
    };
    let Some(added) = table.strings("added")?.first().map(ToString::to_string) else {
        return Ok(Output::default());
    };
    let mut config = amended(base, &unit.name, &added, is_predicted(campaign, place))?;
    if let Some(shifts) = inputs.get("shifts", Part::Number(place))? {
        // The diagnosis has a fit with what was added: thresholds and delays are far from anything
        // the model's own starts fit.
        let found = shifts.strings("parameter")?.into_iter().zip(shifts.f64("after")?);
        let known = found
            .filter(|(name, value)| config.model.parameter(name).is_some() && value.is_finite());
        let starts: Vec<(String, f64)> =
            known.map(|(name, value)| (name.to_string(), *value)).collect();
        config.settings.method.starts.extend(starts);
    }
    let mut output = estimate::estimated(&config, campaign, inputs)?;
    for note in &mut output.notes {
        note.stage = STAGE.name.to_string();
        // Nobody asked for this model by name: that it cannot be estimated is said, and is no
        // failure of the campaign.
        note.severity = note.severity.min(Severity::Warning);
    }
    if let Some(additions) = inputs.get("additions", Part::Number(place))? {
        let again =
            output.tables.iter().find(|(name, _)| *name == "estimates").map(|(_, table)| table);
        let values = recommended::values(
            table.strings("diagnosis")?.first().copied().unwrap_or_default(),
            &additions,
            again,
        )?;
        output.tables.push(("recommended", values));
    }
    Ok(output)
}

/// Whether a diagnosis holds the parameters of its model at what is predicted.
fn is_predicted(campaign: &Campaign, place: usize) -> bool {
    let diagnosis = diagnose::all(campaign).get(place);
    diagnosis.is_some_and(|d| d.settings.method.base == Base::Predicted)
}

/// The estimate with the lines of a diagnosis behind its model; where that is `predicted`, what was added is all that is
/// estimated.
fn amended(base: &Config, name: &str, added: &str, predicted: bool) -> Result<Config, Errors> {
    let model = base.model.amended(added)?;
    if (&model.inputs, &model.outputs) != (&base.model.inputs, &base.model.outputs) {
        return Err(Error::new(format!(
            "{name}: what was added changes the inputs or outputs of the model"
        ))
        .into());
    }
    let mut settings = base.settings.clone();
    settings.name = Some(name.to_string());
    if predicted {
        settings.method.free = Some(free_of_predictions(&base.model, &settings.method));
    }
    if let Some(free) = &mut settings.method.free {
        let new = model
            .parameters
            .iter()
            .filter(|p| !p.fixed && base.model.parameter(&p.quantity.name).is_none());
        free.extend(new.map(|p| p.quantity.name.clone()));
    }
    Ok(Config { settings, model, inputs: base.inputs.clone(), outputs: base.outputs.clone() })
}
