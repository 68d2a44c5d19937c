//! Values of estimates and lines, and maneuvers that these have not seen, come in; how well the
//! model with these values held flies them, goes out.
//!
//! A model whose states are driven by noise flies without it: what is judged is the motion by itself,
//! which noise of the size that was estimated moves about, and beside it whether the predictions of
//! its filter, one sample ahead, err as they say.
//!
//! Every maneuver is run by itself with the one estimator, nothing of the model free but initial
//! states and zero shifts. It is run again with the values moved by every column of a root of their
//! covariance: the standard deviation that they carry into an output is the root of the sum of the
//! squares of what changes, after initial states and shifts have followed.

mod config;
mod file;
mod judge;
mod notes;
mod proof;
mod settings;
mod source;
mod tables;
mod tolerances;
mod validated;
mod values;

use super::estimate;
use super::estimate::ready::{self, Ready};
use super::{
    Campaign, Inputs, Key, Note, Output, Part, Read, Severity, Stage, Unit, said, slice_of,
};
use crate::dynamics::Channel;
use crate::engine::Here;
use crate::error::{Errors, Result};
use crate::estimate::{Asked, Estimation, Row, Segment, Stop, Trace, estimate_where};
use crate::math::products::factor;
use crate::model::noise_of;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeMap;

pub use config::Config;
pub use file::File as Tolerances;
use judge::Agreement;
use notes::note;
use settings::NAME;
pub use settings::Settings;
use validated::Validated;
pub(super) use values::correlated;
use values::{Maneuver, Values, values};

pub const STAGE: Stage = Stage {
    name: NAME,
    about: "validate models",
    key: Some(Key::of::<Vec<Settings>>()),
    check: config::check,
    units: |campaign| Unit::entries(all(campaign).iter().map(|config| config.settings.name())),
    writes: &["validation", "validation_traces", "validation_values", "tolerances"],
    reads,
    slice,
    run,
    spreads: true,
    ..Stage::PLAIN
};

/// The validations of a campaign.
fn all(campaign: &Campaign) -> &[Config] {
    campaign.told.get::<Vec<Config>>(STAGE.name).map(Vec::as_slice).unwrap_or_default()
}

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let Some(config) = all(campaign).get(unit.index) else { return Value::Null };
    // Those whose maneuvers are refused, and against what the lines go.
    let used: Vec<Value> = bases(config, campaign)
        .map(|base| json!([slice_of(&base.settings), ready::left_out(base, campaign)]))
        .collect();
    let against: Vec<_> =
        config.lines.iter().map(|&i| slice_of(&campaign.fits[i].settings.against)).collect();
    json!({
        "settings": slice_of(&config.settings),
        "run": slice_of(&config.run.settings),
        "model": said(&config.run.model),
        "sources": format!("{:?}", config.sources),
        "used": used,
        "left_out": ready::left_out(&config.run, campaign),
        "against": against,
        "tolerances": format!("{:?}", config.tolerances),
    })
}

/// The estimates whose maneuvers the values come from.
fn bases<'a>(
    config: &'a Config,
    campaign: &'a Campaign,
) -> impl Iterator<Item = &'a estimate::Config> {
    let lines = config.lines.iter().filter_map(|&i| campaign.fits.get(i)).map(|fit| fit.estimate);
    let mut places: Vec<usize> = lines.chain([config.estimate]).collect();
    places.sort_unstable();
    places.dedup();
    places.into_iter().filter_map(|place| campaign.estimates.get(place))
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let Some(config) = all(campaign).get(unit.index) else { return Vec::new() };
    let part = |table, i: usize| Read { table, part: Part::Number(i), optional: true };
    let mut reads = Read::flights(&["signals", "samples", "segments", "conditions"], campaign);
    let tables = ["estimates", "correlations", "residuals"];
    reads.extend(estimate::reads_of(&tables, campaign, config.estimate));
    let lines = config.lines.iter();
    reads.extend(lines.flat_map(|&i| ["fits", "line_correlations"].map(|table| part(table, i))));
    reads
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = all(campaign).get(unit.index) else { return Ok(Output::default()) };
    let mut notes = Vec::new();
    let all = ready::of(&config.run, campaign, inputs, &mut notes)?;
    let used = used(config, campaign, inputs)?;
    let mut ready: Vec<Ready> = Vec::new();
    for mut one in all {
        let at = one.steps;
        let same =
            |of: &&Used| of.flight == one.flight && at[0] < of.window[1] && of.window[0] < at[1];
        if let Some(of) = used.iter().find(same) {
            notes.push(refused(config, &one.flight, &one.segment, &of.name));
            continue;
        }
        notes.extend(without_used(config, &mut one, &used));
        ready.push(one);
    }
    notes.iter_mut().for_each(|note: &mut Note| note.stage = STAGE.name.to_string());
    let mut done = Vec::new();
    for (k, one) in ready.iter().enumerate() {
        match validated(config, campaign, inputs, one)? {
            Ok(validated) => {
                notes.extend(notes::doubts(config, &validated));
                notes.extend(notes::tolerances(config, &validated));
                done.push(validated);
            }
            Err(why) => {
                let text = format!("{} is not validated: {why}", one.segment);
                notes.push(note(config, &one.flight, Severity::Missing, &one.segment, text));
            }
        }
        (inputs.progress)(k + 1, ready.len());
    }
    if done.is_empty() {
        let name = config.settings.name();
        let text = format!("{name}: no maneuver to validate the model with");
        notes.push(note(config, "", Severity::Missing, &name, text));
    }
    notes.extend(notes::unused(config, &done));
    let tables = tables::all(&config.settings, &config.run.model.name, &config.tolerances, &done)?;
    Ok(Output { tables, files: Vec::new(), notes })
}

