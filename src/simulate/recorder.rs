//! The true signals of a flight and the recorder's settings in, the topics of a log out: sampled,
//! disturbed, stamped.

use super::random::Stream;
use super::settings::{Sensor, Settings, Topic};
use super::truth::Truth;
use crate::units::Unit;
use serde::Serialize;

/// What one flight's recorder has written, in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    pub flight: String,
    /// In the order of the settings.
    pub topics: Vec<TopicLog>,
    /// The errors drawn for this flight; for tests.
    pub errors: Vec<SensorError>,
}

/// The messages of one topic in the order of their log times.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicLog {
    pub topic: String,
    pub fields: Vec<FieldLog>,
    /// When each message was sampled and sent, ns since 1970.
    pub publish_ns: Vec<u64>,
    /// When the recorder logged it, ns since 1970, ascending.
    pub log_ns: Vec<u64>,
    /// `[messages][fields]`, row by row, in the fields' units.
    pub rows: Vec<f64>,
}

/// Name, unit and meaning of a field.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldLog {
    pub name: String,
    pub unit: String,
    pub doc: String,
}

/// The constant errors of one sensor in one flight; `bias` in the log's unit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SensorError {
    pub topic: String,
    pub field: String,
    pub unit: String,
    pub bias: f64,
    pub scale: f64,
    pub noise: f64,
    pub lag_s: f64,
    pub delay_s: f64,
}

/// Records a flight: every topic with the sensors of `settings`, random numbers from `seed`.
/// `start_ns` is the time of the flight's start.
///
/// Signals that the truth does not have, and units that cannot be read, are passed over: the check
/// of the campaign file reports them.
pub fn record(settings: &Settings, truth: &Truth, seed: u64, start_ns: u64) -> Recording {
    let mut errors = Vec::new();
    let topics = settings
        .topics
        .iter()
        .map(|(name, topic)| record_topic(name, topic, truth, seed, start_ns, &mut errors))
        .collect();
    Recording { flight: truth.flight.clone(), topics, errors }
}

fn record_topic(
    name: &str,
    topic: &Topic,
    truth: &Truth,
    seed: u64,
    start_ns: u64,
    errors: &mut Vec<SensorError>,
) -> TopicLog {
    let mut times = sample_times(name, topic, truth, seed);
    if topic.on_change {
        times = with_changes(times, topic, truth);
    }
    let mut fields = Vec::new();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    if let Some(field) = &topic.time_field {
        fields.push(FieldLog {
            name: field.clone(),
            unit: "s".into(),
            doc: "time of the sample, seconds since 1970-01-01 UTC".into(),
        });
        columns.push(times.iter().map(|t| start_ns as f64 * 1e-9 + t).collect());
    }
    for (field, sensor) in &topic.fields {
        let (Some(signal), Ok(unit)) =
            (truth.signals.get(&sensor.truth), Unit::parse(&sensor.unit))
        else {
            continue;
        };
        let streams = |purpose: &str| Stream::new(seed, &[&truth.flight, name, field, purpose]);
        let error = SensorError {
            topic: name.to_string(),
            field: field.clone(),
            unit: sensor.unit.clone(),
            bias: sensor.bias + sensor.bias_sd * streams("bias").normal(),
            scale: sensor.scale + sensor.scale_sd * streams("scale").normal(),
            noise: sensor.noise,
            lag_s: sensor.lag_s,
            delay_s: sensor.delay_s,
        };
        columns.push(measure(
            sensor,
            &error,
            &unit,
            &signal.values,
            truth.dt,
            &times,
            &mut streams("noise"),
        ));
        fields.push(FieldLog {
            name: field.clone(),
            unit: sensor.unit.clone(),
            doc: signal.doc.clone(),
        });
        errors.push(error);
    }
    let (order, publish_ns, log_ns) = arrivals(name, topic, truth, seed, start_ns, &times);
    let rows = order.iter().flat_map(|k| columns.iter().map(|c| c[*k])).collect();
    TopicLog { topic: name.to_string(), fields, publish_ns, log_ns, rows }
}

/// Sampling times of a topic, s since the start of the flight, ascending: a random phase, then the
/// period with jitter.
fn sample_times(name: &str, topic: &Topic, truth: &Truth, seed: u64) -> Vec<f64> {
    let period = 1.0 / topic.rate_hz;
    let phase = Stream::new(seed, &[&truth.flight, name, "phase"]).uniform() * period;
    let mut jitter = Stream::new(seed, &[&truth.flight, name, "jitter"]);
    let end = truth.duration();
    let count = ((end - phase) / period).floor().max(-1.0) as i64 + 1;
    let time = |k: i64| {
        let shift = if topic.jitter_s > 0.0 {
            (topic.jitter_s * jitter.normal()).clamp(-0.4 * period, 0.4 * period)
        } else {
            0.0
        };
        nanosecond((phase + k as f64 * period + shift).clamp(0.0, end))
    };
    (0..count).map(time).collect()
}

/// Sampling times with those added at which the truth of a field begins or ends a change.
fn with_changes(mut times: Vec<f64>, topic: &Topic, truth: &Truth) -> Vec<f64> {
    for sensor in topic.fields.values() {
        let Some(signal) = truth.signals.get(&sensor.truth) else { continue };
        let moves = |k: usize| {
            signal.values.get(k).zip(signal.values.get(k + 1)).is_some_and(|(a, b)| a != b)
        };
        let changes = (0..truth.n).filter(|&k| moves(k) || k.checked_sub(1).is_some_and(moves));
        let time = |k: usize| k as f64 * truth.dt + sensor.delay_s;
        times.extend(changes.map(time).filter(|t| *t <= truth.duration()).map(nanosecond));
    }
    times.sort_by(f64::total_cmp);
    times.dedup();
    times
}

