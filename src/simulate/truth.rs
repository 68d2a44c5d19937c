//! A truth model and the timeline of a flight in, every true signal on a uniform grid out.

use super::plan::Placed;
use indexmap::IndexMap;

/// One true signal on the grid, SI.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    pub unit: String,
    pub doc: String,
    /// `[n]`.
    pub values: Vec<f64>,
}

/// What really happens in one flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    pub flight: String,
    /// Grid spacing, s, and number of grid points; the first one is at 0 s.
    pub dt: f64,
    pub n: usize,
    /// Outputs and inputs of the truth model, by name.
    pub signals: IndexMap<String, Signal>,
    /// The maneuvers in the order of time.
    pub maneuvers: Vec<Placed>,
}

impl Truth {
    /// Duration of the flight, s.
    pub fn duration(&self) -> f64 {
        self.n.saturating_sub(1) as f64 * self.dt
    }

    /// All signals at the grid point next to `t`, in their order: name and value.
    pub fn at(&self, t: f64) -> IndexMap<&str, f64> {
        let k = ((t / self.dt).round().max(0.0) as usize).min(self.n.saturating_sub(1));
        self.signals.iter().filter_map(|(name, s)| Some((name.as_str(), *s.values.get(k)?))).collect()
    }
}