/// A maneuver that the values come from.
struct Used {
    flight: String,
    /// The estimate, and the maneuver's name in it.
    name: String,
    /// Where its samples are, s.
    window: [f64; 2],
}

/// All maneuvers that the values come from.
fn used(config: &Config, campaign: &Campaign, inputs: &Inputs) -> Result<Vec<Used>> {
    let mut all = Vec::new();
    for base in bases(config, campaign) {
        let of = ready::of(base, campaign, inputs, &mut Vec::new())?;
        all.extend(of.into_iter().map(|one| Used {
            name: format!("{} ({})", base.name(), one.segment),
            flight: one.flight,
            window: one.window,
        }));
    }
    Ok(all)
}

/// Before and behind its steps a maneuver may reach into one that the values come from: what both have is
/// not scored.
fn without_used(config: &Config, one: &mut Ready, used: &[Used]) -> Option<Note> {
    let flight: Vec<&Used> = used.iter().filter(|of| of.flight == one.flight).collect();
    let is_used = |t: f64| flight.iter().any(|of| (of.window[0]..=of.window[1]).contains(&t));
    let mut masked = 0;
    for channel in &mut one.labelled.record.channels {
        let of = |(t, z): (&f64, &f64)| if is_used(*t) { f64::NAN } else { *z };
        let count = |values: &[f64]| values.iter().filter(|z| z.is_finite()).count();
        let left: Vec<f64> = channel.t.iter().zip(channel.z.iter()).map(of).collect();
        masked += count(&channel.z) - count(&left);
        channel.z = left.into();
    }
    let text = format!(
        "{masked} samples of {} around its steps are not scored: the values come from maneuvers that have them, too",
        one.segment
    );
    (masked > 0).then(|| note(config, &one.flight, Severity::Info, &one.segment, text))
}

fn refused(config: &Config, flight: &str, segment: &str, by: &str) -> Note {
    let text = format!("{segment} is refused: its data are among those of the estimate {by}");
    note(config, flight, Severity::Missing, segment, text)
}

/// One maneuver with the values held, and how well they tell its outputs.
fn validated(
    config: &Config,
    campaign: &Campaign,
    inputs: &Inputs,
    one: &Ready,
) -> std::result::Result<std::result::Result<Validated, String>, Errors> {
    let labels = &one.labelled.labels;
    let label = |name: &str| labels.get(name).cloned().unwrap_or_default();
    let conditions = inputs.flight("conditions", &one.flight)?;
    let conditions = ready::held(conditions.as_ref(), &one.segment)?;
    let along = along(config, &one.labelled);
    let maneuver = Maneuver { flight: &one.flight, labels, conditions, along };
    let (input, kind) = (label("input"), label("kind"));
    let found = match values(config, campaign, inputs, &maneuver)? {
        Ok(found) => found,
        Err(why) => return Ok(Err(why)),
    };
    let segment = with_bands(config, &one.labelled);
    let (first, carried) = flown(config, inputs, &segment, &found)?;
    if first.stop != Stop::Converged {
        let why = first.why.unwrap_or_else(|| format!("it ended with \"{}\"", first.stop));
        return Ok(Err(why));
    }
    let scatter = match config.run.model.is_driven() {
        true => noise(&first, &found),
        false => scatter(config, inputs)?,
    };
    let outputs = outputs(config, &first, &carried, &scatter, &|t| {
        let record = &segment.record;
        let k = ((t - record.t0) / record.dt).round().clamp(0.0, record.n as f64 - 1.0);
        found.is_outside(k as usize)
    });
    let seen: Vec<&judge::Output> = outputs.iter().map(|(output, _)| output).collect();
    let is_for = |c: &tolerances::Checked| c.is_for(&input, &kind, &maneuver.conditions);
    let judged = proof::judge(&config.tolerances, is_for, &seen, one.steps);
    Ok(Ok(Validated {
        flight: one.flight.clone(),
        segment: one.segment.clone(),
        outside: found.share_outside(),
        followed: notes::followed(&first.rows),
        values: flown_at(config, &found, &first.rows),
        beyond: found.beyond,
        input,
        kind,
        outputs,
        judged,
    }))
}

