//! Residuals and what moves them in; correlation with its lag, and coherence by frequency, out.
//!
//! Correlation is pooled over maneuvers; its limit allows for the autocorrelation of both series:
//! the variance of a correlation of independent series is `sum_k rho_x(k) rho_y(k) / N` (Bartlett
//! 1935), and the limit is that of the largest of all lags looked at. Coherence is that of spectra
//! averaged over maneuvers (Welch) and over the frequencies of a band; `m` averages of independent
//! series stay below `1 - 0.01^(1/(m-1))` in 99 of 100 cases.

use super::coefficient::Lack;
use super::gaps::Flown;
use super::looks::Looks;
use crate::math::distribution::normal_quantile;
use crate::math::fourier;

/// How one output's residual goes with one source.
#[derive(Debug, Clone, PartialEq)]
pub struct Relation {
    /// An output, or a coefficient that lacks something.
    pub output: String,
    pub source: String,
    /// The largest correlation over lags, the lag (positive: the residual follows the source), s,
    /// and what noise stays below.
    pub correlation: f64,
    pub lag: f64,
    pub limit: f64,
    /// The largest coherence over bands, its band's frequencies, Hz, and what noise stays below.
    pub coherence: f64,
    pub from: f64,
    pub to: f64,
    pub coherence_limit: f64,
}

/// What is looked at.
#[derive(Debug, Clone, Copy)]
struct Look<'a> {
    /// Longest lag, s.
    longest: f64,
    /// Edges of bands, Hz.
    bands: &'a [f64],
    /// Probability that noise exceeds a limit.
    p: f64,
}

/// One series per maneuver on one grid, with what every pair asks of it.
struct Series {
    dt: f64,
    values: Vec<Vec<f64>>,
    /// Autocorrelation at the lags looked at, from the shortest.
    auto: Vec<f64>,
    /// Fourier sums per maneuver, from frequency 0 on.
    spectra: Vec<Vec<(f64, f64)>>,
}

impl Series {
    fn new(look: Look, dt: f64, values: Vec<Vec<f64>>) -> Series {
        let highest = look.bands.last().copied().unwrap_or_default();
        let spectrum = |x: &Vec<f64>| {
            let last = (highest * x.len() as f64 * dt).ceil() as usize;
            let windowed = fourier::hann(x);
            (0..last.min(x.len() / 2)).map(|k| fourier::sum(&windowed, k)).collect()
        };
        let spectra = values.iter().map(spectrum).collect();
        let mut series = Series { dt, values, auto: Vec::new(), spectra };
        let (last, step) = lags(look, dt);
        let whole = products(&series, &series, 0);
        series.auto = (0..=last)
            .step_by(step)
            .map(|k| products(&series, &series, k as isize) / whole)
            .collect();
        series
    }
}

/// The longest lag in samples, and every how many-th is looked at: correlation changes little from
/// one to the next.
fn lags(look: Look, dt: f64) -> (usize, usize) {
    let last = (look.longest / dt).round() as usize;
    (last, (last / 50).max(1))
}

/// Every scored output, and what each coefficient lacks, with every input and every modelled
/// output.
pub fn relations(
    flown: &[Flown],
    inputs: &[String],
    lacking: &[Lack],
    looks: &Looks,
) -> Vec<Relation> {
    let look =
        Look { longest: looks.longest_lag, bands: &looks.coherence_bands, p: looks.relation_p };
    let mut outputs: Vec<String> = Vec::new();
    for trace in flown.iter().flat_map(|f| &f.traces) {
        if !outputs.contains(&trace.name) {
            outputs.push(trace.name.clone());
        }
    }
    let nu = inputs.len();
    let mut sources: Vec<(String, Series)> = inputs
        .iter()
        .enumerate()
        .map(|(i, name)| (name.clone(), input(look, flown, nu, i)))
        .collect();
    sources.extend(
        outputs.iter().map(|name| (format!("modelled {name}"), trace(look, flown, name, |_, y| y))),
    );
    let dt = flown.first().map_or(1.0, |f| f.record.dt);
    let residuals = outputs.iter().map(|output| (output, trace(look, flown, output, |z, y| z - y)));
    let lacks = lacking
        .iter()
        .map(|l| (&l.name, Series::new(look, dt, l.values.iter().cloned().map(centred).collect())));
    let of = |(name, residual): (&String, Series)| -> Vec<Relation> {
        sources
            .iter()
            .filter_map(|(source, series)| relation(look, (name, source), &residual, series))
            .collect()
    };
    residuals.chain(lacks).flat_map(of).collect()
}

