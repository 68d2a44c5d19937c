//! Maneuvers, samples and signals of the flights that an estimate uses come in; one record per
//! maneuver, and notes on what was left out, go out.

use super::chosen::{About, Tally};
use super::config::{Config, NAME};
use super::names::{Driver, Scored};
use super::records::{Grid, Measured, Source, Unusable, record};
use super::stretches::{self, Stretch, Whole};
use crate::config::list;
use crate::dynamics::{Interpolation, Record, Scratch};
use crate::error::{Error, Result};
use crate::estimate::Segment;
use crate::math::median;
use crate::stage::{Campaign, Inputs, Note, Severity, series};
use crate::table::Table;
use std::collections::BTreeMap;

/// One maneuver ready for the estimator.
pub struct Ready {
    pub flight: String,
    pub segment: String,
    /// From when to when its steps are flown, s.
    pub steps: [f64; 2],
    /// From when to when its samples are scored, s.
    pub window: [f64; 2],
    pub labelled: Segment,
}

/// The records of the maneuvers that the settings choose; what cannot be used is noted, and what
/// is left out by choice is counted.
pub fn of(
    config: &Config,
    campaign: &Campaign,
    inputs: &Inputs,
    notes: &mut Vec<Note>,
) -> Result<Vec<Ready>> {
    let mut tally = Tally::new(config.settings.chosen());
    let mib = usize::try_from(config.settings.samples_memory_mib).unwrap_or(usize::MAX);
    let mut scratch = Scratch::beyond(mib.saturating_mul(1 << 20));
    let mut ready = Vec::new();
    for flight in &campaign.flights {
        if !tally.flight(flight) {
            continue;
        }
        let mut of_flight = of_flight(config, flight, inputs, (&mut tally, notes))?;
        for one in &mut of_flight {
            scratch.take(&mut one.labelled.record).map_err(|e| {
                Error::new(format!("no scratch file for the samples of {}: {e}", config.name()))
                    .help(format!(
                        "make room in {}, name another folder in TMPDIR, or give more memory by `samples_memory_mib`",
                        std::env::temp_dir().display()
                    ))
            })?;
        }
        ready.extend(of_flight);
    }
    if scratch.written() > 0 {
        let mib = scratch.written() >> 20;
        (inputs.tell)(&format!("{}: samples of {mib} MiB are in a scratch file", config.name()));
    }
    notes.extend(tally.notes(NAME, &config.name()));
    Ok(ready)
}

/// The same of one flight that the settings choose.
pub fn of_one(
    config: &Config,
    flight: &str,
    inputs: &Inputs,
    notes: &mut Vec<Note>,
) -> Result<Vec<Ready>> {
    let mut tally = Tally::new(config.settings.chosen());
    let ready = of_flight(config, flight, inputs, (&mut tally, notes))?;
    let entry = config.name();
    notes.extend(tally.of_maneuvers(&About { stage: NAME, entry: &entry, flight }));
    Ok(ready)
}

/// The flights that the settings leave out: they are told in a note, and so count in the key.
pub fn left_out<'a>(config: &Config, campaign: &'a Campaign) -> Vec<&'a str> {
    let chosen = config.settings.chosen();
    campaign.flights.iter().map(String::as_str).filter(|id| !chosen.flight(id)).collect()
}

/// The records of one flight.
fn of_flight<'a>(
    config: &Config,
    flight: &'a str,
    inputs: &Inputs,
    (tally, notes): (&mut Tally<'a>, &mut Vec<Note>),
) -> Result<Vec<Ready>> {
    let scored = config.outputs.iter().map(|scored| scored.measured.clone());
    let telling: Vec<String> = config.columns().into_iter().chain(scored).collect();
    let (Some(samples), Some(signals)) =
        (inputs.samples(flight, &telling)?, inputs.signals(flight, &telling)?)
    else {
        tally.empty(flight);
        return Ok(Vec::new());
    };
    let (samples, signals) = (&samples, &signals);
    let t = samples.f64("t_s")?;
    if t.len() < 2 {
        tally.empty(flight);
        return Ok(Vec::new());
    }
    let measured = measured(config, samples, signals)?;
    let spacings = spacings(config, signals, t[1] - t[0])?;
    notes.extend(drawn(config, flight, (samples, signals), &spacings)?);
    let conditions = inputs.flight("conditions", flight)?;
    let conditions = conditions.as_ref();
    let mut ready = Vec::new();
    for stretch in stretches(config, flight, (inputs, samples), (tally, notes))? {
        let segment = stretch.names.first().cloned().unwrap_or_default();
        let held = held(conditions, &segment)?;
        let names: Vec<&str> = stretch.names.iter().map(String::as_str).collect();
        if !tally.maneuver(&names, |name| held.get(name).copied()) {
            continue;
        }
        match labelled(config, samples, &measured, &stretch, &held)? {
            Ok(mut labelled) => {
                labelled.record.spacings.clone_from(&spacings);
                notes.extend(masked(config, flight, &segment, &labelled.record));
                let (flight, steps) = (flight.to_string(), stretch.steps);
                let window = [stretch.window.from, stretch.window.to];
                ready.push(Ready { flight, segment, steps, window, labelled });
            }
            Err(why) => {
                let text = format!("{segment} is not used: {why}");
                notes.push(config.note(flight, Severity::Missing, segment, 1, text));
            }
        }
    }
    Ok(ready)
}

