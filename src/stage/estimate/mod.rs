//! Maneuvers, samples and signals of all flights come in; maximum-likelihood estimates of one
//! model, with responses, go out.

mod batch;
mod config;
mod names;
mod records;
mod settings;
mod tables;
mod trim;
mod uncertainty;

use super::{Campaign, Inputs, Note, Output, Read, Severity, Stage, Unit, series, slice_of};
use crate::dynamics::Record;
use crate::engine::Here;
use crate::error::{Errors, Result};
use crate::estimate::{self, Estimation, Segment};
use crate::noise::Modelled;
use crate::table::Table;
use batch::Batch;
use indexmap::IndexMap;
use rayon::prelude::*;
use records::{Grid, Measured, Source, Window, record};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use trim::Trim;

pub use config::Config;
pub use names::{Driver, Scored};
pub use settings::{Group, Settings, Used};

pub const STAGE: Stage = Stage {
    name: "estimate",
    about: "estimate models",
    units: |campaign| Unit::entries(campaign.estimates.iter().map(Config::name)),
    writes: &[
        "estimates",
        "correlations",
        "separability",
        "budget",
        "profiles",
        "repeats",
        "regressions",
        "equations",
        "iterations",
        "residuals",
        "responses",
    ],
    reads,
    slice,
    run,
    spreads: true,
    ..Stage::PLAIN
};

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let Some(config) = campaign.estimates.get(unit.index) else { return Value::Null };
    let mut slice = slice_of(&config.settings);
    if let Some(entries) = slice.as_object_mut() {
        // The model counts by what it says, not by the name of its file.
        entries.remove("model");
        entries.insert("name".into(), json!(config.name()));
        entries.insert("model".into(), super::said(&config.model));
    }
    slice
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    campaign
        .estimates
        .get(unit.index)
        .map(|config| tables_read(config, campaign))
        .unwrap_or_default()
}

/// What the records of an estimate are made from.
pub(super) fn tables_read(config: &Config, campaign: &Campaign) -> Vec<Read> {
    let whole_flights = config.settings.input.is_none();
    let tables: &[&'static str] = if whole_flights {
        &["signals", "samples"]
    } else {
        &["signals", "samples", "segments", "conditions"]
    };
    Read::flights(tables, campaign)
}

/// One maneuver ready for the estimator.
pub(super) struct Ready {
    pub(super) flight: String,
    pub(super) segment: String,
    pub(super) labelled: Segment,
    trim: Trim,
}

/// A stretch of flight and what is known of it.
struct Stretch {
    segment: String,
    window: Window,
    labels: IndexMap<String, String>,
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    campaign
        .estimates
        .get(unit.index)
        .map_or_else(|| Ok(Output::default()), |config| estimated(config, campaign, inputs))
}

/// One estimate of the campaign's maneuvers.
pub(super) fn estimated(
    config: &Config,
    campaign: &Campaign,
    inputs: &Inputs,
) -> std::result::Result<Output, Errors> {
    let mut notes = Vec::new();
    let mut ready = Vec::new();
    for flight in &campaign.flights {
        ready.extend(flight_records(config, flight, inputs, &mut notes)?);
    }
    if ready.is_empty() {
        let text = format!("no maneuver to estimate {} from", config.name());
        notes.push(note(config, "", Severity::Missing, config.name(), 1, text));
    }
    let batches = batches(config.settings.group, ready);
    let done = AtomicUsize::new(0);
    let estimations: Vec<Estimation> = batches
        .par_iter()
        .map(|batch| {
            let here = Here { engine: inputs.engine, kept: inputs.kept, hear: &|_, _| {} };
            let estimation = estimate::estimate_where(
                &here,
                &config.model,
                &batch.labelled,
                &config.settings.method,
            );
            (inputs.progress)(done.fetch_add(1, Ordering::Relaxed) + 1, batches.len());
            estimation
        })
        .collect::<std::result::Result<_, _>>()?;
    for (batch, estimation) in batches.iter().zip(&estimations) {
        notes.extend(outcome_notes(config, batch, estimation));
    }
    if !estimations.is_empty() && estimations.iter().all(|e| e.stop != estimate::Stop::Converged) {
        let mut stops: Vec<&str> = estimations.iter().map(|e| e.stop.as_str()).collect();
        stops.sort_unstable();
        stops.dedup();
        let text = format!("no estimate of {} converged: {}", config.name(), stops.join(", "));
        notes.push(note(config, "", Severity::Missing, config.name(), estimations.len(), text));
    }
    let results: Vec<(&Batch, &Estimation)> = batches.iter().zip(&estimations).collect();
    Ok(Output { tables: tables::all(&config.name(), &results)?, files: Vec::new(), notes })
}

