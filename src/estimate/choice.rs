//! A model and settings in; which parameters and initial states are free, where their values hold
//! and where they start, out.

use super::segment::{CAMPAIGN, SEGMENT, Segment};
use super::{Line, Settings};
use crate::error::{Error, Errors};
use crate::model::extend::{input_shift, output_shift};
use crate::model::{Model, Scope};

/// What is estimated, by index into the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// Free parameters with one value for all segments, or one per group of them, in the model's
    /// order.
    pub shared: Vec<usize>,
    /// Free parameters with one value per segment, in the model's order.
    pub own: Vec<usize>,
    /// States whose initial value is free, ascending.
    pub initial: Vec<usize>,
    /// Start values of all parameters, free or not.
    pub parameters: Vec<f64>,
    /// Where one value of each parameter holds, as the settings and the model say.
    pub scopes: Vec<Scope>,
    /// Which of `shared` (by place) follow a line, ascending.
    pub lines: Vec<(usize, Line)>,
}

impl Chosen {
    /// Columns by which free parameters differ.
    pub fn columns(&self) -> impl Iterator<Item = &str> {
        self.shared.iter().filter_map(|&p| match &self.scopes[p] {
            Scope::Column(column) => Some(column.as_str()),
            _ => None,
        })
    }
}

/// Reads the settings against the model and the labels of the segments.
///
/// # Errors
/// Unknown names, columns that no segment has, and free parameters that start outside their bounds
/// or at no number: all at once.
pub fn choose(model: &Model, segments: &[Segment], settings: &Settings) -> Result<Chosen, Errors> {
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
    settings
        .free
        .iter()
        .flatten()
        .filter_map(|name| find("free", name))
        .for_each(|i| free[i] = true);
    let shifts = &settings.shifts;
    let shifted = shifts
        .outputs
        .iter()
        .map(|o| output_shift(o))
        .chain(shifts.inputs.iter().map(|i| input_shift(i)));
    shifted.filter_map(|name| model.parameter(&name)).for_each(|i| free[i] = true);
    let noise = model.covariance.iter().flat_map(|c| &c.sd).flatten();
    noise.for_each(|&i| free[i] = true);
    settings
        .candidates
        .iter()
        .filter_map(|name| find("candidates", name))
        .for_each(|i| free[i] = true);
    settings.fixed.iter().filter_map(|name| find("fixed", name)).for_each(|i| free[i] = false);
    let mut parameters = model.parameter_starts();
    for (name, value) in &settings.starts {
        if let Some(i) = find("starts", name) {
            parameters[i] = *value;
        }
    }
    let mut scopes: Vec<Scope> = model.parameters.iter().map(|p| p.scope.clone()).collect();
    for (name, per) in &settings.per {
        if let Some(i) = find("per", name) {
            scopes[i] = Scope::parse(per);
        }
    }
    let lines: Vec<(usize, &Line)> = settings
        .lines
        .iter()
        .filter_map(|(name, line)| Some((find("lines", name)?, line)))
        .collect();
    let states: Vec<&str> =
        model.states.iter().filter(|s| !s.hidden).map(|s| s.quantity.name.as_str()).collect();
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
    check_outputs(model, settings, &mut errors);
    check_profile(model, settings, &free, &initial, &mut errors);
    let (own, shared): (Vec<usize>, Vec<usize>) =
        (0..names.len()).filter(|&i| free[i]).partition(|&i| scopes[i] == Scope::Segment);
    // A parameter with several values has none that could follow a line.
    let line = |(at, p): (usize, &usize)| {
        let line =
            lines.iter().find(|(of, _)| of == p).filter(|_| scopes[*p] == Scope::Campaign)?.1;
        Some((at, line.clone()))
    };
    let lines = shared.iter().enumerate().filter_map(line).collect();
    let chosen = Chosen { shared, own, initial, parameters, scopes, lines };
    for &p in &chosen.shared {
        if let Scope::Column(column) = &chosen.scopes[p] {
            check_column(
                &format!("parameter \"{}\" of model {}", names[p], model.name),
                column,
                segments,
                &mut errors,
            );
        }
    }
    if ![CAMPAIGN, SEGMENT].contains(&settings.noise_per.as_str()) {
        check_column("the noise", &settings.noise_per, segments, &mut errors);
    }
    errors.or(chosen)
}

fn check_column(what: &str, column: &str, segments: &[Segment], errors: &mut Errors) {
    if segments.is_empty() || segments.iter().any(|s| s.labels.contains_key(column)) {
        return;
    }
    let mut known: Vec<&str> = vec![CAMPAIGN, SEGMENT];
    known.extend(segments.iter().flat_map(|s| s.labels.keys().map(String::as_str)));
    known.sort_unstable();
    known.dedup();
    let error =
        Error::new(format!("{what} is per \"{column}\", but no segment has a label of that name"));
    errors.push(error.help(format!("there are {}", known.join(", "))));
}

fn check_outputs(model: &Model, settings: &Settings, errors: &mut Errors) {
    let names: Vec<&str> = model.outputs.iter().map(|o| o.name.as_str()).collect();
    for (name, sd) in &settings.floor {
        if model.output(name).is_none() {
            errors.push(unknown("floor", name, "output", model, &names));
        } else if !(*sd >= 0.0 && sd.is_finite()) {
            errors.push(Error::new(format!(
                "floor: the standard deviation of \"{name}\" is at least zero, not {sd}"
            )));
        }
    }
}

fn check_profile(
    model: &Model,
    settings: &Settings,
    free: &[bool],
    initial: &[usize],
    errors: &mut Errors,
) {
    let parameters = model
        .parameters
        .iter()
        .zip(free)
        .filter(|(_, free)| **free)
        .map(|(p, _)| p.quantity.name.clone());
    let names: Vec<String> = parameters
        .chain(initial.iter().map(|&i| format!("{}(0)", model.states[i].quantity.name)))
        .collect();
    let known: Vec<&str> = names.iter().map(String::as_str).collect();
    for name in settings.profile.iter().filter(|name| !names.contains(name)) {
        errors.push(unknown("profile", name, "estimated parameter", model, &known));
    }
    let level = settings.profile_level;
    if !(level > 0.0 && level < 1.0) {
        errors.push(Error::new(format!("profile_level lies between 0 and 1, it is {level}")));
    }
}

fn check_starts(model: &Model, parameters: &[f64], free: &[bool], errors: &mut Errors) {
    for (i, p) in model.parameters.iter().enumerate() {
        let (name, start) = (&p.quantity.name, parameters[i]);
        if !start.is_finite() {
            errors.push(Error::new(format!(
                "parameter \"{name}\" of model {} starts at {start}, not at a number",
                model.name
            )));
        } else if free[i] && !(p.min..=p.max).contains(&start) {
            let what = format!(
                "parameter \"{name}\" of model {} starts at {start}, outside its bounds {} to {}",
                model.name, p.min, p.max
            );
            errors.push(
                Error::new(what)
                    .help("move the start inside the bounds, or widen them in the model file"),
            );
        }
    }
}

pub fn unknown(setting: &str, name: &str, kind: &str, model: &Model, known: &[&str]) -> Error {
    let near = known
        .iter()
        .copied()
        .max_by(|a, b| strsim::jaro(a, name).total_cmp(&strsim::jaro(b, name)));
    let error = Error::new(format!("{setting}: model {} has no {kind} \"{name}\"", model.name));
    match near {
        Some(near) => error.help(format!("did you mean \"{near}\"? It has {}", known.join(", "))),
        None => error,
    }
}
