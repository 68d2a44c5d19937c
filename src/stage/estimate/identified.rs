//! A finished estimation in; its model's file with the values that were found as starts, for a simulator or
//! another run, out.

use super::batch::Batch;
use super::config::Config;
use crate::estimate::{Estimation, Row, Stop};
use crate::math::digits;

/// The file, and where it is written in the folder of a run: of one estimation over all, or of one flight that is
/// estimated as a whole. None where nothing was found, or each maneuver has values of its own.
pub fn file(
    config: &Config,
    flight: Option<&str>,
    (batch, estimation): (&Batch, &Estimation),
) -> Option<(String, Vec<u8>)> {
    let is_common = |row: &&Row| row.segment.is_none() && row.group.is_none();
    let rows: Vec<&Row> = estimation.rows.iter().filter(is_common).collect();
    if estimation.stop != Stop::Converged || rows.is_empty() {
        return None;
    }
    let values: Vec<(&str, f64)> = rows.iter().map(|row| (row.name.as_str(), row.value)).collect();
    let (text, others) = config.model.started_at(&values)?;
    if others.len() == rows.len() {
        return None;
    }
    let mut head = format!(
        "# Identified by the estimate \"{}\" of {}: the starts of these parameters are its values (+- sd).\n",
        config.name(),
        batch.group
    );
    for row in &rows {
        let sd = row.sd.map(|sd| format!(" +- {}", digits(sd))).unwrap_or_default();
        let elsewhere =
            if others.contains(&row.name) { " (its start stands elsewhere)" } else { "" };
        head += &format!("# {} = {:?}{sd} {}{elsewhere}\n", row.name, row.value, row.unit);
    }
    if estimation.rows.len() > rows.len() {
        head += "# Those of one maneuver, or of some, stand in the table estimates.\n";
    }
    let of = flight.map(|flight| format!(".{flight}")).unwrap_or_default();
    let path = format!("models/{}{of}.identified.model.toml", config.name());
    Some((path, (head + "\n" + &text).into_bytes()))
}
