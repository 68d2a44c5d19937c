//! Estimates of single maneuvers, what they have in common and the conditions at which they were flown
//! come in; whether repeated maneuvers scatter as their standard deviations say goes out.
//!
//! Maneuvers at one condition are compared within a flight, and all of a kind over all flights, also of an
//! estimate that is made flight by flight; what is one number per flight, from flight to flight.

mod apart;
mod flights;
mod one;
mod set;
mod trim;

use super::correlations::Correlations;
use super::estimate::{Config, reads_of};
use super::{Campaign, Inputs, Note, Output, Read, Severity, Stage, Unit};
use crate::error::{Errors, Result};
use crate::fit::Repeats;
use crate::model::{Parameter, Scope};
use crate::table::Table;
use apart::{Apart, apart};
use one::One;
use serde_json::{Value, json};
use set::{Set, set};
use std::collections::BTreeMap;
use trim::Trim;

pub const STAGE: Stage = Stage {
    name: "repeats",
    about: "compare repeated maneuvers",
    units: |campaign| Unit::entries(campaign.estimates.iter().map(Config::name)),
    writes: &["repeats"],
    reads,
    slice,
    run,
    ..Stage::PLAIN
};

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let of = |config: &Config| json!({ "model": config.name(), "columns": columns(campaign, unit.index), "own": own(config), "lined": lined(campaign, unit.index) });
    campaign.estimates.get(unit.index).map_or(Value::Null, of)
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let mut reads = reads_of(&["estimates", "correlations"], campaign, unit.index);
    reads.extend(Read::flights(&["segments", "conditions"], campaign));
    reads
}

/// Parameters that the model has for every maneuver and that are a condition themselves, by their unit: the
/// angle at which it was trimmed.
fn own(config: &Config) -> Vec<&str> {
    let own = |p: &&Parameter| p.scope == Scope::Segment && trim::tells(&p.quantity.unit);
    config.model.parameters.iter().filter(own).map(|p| p.quantity.name.as_str()).collect()
}

/// A condition is told by what a model is driven by, by what it is scored with, and by what lines go along
/// through its estimates.
fn columns(campaign: &Campaign, estimate: usize) -> Vec<String> {
    let Some(config) = campaign.estimates.get(estimate) else { return Vec::new() };
    let measured = config.outputs.iter().map(|scored| scored.measured.clone());
    let lines = campaign.fits.iter().filter(|fit| fit.estimate == estimate);
    let along = lines.map(|fit| fit.settings.against.clone());
    config.columns().into_iter().chain(measured).chain(along).collect()
}

/// By maneuver: flight, input and kind.
type Flown = BTreeMap<String, [String; 3]>;

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = campaign.estimates.get(unit.index) else { return Ok(Output::default()) };
    let Some(estimates) = inputs.numbered("estimates", unit.index)? else {
        return Ok(Output::default());
    };
    let common = inputs.numbered("correlations", unit.index)?;
    let common = common.as_ref().map(Correlations::read).transpose()?.unwrap_or_default();
    let columns = columns(campaign, unit.index);
    let (mut trims, mut flown) = (BTreeMap::new(), Flown::new());
    for flight in &campaign.flights {
        if let Some(segments) = inputs.flight("segments", flight)? {
            let (input, kind) = (segments.strings("input")?, segments.strings("kind")?);
            for (row, name) in segments.strings("segment")?.into_iter().enumerate() {
                flown.insert(name.into(), [flight, input[row], kind[row]].map(String::from));
            }
        }
        if let Some(conditions) = inputs.flight("conditions", flight)? {
            trims.extend(trim::all(&conditions, &columns)?);
        }
    }
    let (mut rows, mut strange): (Vec<Set>, Vec<Apart>) = Default::default();
    for ones in ones(&own(config), &estimates, &trims, &flown)? {
        strange.extend(apart(&ones));
        rows.extend(conditions(&ones, &common));
        rows.extend(sets("kind", &ones, &common, |one| one.kind));
        rows.extend(sets("all", &ones, &common, |_| None));
    }
    for ones in flights::of_flights(&estimates)? {
        strange.extend(apart(&ones));
        rows.extend(flights::beside(&ones));
    }
    rows.sort_by_key(|row| row.parameter);
    let mut notes = notes(config, &strange);
    let loose = flights::loose(&rows, &lined(campaign, unit.index));
    notes.extend(loose.map(|(count, text)| note(config, "", Severity::Warning, count, &text)));
    let tables = vec![("repeats", table(&config.name(), &rows)?)];
    Ok(Output { tables, notes, ..Output::default() })
}

/// Parameters of an estimate that lines go through.
fn lined(campaign: &Campaign, estimate: usize) -> Vec<&str> {
    let lines = campaign.fits.iter().filter(|fit| fit.estimate == estimate);
    lines.flat_map(|fit| fit.settings.parameters.iter().map(String::as_str)).collect()
}

