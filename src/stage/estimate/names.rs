//! Names in an `[[estimate]]` and in its model come in; what they stand for, with agreeing units, or
//! the mistakes, go out.

use super::settings::Settings;
use crate::config::{Doc, nearest};
use crate::error::Errors;
use crate::model::graph::Leaf;
use crate::model::{Model, Quantity};
use crate::stage::channels::Channels;
use crate::stage::check::{Columns, Found, Unlike, agree, driver, keys_are_known, unknown};
use indexmap::IndexMap;

/// What drives one input of the model.
#[derive(Debug, Clone, PartialEq)]
pub enum Driver {
    Column(String),
    /// Held at the mean of this column before the maneuver.
    Held(String),
}

/// One output that is scored.
#[derive(Debug, Clone, PartialEq)]
pub struct Scored {
    /// Index into the model's outputs.
    pub output: usize,
    /// Signal of the channel map, scored at its own time stamps, or column of the samples table.
    pub measured: String,
    pub is_signal: bool,
}

/// What drives the model of an estimate, in the order of its inputs.
pub fn inputs(
    model: &Model,
    settings: &Settings,
    columns: &Columns,
    doc: &Doc,
    key: &str,
    errors: &mut Errors,
) -> Vec<Driver> {
    let (of_inputs, of_held) = (format!("{key}.inputs"), format!("{key}.held"));
    keys_are_known(&settings.inputs, &model.inputs, "input of the model", doc, &of_inputs, errors);
    keys_are_known(&settings.held, &model.inputs, "input of the model", doc, &of_held, errors);
    for name in settings.held.keys().filter(|name| settings.inputs.contains_key(*name)) {
        errors.push(doc.error(
            &format!("{of_held}.{name}"),
            format!("input \"{name}\" is both in `inputs` and in `held`"),
        ));
    }
    if !settings.held.is_empty() && settings.input.is_none() {
        let what =
            "there is no quiet time before a whole record, so nothing can be held at its mean";
        errors.push(
            doc.error(&of_held, what)
                .help("give the estimate an `input`, so that it uses maneuvers"),
        );
    }
    let names: Vec<&str> = model.inputs.iter().map(|q| q.name.as_str()).collect();
    let meant = |name: &str| {
        columns.unit(name).is_none()
            && [&settings.inputs, &settings.held].into_iter().any(|map| misspelt(map, &names, name))
    };
    let one = |input: &Quantity| match settings.held.contains_key(&input.name) {
        _ if meant(&input.name) => None,
        true => driver(input, &settings.held, columns, doc, &of_held, errors).map(Driver::Held),
        false => {
            driver(input, &settings.inputs, columns, doc, &of_inputs, errors).map(Driver::Column)
        }
    };
    model.inputs.iter().filter_map(one).collect()
}

/// Checks the conditions that segments are labelled with.
pub fn levels(settings: &Settings, columns: &Columns, doc: &Doc, key: &str, errors: &mut Errors) {
    for (name, levels) in &settings.levels {
        let key = format!("{key}.levels.{name}");
        columns.look_up(name, "signal or column", doc, &key, errors);
        if levels.is_empty() || levels.iter().any(|v| !v.is_finite()) {
            errors
                .push(doc.error(&key, "the levels of a condition are at least one finite number"));
        }
        if settings.input.is_none() {
            let what = "there is no quiet time before a whole record, so it has no conditions";
            errors.push(
                doc.error(&key, what)
                    .help("give the estimate an `input`, so that it uses maneuvers"),
            );
        }
    }
}

