//! Maneuvers, samples and signals of all flights come in; maximum-likelihood estimates of one
//! model, with responses, go out.

mod adequacy;
mod apart;
mod batch;
pub mod chosen;
mod config;
mod doubts;
mod identified;
mod late;
mod limits;
mod made;
mod method;
mod names;
pub(super) mod ready;
pub mod records;
mod regressions;
mod settings;
mod stretches;
mod tables;
mod told;
mod uncertainty;
mod uneven;

use super::{Campaign, Inputs, Note, Output, Part, Read, Severity, Stage, Unit, slice_of};
use crate::engine::Here;
use crate::error::Errors;
use crate::estimate::{self, Estimation};
use crate::model::Model;
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
        "doubts",
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
        if let Some(model) = derived(config, campaign) {
            entries.insert("derived".into(), super::said(model));
        }
    }
    slice
}

/// The model of columns that an estimate uses, where it assumes constants.
pub(super) fn derived<'a>(config: &Config, campaign: &'a Campaign) -> Option<&'a Model> {
    made::model(config, &campaign.derive)
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
        flight => of_flight(config, flight, campaign, inputs),
    }
}

/// What one flight has of an estimate: the tables that have a row.
fn of_flight(
    config: &Config,
    flight: &str,
    campaign: &Campaign,
    inputs: &Inputs,
) -> Result<Output, Errors> {
    let mut notes = Vec::new();
    let mut ready = ready::of_one(config, flight, inputs, &mut notes)?;
    made::add(config, &campaign.derive, inputs, &mut ready)?;
    let Estimated { mut tables, files, .. } =
        of_ready(config, ready, (Some(flight), inputs), &mut notes)?;
    tables.retain(|(_, table)| table.rows() > 0);
    Ok(Output { tables, files, notes })
}

/// One estimate of the campaign's maneuvers.
pub(super) fn estimated(
    config: &Config,
    campaign: &Campaign,
    inputs: &Inputs,
) -> Result<Output, Errors> {
    let mut notes = Vec::new();
    let mut ready = ready::of(config, campaign, inputs, &mut notes)?;
    made::add(config, &campaign.derive, inputs, &mut ready)?;
    let Estimated { tables, files, stops } = of_ready(config, ready, (None, inputs), &mut notes)?;
    notes.extend(together(config, &stops));
    Ok(Output { tables, files, notes })
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

/// What estimations are told in, and how each of them stopped.
struct Estimated {
    tables: Vec<(&'static str, Table)>,
    files: Vec<(String, Vec<u8>)>,
    stops: Vec<&'static str>,
}

/// Estimates from records that are ready.
fn of_ready(
    config: &Config,
    ready: Vec<Ready>,
    (flight, inputs): (Option<&str>, &Inputs),
    notes: &mut Vec<Note>,
) -> Result<Estimated, Errors> {
    let batches = batches(config.settings.group, ready);
    let done = AtomicUsize::new(0);
    let by = |segments: &[estimate::Segment], method: &estimate::Settings| {
        let here = Here { engine: inputs.engine, kept: inputs.kept, hear: &|_, _| {} };
        estimate::estimate_where(&here, &config.model, segments, method)
    };
    let method = &config.settings.method;
    let briefly = estimate::Settings { asked: estimate::Asked::Nothing, ..method.clone() };
    let estimated = |segments: &[estimate::Segment]| by(segments, method);
    let alone = |segments: &[estimate::Segment]| by(segments, &briefly);
    let estimations: Vec<Estimation> = batches
        .par_iter()
        .map(|batch| {
            let estimation = estimated(&batch.labelled);
            (inputs.progress)(done.fetch_add(1, Ordering::Relaxed) + 1, batches.len());
            estimation
        })
        .collect::<Result<_, _>>()?;
    for (batch, estimation) in batches.iter().zip(&estimations) {
        notes.extend(told::notes(config, batch, estimation));
        notes.extend(late::notes(config, inputs, (batch, estimation), &estimated)?);
        notes.extend(apart::notes(config, (batch, estimation), &alone)?);
        notes.extend(uneven::notes(config, batch, estimation));
    }
    let results: Vec<(&Batch, &Estimation)> = batches.iter().zip(&estimations).collect();
    let stops = estimations.iter().map(|estimation| estimation.stop.as_str()).collect();
    let files = match results[..] {
        [one] => identified::file(config, flight, one).into_iter().collect(),
        _ => Vec::new(),
    };
    Ok(Estimated { tables: tables::all(config, &results)?, files, stops })
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
