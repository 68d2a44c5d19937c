//! The tables of one flight come in, and its rows of the campaign's; the page of the flight goes out.
//!
//! A unit holds what is drawn of one flight, however many there are, and reads what there is of it: its own
//! tables, its part of what estimates write and of the notes. Of an estimate over several flights its rows
//! alone are read; such a table changes with every flight, so pages are made again then, and one that comes
//! out the same is left as it is.

use super::estimate;
use super::report::{drawn_of, frame, own, sections, settings, slice_of_all};
use super::{Campaign, Inputs, Output, Part, Read, Stage, Unit};
use crate::error::{Errors, Result};
use crate::report::{self, Form, HISTORIES, Owners, ReportInput, Turn};
use crate::table::{Rows, Table, Want, schema};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;

pub const STAGE: Stage = Stage {
    name: report::STAGE,
    about: "write the pages of the flights",
    units,
    reads,
    slice,
    run,
    reads_records: true,
    ..Stage::PLAIN
};

fn units(campaign: &Campaign) -> Vec<Unit> {
    match settings(campaign) {
        Some(settings) if !settings.single_file => Unit::flights(campaign),
        _ => Vec::new(),
    }
}

fn form(campaign: &Campaign, flight: &str) -> Form {
    Form::Flight(Turn::of(flight, &campaign.flights))
}

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let turn = Turn::of(&unit.name, &campaign.flights);
    let mut slice = slice_of_all(campaign);
    slice["beside"] = json!([turn.previous, turn.next, turn.crowded]);
    slice
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let of = |table: &'static str| {
        let per_flight = schema(table).is_ok_and(|schema| schema.per_flight);
        let parts = match per_flight {
            true => vec![Part::Flight(unit.name.clone())],
            false => about(campaign, table, &unit.name),
        };
        parts.into_iter().map(move |part| Read { table, part, optional: true })
    };
    let tables = report::tables(&form(campaign, &unit.name), &sections(campaign));
    tables.into_iter().flat_map(of).collect()
}

/// The parts of a table in which there may be rows of a flight. Every page asks, so that nothing here may
/// take all flights.
fn about(campaign: &Campaign, table: &str, flight: &str) -> Vec<Part> {
    let writes = |stage: &&Stage| stage.writes.contains(&table);
    let of = |stage: &Stage| -> Vec<Part> {
        match stage.name == estimate::NAME {
            true => estimate::parts_about(campaign, flight),
            false => (stage.units)(campaign).into_iter().map(|unit| unit.part).collect(),
        }
    };
    match own(table) {
        true => vec![Part::Of(0, flight.to_string())],
        false => campaign.stages.iter().filter(writes).flat_map(of).collect(),
    }
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let flight = &unit.name;
    let form = form(campaign, flight);
    let segments = inputs.flight("segments", flight)?;
    let searched = segments.as_ref().map(|s| s.strings("input")).transpose()?.unwrap_or_default();
    let drawn = drawn_of(campaign, searched.into_iter().map(String::from).collect());
    let owners = Arc::new(Owners::of_flight(flight, segments.as_ref())?);
    let mut tables = BTreeMap::new();
    for name in report::tables(&form, &sections(campaign)) {
        let parts: Vec<Table> = of_flight(name, (flight, &owners), &drawn, inputs)?
            .into_iter()
            // A part of one flight is all about it.
            .map(|part| if part.schema().per_flight { Ok(part) } else { owners.part(part, flight) })
            .collect::<Result<_>>()?;
        // What has no row of this flight is not about it.
        if parts.iter().any(|part| part.rows() > 0) {
            // One part is not copied: histories are large.
            let all = match <[Table; 1]>::try_from(parts) {
                Ok([part]) => part,
                Err(parts) => Table::concat(name, &parts)?,
            };
            tables.insert(name.to_string(), all);
        }
    }
    let page = report::page(&ReportInput { tables, ..frame(campaign, form) })?;
    let file = (report::of_flight(flight), page.into_bytes());
    Ok(Output { files: vec![file], ..Output::default() })
}

/// The parts of a table in which there may be rows of a flight; of histories what is drawn alone.
fn of_flight(
    name: &'static str,
    (flight, owners): (&String, &Arc<Owners>),
    drawn: &[String],
    inputs: &Inputs,
) -> Result<Vec<Table>> {
    if ["samples", "flightpath"].contains(&name) {
        return inputs.all_with(name, Want { columns: Some(drawn), ..Want::default() });
    }
    if !HISTORIES.contains(&name) || schema(name)?.per_flight {
        return inputs.all(name);
    }
    let (flight, owners, reach) = (flight.clone(), owners.clone(), owners.reach(flight));
    let is_mine = move |segment: &str| owners.flight(segment) == Some(flight.as_str());
    inputs.all_with(
        name,
        Want { rows: Some(&Rows::Within("segment", reach, Arc::new(is_mine))), ..Want::default() },
    )
}
