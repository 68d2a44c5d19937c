//! Maneuvers, samples and signals of all flights come in; maximum-likelihood estimates of one
//! model, with responses, go out.

mod adequacy;
mod batch;
pub mod chosen;
mod config;
mod late;
mod limits;
mod method;
mod names;
pub(super) mod ready;
pub mod records;
mod regressions;
mod settings;
mod stretches;
mod tables;
mod uncertainty;
mod uneven;

use super::{Campaign, Inputs, Note, Output, Part, Read, Severity, Stage, Unit, slice_of};
use crate::engine::Here;
use crate::error::Errors;
use crate::estimate::regression::Regressed;
use crate::estimate::{self, Estimation, Row, Trace};
use crate::math::digits;
use crate::noise::Modelled;
use crate::table::Table;
use batch::Batch;
use rayon::prelude::*;
use ready::Ready;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicUsize, Ordering};

pub use config::{Config, NAME};
pub use names::{Driver, Scored};
pub use settings::{Between, Group, Settings, Used};
pub use uncertainty::WITH;

pub const STAGE: Stage = Stage {
    name: NAME,
    about: "estimate models",
    units,
    models: |campaign| campaign.estimates.iter().map(|e| (e.name(), e.columns())).collect(),
    writes: &[
        "estimates",
        "correlations",
        "separability",
        "budget",
        "profiles",
        "regressions",
        "equations",
        "searches",
        "modes",
        "iterations",
        "residuals",
        "adequacy",
        "reached",
        "plateaus",
        "responses",
    ],
    reads,
    slice,
    run,
    spreads: true,
    ..Stage::PLAIN
};

/// One unit per flight for every estimate whose flights have nothing to do with each other, flight by
/// flight; one for every other estimate.
fn units(campaign: &Campaign) -> Vec<Unit> {
    let all = || campaign.estimates.iter().enumerate();
    let of = |flight: &String| -> Vec<Unit> {
        let mine = all().filter(|(_, c)| c.is_by_flight() && c.settings.chosen().flight(flight));
        mine.map(|(index, config)| Unit {
            name: format!("{} of {flight}", config.name()),
            index,
            part: Part::Of(index, flight.clone()),
        })
        .collect()
    };
    let whole = all().filter(|(_, config)| !config.is_by_flight());
    let whole = whole.map(|(index, config)| Unit::entry(index, config.name()));
    campaign.flights.iter().flat_map(of).chain(whole).collect()
}

/// All parts of a table that estimate `i` writes.
pub(super) fn parts(campaign: &Campaign, i: usize) -> Vec<Part> {
    let Some(config) = campaign.estimates.get(i) else { return Vec::new() };
    let chosen = config.settings.chosen();
    let flights = campaign.flights.iter().filter(|id| config.is_by_flight() && chosen.flight(id));
    let pieces = flights.map(|id| Part::Of(i, id.clone()));
    [Part::Number(i)].into_iter().chain(pieces).collect()
}

/// The parts of a table in which estimates may have rows of a flight.
pub(super) fn parts_about(campaign: &Campaign, flight: &str) -> Vec<Part> {
    let of = |(i, config): (usize, &Config)| match config.is_by_flight() {
        false => Some(Part::Number(i)),
        true => config.settings.chosen().flight(flight).then(|| Part::Of(i, flight.to_string())),
    };
    campaign.estimates.iter().enumerate().filter_map(of).collect()
}

