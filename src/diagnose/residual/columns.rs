//! Signals of a segment in; what sources do at given instants, source by source, out.

use super::sources::{Kind, LAGS, Source};
use crate::dynamics::{Numbers, Record};

/// Inputs, then modelled outputs of a segment: times and values.
pub type Signals = Vec<(Numbers, Vec<f64>)>;

/// What sources do at some instants of a segment. What several of them have in common is made once.
pub struct Columns<'a> {
    sources: &'a [Source],
    signals: &'a Signals,
    /// Ascending.
    times: &'a [f64],
    /// The record's grid, its step, and the start of the maneuver.
    grid: Numbers,
    dt: f64,
    begin: f64,
    /// The first signal that is sampled at the instants of each.
    like: Vec<usize>,
    /// By such a signal and the lag.
    places: Known<(usize, f64), Places>,
    /// Cosine and sine, by frequency.
    waves: Known<f64, [Vec<f64>; 2]>,
    from_grid: Option<Places>,
    /// The signal that rang last.
    ringing: Option<(usize, Vec<Rung>)>,
}

impl<'a> Columns<'a> {
    pub fn new(
        sources: &'a [Source],
        record: &Record,
        signals: &'a Signals,
        times: &'a [f64],
    ) -> Columns<'a> {
        let first = |i: usize| (0..i).find(|&k| signals[k].0 == signals[i].0).unwrap_or(i);
        Columns {
            sources,
            signals,
            times,
            grid: Numbers::from(grid(record)),
            dt: record.dt,
            begin: record.t0 + record.start as f64 * record.dt,
            like: (0..signals.len()).map(first).collect(),
            places: Vec::new(),
            waves: Vec::new(),
            from_grid: None,
            ringing: None,
        }
    }

    /// What one of them does, `[coefficient][instant]`, in place of what stands there.
    pub fn of(&mut self, source: &Source, to: &mut Vec<Vec<f64>>) {
        to.resize_with(source.kind.columns(), Vec::new);
        to.iter_mut().for_each(Vec::clear);
        match source.kind {
            Kind::Lagged { signal, squared, lags } => self.lagged(signal, squared, &lags, to),
            Kind::Wave { frequency } => {
                to.iter_mut().zip(self.waves(frequency)).for_each(|(to, x)| to.extend_from_slice(x))
            }
            Kind::Coming { signal, frequency } => {
                let mut now = Vec::new();
                self.at(signal, 0.0, &mut now);
                for (to, wave) in to.iter_mut().zip(self.waves(frequency)) {
                    to.extend(wave.iter().zip(&now).map(|(wave, v)| wave * v));
                }
            }
            Kind::Ringing { signal, frequency, damping } => {
                self.ring(signal);
                let tone = (frequency, damping);
                let (from_grid, all) = (self.from_grid.as_ref(), self.ringing.as_ref());
                let one = all.and_then(|(_, all)| all.iter().find(|one| one.tone == tone));
                for (one, from_grid) in one.iter().zip(from_grid) {
                    to.iter_mut().zip(&one.parts).for_each(|(to, v)| from_grid.read(v, to));
                }
            }
        }
    }

    fn lagged(&mut self, signal: usize, squared: bool, lags: &[f64; LAGS], to: &mut [Vec<f64>]) {
        for (to, lag) in to.iter_mut().zip(lags) {
            self.at(signal, *lag, to);
            if squared {
                to.iter_mut().for_each(|v| *v *= *v);
            }
        }
    }

    /// Appends a signal so much later.
    fn at(&mut self, signal: usize, lag: f64, to: &mut Vec<f64>) {
        let (like, times) = (self.like[signal], self.times);
        let (t, v) = &self.signals[signal];
        once(&mut self.places, (like, lag), || Places::new(t, times, lag)).read(v, to);
    }

    fn waves(&mut self, frequency: f64) -> &[Vec<f64>; 2] {
        let (times, begin) = (self.times, self.begin);
        once(&mut self.waves, frequency, || waves(times, begin, frequency))
    }

    /// Has a signal ring at all its tones.
    fn ring(&mut self, signal: usize) {
        if self.ringing.as_ref().is_some_and(|(of, _)| *of == signal) {
            return;
        }
        let (t, v) = &self.signals[signal];
        let tones = tones(self.sources, signal);
        self.ringing = Some((signal, rung(&sampled(t, v, &self.grid, 0.0), &tones, self.dt)));
        let (grid, times) = (&self.grid, self.times);
        self.from_grid.get_or_insert_with(|| Places::new(grid, times, 0.0));
    }
}

