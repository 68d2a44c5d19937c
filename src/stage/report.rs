//! All tables come in; the page that a person opens first goes out: the index of the report, or all of
//! it.

use super::{
    Campaign, Inputs, Key, NOTES, Note, Output, Part, Read, STAGES_TABLE, Severity, Stage, Unit,
};
use crate::error::{Errors, Result};
use crate::report::{self, Form, HISTORIES, ReportInput, Section};
use crate::table::{Rows, Table, Want};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;

pub const STAGE: Stage = Stage {
    name: "report",
    about: "write the report",
    key: Some(Key::of::<Settings>()),
    units: |campaign| if settings(campaign).is_some() { Unit::campaign() } else { Vec::new() },
    reads,
    slice,
    run,
    reads_records: true,
    ..Stage::PLAIN
};

/// The report in the output folder: `report/index.html`, and a page per flight in `report/flights`; left
/// out, there is none.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// A line under the title.
    pub subtitle: String,
    /// One page that holds everything, flights and script too: to be sent. It grows with the number of
    /// flights, and so does the memory that it is made in.
    pub single_file: bool,
}

pub fn settings(campaign: &Campaign) -> Option<&Settings> {
    campaign.told.get("report")
}

/// The sections that stages bring along.
pub fn sections(campaign: &Campaign) -> Vec<&'static Section> {
    campaign.stages.iter().flat_map(|stage| stage.sections).collect()
}

/// Which page this stage makes.
fn form(campaign: &Campaign) -> Form {
    match settings(campaign).is_some_and(|settings| settings.single_file) {
        true => Form::One,
        false => Form::Index(campaign.flights.clone()),
    }
}

/// What a page is made from, but for its tables.
pub fn frame(campaign: &Campaign, form: Form) -> ReportInput {
    ReportInput {
        form,
        title: campaign.title.clone(),
        subtitle: settings(campaign).map(|r| r.subtitle.clone()).unwrap_or_default(),
        inputs: inputs_of_models(campaign),
        searched: searched(campaign),
        more: sections(campaign),
        unasked: unasked(campaign),
        ..ReportInput::default()
    }
}

/// What all pages depend on.
pub fn slice_of_all(campaign: &Campaign) -> Value {
    let frame = frame(campaign, Form::One);
    json!({ "title": frame.title, "subtitle": frame.subtitle, "inputs": frame.inputs, "searched": frame.searched, "unasked": frame.unasked })
}

fn slice(campaign: &Campaign, _: &Unit) -> Value {
    let mut slice = slice_of_all(campaign);
    // The flights that the list names; none for the one page.
    slice["flights"] = match form(campaign) {
        Form::Index(flights) => json!(flights),
        _ => Value::Null,
    };
    slice
}

/// Columns of the samples table that drive each model, by the model's name in the tables.
fn inputs_of_models(campaign: &Campaign) -> BTreeMap<String, Vec<String>> {
    campaign.stages.iter().flat_map(|stage| (stage.models)(campaign)).collect()
}

/// The signal in which each input of the segments is searched.
fn searched(campaign: &Campaign) -> BTreeMap<String, String> {
    let inputs = campaign.segment.iter().flat_map(|s| &s.settings.input);
    inputs.map(|i| (i.name().to_string(), i.signal.clone())).collect()
}

/// The parts of a table of this campaign.
pub fn parts(campaign: &Campaign, table: &str) -> Vec<Part> {
    let notes = campaign.flights.iter().filter(|_| table == NOTES);
    match own(table) {
        true => {
            let of = notes.map(|flight| Part::Of(0, flight.clone()));
            [Part::Number(0)].into_iter().chain(of).collect()
        }
        false => campaign.parts(table),
    }
}

/// Whether the pipeline writes a table itself.
pub fn own(table: &str) -> bool {
    [NOTES, STAGES_TABLE].contains(&table)
}

/// Tables that no unit of this campaign writes: sections about them have no place on the page.
fn unasked(campaign: &Campaign) -> Vec<&'static str> {
    let written = campaign.written();
    let mut tables = report::tables(&Form::One, &sections(campaign));
    tables.retain(|table| !written.contains(table) && !own(table));
    tables
}

/// Histories of which the index takes something: units of columns, and where maneuvers begin and end.
const OF_THE_INDEX: [&str; 2] = ["samples", "responses"];

/// The tables of the page.
fn tables(campaign: &Campaign) -> Vec<&'static str> {
    let form = form(campaign);
    let mut tables = report::tables(&form, &sections(campaign));
    if let Form::Index(_) = form {
        tables.retain(|table| !HISTORIES.contains(table) || OF_THE_INDEX.contains(table));
    }
    tables
}

fn reads(campaign: &Campaign, _: &Unit) -> Vec<Read> {
    let of = |table| {
        parts(campaign, table).into_iter().map(move |part| Read { table, part, optional: true })
    };
    tables(campaign).into_iter().flat_map(of).collect()
}

