//! Names in an `[[estimate]]` and in its model come in; what they stand for, with agreeing units, or
//! the mistakes, go out.

use super::settings::Settings;
use crate::config::{Doc, nearest};
use crate::error::Errors;
use crate::estimate::{self, By, NoiseKind, Search, StartFrom};
use crate::model::graph::Leaf;
use crate::model::{Model, Quantity};
use crate::stage::channels::Channels;
use crate::stage::check::{Columns, Found, agree, driver, keys_are_known, unknown};
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
        if !agree(unit, &quantity.unit) {
            let what = format!(
                "output \"{}\" of the model is in {}, \"{measured}\" in {unit}",
                quantity.name, quantity.unit
            );
            let help =
                "map another signal to it, or correct the unit in the model or the channel map";
            errors.push(doc.error(&at, what).help(help));
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

/// Checks the names in the settings of the estimator, against the model with the shifts that they
/// ask for.
pub fn method(model: &Model, settings: &Settings, doc: &Doc, key: &str, errors: &mut Errors) {
    let method = &settings.method;
    let parameters: Vec<&str> = model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
    let states: Vec<&str> = model.states.iter().map(|s| s.quantity.name.as_str()).collect();
    let mut check = |list: &str, names: &[String], known: &[&str], kind: &str| {
        for (i, name) in
            names.iter().enumerate().filter(|(_, name)| !known.contains(&name.as_str()))
        {
            errors.push(unknown(doc, &format!("{key}.method.{list}.{i}"), kind, name, known));
        }
    };
    check(
        "free",
        method.free.as_deref().unwrap_or_default(),
        &parameters,
        "parameter of the model",
    );
    check("fixed", &method.fixed, &parameters, "parameter of the model");
    check("candidates", &method.candidates, &parameters, "parameter of the model");
    check("initial", &method.initial, &states, "state of the model");
    let outputs: Vec<&str> = model.outputs.iter().map(|o| o.name.as_str()).collect();
    let mut check = |list: &str, names: Vec<&String>, known: &[&str], kind: &str| {
        for name in names.into_iter().filter(|name| !known.contains(&name.as_str())) {
            errors.push(unknown(doc, &format!("{key}.method.{list}.{name}"), kind, name, known));
        }
    };
    check("starts", method.starts.keys().collect(), &parameters, "parameter of the model");
    check("tries", method.tries.keys().collect(), &parameters, "parameter of the model");
    check("per", method.per.keys().collect(), &parameters, "parameter of the model");
    check("floor", method.floor.keys().collect(), &outputs, "output of the model");
    columns_are_known(model, settings, doc, key, errors);
    if method.by == By::EquationError {
        for (name, is_said, why) in of_motion(method) {
            if is_said {
                let what = format!("`{name}` does not go with by = \"equation error\": {why}");
                let error = doc.error(&format!("{key}.method.{name}"), what);
                errors.push(error.help(format!("leave `{name}` out, or estimate by = \"motion\"")));
            }
        }
    }
}

/// Checks the search through candidates.
pub fn search(
    model: &Model,
    outputs: &[Scored],
    settings: &Settings,
    doc: &Doc,
    key: &str,
    errors: &mut Errors,
) {
    let method = &settings.method;
    if method.search == Search::Backward {
        return;
    }
    let at = format!("{key}.method.search");
    if method.by != By::EquationError {
        let error = doc.error(&at, "a search of this kind goes through equations, not the motion");
        errors.push(error.help("say `by = \"equation error\"`, or leave `search` out"));
    }
    if method.candidates.is_empty() {
        let error = doc.error(&at, "there is nothing to search among");
        errors.push(error.help("list parameters of the model in `candidates`"));
    }
    if !(method.limit_f > 0.0 && method.limit_f.is_finite()) {
        let what = format!("the least partial F is a positive number, not {}", method.limit_f);
        errors.push(doc.error(&format!("{key}.method.limit_f"), what));
    }
    let measured: Vec<usize> = outputs.iter().map(|o| o.output).collect();
    for fault in estimate::unsearchable(model, &measured, method) {
        errors.push(doc.error(&format!("{key}.method.candidates"), fault));
    }
}

/// The settings that are about the motion over time: name, whether they are given, why they say
/// nothing to equations.
fn of_motion(method: &estimate::Settings) -> [(&'static str, bool, &'static str); 5] {
    [
        ("initial", !method.initial.is_empty(), "nothing is integrated, so no start matters"),
        ("stabilise", !method.stabilise.is_empty(), "nothing is integrated that could run away"),
        ("start", method.start != StartFrom::Model, "that is where it would start from"),
        (
            "noise",
            method.noise != NoiseKind::Diagonal,
            "the residuals of equations count as independent",
        ),
        ("tries", !method.tries.is_empty(), "equations are solved from one start"),
    ]
}

/// Checks the columns that parameters or the noise are `per`.
fn columns_are_known(
    model: &Model,
    settings: &Settings,
    doc: &Doc,
    key: &str,
    errors: &mut Errors,
) {
    let known = settings.columns();
    let method = &settings.method;
    for (name, per) in method.per.iter().filter(|(_, per)| !known.contains(&per.as_str())) {
        errors.push(unknown(
            doc,
            &format!("{key}.method.per.{name}"),
            "column of the segments",
            per,
            &known,
        ));
    }
    if !known.contains(&method.noise_per.as_str()) {
        errors.push(unknown(
            doc,
            &format!("{key}.method.noise_per"),
            "column of the segments",
            &method.noise_per,
            &known,
        ));
    }
    for parameter in model.parameters.iter().filter(|p| !method.per.contains_key(&p.quantity.name))
    {
        let per = parameter.scope.name();
        if !known.contains(&per) {
            let mut error =
                unknown(doc, &format!("{key}.model"), "column of the segments", per, &known);
            error.what = format!(
                "parameter \"{}\" of the model is per \"{per}\", which segments do not have",
                parameter.quantity.name
            );
            errors.push(error);
        }
    }
}
