//! Measured and modelled values in; how large the gap is, and where, in units of the measured
//! noise, out.
//!
//! The noise of an output is read from the measurements alone (`signal::robust`): a ratio of 1 is a
//! model as good as the sensor. Frequency bands share the mean square by Fourier sums over the
//! maneuver's residual.

use super::looks::Looks;
use crate::dynamics::Record;
use crate::estimate::Trace;
use crate::math::fourier;
use crate::math::interpolate::{between, held};
use crate::math::quantile;
use crate::signal::robust::noise_sd;

/// The gap of one output, of some of its samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// Index of the segment; none for all together.
    pub segment: Option<usize>,
    pub output: String,
    pub unit: String,
    /// `all`, `band` (Hz), `time since input` (s), or the name of an input or output whose range is
    /// split in three.
    pub by: String,
    /// Ends of the range, in the unit of `by`; infinite where open.
    pub from: f64,
    pub to: f64,
    /// Samples; 0 for a band.
    pub n: usize,
    pub mean: f64,
    pub rms: f64,
    /// Standard deviation of the measured noise.
    pub noise: f64,
}

/// One maneuver and what was modelled of it.
pub struct Flown<'a> {
    /// Index among the segments.
    pub segment: usize,
    pub record: &'a Record,
    pub traces: Vec<Trace>,
}

/// All gaps: per segment and output; then per output, over all segments, by band, time since input
/// and regime.
pub fn gaps(flown: &[Flown], inputs: &[String], looks: &Looks) -> Vec<Gap> {
    let edges = &looks.gap_bands;
    let mut names: Vec<(String, String)> = Vec::new();
    for trace in flown.iter().flat_map(|f| &f.traces) {
        if names.iter().all(|(name, _)| *name != trace.name) {
            names.push((trace.name.clone(), trace.unit.clone()));
        }
    }
    let mut all = Vec::new();
    for (output, unit) in &names {
        let traces: Vec<(&Flown, &Trace)> = flown
            .iter()
            .flat_map(|f| f.traces.iter().filter(|t| t.name == *output).map(move |t| (f, t)))
            .collect();
        let noise = quantile(
            &traces
                .iter()
                .map(|(_, t)| noise_sd(&t.measured))
                .filter(|n| *n > 0.0)
                .collect::<Vec<_>>(),
            0.5,
        );
        let gap = |segment: Option<usize>,
                   by: &str,
                   from: f64,
                   to: f64,
                   values: &mut dyn Iterator<Item = f64>| {
            let (mut n, mut sum, mut square) = (0, 0.0, 0.0);
            for e in values.filter(|e| e.is_finite()) {
                n += 1;
                sum += e;
                square += e * e;
            }
            let (mean, rms) = (sum / n as f64, (square / n as f64).sqrt());
            Gap {
                segment,
                output: output.clone(),
                unit: unit.clone(),
                by: by.to_string(),
                from,
                to,
                n,
                mean,
                rms,
                noise,
            }
        };
        let everything = (f64::NEG_INFINITY, f64::INFINITY);
        for (f, t) in &traces {
            all.push(gap(Some(f.segment), "all", everything.0, everything.1, &mut residuals(t)));
        }
        let whole = gap(
            None,
            "all",
            everything.0,
            everything.1,
            &mut traces.iter().flat_map(|(_, t)| residuals(t)),
        );
        for (i, square) in bands(&traces.iter().map(|(_, t)| *t).collect::<Vec<_>>(), edges)
            .into_iter()
            .enumerate()
        {
            let edge =
                |i: Option<usize>, open: f64| i.and_then(|i| edges.get(i)).copied().unwrap_or(open);
            let (from, to) = (edge(i.checked_sub(1), 0.0), edge(Some(i), f64::INFINITY));
            all.push(Gap {
                by: "band".into(),
                from,
                to,
                n: 0,
                mean: f64::NAN,
                rms: square.sqrt(),
                ..whole.clone()
            });
        }
        all.push(whole);
        let since: Vec<Vec<f64>> = traces
            .iter()
            .map(|(f, t)| since_input(f.record, inputs.len(), &t.t, looks.moving))
            .collect();
        split(&mut all, &traces, &since, "time since input", &looks.gap_times, &gap);
        for (i, name) in inputs.iter().enumerate() {
            let values: Vec<Vec<f64>> =
                traces.iter().map(|(f, t)| input_at(f.record, inputs.len(), i, &t.t)).collect();
            split(&mut all, &traces, &values, name, &thirds(&values), &gap);
        }
        for (name, _) in &names {
            let values: Vec<Vec<f64>> =
                traces.iter().map(|(f, t)| modelled_at(f, name, &t.t)).collect();
            split(&mut all, &traces, &values, &format!("modelled {name}"), &thirds(&values), &gap);
        }
    }
    all.retain(|g| g.rms.is_finite());
    all
}

type Maker<'a> = dyn Fn(Option<usize>, &str, f64, f64, &mut dyn Iterator<Item = f64>) -> Gap + 'a;

/// The gap of the samples between each two edges of another quantity.
fn split(
    all: &mut Vec<Gap>,
    traces: &[(&Flown, &Trace)],
    values: &[Vec<f64>],
    by: &str,
    edges: &[f64],
    gap: &Maker,
) {
    for i in 0..=edges.len() {
        let from = i.checked_sub(1).map_or(f64::NEG_INFINITY, |i| edges[i]);
        let to = edges.get(i).copied().unwrap_or(f64::INFINITY);
        let inside = |v: &f64| *v >= from && *v < to;
        let mut these = traces.iter().zip(values).flat_map(|((_, t), values)| {
            residuals(t).zip(values).filter(|(_, v)| inside(v)).map(|(e, _)| e).collect::<Vec<_>>()
        });
        all.push(gap(None, by, from, to, &mut these));
    }
}