/// What measures the outputs that are scored.
fn measured<'a>(
    config: &Config,
    samples: &'a Table,
    signals: &'a Table,
) -> Result<Vec<Measured<'a>>> {
    let (t, signals) = (samples.f64("t_s")?, series(signals)?);
    let one = |scored: &Scored| {
        let (t, z) = match signals.get(scored.measured.as_str()).filter(|_| scored.is_signal) {
            Some(series) => *series,
            None if samples.has(&scored.measured) => (t, samples.f64(&scored.measured)?),
            // An optional signal that the log does not have.
            None => (&[][..], &[][..]),
        };
        Ok(Measured { output: scored.output, t, z })
    };
    config.outputs.iter().map(one).collect()
}

/// Time between two samples of what each input was brought to the grid from, s. A derived column is made of
/// several, not told here: it is taken to have a value of its own at every point of the grid where no signal
/// of the model is slower.
fn spacings(config: &Config, signals: &Table, dt: f64) -> Result<Vec<f64>> {
    let signals = series(signals)?;
    let spacing = |t: &[f64]| median(&t.windows(2).map(|w| w[1] - w[0]).collect::<Vec<f64>>());
    let slower = signals.values().any(|(t, _)| t.len() > 1 && spacing(t) > SLOWER * dt);
    let of = |driver: &Driver| match driver {
        Driver::Held(_) => dt,
        Driver::Column(name) => match signals.get(name.as_str()) {
            Some((t, _)) if t.len() > 1 => spacing(t),
            _ if slower => f64::NAN,
            _ => dt,
        },
    };
    Ok(config.inputs.iter().map(of).collect())
}

/// Inputs that hold their value from one point of the grid to the next, but were brought there by straight
/// lines between samples that are further apart.
fn drawn(
    config: &Config,
    flight: &str,
    (samples, signals): (&Table, &Table),
    spacings: &[f64],
) -> Result<Option<Note>> {
    let (t, signals) = (samples.f64("t_s")?, series(signals)?);
    let between =
        config.settings.interpolation.of(config.model.inputs.iter().map(|q| q.name.as_str()));
    let mut names: Vec<&str> = Vec::new();
    for (k, driver) in config.inputs.iter().enumerate() {
        let Driver::Column(name) = driver else { continue };
        let holds = between.get(k) == Some(&Interpolation::Hold);
        let slow = spacings[k] > SLOWER * (t[1] - t[0]);
        let known = signals.get(name.as_str()).filter(|_| holds && slow && samples.has(name));
        let Some((at, z)) = known else { continue };
        let column = samples.f64(name)?;
        let is_drawn = |(t, x): (&f64, &f64)| {
            let behind = at.partition_point(|s| s <= t);
            let ends = behind.checked_sub(1).and_then(|k| Some((*z.get(k)?, *z.get(k + 1)?)));
            // Strictly between two samples in time and value.
            ends.is_some_and(|(a, b)| *t > at[behind - 1] && (x - a) * (x - b) < 0.0)
        };
        if t.iter().zip(column).any(is_drawn) {
            names.push(name);
        }
    }
    let text = format!(
        "{flight}: {} holds its value between the points of the grid, but its samples are further apart, and straight lines were drawn between them: [derive] needs `interpolation = \"hold\"` for it, too",
        list(&names)
    );
    Ok((!names.is_empty())
        .then(|| config.note(flight, Severity::Warning, flight.to_string(), names.len(), text)))
}

/// A signal whose samples are further apart than so many steps of the grid is slower than it.
const SLOWER: f64 = 1.5;

