//! A truth model and the timeline of a flight in, every true signal on a uniform grid out.

use super::timeline::{Placed, Timeline};
use super::trim::trim;
use crate::dynamics::{self, Directions, Lost, Record, Tier};
use crate::error::{Error, Result};
use crate::model::{Model, Quantity};
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
        self.signals
            .iter()
            .filter_map(|(name, s)| Some((name.as_str(), *s.values.get(k)?)))
            .collect()
    }
}

/// Flies a timeline: `inputs` are the model's, one `[n]` each. The flight starts in the steady
/// condition of its first inputs; quantities that the trim frees among the inputs keep their
/// trimmed value on top of their signal.
///
/// # Errors
/// There is no steady condition, or the motion diverges.
pub(super) fn fly(model: &Model, timeline: &Timeline, mut inputs: Vec<Vec<f64>>) -> Result<Truth> {
    let first: Vec<f64> =
        inputs.iter().map(|signal| signal.first().copied().unwrap_or(0.0)).collect();
    let steady = trim(model, &first)?;
    for (signal, (trimmed, first)) in inputs.iter_mut().zip(steady.inputs.iter().zip(&first)) {
        if trimmed != first {
            signal.iter_mut().for_each(|u| *u += trimmed - first);
        }
    }
    let rows = (0..timeline.n).flat_map(|k| inputs.iter().map(move |signal| signal[k])).collect();
    let record =
        Record { t0: 0.0, dt: timeline.dt, n: timeline.n, inputs: rows, ..Record::default() };
    let starts = Directions { parameters: Vec::new(), starts: (0..model.states.len()).collect() };
    let mut propagator = dynamics::Propagator::new(model, starts)?;
    propagator.compile(Tier::Auto, 1, timeline.n);
    let grid = propagator.run(&steady.parameters, &steady.states, &record, false);
    drop(record);
    if !grid.finite {
        let why = grid.lost.unwrap_or(Lost::Diverges).words(&model.states);
        return Err(given_up(timeline, &grid.y, model.outputs.len(), &why));
    }
    let mut signals = IndexMap::new();
    let mut put = |quantity: &Quantity, values: Vec<f64>| {
        let signal = Signal { unit: quantity.unit.clone(), doc: quantity.doc.clone(), values };
        // An output may have an input's name: what the sensors see is the output.
        signals.entry(quantity.name.clone()).or_insert(signal);
    };
    let ny = model.outputs.len();
    for (j, output) in model.outputs.iter().enumerate() {
        put(output, grid.y.iter().skip(j).step_by(ny).copied().collect());
    }
    for (input, signal) in model.inputs.iter().zip(inputs) {
        put(input, signal);
    }
    Ok(Truth {
        flight: timeline.flight.clone(),
        dt: timeline.dt,
        n: timeline.n,
        signals,
        maneuvers: timeline.maneuvers.clone(),
    })
}

fn given_up(timeline: &Timeline, outputs: &[f64], ny: usize, why: &str) -> Error {
    let k = outputs.iter().position(|y| !y.is_finite()).map_or(timeline.n, |i| i / ny.max(1));
    let t = k as f64 * timeline.dt;
    let last = timeline.maneuvers.iter().rfind(|m| m.t_start_s <= t);
    let after = last.map_or("before the first maneuver".to_string(), |m| {
        format!("after \"{}\" at {:.1} s", m.maneuver, m.t_start_s)
    });
    Error::new(format!("{why} at {t:.2} s, {after}"))
        .help("look at the truth model's stability, its limits, and the amplitude of the input")
}
