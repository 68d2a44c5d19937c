//! A case in; the sources that its residuals may respond to, and what each does at given instants,
//! out.
//!
//! A source is an input of the model or a modelled output (less its value at the start of the
//! maneuver), or the square of it, with lags; what such a signal rings at one frequency (a lightly
//! damped oscillation that its changes excite); the time since the start, as waves of one frequency
//! (what repeats itself in every maneuver is no noise); or an input whose effect comes and goes
//! with such a wave.

use super::timescale::characteristic_time;
use crate::diagnose::thresholds::Thresholds;
use crate::dynamics::{Numbers, Record};
use crate::estimate::{Case, Trace};
use crate::math::distribution::chi2_quantile;

/// Lags of an impulse response.
const LAGS: usize = 8;

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

/// Inputs, then modelled outputs of a segment: times and values.
pub type Signals = Vec<(Numbers, Vec<f64>)>;

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

/// Signals of one segment, less their value at its start.
pub fn signals(case: &Case, s: usize, traces: &[Trace]) -> Signals {
    let (record, nu) = (&case.records[s], case.model.inputs.len());
    let grid = Numbers::from(grid(record));
    let begin = record.t0 + record.start as f64 * record.dt;
    let inputs = (0..nu).map(|i| {
        (grid.clone(), (0..record.n).map(|k| record.inputs[k * nu + i]).collect::<Vec<f64>>())
    });
    let modelled = case.outputs.iter().map(|&o| {
        let trace = traces.iter().find(|t| t.output == o);
        trace.map(|t| (t.t.clone(), t.modelled.clone())).unwrap_or_default()
    });
    let mut all: Signals = inputs.chain(modelled).collect();
    for (t, v) in &mut all {
        let first = sampled(t, v, &[begin], 0.0)[0];
        v.iter_mut().for_each(|v| *v -= first);
    }
    all
}

fn grid(record: &Record) -> Vec<f64> {
    (0..record.n).map(|k| record.t0 + k as f64 * record.dt).collect()
}

/// What every source does at these instants (ascending): `[source][coefficient][instant]`.
pub fn columns(
    sources: &[Source],
    record: &Record,
    signals: &Signals,
    times: &[f64],
) -> Vec<Vec<Vec<f64>>> {
    let grid = Numbers::from(grid(record));
    let begin = record.t0 + record.start as f64 * record.dt;
    let on = |times: &[f64]| -> Vec<Vec<f64>> {
        signals.iter().map(|(t, v)| sampled(t, v, times, 0.0)).collect()
    };
    let (on_grid, now, from_grid) = (on(&grid), on(times), Places::new(&grid, times, 0.0));
    // what several sources have in common is made once
    let mut waving: Known<f64, Vec<Vec<f64>>> = Vec::new();
    let mut waves =
        |frequency: f64| once(&mut waving, &frequency, || waves(times, begin, frequency)).clone();
    let mut lagging: Known<(usize, [f64; LAGS]), Vec<Vec<f64>>> = Vec::new();
    let mut ringing: Known<usize, Vec<Rung>> = Vec::new();
    let of = |source: &Source| match source.kind {
        Kind::Lagged { signal, squared, lags } => {
            let (t, v) = &signals[signal];
            let lagged = || lags.iter().map(|lag| sampled(t, v, times, *lag)).collect();
            let mut lagged: Vec<Vec<f64>> = once(&mut lagging, &(signal, lags), lagged).clone();
            if squared {
                lagged.iter_mut().flatten().for_each(|v| *v *= *v);
            }
            lagged
        }
        Kind::Wave { frequency } => waves(frequency),
        Kind::Coming { signal, frequency } => {
            let mut both = waves(frequency);
            both.iter_mut().for_each(|wave| {
                wave.iter_mut().zip(&now[signal]).for_each(|(wave, v)| *wave *= v)
            });
            both
        }
        Kind::Ringing { signal, frequency, damping } => {
            let all = once(&mut ringing, &signal, || {
                rung(&on_grid[signal], &tones(sources, signal), record.dt)
            });
            let one = all.iter().find(|one| one.tone == (frequency, damping));
            one.iter().flat_map(|one| &one.parts).map(|v| from_grid.of(v)).collect()
        }
    };
    sources.iter().map(of).collect()
}

/// What was made for each key.
type Known<K, T> = Vec<(K, T)>;

/// What belongs to a key: looked up, or made and kept.
fn once<'a, K: PartialEq + Copy, T>(
    known: &'a mut Known<K, T>,
    key: &K,
    make: impl FnOnce() -> T,
) -> &'a T {
    let at = known.iter().position(|(of, _)| of == key).unwrap_or_else(|| {
        known.push((*key, make()));
        known.len() - 1
    });
    &known[at].1
}

/// Frequencies and dampings at which a signal rings in some source.
fn tones(sources: &[Source], signal: usize) -> Vec<(f64, f64)> {
    let tone = |source: &Source| match source.kind {
        Kind::Ringing { signal: of, frequency, damping } if of == signal => {
            Some((frequency, damping))
        }
        _ => None,
    };
    sources.iter().filter_map(tone).collect()
}

