//! All tables come in, the pages that a person reads go out.

use super::{Campaign, Inputs, NOTES, Note, Output, Per, Read, STAGES_TABLE, Severity, Stage, Unit};
use crate::error::Errors;
use crate::report::{self, ReportInput, TABLES};
use crate::table::{Table, schema};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;

pub const STAGE: Stage = Stage {
    name: "report",
    about: "write the report",
    per: Per::Campaign,
    wanted: |campaign| campaign.report.is_some(),
    writes: &[],
    reads,
    reads_log: false,
    slice,
    run,
};

/// The report `report/index.html` in the output folder.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// A line under the title.
    pub subtitle: String,
}

fn slice(campaign: &Campaign, _: &Unit) -> Value {
    let subtitle = campaign.report.as_ref().map(|r| r.subtitle.clone()).unwrap_or_default();
    json!({ "title": campaign.title, "subtitle": subtitle, "inputs": inputs_of_models(campaign), "searched": searched(campaign), "unasked": unasked(campaign) })
}

/// Sections of what the pipeline does not ask for. (What a diagnosis is stays where there are models: the section says how to have one.)
fn unasked(campaign: &Campaign) -> Vec<&'static str> {
    match (campaign.estimates.is_empty(), campaign.fits.is_empty()) {
        (true, _) => vec!["lines", "fits", "maneuvers", "estimates", "uncertainty", "diagnosis"],
        (false, true) => vec!["lines", "fits"],
        (false, false) => Vec::new(),
    }
}

fn reads(campaign: &Campaign, _: &Unit) -> Vec<Read> {
    let mut all = Vec::new();
    for table in TABLES {
        let per_flight = schema(table).is_ok_and(|s| s.per_flight);
        all.extend(match table {
            NOTES | STAGES_TABLE => Read::parts(&[table], 1),
            _ if per_flight => Read::flights(&[table], campaign),
            _ => Read::parts(&[table], (campaign.estimates.len() + campaign.diagnoses.len()).max(campaign.fits.len())),
        });
    }
    all
}

/// Columns of the samples table that drive each model.
fn inputs_of_models(campaign: &Campaign) -> BTreeMap<String, Vec<String>> {
    let again = campaign.diagnoses.iter().filter_map(|d| Some((d.settings.next(), campaign.estimates.get(d.estimate)?)));
    campaign.estimates.iter().map(|e| (e.name(), e)).chain(again).map(|(name, e)| (name, e.columns())).collect()
}

/// The signal in which each input of the segments is searched.
fn searched(campaign: &Campaign) -> BTreeMap<String, String> {
    let inputs = campaign.segment.iter().flat_map(|s| &s.settings.input);
    inputs.map(|i| (i.name().to_string(), i.signal.clone())).collect()
}

fn run(campaign: &Campaign, _: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let mut tables = BTreeMap::new();
    for name in TABLES {
        let parts: Vec<Table> = inputs.all(name).into_iter().cloned().collect();
        if !parts.is_empty() {
            tables.insert(name.to_string(), Table::concat(name, &parts)?);
        }
    }
    let input = ReportInput {
        title: campaign.title.clone(),
        subtitle: campaign.report.as_ref().map(|r| r.subtitle.clone()).unwrap_or_default(),
        tables,
        inputs: inputs_of_models(campaign),
        searched: searched(campaign),
        unasked: unasked(campaign),
        provenance: vec![
            ("program".to_string(), format!("koehler {}", env!("CARGO_PKG_VERSION"))),
            ("sources".to_string(), env!("KOEHLER_CODE").to_string()),
        ],
    };
    let report = report::report(&input)?;
    let notes = report.problems.into_iter().map(problem).collect();
    Ok(Output { tables: Vec::new(), files: vec![("report/index.html".to_string(), report.page.into_bytes())], notes })
}

/// What the page calls a problem, for the screen and the exit code.
fn problem(text: String) -> Note {
    let (flight, subject) = (String::new(), "report".to_string());
    Note { flight, stage: STAGE.name.to_string(), severity: Severity::Problem, subject, count: 1, text }
}