fn residuals(t: &Trace) -> impl Iterator<Item = f64> {
    t.measured.iter().zip(&t.modelled).map(|(z, y)| z - y)
}

/// Edges of three equal shares of the samples; none where a quantity hardly takes more than one
/// value.
fn thirds(values: &[Vec<f64>]) -> Vec<f64> {
    let all: Vec<f64> = values.iter().flatten().copied().filter(|v| v.is_finite()).collect();
    let (low, high) = (quantile(&all, 1.0 / 3.0), quantile(&all, 2.0 / 3.0));
    if high > low { vec![low, high] } else { Vec::new() }
}

fn input_at(record: &Record, nu: usize, i: usize, t: &[f64]) -> Vec<f64> {
    let at = |t: &f64| {
        let place = ((t - record.t0) / record.dt).clamp(0.0, record.n.saturating_sub(1) as f64);
        let u = |k: usize| record.inputs.get(k * nu + i).copied();
        let (k, share) = (place as usize, place.fract());
        u(k).map_or(f64::NAN, |left| between(left, u(k + 1).unwrap_or(left), share))
    };
    t.iter().map(at).collect()
}

fn modelled_at(flown: &Flown, name: &str, t: &[f64]) -> Vec<f64> {
    let Some(trace) = flown.traces.iter().find(|t| t.name == *name) else {
        return vec![f64::NAN; t.len()];
    };
    t.iter().map(|t| held(&trace.t, &trace.modelled, *t)).collect()
}

/// Time since any input last moved by more than a share of its fastest move in the maneuver.
fn since_input(record: &Record, nu: usize, t: &[f64], share: f64) -> Vec<f64> {
    let u = |k: usize, i: usize| record.inputs[k * nu + i];
    let steps: Vec<f64> = (0..nu)
        .map(|i| (1..record.n).map(|k| (u(k, i) - u(k - 1, i)).abs()).fold(0.0, f64::max))
        .collect();
    let moved: Vec<f64> = (1..record.n)
        .filter(|&k| {
            (0..nu).any(|i| steps[i] > 0.0 && (u(k, i) - u(k - 1, i)).abs() > share * steps[i])
        })
        .map(|k| record.t0 + k as f64 * record.dt)
        .collect();
    let since = |t: &f64| {
        moved.partition_point(|m| m <= t).checked_sub(1).map_or(f64::NAN, |k| t - moved[k])
    };
    t.iter().map(since).collect()
}

/// Mean squares of the residuals by band, over all traces.
fn bands(traces: &[&Trace], edges: &[f64]) -> Vec<f64> {
    let mut squares = vec![0.0; edges.len() + 1];
    let mut samples = 0.0;
    for trace in traces {
        let r: Vec<f64> = residuals(trace).map(|e| if e.is_finite() { e } else { 0.0 }).collect();
        let n = r.len();
        let (Some(first), Some(last)) = (trace.t.first(), trace.t.last()) else { continue };
        let dt = (last - first) / (n.max(2) - 1) as f64;
        if !(dt > 0.0) {
            continue;
        }
        samples += n as f64;
        for k in 0..=n / 2 {
            let frequency = k as f64 / (n as f64 * dt);
            let band = edges.iter().position(|edge| frequency < *edge).unwrap_or(edges.len());
            let (a, b) = fourier::sum(&r, k);
            // Parseval: every frequency but zero and half the sampling rate stands for two.
            let twice = if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
            squares[band] += twice * (a * a + b * b) / n as f64;
        }
    }
    squares.iter().map(|s| s / samples).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::Thresholds;

    fn trace(values: Vec<f64>) -> Trace {
        let t = (0..values.len()).map(|k| 0.02 * k as f64).collect();
        let modelled = vec![0.0; values.len()];
        Trace {
            noise: None,
            output: 0,
            name: "q".into(),
            unit: "rad/s".into(),
            t,
            measured: values.into(),
            modelled,
            filtered: None,
        }
    }

    #[test]
    fn bands_share_the_mean_square_and_a_tone_falls_into_its_own() {
        let tone = |f: f64| {
            (0..500)
                .map(|k| libm::sin(2.0 * std::f64::consts::PI * f * 0.02 * f64::from(k)))
                .collect::<Vec<f64>>()
        };
        let squares = bands(&[&trace(tone(2.0)), &trace(tone(2.0))], &[0.3, 1.0, 3.0, 8.0]);
        assert!(
            (squares[2] - 0.5).abs() < 1e-6 && squares.iter().sum::<f64>() - squares[2] < 1e-6,
            "{squares:?}"
        );
    }

    #[test]
    fn a_gap_that_follows_an_input_is_seen_there() {
        let n = 400;
        let inputs: Vec<f64> =
            (0..n).map(|k| if (100..200).contains(&k) { 1.0 } else { 0.0 }).collect();
        let record = Record { dt: 0.02, n, inputs: inputs.clone().into(), ..Record::default() };
        let traces = vec![trace(inputs.iter().map(|u| 0.3 * u).collect())];
        let all = gaps(
            &[Flown { segment: 0, record: &record, traces }],
            &["u".into()],
            &Looks::of(&Thresholds::default(), 0.6),
        );
        let soon: Vec<&Gap> =
            all.iter().filter(|g| g.by == "time since input" && g.rms > 0.0).collect();
        assert!(soon.iter().all(|g| g.to <= 2.0 || g.from >= 1.0) && !soon.is_empty(), "{soon:?}");
        let whole = all.iter().find(|g| g.by == "all" && g.segment.is_none()).expect("all");
        assert!((whole.rms - 0.15).abs() < 1e-12 && whole.n == 400);
    }
}
