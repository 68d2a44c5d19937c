//! The method of an `[[estimate]]` and its model come in; the mistakes in it go out.

use super::names::Scored;
use super::settings::Settings;
use crate::config::Doc;
use crate::error::Errors;
use crate::estimate::{self, By, NoiseKind, Search, StartFrom};
use crate::model::Model;
use crate::stage::check::{placed, unknown};

/// Checks the names in the settings of the estimator, against the model with the shifts that they
/// ask for.
pub fn names(model: &Model, settings: &Settings, doc: &Doc, key: &str, errors: &mut Errors) {
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
    let refused =
        [("tries", estimate::too_many(method)), ("noise", estimate::not_filtered(model, method))];
    for (name, error) in refused.into_iter().filter_map(|(name, error)| Some((name, error?))) {
        errors.push(placed(doc, &format!("{key}.method.{name}"), error));
    }
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