/// The records of one flight's maneuvers; what cannot be used is noted.
pub(super) fn flight_records(
    config: &Config,
    flight: &str,
    inputs: &Inputs,
    notes: &mut Vec<Note>,
) -> Result<Vec<Ready>> {
    let (Some(samples), Some(signals)) =
        (inputs.flight("samples", flight), inputs.flight("signals", flight))
    else {
        return Ok(Vec::new());
    };
    let signals = series(signals)?;
    let t = samples.f64("t_s")?;
    let &[t0, t1, ..] = t else { return Ok(Vec::new()) };
    let column = |name: &str| samples.f64(name).ok();
    let grid = Grid { t0, dt: t1 - t0, n: t.len(), column: &column };
    let mut measured = Vec::new();
    for scored in &config.outputs {
        let (t, z) = match signals.get(scored.measured.as_str()).filter(|_| scored.is_signal) {
            Some(series) => *series,
            None => (t, samples.f64(&scored.measured)?),
        };
        measured.push(Measured { output: scored.output, t, z });
    }
    let telling: Vec<String> = config
        .columns()
        .into_iter()
        .chain(config.outputs.iter().map(|s| s.measured.clone()))
        .collect();
    let inputs_by_name = config.model.inputs.iter().map(|q| q.name.as_str());
    let interpolation = config.settings.interpolation.of(inputs_by_name);
    let mut ready = Vec::new();
    for Stretch { segment, window, mut labels } in stretches(config, flight, inputs, t)? {
        let held = held(inputs.flight("conditions", flight), &segment)?;
        labels.extend(
            config.settings.levels.iter().filter_map(|(name, levels)| level(name, levels, &held)),
        );
        let sources: Vec<Source> =
            config.inputs.iter().map(|driver| source(driver, &held)).collect();
        match record(&grid, &sources, &measured, window) {
            Ok(record) => {
                let record = Record {
                    substeps: config.settings.substeps,
                    interpolation: interpolation.clone(),
                    ..record
                };
                let masked: usize = record
                    .channels
                    .iter()
                    .map(|c| c.z.iter().filter(|z| !z.is_finite()).count())
                    .sum();
                if masked > 0 {
                    let text = format!(
                        "{masked} masked or lost samples of the outputs are not scored in {segment}"
                    );
                    notes.push(note(
                        config,
                        flight,
                        Severity::Warning,
                        segment.clone(),
                        masked,
                        text,
                    ));
                }
                let trim = Trim::of(inputs.flight("conditions", flight), &segment, &telling)?;
                let conditions =
                    held.iter().map(|(name, value)| (name.to_string(), *value)).collect();
                let labelled = Segment { record, labels, conditions, stretch: None };
                ready.push(Ready { flight: flight.to_string(), segment, labelled, trim });
            }
            Err(why) => notes.push(note(
                config,
                flight,
                Severity::Missing,
                segment.clone(),
                1,
                format!("{segment} is not used: {why}"),
            )),
        }
    }
    Ok(ready)
}

fn source(driver: &Driver, held: &BTreeMap<&str, f64>) -> Source {
    match driver {
        Driver::Column(name) => Source::Column(name.clone()),
        Driver::Held(name) => Source::Held(held.get(name.as_str()).copied().unwrap_or(f64::NAN)),
    }
}

