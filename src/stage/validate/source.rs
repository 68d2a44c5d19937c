//! Where the values of a validated model come from: settings come in, a source for every parameter,
//! or the mistakes, go out.

use super::settings::Settings;
use crate::estimate::Line;
use crate::model::{Model, Scope, noise_of};
use crate::stage::check::{Given, agree};
use crate::stage::estimate::{self, Group};
use crate::stage::fit;

/// Where a parameter has its value from.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A parameter of the estimate.
    Estimate(String),
    /// Held by the estimate at this number.
    Held(f64),
    /// The line of a fit (its place in the list), of a parameter: at the condition of the maneuver,
    /// or the number itself.
    Line { fit: usize, parameter: String, part: Part },
}

impl Source {
    /// The word for it in the table `validation_values`.
    pub fn word(&self) -> &'static str {
        match self {
            Source::Estimate(_) => "estimate",
            Source::Held(_) => "held",
            Source::Line { .. } => "line",
        }
    }
}

/// What is taken of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Its value at the condition of the maneuver.
    Value,
    Slope,
    Intercept,
}

/// The sources of all parameters of the model that its file does not fix; none where one has none.
pub fn find(
    (given, key): (&mut Given, &str),
    settings: &Settings,
    base: &estimate::Config,
    fits: &[(usize, &fit::Config)],
    model: &Model,
) -> Option<Vec<(String, Source)>> {
    let names: Vec<&str> = model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
    for name in settings.take.keys().filter(|name| !names.contains(&name.as_str())) {
        given.unknown(&format!("{key}.take.{name}"), "parameter of the model", name, &names);
    }
    for (i, name) in settings.free.iter().enumerate() {
        if !names.contains(&name.as_str()) {
            given.unknown(&format!("{key}.free.{i}"), "parameter of the model", name, &names);
        }
    }
    let before = given.errors.0.len();
    let (mut sources, mut without) = (Vec::new(), Vec::new());
    let held = |name: &String| !settings.free.contains(name);
    for parameter in model.parameters.iter().filter(|p| held(&p.quantity.name)) {
        let name = &parameter.quantity.name;
        let told = settings.take.get(name);
        let from = told.unwrap_or(name);
        let found = named(from, base, fits);
        let at = format!("{key}.take.{name}");
        match (found, told) {
            // Its own file says what the estimate has not found either.
            (Some((Source::Held(_), _)), None) if parameter.fixed => {}
            (Some((source, unit)), _) => {
                if !agree(&unit, &parameter.quantity.unit) {
                    let key = if told.is_some() { at } else { format!("{key}.model") };
                    let what = format!(
                        "parameter \"{name}\" of the model is in {}, \"{from}\" in {unit}",
                        parameter.quantity.unit
                    );
                    given.push(&key, what, "");
                }
                sources.push((name.clone(), source));
            }
            (None, Some(from)) => {
                let known: Vec<String> = all(base, fits);
                given.unknown(&at, "parameter of the estimate or of a line", from, &known);
            }
            (None, None) if parameter.fixed => {}
            (None, None) => without.push(name.as_str()),
        }
    }
    if !without.is_empty() {
        let apart = base.settings.group == Group::Segment;
        let help = match apart {
            true => {
                "the estimate gives one value per maneuver: name the `[[fit]]` through them in `lines`, name a source in `take`, or say `fixed = true` in the model file; what is another number in every maneuver is `free`"
            }
            false => {
                "name a source in `take`, or say `fixed = true` in the model file; what is another number in every maneuver is `free`"
            }
        };
        let what = format!("no value is found for {}", crate::config::list(&without));
        given.push(&format!("{key}.estimate"), what, help);
    }
    sources.extend(noise(settings, base, model));
    (given.errors.0.len() == before).then_some(sources)
}

/// Where noise drives a model's states, the noise of its outputs is a value as well: that of the
/// estimate, of the outputs that it scores.
fn noise(settings: &Settings, base: &estimate::Config, model: &Model) -> Vec<(String, Source)> {
    let both = model.is_driven() && base.model.is_driven();
    let scored = base.outputs.iter().filter(|_| both);
    let names = scored.filter_map(|s| Some(noise_of(&base.model.outputs.get(s.output)?.name)));
    names
        .filter(|name| !settings.free.contains(name))
        .map(|name| (name.clone(), Source::Estimate(name)))
        .collect()
}

/// A source by its name, and its unit. A line comes before the estimate that it goes through.
fn named(
    name: &str,
    base: &estimate::Config,
    fits: &[(usize, &fit::Config)],
) -> Option<(Source, String)> {
    let (parameter, part) = match name.rsplit_once('.') {
        Some((parameter, "slope")) => (parameter, Part::Slope),
        Some((parameter, "intercept")) => (parameter, Part::Intercept),
        _ => (name, Part::Value),
    };
    for (place, fit) in fits {
        let Some(i) = fit.settings.parameters.iter().position(|p| p == parameter) else { continue };
        let line =
            Line { against: fit.settings.against.clone(), unit: fit.unit_x.clone(), centre: 0.0 };
        let unit = match part {
            Part::Slope => line.slope_unit(&fit.units[i]),
            _ => fit.units[i].clone(),
        };
        return Some((Source::Line { fit: *place, parameter: parameter.to_string(), part }, unit));
    }
    let known = base.model.parameters.iter().find(|p| p.quantity.name == name)?;
    let method = &base.settings.method;
    let free = match &method.free {
        Some(free) => free.iter().any(|free| free == name),
        None => !known.fixed,
    };
    let held = !free || method.fixed.iter().any(|fixed| fixed == name);
    let source = match held {
        true => Source::Held(method.starts.get(name).copied().unwrap_or(known.start)),
        // What is estimated per maneuver has no value for another one.
        false if base.settings.group == Group::Segment || known.scope == Scope::Segment => {
            return None;
        }
        false => Source::Estimate(name.to_string()),
    };
    Some((source, known.quantity.unit.clone()))
}

/// All names that a source may have.
fn all(base: &estimate::Config, fits: &[(usize, &fit::Config)]) -> Vec<String> {
    let parts = |p: &String| [p.clone(), format!("{p}.slope"), format!("{p}.intercept")];
    let lines = fits.iter().flat_map(|(_, fit)| fit.settings.parameters.iter().flat_map(parts));
    let own = base.model.parameters.iter().map(|p| p.quantity.name.clone());
    lines.chain(own.filter(|_| base.settings.group != Group::Segment)).collect()
}