/// Every value at which a maneuver was flown, by name: those that are held, and what was found in it.
fn flown_at(config: &Config, held: &Values, found: &[Row]) -> Vec<validated::Value> {
    let model = &config.run.model;
    let unit = |name: &str| {
        let parameter = model.parameter(name).map(|i| model.parameters[i].quantity.unit.clone());
        let noise = || model.outputs.iter().find(|o| noise_of(&o.name) == name);
        parameter.or_else(|| Some(noise()?.unit.clone())).unwrap_or_default()
    };
    let n = held.at.len();
    let own = held.at.iter().zip(&config.sources).enumerate();
    let mut all: Vec<validated::Value> = own
        .map(|(i, ((name, value), (_, source)))| validated::Value {
            name: name.clone(),
            unit: unit(name),
            value: *value,
            sd: held.covariance[i * n + i].max(0.0).sqrt(),
            source: source.word(),
        })
        .collect();
    all.extend(found.iter().filter(|row| !row.idle).map(|row| validated::Value {
        name: row.name.clone(),
        unit: row.unit.clone(),
        value: row.value,
        sd: row.sd.unwrap_or(f64::NAN),
        source: "maneuver",
    }));
    all.sort_by(|a, b| a.name.cmp(&b.name));
    all
}

/// The values along a maneuver of every input of the model.
fn along<'a>(config: &'a Config, segment: &Segment) -> BTreeMap<&'a str, Vec<f64>> {
    let inputs = &config.run.model.inputs;
    let column = |i: usize| {
        segment.record.inputs.iter().skip(i).step_by(inputs.len().max(1)).copied().collect()
    };
    inputs.iter().enumerate().map(|(i, input)| (input.name.as_str(), column(i))).collect()
}

/// The segment with a channel for every output that gives a band, on which nothing was measured.
fn with_bands(config: &Config, segment: &Segment) -> Segment {
    let mut segment = segment.clone();
    let place = |name: &String| config.run.model.output(name);
    for (output, band) in &config.settings.band {
        let (Some(output), Some(band)) = (place(output), place(band)) else { continue };
        let channels = &segment.record.channels;
        if let Some(of) = channels.iter().find(|c| c.output == output).cloned() {
            let z = vec![f64::NAN; of.t.len()];
            segment.record.channels.push(Channel { output: band, t: of.t, z: z.into() });
        }
    }
    segment
}

/// By output, the root of the estimate's `R`, that of the mean square of its residuals, and their colour.
fn scatter(config: &Config, inputs: &Inputs) -> Result<BTreeMap<String, [f64; 2]>> {
    let Some(table) = inputs.numbered("residuals", config.estimate)? else {
        return Ok(BTreeMap::new());
    };
    let (names, n, rms) = (table.strings("output")?, table.i64("n")?, table.f64("rms")?);
    let colour = table.f64("colour")?;
    let mut sums: BTreeMap<&str, [f64; 3]> = BTreeMap::new();
    for (row, name) in names.into_iter().enumerate().filter(|(row, _)| rms[*row].is_finite()) {
        let [count, square, level] = sums.entry(name).or_default();
        let power = n[row] as f64 * rms[row] * rms[row];
        *count += n[row] as f64;
        *square += power;
        *level += power * if colour[row].is_finite() { colour[row] } else { 1.0 };
    }
    let of = |[n, sum, level]: [f64; 3]| [(sum / n).sqrt(), level / sum];
    Ok(sums.into_iter().map(|(name, sums)| (name.to_string(), of(sums))).collect())
}