/// The stretches of a flight that are used: the included maneuvers of the input, or the whole
/// record.
fn stretches(config: &Config, flight: &str, inputs: &Inputs, t: &[f64]) -> Result<Vec<Stretch>> {
    let settings = &config.settings;
    let of_flight = || IndexMap::from([("flight".to_string(), flight.to_string())]);
    let Some(input) = &settings.input else {
        let (from, to) = (t.first().copied().unwrap_or(0.0), t.last().copied().unwrap_or(0.0));
        let stretch = |(segment, window)| Stretch { segment, window, labels: of_flight() };
        return Ok(pieces(flight, from, to, settings).into_iter().map(stretch).collect());
    };
    let Some(segments) = inputs.flight("segments", flight) else { return Ok(Vec::new()) };
    let (names, kinds, found_in) =
        (segments.strings("segment")?, segments.strings("kind")?, segments.strings("input")?);
    let (starts, ends, included) =
        (segments.f64("t_start_s")?, segments.f64("t_end_s")?, segments.bools("included")?);
    let polarity = segments.i64("polarity")?;
    let of_ours = |i: usize| input.names().iter().any(|name| name == found_in[i]);
    let of_kind =
        |i: usize| settings.kinds.is_empty() || settings.kinds.iter().any(|kind| kind == kinds[i]);
    let overlap = |i: usize, k: usize| starts[i] < ends[k] && starts[k] < ends[i];
    let alone = |i: usize| !(0..names.len()).any(|k| !of_ours(k) && overlap(i, k));
    let wanted =
        |i: &usize| included[*i] && of_ours(*i) && of_kind(*i) && (!settings.alone || alone(*i));
    let (preroll, settle) = (settings.preroll_s, settings.settle_s);
    let window = |i: usize| Window {
        from: starts[i] - settings.pre_s,
        to: ends[i] + settings.post_s,
        preroll,
        settle,
    };
    // (last maneuver so far, stretch): in order of time, so that an overlap is one with the stretch
    // before
    let mut used: Vec<(usize, Stretch)> = Vec::new();
    for i in (0..names.len()).filter(wanted) {
        if let Some((last, stretch)) = used.last_mut().filter(|(last, _)| overlap(*last, i)) {
            stretch.window.to = stretch.window.to.max(window(i).to);
            *last = if ends[i] > ends[*last] { i } else { *last };
            continue;
        }
        let values = [kinds[i].to_string(), found_in[i].to_string(), polarity[i].to_string()];
        let labels = of_flight()
            .into_iter()
            .chain(settings::LABELS.iter().map(ToString::to_string).zip(values))
            .collect();
        used.push((i, Stretch { segment: names[i].to_string(), window: window(i), labels }));
    }
    Ok(used.into_iter().map(|(_, stretch)| stretch).collect())
}

/// What an estimate uses of a flight: the names of its segments, and from when to when each is
/// flown, without the time before and behind its steps.
pub(super) fn maneuvers(
    config: &Config,
    flight: &str,
    inputs: &Inputs,
) -> Result<Vec<(String, [f64; 2])>> {
    let Some(samples) = inputs.flight("samples", flight) else { return Ok(Vec::new()) };
    let settings = &config.settings;
    let [pre, post] = match settings.input {
        Some(_) => [settings.pre_s, settings.post_s],
        None => [0.0; 2],
    };
    let times = |s: Stretch| (s.segment, [s.window.from + pre, s.window.to - post]);
    let all = stretches(config, flight, inputs, samples.f64("t_s")?)?;
    Ok(all.into_iter().map(times).collect())
}

/// The level nearest to a condition, as a label; none where the condition has no value.
fn level(name: &str, levels: &[f64], held: &BTreeMap<&str, f64>) -> Option<(String, String)> {
    let value = held.get(name).copied().filter(|v| v.is_finite())?;
    let nearest = levels.iter().min_by(|a, b| (*a - value).abs().total_cmp(&(*b - value).abs()))?;
    Some((name.to_string(), nearest.to_string()))
}

/// A whole flight, or its equal pieces.
fn pieces(flight: &str, from: f64, to: f64, settings: &Settings) -> Vec<(String, Window)> {
    let longest = settings.window_s;
    let n = if longest > 0.0 { ((to - from) / longest).ceil().max(1.0) as usize } else { 1 };
    let at = |i: usize| from + (to - from) * i as f64 / n as f64;
    let name =
        |i: usize| if n == 1 { flight.to_string() } else { format!("{flight}-{:03}", i + 1) };
    let settle = settings.settle_s;
    (0..n)
        .map(|i| {
            (name(i), Window { from: at(i), to: at(i + 1), preroll: settings.preroll_s, settle })
        })
        .collect()
}

/// The conditions of one maneuver, by signal.
pub(super) fn held<'a>(
    conditions: Option<&'a Table>,
    segment: &str,
) -> Result<BTreeMap<&'a str, f64>> {
    let Some(conditions) = conditions else { return Ok(BTreeMap::new()) };
    let (segments, signals) = (conditions.strings("segment")?, conditions.strings("signal")?);
    let values = conditions.f64("value")?;
    Ok((0..values.len())
        .filter(|i| segments[*i] == segment)
        .map(|i| (signals[i], values[i]))
        .collect())
}

