//! `overlays` in; held-out maneuvers before and after an addition, as curves that are drawn, out.

use super::columns::Columns;
use super::format::{display_unit, short, shorts, thin};
use serde::Serialize;

/// One held-out maneuver, before and after (JSON).
#[derive(Debug, Clone, Serialize)]
pub struct Overlay {
    pub label: String,
    pub diagnosis: String,
    pub segment: String,
    pub outputs: Vec<Curve>,
}

#[derive(Debug, Clone, Serialize)]
pub struct Curve {
    pub name: String,
    pub unit: String,
    pub t: Vec<Option<f64>>,
    pub measured: Vec<Option<f64>>,
    pub before: Vec<Option<f64>>,
    pub after: Vec<Option<f64>>,
}

/// Samples drawn per curve.
const DRAWN: usize = 500;

/// Every held-out maneuver, what changed most first.
pub fn overlays(table: Option<&Columns>) -> Vec<Overlay> {
    let Some(table) = table else { return Vec::new() };
    let mut all: Vec<Overlay> = Vec::new();
    for ([diagnosis, segment, output], rows) in table.groups(["diagnosis", "segment", "output"]) {
        let label = format!("{diagnosis}: {segment}");
        let column = |name: &str| rows.iter().map(|&r| table.number(name, r)).collect::<Vec<f64>>();
        let (t, measured, before, after) =
            (column("t_s"), column("measured"), column("before"), column("after"));
        let (factor, unit) =
            display_unit(&rows.first().map(|&r| table.unit_in("unit", r)).unwrap_or_default());
        let kept = thin(t.len(), &[&measured, &before, &after], DRAWN);
        let some = |values: &[f64]| shorts(kept.iter().map(|&k| values[k]), factor);
        let curve = Curve {
            name: output,
            unit,
            t: kept.iter().map(|&k| short(t[k])).collect(),
            measured: some(&measured),
            before: some(&before),
            after: some(&after),
        };
        match all.iter_mut().find(|o| o.label == label) {
            Some(overlay) => overlay.outputs.push(curve),
            None => all.push(Overlay { label, diagnosis, segment, outputs: vec![curve] }),
        }
    }
    // What changed most is shown first.
    let changed = |overlay: &Overlay| overlay.outputs.iter().map(Curve::moved).sum::<f64>();
    all.sort_by(|a, b| changed(b).total_cmp(&changed(a)));
    all
}

impl Curve {
    /// What the addition moved, as a share of what was measured.
    pub fn moved(&self) -> f64 {
        let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
        let known: Vec<f64> = self.measured.iter().flatten().copied().collect();
        let mean = known.iter().sum::<f64>() / known.len() as f64;
        let moved = squares(
            &mut self.before.iter().zip(&self.after).filter_map(|(b, a)| Some((*b)? - (*a)?)),
        );
        Some(moved / squares(&mut known.iter().map(|v| v - mean)))
            .filter(|share| share.is_finite())
            .unwrap_or(0.0)
    }
}
