//! What a filter leaves new of each output in; the output and input that go together more than chance lets
//! them, out.

use crate::diagnose::residual::timescale::characteristic_time;
use crate::diagnose::thresholds::Thresholds;
use crate::dynamics::Record;
use crate::estimate::{Estimation, Segment, Trace};
use crate::math::distribution::normal_quantile;
use crate::model::Model;

/// Lags of an autocorrelation at most, samples.
const LONGEST: usize = 500;
/// Shapes of an input.
const SHAPES: usize = 3;
/// Samples of a record from one whose noise is not its own: the curve between two samples is made of four.
const BESIDE: f64 = 2.0;

/// The output and input whose correlation is furthest above chance, where it is above what counts.
pub(super) fn with_inputs(
    model: &Model,
    (segments, noisy): (&[Segment], &[String]),
    estimation: &Estimation,
    thresholds: &Thresholds,
) -> Option<String> {
    let mut names: Vec<&str> = Vec::new();
    for trace in estimation.responses.iter().flatten() {
        if !names.contains(&trace.name.as_str()) {
            names.push(&trace.name);
        }
    }
    let flown: Vec<Flown> = segments.iter().zip(&estimation.responses).collect();
    let time = characteristic_time(segments.iter().map(|s| &s.record), thresholds);
    let nu = model.inputs.len();
    let looked = (nu * names.len() * thresholds.lags.len() * SHAPES) as f64;
    let quantile = normal_quantile(1.0 - 0.5 * thresholds.relation_p / looked.max(1.0));
    let mut most: Option<(f64, f64, &str, &str)> = None;
    for (i, input) in model.inputs.iter().enumerate() {
        let shapes = shapes(segments, i, nu);
        for (name, lag) in
            names.iter().flat_map(|name| thresholds.lags.iter().map(move |l| (name, l)))
        {
            for shape in &shapes {
                let beside = noisy.contains(&input.name);
                let pairs = pairs(&flown, name, (i, nu, lag * time), (shape, beside));
                let Some((r, n)) = correlation(&pairs) else { continue };
                // A series that is not random, and white noise: the variance of their correlation is 1/n.
                let white = quantile / n.sqrt();
                if r * r <= thresholds.innovation_input || r.abs() <= white {
                    continue;
                }
                let chance = white * inflation(&pairs).sqrt();
                if r.abs() > chance && most.is_none_or(|m| r.abs() / chance > m.0.abs() / m.1) {
                    most = Some((r, chance, name, &input.name));
                }
            }
        }
    }
    let (r, chance, output, input) = most?;
    Some(format!(
        "what is new in {output} goes with {input} (correlation {r:.2}, by chance {chance:.2} at most)"
    ))
}

/// A maneuver and what was modelled of it.
type Flown<'a> = (&'a Segment, &'a Vec<Trace>);

/// An input about its mean, its square about its mean, and its cube without what goes with the input.
fn shapes(segments: &[Segment], i: usize, nu: usize) -> [Box<dyn Fn(f64) -> f64>; SHAPES] {
    let (mut n, mut squares, mut fourth) = (0.0, 0.0, 0.0);
    for segment in segments {
        let (all, mean) = about_mean(&segment.record, i, nu);
        for x in all.iter().map(|x| x - mean).filter(|x| x.is_finite()) {
            (n, squares, fourth) = (n + 1.0, squares + x * x, fourth + x * x * x * x);
        }
    }
    let (mean, slope) =
        (squares / f64::max(n, 1.0), if squares > 0.0 { fourth / squares } else { 0.0 });
    [Box::new(|x| x), Box::new(move |x| x * x - mean), Box::new(move |x| x * x * x - slope * x)]
}

/// The values of an input, and their mean.
fn about_mean(record: &Record, i: usize, nu: usize) -> (Vec<f64>, f64) {
    let all: Vec<f64> = record.inputs.chunks_exact(nu).map(|row| row[i]).collect();
    let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
    (all, mean)
}

/// In each maneuver, a shape of input `i` of `nu`, so many seconds before, about the input's mean, and an
/// output's innovation; of the mean of both neighbours where the input's own noise is to be `beside`.
type Pairs = Vec<Vec<[f64; 2]>>;

fn pairs(
    flown: &[Flown],
    name: &str,
    (i, nu, lag): (usize, usize, f64),
    (shape, beside): (&dyn Fn(f64) -> f64, bool),
) -> Pairs {
    let of = |(segment, traces): &Flown| {
        let record = &segment.record;
        let (all, mean) = about_mean(record, i, nu);
        let spacing = record.spacings.get(i).filter(|s| s.is_finite()).map_or(record.dt, |s| *s);
        let far = if beside { (BESIDE * spacing / record.dt).ceil() as usize } else { 0 };
        let at = |k: usize| Some(0.5 * (all.get(k.checked_sub(far)?)? + all.get(k + far)?));
        let mut pairs = Vec::new();
        for trace in traces.iter().filter(|t| t.name == name) {
            for ((t, z), y) in trace.t.iter().zip(&trace.measured).zip(&trace.modelled) {
                let (k, e) = (((t - lag - record.t0) / record.dt).round(), z - y);
                let x = if k >= 0.0 { at(k as usize) } else { None };
                let x = x.map(|x| shape(x - mean)).filter(|x| x.is_finite() && e.is_finite());
                pairs.extend(x.map(|x| [x, e]));
            }
        }
        pairs
    };
    flown.iter().map(of).collect()
}

/// Correlation of both, and of how many samples. None where one of them is nothing.
fn correlation(pairs: &Pairs) -> Option<(f64, f64)> {
    let sum = |a: usize, b: usize| pairs.iter().flatten().map(|p| p[a] * p[b]).sum::<f64>();
    let (xx, ee, xe) = (sum(0, 0), sum(1, 1), sum(0, 1));
    let n = pairs.iter().map(Vec::len).sum::<usize>() as f64;
    (xx > 0.0 && ee > 0.0).then(|| (xe / (xx * ee).sqrt(), n))
}

/// How many times `1/n` the variance of the correlation of two independent series is:
/// `sum_k rho_x(k) rho_e(k)` (Bartlett 1946), at least 1. Innovations of gusts that last are not
/// white.
fn inflation(pairs: &Pairs) -> f64 {
    let at = |lag: usize, of: usize| {
        let one = |p: &Vec<[f64; 2]>| -> f64 {
            p.iter().zip(p.iter().skip(lag)).map(|(a, b)| a[of] * b[of]).sum()
        };
        pairs.iter().map(one).sum::<f64>()
    };
    let (xx, ee) = (at(0, 0), at(0, 1));
    let longest = pairs.iter().map(Vec::len).max().unwrap_or(0) / 4;
    let sum: f64 = (1..=longest.min(LONGEST)).map(|k| at(k, 0) * at(k, 1)).sum();
    (1.0 + 2.0 * sum / (xx * ee)).max(1.0)
}
