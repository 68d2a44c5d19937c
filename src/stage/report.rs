//! All tables come in, the pages that a person reads go out.

use super::{
    Campaign, Inputs, Key, NOTES, Note, Output, Part, Read, STAGES_TABLE, Severity, Stage, Unit,
};
use crate::error::{Error, Errors};
use crate::report::{self, ReportInput, Section};
use crate::table::Table;
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

/// The report `report/index.html` in the output folder; left out, there is none.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// A line under the title.
    pub subtitle: String,
}

fn settings(campaign: &Campaign) -> Option<&Settings> {
    campaign.told.get("report")
}

/// The sections that stages bring along.
fn sections(campaign: &Campaign) -> Vec<&'static Section> {
    campaign.stages.iter().flat_map(|stage| stage.sections).collect()
}

fn slice(campaign: &Campaign, _: &Unit) -> Value {
    let subtitle = settings(campaign).map(|r| r.subtitle.clone()).unwrap_or_default();
    json!({ "title": campaign.title, "subtitle": subtitle, "inputs": inputs_of_models(campaign), "searched": searched(campaign), "unasked": unasked(campaign) })
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
fn parts(campaign: &Campaign, table: &str) -> Vec<Part> {
    // The pipeline writes these itself.
    let own = [NOTES, STAGES_TABLE].contains(&table);
    if own { vec![Part::Number(0)] } else { campaign.parts(table) }
}

/// Tables that no unit of this campaign writes: sections about them have no place on the page.
fn unasked(campaign: &Campaign) -> Vec<&'static str> {
    report::tables(&sections(campaign))
        .into_iter()
        .filter(|table| parts(campaign, table).is_empty())
        .collect()
}

fn reads(campaign: &Campaign, _: &Unit) -> Vec<Read> {
    let of = |table| {
        parts(campaign, table).into_iter().map(move |part| Read { table, part, optional: true })
    };
    report::tables(&sections(campaign)).into_iter().flat_map(of).collect()
}

fn run(campaign: &Campaign, _: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let mut tables = BTreeMap::new();
    let drawn = drawn(campaign, inputs)?;
    for name in report::tables(&sections(campaign)) {
        // Histories of whole flights are most of what there is: only what is drawn of them is read.
        let parts = match ["samples", "flightpath"].contains(&name) {
            true => inputs.all_with(name, Some(&drawn))?,
            false => inputs.all(name)?,
        };
        if !parts.is_empty() {
            tables.insert(name.to_string(), Table::concat(name, &parts)?);
        }
    }
    let input = ReportInput {
        title: campaign.title.clone(),
        subtitle: settings(campaign).map(|r| r.subtitle.clone()).unwrap_or_default(),
        tables,
        inputs: inputs_of_models(campaign),
        searched: searched(campaign),
        more: sections(campaign),
        unasked: unasked(campaign),
        provenance: vec![
            ("program".to_string(), format!("koehler {}", env!("CARGO_PKG_VERSION"))),
            ("sources".to_string(), super::code(STAGE.name).to_string()),
        ],
    };
    let report = report::report(&input)?;
    let notes = report.problems.into_iter().map(problem).collect();
    Ok(Output {
        tables: Vec::new(),
        files: vec![("report/index.html".to_string(), report.page.into_bytes())],
        notes,
    })
}

/// Columns of flights' histories that the page draws, or of which it tells the unit.
fn drawn(campaign: &Campaign, inputs: &Inputs) -> Result<Vec<String>, Error> {
    let mut names: Vec<String> = report::overview_columns().map(String::from).collect();
    names.extend(inputs_of_models(campaign).into_values().flatten());
    for (input, signal) in searched(campaign) {
        names.extend([input, signal]);
    }
    for segments in inputs.all("segments")? {
        names.extend(segments.strings("input")?.into_iter().map(String::from));
    }
    for gaps in inputs.all("gaps")? {
        let by = gaps.strings("by")?.into_iter();
        names.extend(by.map(|by| by.strip_prefix("modelled ").unwrap_or(by).to_string()));
    }
    names.sort();
    names.dedup();
    Ok(names)
}

/// What the page calls a problem, for the screen and the exit code.
fn problem(text: String) -> Note {
    let (flight, subject) = (String::new(), "report".to_string());
    Note {
        flight,
        stage: STAGE.name.to_string(),
        severity: Severity::Problem,
        subject,
        count: 1,
        text,
    }
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
                        stage.writes.iter().filter(|table| report::tables(&[]).contains(table))
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