/// Instants of a record.
pub fn grid(record: &Record) -> Vec<f64> {
    (0..record.n).map(|k| record.t0 + k as f64 * record.dt).collect()
}

/// What was made for each key.
type Known<K, T> = Vec<(K, T)>;

/// What belongs to a key: looked up, or made and kept.
fn once<K: PartialEq, T>(known: &mut Known<K, T>, key: K, make: impl FnOnce() -> T) -> &T {
    let at = known.iter().position(|(of, _)| *of == key).unwrap_or_else(|| {
        known.push((key, make()));
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
fn waves(times: &[f64], begin: f64, frequency: f64) -> [Vec<f64>; 2] {
    let phase = |time: &f64| libm::sincos(frequency * (time - begin));
    let (sin, cos) = times.iter().map(phase).unzip();
    [cos, sin]
}

/// Both parts of a lightly damped oscillation that the changes of a signal start.
struct Rung {
    /// Frequency and damping.
    tone: (f64, f64),
    parts: [Vec<f64>; 2],
}

/// Oscillations that go side by side: a step of one does not wait for that of another.
const TONES: usize = 8;
/// Samples after which each of them takes its own: they stay in the nearest cache.
const PIECE: usize = 64;

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
    let part = || Vec::with_capacity(v.len());
    let mut all: Vec<Rung> =
        tones.iter().map(|tone| Rung { tone: *tone, parts: [part(), part()] }).collect();
    let mut made: Vec<[[f64; TONES]; 2]> = Vec::with_capacity(PIECE);
    for piece in v.chunks(PIECE) {
        made.clear();
        for &v in piece {
            for k in 0..TONES {
                (x[k], y[k]) = (
                    keep[k] * (cos[k] * x[k] - sin[k] * y[k]) + v - last,
                    keep[k] * (sin[k] * x[k] + cos[k] * y[k]),
                );
            }
            last = v;
            made.push([x, y]);
        }
        for (k, rung) in all.iter_mut().enumerate() {
            for (part, at) in rung.parts.iter_mut().zip(0..) {
                part.extend(made.iter().map(|now: &[[f64; TONES]; 2]| now[at][k]));
            }
        }
    }
    all
}

/// A sampled signal at `times` (ascending) less `lag`: straight lines between samples, held before
/// the first and after the last; NaN for none.
pub fn sampled(t: &[f64], v: &[f64], times: &[f64], lag: f64) -> Vec<f64> {
    let mut all = Vec::with_capacity(times.len());
    Places::new(t, times, lag).read(v, &mut all);
    all
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

    /// Appends what a signal that has so many samples is there.
    fn read(&self, v: &[f64], to: &mut Vec<f64>) {
        let one = |place: &Option<(usize, f64)>| match *place {
            Some((i, share)) if share != 0.0 => v[i] + share * (v[i + 1] - v[i]),
            Some((i, _)) => v[i],
            None => f64::NAN,
        };
        to.extend(self.0.iter().map(one));
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
    fn what_sources_have_in_common_is_that_of_each() {
        let signal = |dt: f64, n: usize, by: f64| {
            let t: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
            let v = t.iter().map(|t| libm::sin(by * t)).collect();
            (Numbers::from(t), v)
        };
        let signals = vec![signal(0.1, 40, 3.0), signal(0.1, 40, 5.0), signal(0.25, 16, 2.0)];
        let mut kinds = vec![Kind::Wave { frequency: 2.0 }];
        for frequency in [2.0, 4.0] {
            for (signal, squared) in [(0, false), (1, false), (2, true), (0, true)] {
                let lags = std::array::from_fn(|k| 0.03 * frequency * k as f64);
                kinds.push(Kind::Lagged { signal, squared, lags });
                kinds.push(Kind::Ringing { signal, frequency, damping: 0.03 });
                kinds.push(Kind::Coming { signal, frequency });
            }
        }
        let source = |kind| Source { name: String::new(), group: 0, kind, limit: 0.0 };
        let all: Vec<Source> = kinds.into_iter().map(source).collect();
        let record = Record { dt: 0.1, n: 40, ..Record::default() };
        let times: Vec<f64> = (0..25).map(|k| 0.17 * f64::from(k)).collect();
        let mut together = Columns::new(&all, &record, &signals, &times);
        let (mut shared, mut alone) = (vec![vec![7.0; 3]; 9], Vec::new());
        for one in &all {
            together.of(one, &mut shared);
            let only = std::slice::from_ref(one);
            Columns::new(only, &record, &signals, &times).of(one, &mut alone);
            assert_eq!((shared.len(), shared[0].len()), (one.kind.columns(), times.len()));
            assert_eq!(shared, alone, "{:?}", one.kind);
        }
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