/// An input on the grids, about its mean in each maneuver.
fn input(look: Look, flown: &[Flown], nu: usize, i: usize) -> Series {
    let one = |f: &Flown| {
        centred((f.record.start..f.record.n).map(|k| f.record.inputs[k * nu + i]).collect())
    };
    Series::new(look, flown.first().map_or(1.0, |f| f.record.dt), flown.iter().map(one).collect())
}

/// An output's residual, or its modelled values, at the points of the grid, about the mean in each
/// maneuver; gaps are zero.
fn trace(look: Look, flown: &[Flown], output: &str, of: fn(f64, f64) -> f64) -> Series {
    let one = |f: &Flown| {
        let n = f.record.n.saturating_sub(f.record.start);
        let mut values = vec![f64::NAN; n];
        for t in f.traces.iter().filter(|t| t.name == output) {
            for ((time, z), y) in t.t.iter().zip(&t.measured).zip(&t.modelled) {
                let k = ((time - f.record.t0) / f.record.dt).round() - f.record.start as f64;
                if k >= 0.0 && (k as usize) < n {
                    values[k as usize] = of(*z, *y);
                }
            }
        }
        centred(values)
    };
    Series::new(look, flown.first().map_or(1.0, |f| f.record.dt), flown.iter().map(one).collect())
}

fn centred(mut values: Vec<f64>) -> Vec<f64> {
    let finite = values.iter().filter(|v| v.is_finite());
    let mean = finite.clone().sum::<f64>() / finite.count().max(1) as f64;
    values.iter_mut().for_each(|v| *v = if v.is_finite() { *v - mean } else { 0.0 });
    values
}

/// Sum of products of `x` at `k` and `y` at `k + lag`, over all maneuvers.
fn products(x: &Series, y: &Series, lag: isize) -> f64 {
    let one = |(x, y): (&Vec<f64>, &Vec<f64>)| -> f64 {
        let (from_x, from_y) = ((-lag).max(0) as usize, lag.max(0) as usize);
        x.iter().skip(from_x).zip(y.iter().skip(from_y)).map(|(a, b)| a * b).sum()
    };
    x.values.iter().zip(&y.values).map(one).sum()
}

fn relation(
    look: Look,
    (output, name): (&str, &str),
    residual: &Series,
    source: &Series,
) -> Option<Relation> {
    let samples: usize = residual.values.iter().map(Vec::len).sum();
    let (last, step) = lags(look, residual.dt);
    let (rr, ss) = (products(residual, residual, 0), products(source, source, 0));
    // Where a trajectory runs far away nothing goes with anything: squares overflow.
    if !(rr > 0.0 && ss > 0.0 && (rr * ss).is_finite()) {
        return None;
    }
    let at = |lag: isize| (products(source, residual, lag) / (rr * ss).sqrt(), lag);
    let looked: Vec<(f64, isize)> =
        (-(last as isize)..=last as isize).step_by(step).map(at).collect();
    let (correlation, lag) =
        looked.iter().copied().max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?;
    let both: f64 = residual.auto.iter().zip(&source.auto).skip(1).map(|(a, b)| a * b).sum();
    let variance = step as f64 * (1.0 + 2.0 * both) / samples as f64;
    let limit = normal_quantile(1.0 - 0.5 * look.p / looked.len() as f64)
        * variance.max(1.0 / samples as f64).sqrt();
    let (coherence, from, to, averages) = coherence(look, residual, source)?;
    let coherence_limit =
        if averages > 1 { 1.0 - libm::pow(look.p, 1.0 / (averages - 1) as f64) } else { 1.0 };
    Some(Relation {
        output: output.to_string(),
        source: name.to_string(),
        correlation,
        lag: lag as f64 * residual.dt,
        limit,
        coherence,
        from,
        to,
        coherence_limit,
    })
}

