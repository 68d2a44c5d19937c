//! A case in; the sources that its residuals may respond to, out. What each does at given instants is
//! said by `columns`.
//!
//! A source is an input of the model or a modelled output (less its value at the start of the
//! maneuver), or the square of it, with lags; what such a signal rings at one frequency (a lightly
//! damped oscillation that its changes excite); the time since the start, as waves of one frequency
//! (what repeats itself in every maneuver is no noise); or an input whose effect comes and goes
//! with such a wave.

use super::timescale::characteristic_time;
use crate::diagnose::thresholds::Thresholds;
use crate::estimate::Case;
use crate::math::distribution::chi2_quantile;

/// Lags of an impulse response.
pub const LAGS: usize = 8;

/// What an output may respond to.
#[derive(Debug, Clone)]
pub struct Source {
    pub name: String,
    /// Those of one group are one row of the result: the best of them.
    pub group: usize,
    pub kind: Kind,
    /// The gain that it must exceed.
    pub limit: f64,
}

/// Signals by their place among inputs and modelled outputs; lags in s; angular frequencies in
/// rad/s; damping as a share of the critical one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    Lagged {
        signal: usize,
        squared: bool,
        lags: [f64; LAGS],
    },
    Ringing {
        signal: usize,
        frequency: f64,
        damping: f64,
    },
    /// The time since the start.
    Wave {
        frequency: f64,
    },
    /// A signal that comes and goes with the time since the start.
    Coming {
        signal: usize,
        frequency: f64,
    },
}

impl Kind {
    pub fn columns(&self) -> usize {
        if matches!(self, Kind::Lagged { .. }) { LAGS } else { 2 }
    }
}

/// All sources of a case.
pub struct Sources {
    pub all: Vec<Source>,
    pub groups: usize,
}

impl Sources {
    /// `chance`: share of the campaigns with nothing missing in which one of them may exceed its
    /// limit at one of the outputs. `motion`: whether what the motion rings, and what inputs do
    /// that come and go, are among them.
    pub fn of(
        case: &Case,
        segments: &[usize],
        chance: f64,
        motion: bool,
        thresholds: &Thresholds,
    ) -> Sources {
        let inputs = case.model.inputs.iter().map(|i| i.name.clone());
        let modelled =
            case.outputs.iter().map(|&o| format!("modelled {}", case.model.outputs[o].name));
        let names: Vec<String> = inputs.chain(modelled).collect();
        let controls = case.model.inputs.len();
        let mut sources = Sources { all: Vec::new(), groups: 0 };
        let time = characteristic_time(segments.iter().map(|&s| &case.records[s]), thresholds);
        let (lags, damping) = (thresholds.lags.map(|lag| lag * time), thresholds.ringing);
        for squared in [false, true] {
            for (signal, name) in names.iter().enumerate() {
                let name = if squared { format!("the square of {name}") } else { name.clone() };
                sources.group(vec![(name, Kind::Lagged { signal, squared, lags })]);
            }
        }
        let lagged = sources.all.len();
        let frequencies = frequencies(case, segments, thresholds);
        let mut waves = |what: &str, kind: &dyn Fn(f64) -> Kind| {
            sources.group(
                frequencies.iter().map(|&f| (format!("{what} at {f:.2} rad/s"), kind(f))).collect(),
            );
        };
        for (signal, name) in
            names.iter().enumerate().take(if motion { names.len() } else { controls })
        {
            waves(&format!("{name}, ringing"), &|frequency| Kind::Ringing {
                signal,
                frequency,
                damping,
            });
        }
        waves("the time since the start", &|frequency| Kind::Wave { frequency });
        for (signal, name) in names.iter().enumerate().take(if motion { controls } else { 0 }) {
            waves(&format!("{name}, coming and going"), &|frequency| Kind::Coming {
                signal,
                frequency,
            });
        }
        // Half of what chance is allowed for those with lags.
        let counts = [lagged, sources.all.len() - lagged];
        for (i, source) in sources.all.iter_mut().enumerate() {
            let share = thresholds.question_share * chance
                / (counts[usize::from(i >= lagged)] * case.outputs.len()).max(1) as f64;
            source.limit = 0.5 * chi2_quantile(1.0 - share, source.kind.columns() as f64);
        }
        sources
    }

    /// Some of them, each once, in their order; and which these are.
    pub fn only(&self, of: &[usize]) -> (Sources, Vec<usize>) {
        let places: Vec<usize> = (0..self.all.len()).filter(|i| of.contains(i)).collect();
        (
            Sources {
                all: places.iter().map(|&i| self.all[i].clone()).collect(),
                groups: self.groups,
            },
            places,
        )
    }

    fn group(&mut self, of: Vec<(String, Kind)>) {
        let group = self.groups;
        self.all.extend(of.into_iter().map(|(name, kind)| Source {
            name,
            group,
            kind,
            limit: f64::NAN,
        }));
        self.groups += 1;
    }
}

/// Multiples of one period per maneuver of middle length, up to a share of what the record
/// resolves.
fn frequencies(case: &Case, segments: &[usize], thresholds: &Thresholds) -> Vec<f64> {
    let mut lengths: Vec<(f64, f64)> = segments
        .iter()
        .map(|&s| &case.records[s])
        .map(|r| (r.n.saturating_sub(r.start + 1) as f64 * r.dt, r.dt))
        .filter(|(length, dt)| *length > 0.0 && *dt > 0.0)
        .collect();
    lengths.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(length, dt)) = lengths.get(lengths.len() / 2) else { return Vec::new() };
    let lowest = 2.0 * std::f64::consts::PI / length;
    let count = ((thresholds.highest_frequency * std::f64::consts::PI / dt / lowest) as usize)
        .min(thresholds.frequencies);
    (1..=count).map(|k| k as f64 * lowest).collect()
}