/// What there is to say about flights that stand apart, one by one.
fn notes(config: &Config, strange: &[Apart]) -> Vec<Note> {
    let mut flights: BTreeMap<&str, Vec<&Apart>> = BTreeMap::new();
    strange.iter().for_each(|apart| flights.entry(apart.flight).or_default().push(apart));
    let told = |(flight, all): (&str, Vec<&Apart>)| {
        let degrees = all.iter().any(|apart| apart.is_of_degrees());
        let each = all.iter().map(|apart| {
            let (name, value, others) = (apart.parameter, apart.value, apart.others);
            match apart.count {
                1 => format!("{name} is {value:.4} and in the other flight {others:.4}"),
                n => format!("{name} is {value:.4} and in {n} other flights {others:.4}"),
            }
        });
        let each = each.collect::<Vec<_>>().join("; ");
        let why = if degrees {
            "180/pi times: angles in deg for rad?"
        } else {
            "a sign, a unit or a scale of its log?"
        };
        let severity = if degrees { Severity::Problem } else { Severity::Warning };
        note(config, flight, severity, all.len(), &format!("{each}: {why}"))
    };
    flights.into_iter().map(told).collect()
}

fn note(config: &Config, flight: &str, severity: Severity, count: usize, text: &str) -> Note {
    Note {
        flight: flight.to_string(),
        stage: STAGE.name.to_string(),
        severity,
        subject: config.name(),
        count: count as u64,
        text: format!("{}: {text}", config.name()),
    }
}

/// The estimates that belong to one maneuver and have an sd, parameter by parameter in the order of
/// their names. Initial values are no repeats of each other, nor are conditions that the model has for every
/// maneuver (`own`).
fn ones<'a>(
    own: &[&str],
    estimates: &'a Table,
    trims: &'a BTreeMap<String, Trim>,
    flown: &'a Flown,
) -> Result<Vec<Vec<One<'a>>>> {
    let (parameters, units) = (estimates.strings("parameter")?, estimates.strings("unit")?);
    let (values, sds) = (estimates.f64("value")?, estimates.f64("sd")?);
    let mut all: BTreeMap<&str, Vec<One>> = BTreeMap::new();
    for (row, segment) in estimates.opt_strings("segment")?.into_iter().enumerate() {
        let (parameter, value, sd) = (parameters[row], values[row], sds[row]);
        let differs = parameter.ends_with("(0)") || own.contains(&parameter);
        let Some(segment) = segment.filter(|_| !differs) else { continue };
        if !(value.is_finite() && sd > 0.0 && sd.is_finite()) {
            continue;
        }
        let maneuver = flown.get(segment);
        all.entry(parameter).or_default().push(One {
            parameter,
            unit: units[row],
            segment,
            value,
            sd,
            trim: trims.get(segment),
            flight: maneuver.map(|m| m[0].as_str()),
            input: maneuver.map(|m| m[1].as_str()),
            kind: maneuver.map(|m| m[2].as_str()),
        });
    }
    Ok(all.into_values().collect())
}

/// The sets of maneuvers of one flight, input and kind at the same trimmed condition, each as the first of
/// it tells: repeats of one another. From flight to flight friction, mass and what nobody asked for differ.
fn conditions<'a>(ones: &[One<'a>], common: &Correlations) -> Vec<Set<'a>> {
    let mut all: Vec<(&Trim, Vec<&One<'a>>)> = Vec::new();
    // Places in `all` of what was flown in one way: a set is looked for among these.
    let mut flown: BTreeMap<[Option<&str>; 3], Vec<usize>> = BTreeMap::new();
    for one in ones {
        let Some(trim) = one.trim.filter(|trim| trim.is_known()) else { continue };
        let places = flown.entry(one.flown()).or_default();
        match places.iter().find(|&&k| all[k].0.is_like(trim)) {
            Some(&k) => all[k].1.push(one),
            None => {
                places.push(all.len());
                all.push((trim, vec![one]));
            }
        }
    }
    let of = |(trim, mine): &(&'a Trim, Vec<&One<'a>>)| {
        Some(Set { trim: Some(*trim), ..set("condition", mine, common)? })
    };
    all.iter().filter_map(of).collect()
}

/// The sets of at least two estimates that are alike in `key`, in the order in which they come.
fn sets<'a>(
    name: &'static str,
    ones: &[One<'a>],
    common: &Correlations,
    key: impl Fn(&One<'a>) -> Option<&'a str>,
) -> Vec<Set<'a>> {
    let mut keys: Vec<Option<&str>> = Vec::new();
    for one in ones {
        if !keys.contains(&key(one)) {
            keys.push(key(one));
        }
    }
    let of = |kind: &Option<&'a str>| {
        let mine: Vec<&One> = ones.iter().filter(|one| key(one) == *kind).collect();
        Some(Set { kind: *kind, ..set(name, &mine, common)? })
    };
    keys.iter().filter_map(of).collect()
}

fn table(model: &str, rows: &[Set]) -> Result<Table> {
    let number = |of: fn(&Repeats) -> f64| rows.iter().map(|s| of(&s.found)).collect::<Vec<f64>>();
    Table::build("repeats")
        .repeat("model", model)
        .strings("parameter", rows.iter().map(|s| s.parameter))
        .strings("unit", rows.iter().map(|s| s.unit))
        .strings("set", rows.iter().map(|s| s.set))
        .opt_strings("condition", rows.iter().map(|s| s.trim.map(Trim::words)))
        .opt_strings("input", rows.iter().map(|s| s.input))
        .opt_strings("kind", rows.iter().map(|s| s.kind))
        .i64("n", rows.iter().map(|s| s.found.n as i64).collect::<Vec<_>>())
        .f64("mean", number(|f| f.mean))
        .f64("scatter_sd", number(|f| f.scatter))
        .f64("rms_sd", number(|f| f.claimed))
        .f64("ratio", number(|f| f.scatter / f.claimed))
        .f64("chi2", number(|f| f.chi2))
        .f64("p", number(|f| f.p))
        .finish()
}