/// The band of largest coherence above what its number of averages allows: coherence, edges,
/// averages.
fn coherence(look: Look, residual: &Series, source: &Series) -> Option<(f64, f64, f64, usize)> {
    let mut best: Option<(f64, f64, f64, usize, f64)> = None;
    for band in look.bands.windows(2) {
        let (mut xx, mut yy, mut re, mut im, mut averages) = (0.0, 0.0, 0.0, 0.0, 0usize);
        for ((x, y), values) in source.spectra.iter().zip(&residual.spectra).zip(&source.values) {
            let length = values.len() as f64 * residual.dt;
            let inside = (band[0] * length).ceil() as usize
                ..((band[1] * length).ceil() as usize).min(x.len()).min(y.len());
            // Every second one: the window makes neighbours alike.
            for k in inside.step_by(2) {
                let ((a, b), (c, d)) = (x[k], y[k]);
                xx += a * a + b * b;
                yy += c * c + d * d;
                re += a * c + b * d;
                im += b * c - a * d;
                averages += 1;
            }
        }
        if averages < 2 || !(xx * yy > 0.0 && (xx * yy).is_finite()) {
            continue;
        }
        let value = (re * re + im * im) / (xx * yy);
        let above = value - (1.0 - libm::pow(look.p, 1.0 / (averages - 1) as f64));
        if best.is_none_or(|b| above > b.4) {
            best = Some((value, band[0], band[1], averages, above));
        }
    }
    best.map(|(value, from, to, averages, _)| (value, from, to, averages))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Stream;

    fn coloured(seed: u64, n: usize) -> Vec<f64> {
        let mut stream = Stream::new(seed, &["relation"]);
        let mut v = 0.0;
        let next = |_| {
            v = 0.95 * v + stream.normal();
            v
        };
        centred((0..n).map(next).collect())
    }

    const LOOK: Look = Look { longest: 2.0, bands: &[0.1, 0.3, 1.0, 2.0, 4.0, 8.0], p: 0.01 };

    fn series(seeds: std::ops::Range<u64>) -> Series {
        Series::new(LOOK, 0.02, seeds.map(|s| coloured(s, 600)).collect())
    }

    #[test]
    fn what_runs_far_away_goes_with_nothing() {
        let source = series(0..2);
        let far = |x: &Vec<f64>| x.iter().map(|v| 1e160 * v).collect();
        let residual = Series::new(LOOK, 0.02, source.values.iter().map(far).collect());
        assert!(relation(LOOK, ("y", "u"), &residual, &source).is_none());
        let plain = relation(LOOK, ("y", "u"), &source, &source).expect("itself");
        assert!((plain.correlation - 1.0).abs() < 1e-9 && plain.coherence > 0.99);
    }

    #[test]
    fn a_delayed_copy_is_found_at_its_lag() {
        let source = series(0..6);
        let late = |x: &Vec<f64>| {
            (0..x.len()).map(|k| if k >= 10 { 0.5 * x[k - 10] } else { 0.0 }).collect()
        };
        let mut values: Vec<Vec<f64>> = source.values.iter().map(late).collect();
        values
            .iter_mut()
            .zip(series(50..56).values)
            .for_each(|(r, n)| r.iter_mut().zip(n).for_each(|(r, n)| *r += 0.3 * n));
        let residual = Series::new(LOOK, 0.02, values);
        let found = relation(LOOK, ("q", "de"), &residual, &source).expect("a relation");
        assert!(
            (found.lag - 0.2).abs() < 1e-9
                && found.correlation > 0.7
                && found.coherence > found.coherence_limit,
            "{found:?}"
        );
    }

    #[test]
    fn coloured_series_without_relation_stay_below_the_limits() {
        let above = (0..60).filter(|i| {
            let found = relation(
                LOOK,
                ("q", "de"),
                &series(100 + 20 * i..106 + 20 * i),
                &series(5000 + 20 * i..5006 + 20 * i),
            )
            .expect("a relation");
            found.correlation.abs() > found.limit
        });
        let count = above.count();
        assert!(count <= 4, "{count} of 60");
    }
}
