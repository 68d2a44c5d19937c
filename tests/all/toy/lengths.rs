//! Samples of a flight come in; how long the flight is goes out.

use super::{Campaign, Inputs, Key, Known, Output, Read, Stage, Told, Unit, slice_of};
use crate::error::Errors;
use crate::report::{Body, Given, Grid, On, Section};
use crate::table::Table;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

pub const STAGE: Stage = Stage {
    name: "lengths",
    about: "measure the flights",
    key: Some(Key::of::<Settings>()),
    check,
    units: |campaign| if settings(&campaign.told).is_some() { Unit::flights(campaign) } else { Vec::new() },
    writes: &["lengths"],
    sections: &[SECTION],
    reads: |_, unit| Read::flight(&["samples"], &unit.name),
    slice: |campaign, _| slice_of(&settings(&campaign.told)),
    run,
    ..Stage::PLAIN
};

/// How long the flights are; left out, nobody asks.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Shorter flights are left out, s.
    pub longer_than_s: f64,
}

fn settings(told: &Told) -> Option<&Settings> {
    told.get("lengths")
}

fn check(told: &mut Told, known: &mut Known) {
    if let Some(Settings { longer_than_s: t }) = settings(told).filter(|s| !(s.longer_than_s >= 0.0)) {
        known.given.push("lengths.longer_than_s", format!("a length is zero or more seconds, not {t}"), "");
    }
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> Result<Output, Errors> {
    let t = inputs.of("samples", &unit.name)?.f64("t_s")?;
    let length = t.last().copied().unwrap_or_default() - t.first().copied().unwrap_or_default();
    let rows = usize::from(settings(&campaign.told).is_some_and(|s| length > s.longer_than_s));
    let flights = vec![&unit.name; rows];
    let table = Table::build("lengths").strings("flight", flights).f64("length", vec![length; rows]).finish()?;
    Ok(Output { tables: vec![("lengths", table)], ..Output::default() })
}

const SECTION: Section = Section { id: "lengths", heading: "Lengths of the flights", on: On::Index, tables: &["lengths"], build };

fn build(given: &Given) -> crate::error::Result<Option<Body>> {
    let Some(table) = given.get("lengths") else { return Ok(None) };
    let mut grid = Grid::new(["flight", "#length|s"]);
    (0..table.rows()).for_each(|r| grid.push(vec![table.text("flight", r).into(), table.text("length", r).into()]));
    Ok(Some(Body::grid(grid)))
}