/// What measures the outputs of a model that are scored.
pub fn outputs(
    model: &Model,
    settings: &Settings,
    columns: &Columns,
    doc: &Doc,
    key: &str,
    errors: &mut Errors,
) -> Vec<Scored> {
    let (of_outputs, of_unscored) = (format!("{key}.outputs"), format!("{key}.unscored"));
    keys_are_known(
        &settings.outputs,
        &model.outputs,
        "output of the model",
        doc,
        &of_outputs,
        errors,
    );
    let names: Vec<&str> = model.outputs.iter().map(|q| q.name.as_str()).collect();
    for (i, name) in
        settings.unscored.iter().enumerate().filter(|(_, name)| !names.contains(&name.as_str()))
    {
        errors.push(unknown(
            doc,
            &format!("{of_unscored}.{i}"),
            "output of the model",
            name,
            &names,
        ));
    }
    let mut all = Vec::new();
    for (output, quantity) in
        model.outputs.iter().enumerate().filter(|(_, q)| !settings.unscored.contains(&q.name))
    {
        let mapped = settings.outputs.get(&quantity.name);
        let measured = mapped.unwrap_or(&quantity.name).clone();
        let at = if mapped.is_some() {
            format!("{of_outputs}.{}", quantity.name)
        } else {
            of_outputs.clone()
        };
        let (unit, is_signal) = match (columns.signal(&measured), columns.find(&measured)) {
            (Some(unit), _) => (unit, true),
            (None, Found::Known(column)) => (column.unit.as_str(), false),
            (None, Found::Unsure) => continue,
            // It is mapped under a name that is said to be unknown, with this one as the nearest.
            (None, Found::Missing) if misspelt(&settings.outputs, &names, &quantity.name) => {
                continue;
            }
            (None, Found::Missing) => {
                let mut error = unknown(doc, &at, "signal or column", &measured, &columns.names());
                if mapped.is_none() {
                    error.what = format!(
                        "output \"{}\" of the model has no signal of this name, and none is mapped to it",
                        quantity.name
                    );
                    error.help =
                        Some("map a signal to it in `outputs`, or list it in `unscored`".into());
                }
                errors.push(error);
                continue;
            }
        };
        // A signal without a unit has been told.
        if !unit.is_empty() && !agree(unit, &quantity.unit) {
            let stated = columns.stated(&measured).filter(|_| is_signal);
            let by = format!("output \"{}\" of the model", quantity.name);
            let (name, wanted) = (&measured, &quantity.unit);
            errors.push(Unlike { name, unit, wanted, by: &by, stated }.error(doc.place(&at)));
        }
        all.push(Scored { output, measured, is_signal });
    }
    if names.iter().all(|name| settings.unscored.iter().any(|unscored| unscored == name)) {
        errors.push(doc.error(key, "no output of the model is scored"));
    }
    all
}

/// Whether a mapping has a misspelling of this name among all names.
fn misspelt(map: &IndexMap<String, String>, names: &[&str], name: &str) -> bool {
    let unknown = map.keys().filter(|key| !names.contains(&key.as_str()));
    unknown.into_iter().any(|key| nearest(key, names.iter().copied()) == Some(name))
}

/// Files an error for every output that is compared with the measurement that is its own input: a
/// sensor would be compared with itself.
pub fn itself(
    model: &Model,
    (inputs, outputs): (&[Driver], &[Scored]),
    columns: &Columns,
    channels: &Channels,
    doc: &Doc,
    key: &str,
    errors: &mut Errors,
) {
    if inputs.len() != model.inputs.len() {
        return;
    }
    for scored in outputs.iter().filter(|scored| scored.is_signal) {
        let leaves = model.graph.leaves(&[model.output_nodes[scored.output]]);
        let is_it = |(i, driver): &(usize, &Driver)| match driver {
            Driver::Column(name) => {
                let raw = matches!(columns.find(name), Found::Known(column) if !column.made);
                raw && leaves.contains(&Leaf::Input(*i)) && channels.same(name, &scored.measured)
            }
            Driver::Held(_) => false,
        };
        if let Some((i, _)) = inputs.iter().enumerate().find(is_it) {
            let (output, input) = (&model.outputs[scored.output].name, &model.inputs[i].name);
            let what = format!(
                "output \"{output}\" of the model follows from input \"{input}\", and both are signal \"{}\": it would be compared with itself",
                scored.measured
            );
            let help = format!(
                "list \"{output}\" in `unscored`, or map another signal to it in `outputs`"
            );
            errors.push(doc.error(&format!("{key}.outputs"), what).help(help));
        }
    }
}