fn run(campaign: &Campaign, _: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let form = form(campaign);
    let mut found = BTreeMap::new();
    let drawn = drawn(campaign, inputs)?;
    for name in tables(campaign) {
        let parts = match form {
            Form::Index(_) => of_index(name, &drawn, inputs)?,
            _ => of_one(name, &drawn, inputs)?,
        };
        if !parts.is_empty() {
            found.insert(name.to_string(), Table::concat(name, &parts)?);
        }
    }
    let shared = matches!(form, Form::Index(_)).then(report::script);
    let input = ReportInput {
        tables: found,
        provenance: vec![
            ("program".to_string(), format!("koehler {}", env!("CARGO_PKG_VERSION"))),
            ("sources".to_string(), super::code(STAGE.name).to_string()),
        ],
        ..frame(campaign, form)
    };
    let report = report::report(&input)?;
    let page = (report::INDEX.to_string(), report.page.into_bytes());
    let script = shared.map(|(path, text)| (path.to_string(), text.as_bytes().to_vec()));
    Ok(Output {
        tables: Vec::new(),
        files: [page].into_iter().chain(script).collect(),
        notes: (report.problems.into_iter().map(|text| note(Severity::Problem, text)))
            .chain(report.looks.into_iter().map(|text| note(Severity::Warning, text)))
            .collect(),
    })
}

/// All parts of a table. Histories of whole flights are most of what there is: only what is drawn of
/// them is read.
fn of_one(name: &'static str, drawn: &[String], inputs: &Inputs) -> Result<Vec<Table>> {
    let columns = ["samples", "flightpath"].contains(&name).then_some(drawn);
    inputs.all_with(name, Want { columns, ..Want::default() })
}

/// What the index takes of a table: of the samples their units, of histories their ends.
fn of_index(name: &'static str, drawn: &[String], inputs: &Inputs) -> Result<Vec<Table>> {
    match name {
        "samples" => {
            let first = inputs.parts.iter().find(|(table, _)| *table == name);
            let want = Want { columns: Some(drawn), ..Want::default() };
            let units = first.map(|(_, part)| (inputs.table)(name, part, want)?.take(&[]));
            units.into_iter().collect()
        }
        "responses" => {
            inputs.all_with(name, Want { rows: Some(&Rows::Ends("segment")), ..Want::default() })
        }
        _ => inputs.all(name),
    }
}

/// Columns of flights' histories that a page draws, or of which it tells the unit.
fn drawn(campaign: &Campaign, inputs: &Inputs) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for segments in inputs.all("segments")? {
        names.extend(segments.strings("input")?.into_iter().map(String::from));
    }
    for gaps in inputs.all("gaps")? {
        let by = gaps.strings("by")?.into_iter();
        names.extend(by.map(|by| by.strip_prefix("modelled ").unwrap_or(by).to_string()));
    }
    Ok(drawn_of(campaign, names))
}

/// Columns that a page draws for any flight, and these.
pub fn drawn_of(campaign: &Campaign, mut names: Vec<String>) -> Vec<String> {
    names.extend(report::overview_columns().map(String::from));
    names.extend(inputs_of_models(campaign).into_values().flatten());
    for (input, signal) in searched(campaign) {
        names.extend([input, signal]);
    }
    names.sort();
    names.dedup();
    names
}

/// What the page calls a problem, or worth a look, for the screen and the exit code.
fn note(severity: Severity, text: String) -> Note {
    let (flight, subject) = (String::new(), "report".to_string());
    Note { flight, stage: STAGE.name.to_string(), severity, subject, count: 1, text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Plan;
    use crate::stage::STAGES;
    use std::path::Path;

    /// Campaigns with several estimates, fits, diagnoses and reruns.
    fn campaigns() -> Vec<Campaign> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
        let read = |name: &str| {
            Plan::read(&folder.join(name)).unwrap_or_else(|e| panic!("{name}: {e}")).campaign
        };
        vec![
            read("citation/pipeline.toml"),
            read("attas/pipeline.toml"),
            read("attas/diagnosis.toml"),
        ]
    }

    #[test]
    fn every_part_that_any_stage_writes_is_read() {
        for campaign in campaigns() {
            let reads = reads(&campaign, &Unit::campaign()[0]);
            let mut most = 0;
            for stage in STAGES {
                for unit in (stage.units)(&campaign) {
                    for table in
                        stage.writes.iter().filter(|table| tables(&campaign).contains(table))
                    {
                        let part = unit.part.clone();
                        most = most.max(if let Part::Number(i) = part { i } else { 0 });
                        let read = Read { table, part, optional: true };
                        assert!(
                            reads.contains(&read),
                            "{} of {} is not read",
                            read.part.words(table),
                            stage.name
                        );
                    }
                }
            }
            let diagnosed = campaign.estimates.len() + crate::stage::diagnose::all(&campaign).len();
            let figures = campaign.parts("figures").len();
            assert_eq!(most + 1, diagnosed.max(campaign.fits.len()).max(figures).max(1));
        }
    }

    #[test]
    fn a_table_of_the_page_is_written_by_a_stage() {
        let written: Vec<&str> =
            STAGES.iter().flat_map(|s| s.writes).copied().chain([NOTES, STAGES_TABLE]).collect();
        for section in report::SECTIONS {
            for table in section.tables {
                assert!(written.contains(table), "{}: no stage writes {table}", section.id);
            }
        }
    }
}