/// By output, the standard deviation of its noise that is held.
fn noise(first: &Estimation, values: &Values) -> BTreeMap<String, [f64; 2]> {
    let names = first.responses.iter().flatten().map(|trace| &trace.name);
    names.filter_map(|name| Some((name.clone(), [*values.at.get(&noise_of(name))?, 1.0]))).collect()
}

/// The maneuver at the values, and what of it changes with each column of a root of their
/// covariance, `[column][trace][sample]`.
type Flown = (Estimation, Vec<Vec<Vec<f64>>>);

fn flown(
    config: &Config,
    inputs: &Inputs,
    segment: &Segment,
    values: &Values,
) -> std::result::Result<Flown, Errors> {
    let model = &config.run.model;
    let mut method = config.run.settings.method.clone();
    method.asked = Asked::Nothing;
    let names = model.parameters.iter().map(|p| &p.quantity.name).chain(values.at.keys());
    method.fixed = names.filter(|name| !config.settings.free.contains(name)).cloned().collect();
    let here = Here { engine: inputs.engine, kept: inputs.kept, hear: &|_, _| {} };
    let fly = |moved: &dyn Fn(usize) -> f64| {
        let mut method = method.clone();
        let at = values.at.iter().enumerate();
        method.starts.extend(at.map(|(i, (name, value))| (name.clone(), value + moved(i))));
        estimate_where(&here, model, std::slice::from_ref(segment), &method)
    };
    let first = fly(&|_| 0.0)?;
    if first.stop != Stop::Converged {
        return Ok((first, Vec::new()));
    }
    let n = values.at.len();
    let root = factor(&values.covariance, n);
    let columns: Vec<usize> = (0..n).filter(|c| root[c * n + c] > 0.0).collect();
    let along = |&column: &usize| Ok(change(&first, &fly(&|i| root[i * n + column])?));
    let carried: std::result::Result<Vec<_>, Errors> = columns.par_iter().map(along).collect();
    Ok((first, carried?))
}

/// By how much the motions of two runs of one segment differ.
fn change(first: &Estimation, moved: &Estimation) -> Vec<Vec<f64>> {
    let pairs = first.responses.iter().flatten().zip(moved.responses.iter().flatten());
    pairs.map(|(a, b)| motion(a).iter().zip(motion(b)).map(|(a, b)| b - a).collect()).collect()
}

/// The motion by itself, without a look at the measurements.
fn motion(trace: &Trace) -> &[f64] {
    trace.filtered.as_ref().map_or(&trace.modelled, |filtered| &filtered.simulated)
}

fn outputs(
    config: &Config,
    first: &Estimation,
    carried: &[Vec<Vec<f64>>],
    scatter: &BTreeMap<String, [f64; 2]>,
    beyond: &dyn Fn(f64) -> bool,
) -> Vec<(judge::Output, Option<Agreement>)> {
    let traces: Vec<_> = first.responses.iter().flatten().collect();
    let mut all = Vec::new();
    for (place, trace) in traces.iter().enumerate() {
        if config.settings.band.values().any(|band| *band == trace.name) {
            continue;
        }
        let square = |k: usize| carried.iter().map(|of| of[place][k] * of[place][k]).sum::<f64>();
        let half = config.settings.band.get(&trace.name);
        let half = half.and_then(|name| traces.iter().find(|trace| trace.name == *name));
        let n = trace.t.len();
        let [r_sd, r_colour] = scatter.get(&trace.name).copied().unwrap_or([f64::NAN; 2]);
        let output = judge::Output {
            name: trace.name.clone(),
            unit: trace.unit.clone(),
            t: trace.t.to_vec(),
            measured: trace.measured.to_vec(),
            modelled: motion(trace).to_vec(),
            driven: trace.filtered.as_ref().map(|filtered| judge::Driven {
                sd: filtered.simulated_sd.clone(),
                ahead: trace.modelled.clone(),
                ahead_sd: filtered.sd.clone(),
            }),
            carried_sd: (0..n).map(|k| square(k).sqrt()).collect(),
            band: half.map_or_else(|| vec![0.0; n], |half| half.modelled.clone()),
            beyond: trace.t.iter().map(|t| beyond(*t)).collect(),
            r_sd,
            r_colour,
            smooth_s: config.settings.smooth_s,
        };
        let agreement = output.agreement();
        all.push((output, agreement));
    }
    all
}