/// The record of one stretch with what is known of it, or why there is none.
fn labelled(
    config: &Config,
    samples: &Table,
    measured: &[Measured],
    stretch: &Stretch,
    held: &BTreeMap<&str, f64>,
) -> Result<std::result::Result<Segment, Unusable>> {
    let settings = &config.settings;
    let (t, rows) = (samples.f64("t_s")?, &stretch.rows);
    let (t0, dt) = (t.first().copied().unwrap_or(0.0), t[1] - t[0]);
    let column = |name: &str| samples.f64(name).ok().and_then(|c| c.get(rows.clone()));
    let grid = Grid { t0: t0 + rows.start as f64 * dt, dt, n: rows.len(), column: &column };
    let sources: Vec<Source> = config.inputs.iter().map(|driver| source(driver, held)).collect();
    let inputs_by_name = config.model.inputs.iter().map(|q| q.name.as_str());
    let interpolation = settings.interpolation.of(inputs_by_name);
    let mut labels = stretch.labels.clone();
    labels.extend(settings.levels.iter().filter_map(|(name, levels)| level(name, levels, held)));
    Ok(record(&grid, &sources, measured, stretch.window).map(|record| Segment {
        record: Record { substeps: settings.substeps, interpolation, ..record },
        labels,
        conditions: held.iter().map(|(name, value)| (name.to_string(), *value)).collect(),
        ..Segment::default()
    }))
}

/// What to say about samples of the outputs that are not there.
fn masked(config: &Config, flight: &str, segment: &str, record: &Record) -> Option<Note> {
    let masked: usize =
        record.channels.iter().map(|c| c.z.iter().filter(|z| !z.is_finite()).count()).sum();
    let text =
        format!("{masked} masked or lost samples of the outputs are not scored in {segment}");
    let note = |text| config.note(flight, Severity::Warning, segment.to_string(), masked, text);
    (masked > 0).then(|| note(text))
}

fn source(driver: &Driver, held: &BTreeMap<&str, f64>) -> Source {
    match driver {
        Driver::Column(name) => Source::Column(name.clone()),
        Driver::Held(name) => Source::Held(held.get(name.as_str()).copied().unwrap_or(f64::NAN)),
    }
}

/// The stretches of a flight that there are to choose from: the included maneuvers of the input, or
/// the whole record.
fn stretches(
    config: &Config,
    flight: &str,
    (inputs, samples): (&Inputs, &Table),
    (tally, notes): (&mut Tally, &mut Vec<Note>),
) -> Result<Vec<Stretch>> {
    let (settings, t) = (&config.settings, samples.f64("t_s")?);
    if let Some(input) = &settings.input {
        let Some(segments) = inputs.flight("segments", flight)? else { return Ok(Vec::new()) };
        segments.strings("segment")?.iter().for_each(|name| tally.meet(name));
        return stretches::maneuvers(settings, input, (flight, t), &segments);
    }
    // A column that is not there is said where a record is made.
    let columns = config.columns();
    let driving: Vec<(&str, &[f64])> =
        columns.iter().filter_map(|name| Some((name.as_str(), samples.f64(name).ok()?))).collect();
    let Whole { stretches, lost } = stretches::whole(settings, flight, t, &driving);
    if let Some(lost) = lost {
        let severity = match (stretches.is_empty(), lost.matters) {
            (true, _) => Severity::Missing,
            (false, true) => Severity::Warning,
            (false, false) => Severity::Info,
        };
        let text = format!("{flight}: {}", lost.text);
        notes.push(config.note(flight, severity, flight.to_string(), lost.samples, text));
    }
    Ok(stretches)
}

/// The level nearest to a condition, as a label; none where the condition has no value.
fn level(name: &str, levels: &[f64], held: &BTreeMap<&str, f64>) -> Option<(String, String)> {
    let value = held.get(name).copied().filter(|v| v.is_finite())?;
    let nearest = levels.iter().min_by(|a, b| (*a - value).abs().total_cmp(&(*b - value).abs()))?;
    Some((name.to_string(), nearest.to_string()))
}

/// The conditions of one maneuver, by signal.
pub fn held<'a>(conditions: Option<&'a Table>, segment: &str) -> Result<BTreeMap<&'a str, f64>> {
    let Some(conditions) = conditions else { return Ok(BTreeMap::new()) };
    let (segments, signals) = (conditions.strings("segment")?, conditions.strings("signal")?);
    let values = conditions.f64("value")?;
    Ok((0..values.len())
        .filter(|i| segments[*i] == segment)
        .map(|i| (signals[i], values[i]))
        .collect())
}
