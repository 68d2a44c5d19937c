//! `pathmatch` in, every measured channel of a flight beside what the reconstructed path says of it
//! out.

use super::columns::Columns;
use super::format::{display_unit, thin};
use super::maneuvers::Output;
use super::packed::Packed;
use super::room::Room;
use serde::Serialize;

/// What one flight's plot is drawn from (JSON); `modelled` is what was reconstructed.
#[derive(Debug, Serialize)]
pub struct PathPlot {
    pub flight: String,
    pub channels: Vec<Output>,
}

/// Samples drawn per channel, at most about.
const LIMIT: usize = 1500;

/// One plot per flight, flights and channels in the order of the table.
pub fn paths(table: Option<&Columns>, room: Room) -> Vec<PathPlot> {
    let Some(table) = table else { return Vec::new() };
    let mut plots: Vec<PathPlot> = Vec::new();
    let groups = table.groups(["flight", "channel"]);
    let limit = room.samples(LIMIT, 1, 3 * groups.len());
    for ([flight, name], rows) in groups {
        let (factor, unit) =
            display_unit(&rows.first().map(|&row| table.unit_in("unit", row)).unwrap_or_default());
        let pick =
            |column: &str| rows.iter().map(|&row| table.number(column, row)).collect::<Vec<f64>>();
        let (t, measured, modelled) = (pick("t_s"), pick("measured"), pick("reconstructed"));
        let kept = thin(t.len(), &[&measured, &modelled], limit);
        let shown =
            |values: &[f64], factor: f64| Packed::of(kept.iter().map(|&k| values[k]), factor);
        let (t, measured, modelled) =
            (shown(&t, 1.0), shown(&measured, factor), shown(&modelled, factor));
        let output = Output { name, unit, t, measured, modelled, simulated: Packed::default() };
        match plots.last_mut().filter(|plot| plot.flight == flight) {
            Some(plot) => plot.channels.push(output),
            None => plots.push(PathPlot { flight, channels: vec![output] }),
        }
    }
    plots
}
