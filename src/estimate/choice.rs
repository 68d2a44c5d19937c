//! A model and settings in; which parameters and initial states are free, and all start values, out.

use super::Settings;
use crate::error::{Error, Errors};
use crate::model::{Model, Scope};

/// What is estimated, by index into the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// Free parameters with one value for all segments, in the model's order.
    pub shared: Vec<usize>,
    /// Free parameters with one value per segment, in the model's order.
    pub own: Vec<usize>,
    /// States whose initial value is free, ascending.
    pub initial: Vec<usize>,
    /// Start values of all parameters, free or not.
    pub parameters: Vec<f64>,
}

/// Reads the settings against the model.
///
/// # Errors
/// Unknown names, and free parameters that start outside their bounds or at no number: all at once.
pub fn choose(model: &Model, settings: &Settings) -> Result<Chosen, Errors> {
    let mut errors = Errors::default();
    let names: Vec<&str> = model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
    let mut find = |setting: &str, name: &str| {
        let found = model.parameter(name);
        if found.is_none() {
            errors.push(unknown(setting, name, "parameter", model, &names));
        }
        found
    };
    let mut free: Vec<bool> = match &settings.free {
        Some(_) => vec![false; names.len()],
        None => model.parameters.iter().map(|p| !p.fixed).collect(),
    };
    settings.free.iter().flatten().filter_map(|name| find("free", name)).for_each(|i| free[i] = true);
    settings.fixed.iter().filter_map(|name| find("fixed", name)).for_each(|i| free[i] = false);
    let mut parameters = model.parameter_starts();
    for (name, value) in &settings.starts {
        if let Some(i) = find("starts", name) {
            parameters[i] = *value;
        }
    }
    let states: Vec<&str> = model.states.iter().filter(|s| !s.hidden).map(|s| s.quantity.name.as_str()).collect();
    let mut initial = Vec::new();
    for name in &settings.initial {
        match model.state(name) {
            Some(i) if !model.states[i].hidden => initial.push(i),
            _ => errors.push(unknown("initial", name, "state", model, &states)),
        }
    }
    initial.sort_unstable();
    initial.dedup();
    check_starts(model, &parameters, &free, &mut errors);
    let of = |scope: Scope| (0..names.len()).filter(|&i| free[i] && model.parameters[i].scope == scope).collect();
    let (shared, own) = (of(Scope::Campaign), of(Scope::Segment));
    errors.or(Chosen { shared, own, initial, parameters })
}

fn check_starts(model: &Model, parameters: &[f64], free: &[bool], errors: &mut Errors) {
    for (i, p) in model.parameters.iter().enumerate() {
        let (name, start) = (&p.quantity.name, parameters[i]);
        if !start.is_finite() {
            errors.push(Error::new(format!("parameter \"{name}\" of model {} starts at {start}, not at a number", model.name)));
        } else if free[i] && !(p.min..=p.max).contains(&start) {
            let what = format!(
                "parameter \"{name}\" of model {} starts at {start}, outside its bounds {} to {}",
                model.name, p.min, p.max
            );
            errors.push(Error::new(what).help("move the start inside the bounds, or widen them in the model file"));
        }
    }
}

fn unknown(setting: &str, name: &str, kind: &str, model: &Model, known: &[&str]) -> Error {
    let near = known.iter().copied().max_by(|a, b| strsim::jaro(a, name).total_cmp(&strsim::jaro(b, name)));
    let error = Error::new(format!("{setting}: model {} has no {kind} \"{name}\"", model.name));
    match near {
        Some(near) => error.help(format!("did you mean \"{near}\"? It has {}", known.join(", "))),
        None => error,
    }
}
