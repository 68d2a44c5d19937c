//! What flights have of an estimate comes in; what is to be said of all of them together goes out, and a
//! table without rows where no flight has any.
//!
//! An estimate whose flights have nothing to do with each other is made flight by flight. That no maneuver
//! is left, that no estimation converged, that a name is that of no maneuver: no flight can tell by itself.

use super::estimate::chosen::{About, Tally};
use super::estimate::{self, NAME};
use super::{Campaign, Inputs, Output, Part, Read, Stage, Unit, slice_of};
use crate::error::{Errors, Result};
use crate::table::Table;
use serde_json::{Value, json};
use std::collections::BTreeMap;

pub const STAGE: Stage = Stage {
    name: "review",
    about: "look at estimates of all flights",
    units,
    writes: estimate::STAGE.writes,
    reads,
    slice,
    run,
    ..Stage::PLAIN
};

fn units(campaign: &Campaign) -> Vec<Unit> {
    let all = campaign.estimates.iter().enumerate();
    let by_flight = all.filter(|(_, config)| config.is_by_flight());
    by_flight.map(|(index, config)| Unit::entry(index, config.name())).collect()
}

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let Some(config) = campaign.estimates.get(unit.index) else { return Value::Null };
    json!({ "settings": slice_of(&config.settings), "flights": campaign.flights, "driven": config.model.is_driven() })
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let mut reads = estimate::reads_of(STAGE.writes, campaign, unit.index);
    // What stands in the place of this unit's own part is not read.
    reads.retain(|read| read.part.flight().is_some());
    reads.extend(Read::flights(&["segments"], campaign));
    reads
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = campaign.estimates.get(unit.index) else { return Ok(Output::default()) };
    let mut tally = Tally::new(config.settings.chosen());
    for flight in &campaign.flights {
        if tally.flight(flight) {
            match inputs.flight("segments", flight)? {
                Some(segments) => {
                    segments.strings("segment")?.into_iter().for_each(|name| tally.meet(name));
                }
                None => tally.empty(flight),
            }
        }
    }
    let entry = config.name();
    let on = About { stage: NAME, entry: &entry, flight: "" };
    let mut notes = [tally.of_flights(&on), tally.of_names(&on)].concat();
    let stops = stops(inputs)?;
    notes.extend(estimate::together(config, &stops.iter().map(String::as_str).collect::<Vec<_>>()));
    let is_there = |name: &str| inputs.parts.iter().any(|(table, _)| *table == name);
    let without = STAGE.writes.iter().filter(|name| !is_there(name));
    let tables = without.map(|name| Ok((*name, Table::empty(name)?))).collect::<Result<_>>()?;
    Ok(Output { tables, files: Vec::new(), notes })
}

/// How each estimation stopped. One that estimates nothing has no row that says so: it has converged.
fn stops(inputs: &Inputs) -> Result<Vec<String>> {
    let mut stops: BTreeMap<(Part, String), String> = BTreeMap::new();
    for (table, part) in &inputs.parts {
        if part.flight().is_none() || !["estimates", "residuals"].contains(table) {
            continue;
        }
        let Some(found) = inputs.get(table, part.clone())? else { continue };
        let groups = found.strings("group")?;
        let said = if *table == "estimates" { found.strings("stop")? } else { Vec::new() };
        for (row, group) in groups.into_iter().enumerate() {
            let stop = said.get(row).map(ToString::to_string);
            let key = (part.clone(), group.to_string());
            match (stop, stops.entry(key)) {
                (Some(stop), entry) => drop(entry.insert_entry(stop)),
                (None, entry) => drop(entry.or_insert_with(converged)),
            }
        }
    }
    Ok(stops.into_values().collect())
}

fn converged() -> String {
    crate::estimate::Stop::Converged.as_str().to_string()
}
