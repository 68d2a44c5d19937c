//! A recording in, an MCAP log out; the truth of a flight in, a JSON file for tests out. Both appear whole or not at all.

use super::plan::Placed;
use super::record::{Recording, SensorError};
use super::truth::Truth;
use crate::error::{Error, Result};
use crate::log::{FieldSpec, LogWriter, Stream};
use indexmap::IndexMap;
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// Writes the log of one flight.
///
/// # Errors
/// The file cannot be written.
pub fn write_log(recording: &Recording, path: &Path) -> Result<()> {
    let mut writer = LogWriter::create(path)?;
    let mut streams = Vec::with_capacity(recording.topics.len());
    for topic in &recording.topics {
        let fields: Vec<FieldSpec> = topic.fields.iter().map(|f| FieldSpec::new(&f.name, &f.unit, &f.doc)).collect();
        let id = writer.add_topic(&topic.topic, &fields)?;
        streams.push(Stream { topic: id, log_time_ns: &topic.log_ns, publish_time_ns: &topic.publish_ns, rows: &topic.rows });
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

/// A maneuver and every true signal (SI) at its first step.
#[derive(Serialize)]
struct TrueManeuver<'a> {
    #[serde(flatten)]
    placed: &'a Placed,
    at_start: IndexMap<&'a str, f64>,
}

/// Writes what is true in one flight: maneuvers with their times, all true signals at each one's first step, sensor errors.
///
/// # Errors
/// The file cannot be written.
pub fn write_truth(truth: &Truth, recording: &Recording, path: &Path) -> Result<()> {
    let maneuvers = truth.maneuvers.iter().map(|placed| TrueManeuver { placed, at_start: truth.at(placed.t_start_s) }).collect();
    let content = TruthFile { flight: &truth.flight, maneuvers, sensors: &recording.errors };
    let failed = |e: &dyn std::fmt::Display| {
        Error::new(format!("cannot write {}: {e}", path.display())).help("check the folder and its free space")
    };
    let text = serde_json::to_string_pretty(&content).map_err(|e| failed(&e))?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|e| failed(&e))?;
    let mut file = tempfile::Builder::new().prefix(".koehler-").tempfile_in(folder).map_err(|e| failed(&e))?;
    file.write_all(text.as_bytes()).and_then(|()| file.as_file().sync_all()).map_err(|e| failed(&e))?;
    file.persist(path).map_err(|e| failed(&e))?;
    Ok(())
}