/// The parts of these tables that estimate `i` writes; none of them has to be there.
pub(super) fn reads_of(tables: &[&'static str], campaign: &Campaign, i: usize) -> Vec<Read> {
    let parts = parts(campaign, i);
    let of = |table: &&'static str| -> Vec<Read> {
        parts.iter().map(|part| Read { table, part: part.clone(), optional: true }).collect()
    };
    tables.iter().flat_map(of).collect()
}

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let Some(config) = campaign.estimates.get(unit.index) else { return Value::Null };
    let mut slice = slice_of(&config.settings);
    if let Some(entries) = slice.as_object_mut() {
        // The model counts by what it says, not by the name of its file.
        entries.remove("model");
        entries.insert("name".into(), json!(config.name()));
        if unit.flight().is_empty() {
            entries.insert("left_out".into(), json!(ready::left_out(config, campaign)));
        }
        entries.insert("model".into(), super::said(&config.model));
        entries.extend(super::taken(&config.model));
    }
    slice
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let Some(config) = campaign.estimates.get(unit.index) else { return Vec::new() };
    let flight = unit.flight();
    if flight.is_empty() {
        return tables_read(config, campaign);
    }
    let mut reads = Read::flight(tables(config), flight);
    reads.iter_mut().for_each(|read| read.optional = true);
    reads
}

/// Tables of a flight that records are made from.
fn tables(config: &Config) -> &'static [&'static str] {
    match config.settings.input {
        None => &["signals", "samples"],
        Some(_) => &["signals", "samples", "segments", "conditions"],
    }
}