/// Whole nanoseconds: the value is then the one at the stamp.
fn nanosecond(t: f64) -> f64 {
    (t * 1e9).round() * 1e-9
}

/// The messages that reach the log, by log time: index of the sample, publish time, log time.
fn arrivals(
    name: &str,
    topic: &Topic,
    truth: &Truth,
    seed: u64,
    start_ns: u64,
    times: &[f64],
) -> (Vec<usize>, Vec<u64>, Vec<u64>) {
    let stream = |purpose: &str| Stream::new(seed, &[&truth.flight, name, purpose]);
    let (mut latency, mut lost, mut repeated) =
        (stream("latency"), stream("lost"), stream("repeated"));
    let in_gap = |t: f64| {
        topic.gaps.iter().any(|g| g.flight == truth.flight && (g.from_s..g.to_s).contains(&t))
    };
    let nanoseconds = |t: f64| (t * 1e9).round() as u64;
    let mut messages = Vec::with_capacity(times.len());
    for (k, t) in times.iter().enumerate() {
        // Every message takes its numbers, lost or not: a gap then changes nothing behind it.
        let late = topic.latency_s + topic.latency_jitter_s * latency.exponential();
        let (is_lost, is_repeated) =
            (lost.uniform() < topic.lost, repeated.uniform() < topic.repeated);
        if is_lost || in_gap(*t) {
            continue;
        }
        let publish = start_ns + nanoseconds(*t);
        let logged = publish + nanoseconds(late);
        messages.push((logged, publish, k));
        if is_repeated {
            messages.push((logged + nanoseconds(0.1 / topic.rate_hz), publish, k));
        }
    }
    // Stable: at equal log times the earlier sample comes first.
    messages.sort_by_key(|m| m.0);
    (
        messages.iter().map(|m| m.2).collect(),
        messages.iter().map(|m| m.1).collect(),
        messages.iter().map(|m| m.0).collect(),
    )
}

/// A sensor's values at `times`, in the log's unit, from the true signal (SI, on a grid from 0 with
/// spacing `dt`).
fn measure(
    sensor: &Sensor,
    error: &SensorError,
    unit: &Unit,
    signal: &[f64],
    dt: f64,
    times: &[f64],
    noise: &mut Stream,
) -> Vec<f64> {
    let lagged = if sensor.lag_s > 0.0 { Some(lag(signal, dt, sensor.lag_s)) } else { None };
    let signal = lagged.as_deref().unwrap_or(signal);
    let value = |t: &f64| {
        let exact = unit.from_si(sensor.sign * sample(signal, dt, t - sensor.delay_s));
        let noisy = error.scale * exact
            + error.bias
            + if sensor.noise > 0.0 { sensor.noise * noise.normal() } else { 0.0 };
        rounded(noisy, sensor.resolution)
    };
    times.iter().map(value).collect()
}

/// The nearest multiple of `resolution`; multiples of 1/integer are formed by division, which gives
/// the short decimal number.
fn rounded(value: f64, resolution: f64) -> f64 {
    if resolution <= 0.0 {
        return value;
    }
    let inverse = (1.0 / resolution).round();
    let count = (value / resolution).round();
    let decimal = inverse >= 1.0 && (inverse * resolution - 1.0).abs() < 1e-12;
    // -0.0 would be written as such.
    (if decimal { count / inverse } else { count * resolution }) + 0.0
}

/// The signal behind a first-order lag with time constant `tau`, exact for a signal that is linear
/// between grid points; steady at the start.
fn lag(signal: &[f64], dt: f64, tau: f64) -> Vec<f64> {
    let decay = libm::exp(-dt / tau);
    // x' = (u - x)/tau with u = u0 + (u1 - u0) t/dt: x1 = x0 e + (1 - e) u0 + (1 - (1 - e) tau/dt)
    // (u1 - u0).
    let ramp = 1.0 - (1.0 - decay) * tau / dt;
    let mut x = signal.first().copied().unwrap_or(0.0);
    let mut out = Vec::with_capacity(signal.len());
    out.extend(signal.first());
    for u in signal.windows(2) {
        x = x * decay + (1.0 - decay) * u[0] + ramp * (u[1] - u[0]);
        out.push(x);
    }
    out
}

/// The signal at time `t` (held outside the grid): cubic Hermite with slopes limited so that
/// nothing overshoots at a step (Fritsch and Carlson, SIAM J. Numer. Anal. 17, 1980).
fn sample(signal: &[f64], dt: f64, t: f64) -> f64 {
    let Some(last) = signal.len().checked_sub(1) else { return f64::NAN };
    let x = (t / dt).clamp(0.0, last as f64);
    let k = (x as usize).min(last.saturating_sub(1));
    let s = x - k as f64;
    if s == 0.0 || last == 0 {
        return signal[k];
    }
    let difference = |i: usize| signal[(i + 1).min(last)] - signal[i];
    let here = difference(k);
    let before = if k == 0 { here } else { difference(k - 1) };
    let after = if k + 1 < last { difference(k + 1) } else { here };
    let (m0, m1) = (slope(before, here), slope(here, after));
    let (s2, s3) = (s * s, s * s * s);
    signal[k] + m0 * (s3 - 2.0 * s2 + s) + here * (3.0 * s2 - 2.0 * s3) + m1 * (s3 - s2)
}

/// Slope at a grid point between two differences: their mean, limited to three times the smaller, 0
/// at an extremum.
fn slope(before: f64, after: f64) -> f64 {
    if before * after <= 0.0 {
        return 0.0;
    }
    let mean = 0.5 * (before + after);
    let limit = 3.0 * before.abs().min(after.abs());
    mean.clamp(-limit, limit)
}

#[cfg(test)]
#[path = "recorder_tests.rs"]
mod tests;