/// Cosine and sine of the time since `begin`.
fn waves(times: &[f64], begin: f64, frequency: f64) -> Vec<Vec<f64>> {
    let phase = |time: &f64| libm::sincos(frequency * (time - begin));
    vec![times.iter().map(|t| phase(t).1).collect(), times.iter().map(|t| phase(t).0).collect()]
}

/// Both parts of a lightly damped oscillation that the changes of a signal start.
struct Rung {
    /// Frequency and damping.
    tone: (f64, f64),
    parts: [Vec<f64>; 2],
}

/// Oscillations that go side by side: a step of one does not wait for that of another.
const TONES: usize = 8;

/// Oscillations of every tone.
fn rung(v: &[f64], tones: &[(f64, f64)], dt: f64) -> Vec<Rung> {
    tones.chunks(TONES).flat_map(|tones| rung_together(v, tones, dt)).collect()
}

fn rung_together(v: &[f64], tones: &[(f64, f64)], dt: f64) -> Vec<Rung> {
    let (mut sin, mut cos, mut keep) = ([0.0; TONES], [0.0; TONES], [0.0; TONES]);
    for (k, (frequency, damping)) in tones.iter().enumerate() {
        (sin[k], cos[k]) = libm::sincos(frequency * dt);
        keep[k] = libm::exp(-damping * frequency * dt);
    }
    let (mut x, mut y, mut last) = ([0.0; TONES], [0.0; TONES], v.first().copied().unwrap_or(0.0));
    let mut all: Vec<[f64; 2 * TONES]> = Vec::with_capacity(v.len());
    for &v in v {
        let mut now = [0.0; 2 * TONES];
        for k in 0..TONES {
            (x[k], y[k]) = (
                keep[k] * (cos[k] * x[k] - sin[k] * y[k]) + v - last,
                keep[k] * (sin[k] * x[k] + cos[k] * y[k]),
            );
            (now[k], now[TONES + k]) = (x[k], y[k]);
        }
        last = v;
        all.push(now);
    }
    let part = |k: usize| all.iter().map(|now| now[k]).collect();
    let one =
        |(k, tone): (usize, &(f64, f64))| Rung { tone: *tone, parts: [k, TONES + k].map(part) };
    tones.iter().enumerate().map(one).collect()
}

/// A sampled signal at `times` (ascending) less `lag`: straight lines between samples, held before
/// the first and after the last; NaN for none.
fn sampled(t: &[f64], v: &[f64], times: &[f64], lag: f64) -> Vec<f64> {
    Places::new(t, times, lag).of(v)
}

/// Where some times lie among those of samples: the sample before, and the share of the way to the
/// next one; no sample at all.
struct Places(Vec<Option<(usize, f64)>>);

impl Places {
    fn new(t: &[f64], times: &[f64], lag: f64) -> Places {
        let mut after = 0;
        let one = |time: &f64| {
            let time = time - lag;
            after += t[after..].iter().take_while(|t| **t <= time).count();
            let (a, b) = (t.get(after.wrapping_sub(1)), t.get(after));
            match (a, b) {
                (Some(a), Some(b)) => Some((after - 1, (time - a) / (b - a))),
                (Some(_), None) => Some((after - 1, 0.0)),
                (None, Some(_)) => Some((0, 0.0)),
                (None, None) => None,
            }
        };
        Places(times.iter().map(one).collect())
    }

    /// A signal that has so many samples.
    fn of(&self, v: &[f64]) -> Vec<f64> {
        let one = |place: &Option<(usize, f64)>| match *place {
            Some((i, share)) if share != 0.0 => v[i] + share * (v[i + 1] - v[i]),
            Some((i, _)) => v[i],
            None => f64::NAN,
        };
        self.0.iter().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_is_held_beyond_its_samples_and_straight_between_them() {
        let v = sampled(&[0.0, 1.0, 3.0], &[1.0, 2.0, 0.0], &[-1.0, 0.5, 1.0, 2.0, 9.0], 0.0);
        assert_eq!(v, [1.0, 1.5, 2.0, 1.0, 0.0]);
        assert_eq!(sampled(&[0.0, 1.0], &[1.0, 2.0], &[0.5, 1.5], 1.0), [1.0, 1.5]);
        assert!(sampled(&[], &[], &[0.0], 0.0)[0].is_nan());
    }

    #[test]
    fn a_step_rings_at_its_frequency_and_dies_out() {
        let v: Vec<f64> = (0..2000).map(|k| if k < 10 { 0.0 } else { 1.0 }).collect();
        let one = rung(&v, &[(2.0 * std::f64::consts::PI, 0.03)], 0.01);
        let [x, _] = &one[0].parts;
        // one period after the step, and half of one
        let after = |s: f64| x[10 + (s / 0.01) as usize];
        let kept = libm::exp(-0.03 * 2.0 * std::f64::consts::PI);
        assert!(
            (after(1.0) - kept).abs() < 1e-3
                && (after(0.5) + kept.sqrt()).abs() < 1e-3
                && x[9] == 0.0
        );
    }
}