/// What the records of an estimate are made from.
pub(super) fn tables_read(config: &Config, campaign: &Campaign) -> Vec<Read> {
    let chosen = config.settings.chosen();
    let mut reads = Read::flights(tables(config), campaign);
    reads.retain(|read| matches!(&read.part, Part::Flight(id) if chosen.flight(id)));
    reads
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> Result<Output, Errors> {
    let Some(config) = campaign.estimates.get(unit.index) else { return Ok(Output::default()) };
    match unit.flight() {
        "" => estimated(config, campaign, inputs),
        flight => of_flight(config, flight, inputs),
    }
}

/// What one flight has of an estimate: the tables that have a row.
fn of_flight(config: &Config, flight: &str, inputs: &Inputs) -> Result<Output, Errors> {
    let mut notes = Vec::new();
    let ready = ready::of_one(config, flight, inputs, &mut notes)?;
    let (mut tables, _) = of_ready(config, ready, inputs, &mut notes)?;
    tables.retain(|(_, table)| table.rows() > 0);
    Ok(Output { tables, files: Vec::new(), notes })
}

/// One estimate of the campaign's maneuvers.
pub(super) fn estimated(
    config: &Config,
    campaign: &Campaign,
    inputs: &Inputs,
) -> Result<Output, Errors> {
    let mut notes = Vec::new();
    let ready = ready::of(config, campaign, inputs, &mut notes)?;
    let (tables, stops) = of_ready(config, ready, inputs, &mut notes)?;
    notes.extend(together(config, &stops));
    Ok(Output { tables, files: Vec::new(), notes })
}

/// What is said of all estimations of an estimate together, by how each of them stopped.
pub(super) fn together(config: &Config, stops: &[&str]) -> Vec<Note> {
    let of = |severity, count, text| config.note("", severity, config.name(), count, text);
    let mut notes = Vec::new();
    if stops.is_empty() {
        let text = format!("no maneuver to estimate {} from", config.name());
        notes.push(of(Severity::Missing, 1, text));
    }
    let by_motion = config.settings.method.by == estimate::By::Motion;
    if config.model.is_driven() && by_motion && !stops.is_empty() {
        let text = "noise drives its states: it is estimated by filter error, and its responses are predictions one sample ahead, not free simulations".to_string();
        notes.push(of(Severity::Info, 1, text));
    }
    let converged = estimate::Stop::Converged.as_str();
    if !stops.is_empty() && stops.iter().all(|stop| *stop != converged) {
        let mut kinds = stops.to_vec();
        kinds.sort_unstable();
        kinds.dedup();
        let text = format!("no estimate of {} converged: {}", config.name(), kinds.join(", "));
        notes.push(of(Severity::Missing, stops.len(), text));
    }
    notes
}

/// Tables, and how each estimation stopped.
type Estimated = (Vec<(&'static str, Table)>, Vec<&'static str>);

/// Estimates from records that are ready.
fn of_ready(
    config: &Config,
    ready: Vec<Ready>,
    inputs: &Inputs,
    notes: &mut Vec<Note>,
) -> Result<Estimated, Errors> {
    let batches = batches(config.settings.group, ready);
    let done = AtomicUsize::new(0);
    let estimated = |segments: &[estimate::Segment]| {
        let here = Here { engine: inputs.engine, kept: inputs.kept, hear: &|_, _| {} };
        estimate::estimate_where(&here, &config.model, segments, &config.settings.method)
    };
    let estimations: Vec<Estimation> = batches
        .par_iter()
        .map(|batch| {
            let estimation = estimated(&batch.labelled);
            (inputs.progress)(done.fetch_add(1, Ordering::Relaxed) + 1, batches.len());
            estimation
        })
        .collect::<Result<_, _>>()?;
    for (batch, estimation) in batches.iter().zip(&estimations) {
        notes.extend(outcome_notes(config, batch, estimation));
        notes.extend(late::notes(config, inputs, (batch, estimation), &estimated)?);
        notes.extend(uneven::notes(config, batch, estimation));
    }
    let results: Vec<(&Batch, &Estimation)> = batches.iter().zip(&estimations).collect();
    let stops = estimations.iter().map(|estimation| estimation.stop.as_str()).collect();
    Ok((tables::all(&config.name(), &results)?, stops))
}

/// Groups the records, in order of flights and maneuvers.
fn batches(group: Group, ready: Vec<Ready>) -> Vec<Batch> {
    let mut batches: Vec<Batch> = Vec::new();
    for r in ready {
        let name = match group {
            Group::Segment => r.segment.clone(),
            Group::Flight => r.flight.clone(),
            Group::All => "all".to_string(),
        };
        match batches.last_mut().filter(|b| b.group == name) {
            Some(batch) => {
                batch.segments.push(r.segment);
                batch.flights.push(r.flight);
                batch.labelled.push(r.labelled);
            }
            None => batches.push(Batch {
                group: name,
                segments: vec![r.segment],
                flights: vec![r.flight],
                labelled: vec![r.labelled],
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
        notes.push(config.note("", Severity::Warning, batch.group.clone(), 1, text));
    }
    for left in &estimation.left_out {
        let segment = batch.segments.get(left.segment).cloned().unwrap_or_default();
        let text =
            format!("{segment} is left out of the estimate of {}: {}", config.name(), left.why);
        notes.push(config.note("", Severity::Missing, segment, 1, text));
    }
    for doubtful in &estimation.doubtful {
        let segment = batch.segments.get(doubtful.segment).cloned().unwrap_or_default();
        let text = format!("output {} of {segment}: {}", doubtful.output, doubtful.why);
        notes.push(config.note("", Severity::Warning, segment, 1, text));
    }
    for (segment, state) in &estimation.stuck {
        let segment = batch.segments.get(*segment).cloned().unwrap_or_default();
        let text = format!("{state} is stuck throughout {segment}: friction holds it all along");
        notes.push(config.note("", Severity::Warning, segment, 1, text));
    }
    for short in &estimation.too_short {
        let segment = batch.segments.get(short.segment).cloned().unwrap_or_default();
        let text = format!(
            "{segment}: a delay of {} is {:.3} s, and the record has {:.3} s before its start: what came before is taken for its first value \
             (`preroll_s` gives more)",
            short.input, short.delay, short.preroll
        );
        notes.push(config.note("", Severity::Warning, segment, 1, text));
    }
    for text in &estimation.crossed {
        let text = format!("{}: {text}", batch.group);
        notes.push(config.note("", Severity::Warning, batch.group.clone(), 1, text));
    }
    notes.extend(influential_note(config, batch, estimation));
    notes.extend(coarse_note(config, batch, estimation));
    notes.extend(moved_note(config, batch, estimation));
    notes.extend(tried_notes(config, batch, estimation));
    notes.extend(elsewhere_note(config, batch, estimation));
    if config.settings.method.stabilise.values().any(|gain| *gain != 0.0) {
        let text = format!(
            "{}: states are led back to what was measured of them, whose noise drives the model: no standard deviations",
            batch.group
        );
        notes.push(config.note("", Severity::Warning, batch.group.clone(), 1, text));
    }
    notes.extend(colour_notes(config, batch, estimation));
    for row in estimation.rows.iter().filter(|row| row.idle) {
        let text = format!("{}: {}", batch.group, limits::idle(estimation, row).1);
        notes.push(config.note("", Severity::Warning, batch.group.clone(), 1, text));
    }
    for row in estimation.rows.iter().filter(|row| row.at_bound) {
        notes.push(bound_note(config, batch, row));
    }
    notes.extend(still_notes(config, batch, estimation));
    for combination in &estimation.verdict.combinations {
        notes.push(config.note(
            "",
            Severity::Warning,
            batch.group.clone(),
            1,
            format!("{}: {combination}", batch.group),
        ));
    }
    notes
}

/// A parameter on its bound. None of something that cannot be negative is an ordinary result.
fn bound_note(config: &Config, batch: &Batch, row: &Row) -> Note {
    let severity = if row.value == 0.0 { Severity::Info } else { Severity::Warning };
    let unit = if row.unit == "-" { String::new() } else { format!(" {}", row.unit) };
    let text = format!(
        "{}: {} is on its bound, {}{unit}: it has no sd, and the other estimates hold for it fixed there",
        batch.group,
        row.name,
        digits(row.value)
    );
    config.note("", severity, batch.group.clone(), 1, text)
}

/// Outputs of which one value was measured throughout a maneuver in which the model moves them.
fn still_notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let mut notes = Vec::new();
    for (segment, traces) in batch.segments.iter().zip(&estimation.responses) {
        for trace in traces.iter().filter(|trace| is_still(trace)) {
            let text = format!(
                "{segment}: {} has one value throughout, and the model moves it: is its sensor dead?",
                trace.name
            );
            notes.push(config.note("", Severity::Problem, segment.clone(), 1, text));
        }
    }
    notes
}

/// Fewest samples of one value that tell something.
const STILL: usize = 20;

fn is_still(trace: &Trace) -> bool {
    let both = trace.measured.iter().zip(trace.modelled.iter());
    let scored: Vec<(f64, f64)> =
        both.map(|(z, y)| (*z, *y)).filter(|(z, _)| z.is_finite()).collect();
    let Some(&(first, start)) = scored.first() else { return false };
    let scale = scored.iter().fold(0.0f64, |most, (z, y)| most.max(z.abs()).max(y.abs()));
    let moves = scored.iter().any(|(_, y)| (y - start).abs() > MOVES * scale);
    scored.len() >= STILL && moves && scored.iter().all(|(z, _)| *z == first)
}

/// A modelled output that changes by less than this share of its size is at rest.
const MOVES: f64 = 1e-3;

/// The sample on which the estimate hangs.
fn influential_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let sample = estimation.influential.as_ref()?;
    let (row, segment) =
        (estimation.rows.get(sample.row)?, batch.segments.get(sample.segment)?.clone());
    let text = format!(
        "{}: {} hangs on one sample: without {} of {segment} at {:.3} s, {:.0} sd of the others' noise off the model, it would be {:.2} sd {}",
        batch.group,
        row.name,
        sample.output,
        sample.t,
        sample.residual.abs(),
        sample.shift.abs(),
        if sample.shift > 0.0 { "larger" } else { "smaller" },
    );
    Some(config.note("", Severity::Warning, segment, 1, text))
}

/// Parameters that are named in a note at most.
const NAMED: usize = 4;

/// Estimates that depend on how fine the integration steps are.
fn coarse_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let coarse = estimation.coarse.as_ref()?;
    let of = |(name, by): &(String, f64)| format!("{name} by {by:.1} sd");
    let words: Vec<String> = coarse.moved.iter().take(NAMED).map(of).collect();
    let more = coarse.moved.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} others") } else { String::new() };
    let text = format!(
        "{}: where a state meets its limit inside a step the motion is off: integration steps {} times finer would move {}{more}: say `substeps` in [[estimate]]",
        batch.group,
        coarse.finer,
        words.join(", ")
    );
    Some(config.note("", Severity::Warning, batch.group.clone(), coarse.moved.len(), text))
}

/// Estimates by equation error that the noise of the regressors is expected to have moved.
fn moved_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let regression = estimation.regression.as_ref().filter(|r| r.is_estimate)?;
    if regression.rows.iter().all(|r| r.shift.is_none())
        && regression.rows.iter().any(|r| r.sd.is_some())
    {
        let text = format!(
            "{}: how far noise in the regressors has moved the estimates cannot be told: signals are slower than the grid, and of a derived column nobody knows which ones it has its noise from",
            batch.group
        );
        return Some(config.note("", Severity::Info, batch.group.clone(), 1, text));
    }
    let moved = regression.rows.iter().filter(|r| r.is_moved());
    let words = |r: &Regressed| {
        let (row, shift) = (estimation.rows.get(r.row)?, r.shift?);
        Some(format!("{} by {shift:.2e}", row.name))
    };
    let words: Vec<String> = moved.filter_map(words).collect();
    let text = format!(
        "{}: noise in the regressors is expected to have moved these by more than their sd: {} (`shift` in the table regressions)",
        batch.group,
        words.join(", ")
    );
    let note = config.note("", Severity::Warning, batch.group.clone(), words.len(), text);
    (!words.is_empty()).then_some(note)
}

