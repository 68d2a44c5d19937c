//! A recording in, an MCAP log out; the truth of a flight in, a JSON file for tests out. Both
//! appear whole or not at all.

use super::recorder::{Recording, SensorError};
use super::timeline::Placed;
use super::truth::Truth;
use crate::error::{Error, Result};
use crate::log::{FieldSpec, LogWriter, Stream};
use crate::table;
use indexmap::IndexMap;
use serde::Serialize;
use std::path::Path;

/// Writes the log of one flight; `writer` is what its header names as the program that wrote it.
///
/// # Errors
/// The file cannot be written.
pub fn write_log(recording: &Recording, path: &Path, writer: &str) -> Result<()> {
    let mut writer = LogWriter::create_as(path, writer)?;
    let mut streams = Vec::with_capacity(recording.topics.len());
    for topic in &recording.topics {
        let fields: Vec<FieldSpec> =
            topic.fields.iter().map(|f| FieldSpec::new(&f.name, &f.unit, &f.doc)).collect();
        let id = writer.add_topic(&topic.topic, &fields)?;
        streams.push(Stream {
            topic: id,
            log_time_ns: &topic.log_ns,
            publish_time_ns: &topic.publish_ns,
            rows: &topic.rows,
        });
    }
    writer.write_streams(&streams)?;
    writer.finish()
}

/// What only a test may read of one flight.
#[derive(Serialize)]
struct TruthFile<'a> {
    flight: &'a str,
    maneuvers: Vec<TrueManeuver<'a>>,
    sensors: &'a [SensorError],
}

/// A maneuver and every true signal (SI) just before its first step.
#[derive(Serialize)]
struct TrueManeuver<'a> {
    #[serde(flatten)]
    placed: &'a Placed,
    at_start: IndexMap<&'a str, f64>,
}

/// Writes what is true in one flight: maneuvers with their times, all true signals just before each
/// one's first step, sensor errors.
///
/// # Errors
/// The file cannot be written.
pub fn write_truth(truth: &Truth, recording: &Recording, path: &Path) -> Result<()> {
    let maneuvers = truth
        .maneuvers
        .iter()
        .map(|placed| TrueManeuver { placed, at_start: truth.at(placed.t_start_s - truth.dt) })
        .collect();
    let content = TruthFile { flight: &truth.flight, maneuvers, sensors: &recording.errors };
    let text = serde_json::to_string_pretty(&content)
        .map_err(|e| Error::new(format!("cannot write {}: {e}", path.display())))?;
    table::write_atomic(path, text.as_bytes())
}