/// Groups the records, in order of flights and maneuvers.
fn batches(group: Group, ready: Vec<Ready>) -> Vec<Batch> {
    let mut batches: Vec<Batch> = Vec::new();
    for r in ready {
        let name = match group {
            Group::Segment => r.segment.clone(),
            Group::Flight => r.flight,
            Group::All => "all".to_string(),
        };
        match batches.last_mut().filter(|b| b.group == name) {
            Some(batch) => {
                batch.segments.push(r.segment);
                batch.labelled.push(r.labelled);
                batch.trims.push(r.trim);
            }
            None => batches.push(Batch {
                group: name,
                segments: vec![r.segment],
                labelled: vec![r.labelled],
                trims: vec![r.trim],
            }),
        }
    }
    batches
}

/// What to say about one estimation that did not end well, or whose parameters the data hardly
/// separate.
fn outcome_notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let mut notes = Vec::new();
    if estimation.stop != estimate::Stop::Converged {
        let why = estimation.why.as_ref().map_or(String::new(), |why| format!(": {why}"));
        let text = format!(
            "{}: the estimate of {} ended with \"{}\"{why}",
            batch.group,
            config.name(),
            estimation.stop
        );
        notes.push(note(config, "", Severity::Warning, batch.group.clone(), 1, text));
    }
    for left in &estimation.left_out {
        let segment = batch.segments.get(left.segment).cloned().unwrap_or_default();
        let text =
            format!("{segment} is left out of the estimate of {}: {}", config.name(), left.why);
        notes.push(note(config, "", Severity::Missing, segment, 1, text));
    }
    for doubtful in &estimation.doubtful {
        let segment = batch.segments.get(doubtful.segment).cloned().unwrap_or_default();
        let text = format!("output {} of {segment}: {}", doubtful.output, doubtful.why);
        notes.push(note(config, "", Severity::Warning, segment, 1, text));
    }
    for (segment, state) in &estimation.stuck {
        let segment = batch.segments.get(*segment).cloned().unwrap_or_default();
        let text = format!("{state} is stuck throughout {segment}: friction holds it all along");
        notes.push(note(config, "", Severity::Warning, segment, 1, text));
    }
    notes.extend(colour_notes(config, batch, estimation));
    for combination in &estimation.verdict.combinations {
        notes.push(note(
            config,
            "",
            Severity::Warning,
            batch.group.clone(),
            1,
            format!("{}: {combination}", batch.group),
        ));
    }
    notes
}

/// What was cut off where the colour of the residuals was found.
fn colour_notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let of = |text: String| note(config, "", Severity::Info, batch.group.clone(), 1, text);
    let cut = |output: &estimate::OutputScatter| {
        let order = output.colour.as_ref()?.cut?;
        let words = Modelled::cut_words(order);
        Some(of(format!("{}: {}: {words}", batch.group, output.name)))
    };
    let unsettled = (!estimation.settled).then(|| {
        of(format!("{}: the colour of the residuals still changed in the last round: sd may be off by some percent", batch.group))
    });
    estimation.outputs.iter().filter_map(cut).chain(unsettled).collect()
}

fn note(
    config: &Config,
    flight: &str,
    severity: Severity,
    subject: String,
    count: usize,
    text: String,
) -> Note {
    let text =
        if text.contains(&config.name()) { text } else { format!("{}: {text}", config.name()) };
    Note {
        flight: flight.to_string(),
        stage: STAGE.name.to_string(),
        severity,
        subject,
        count: count as u64,
        text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_cut_into_equal_stretches_that_cover_it() {
        let settings = |longest: f64| -> Settings {
            toml::from_str(&format!("model = \"m\"\nwindow_s = {longest:?}")).expect("settings")
        };
        let whole = pieces("f", 2.0, 45.0, &settings(0.0));
        assert_eq!(
            (whole.len(), whole[0].0.as_str(), whole[0].1.from, whole[0].1.to),
            (1, "f", 2.0, 45.0)
        );
        let cut = pieces("f", 2.0, 45.0, &settings(20.0));
        assert_eq!(
            cut.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(),
            ["f-001", "f-002", "f-003"]
        );
        assert_eq!((cut[0].1.from, cut[2].1.to), (2.0, 45.0));
        assert!(cut.windows(2).all(|w| w[0].1.to == w[1].1.from));
        assert!(cut.iter().all(|(_, w)| (w.to - w.from - 43.0 / 3.0).abs() < 1e-12));
    }
}