/// What became of several starts.
fn tried_notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let tried = &estimation.tried;
    let Some(best) = tried.iter().filter(|t| t.there).map(|t| t.cost).reduce(f64::min) else {
        return Vec::new();
    };
    let of = |severity, text: String| {
        config.note("", severity, batch.group.clone(), 1, format!("{}: {text}", batch.group))
    };
    let there = tried.iter().filter(|t| t.there).count();
    let text = format!("the best of {} starts, and {there} of them end there", tried.len());
    let mut notes = vec![of(Severity::Info, text)];
    let names: Vec<&String> = config.settings.method.tries.keys().collect();
    let mut said: Vec<String> = Vec::new();
    for rival in tried.iter().filter(|t| t.rivals(best)) {
        let ends = names.iter().zip(&rival.ends);
        let at: Vec<String> =
            ends.map(|(name, end)| format!("{name} = {}", digits(*end))).collect();
        let at = at.join(", ");
        if !said.contains(&at) {
            let more = rival.cost - best;
            notes.push(of(
                Severity::Warning,
                format!("another minimum, at {at}, is hardly worse (cost + {more:.2}): these data do not tell which"),
            ));
            said.push(at);
        }
    }
    notes
}

/// What is said of another start that ended in another minimum.
fn elsewhere_note(config: &Config, batch: &Batch, estimation: &Estimation) -> Option<Note> {
    let other = estimation.elsewhere.as_ref()?;
    let ends = other.ends.iter().map(|(name, value)| format!("{name} = {}", digits(*value)));
    let at = ends.collect::<Vec<_>>().join(", ");
    let (from, worse) = (other.from, other.worse);
    let text = match other.taken {
        true => format!(
            "from {from} the iteration ends in a worse minimum (cost + {worse:.1}), at {at}: the estimate is where another start leads to"
        ),
        false => format!(
            "from {from} the iteration ends in another minimum, at {at}, which is worse (cost + {worse:.1})"
        ),
    };
    let text = format!("{}: {text}", batch.group);
    Some(config.note("", Severity::Warning, batch.group.clone(), 1, text))
}

/// What was cut off where the colour of the residuals was found.
fn colour_notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let of = |text: String| config.note("", Severity::Info, batch.group.clone(), 1, text);
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
