//! Length, band and amplitude in, the terms of a multisine out.

use super::keys;
use super::shape::{Mistake, Shape};
use crate::simulate::settings::Maneuver;
use std::f64::consts::{PI, TAU};

/// Harmonics of 1/duration inside the band, equal power, Schroeder phases (IEEE Trans. Inf. Theory
/// 16, 1970), shifted in time so that the signal begins and ends at zero.
pub fn shape(maneuver: &Maneuver, mistakes: &mut Vec<Mistake>) -> Option<Shape> {
    keys::only(maneuver, &["amplitude", "duration_s", "band_hz"], mistakes);
    let amplitude = keys::amplitude(maneuver, "a multisine", mistakes);
    let duration = keys::positive(maneuver.duration_s, "duration_s", "a multisine", mistakes);
    let Some([low, high]) = maneuver.band_hz else {
        mistakes.push(("band_hz", "a multisine needs `band_hz = [lowest, highest]`".into()));
        return None;
    };
    let (amplitude, duration) = (amplitude?, duration?);
    // Bounded: a band of many thousand harmonics is a mistake in a unit.
    let (first, last) = ((low * duration - 1e-9).ceil().max(1.0), (high * duration + 1e-9).floor());
    if !(low > 0.0 && last >= first && last < 10_000.0) {
        let what = format!(
            "between {low} and {high} Hz there must be 1 to 9999 multiples of 1/duration = {} Hz",
            1.0 / duration
        );
        mistakes.push(("band_hz", what));
        return None;
    }
    let count = last - first + 1.0;
    let term = |k: f64| {
        let j = k - first + 1.0;
        (TAU * k / duration, -PI * j * (j - 1.0) / count)
    };
    let terms: Vec<(f64, f64)> = (0..count as usize).map(|i| term(first + i as f64)).collect();
    let sum = |t: f64| terms.iter().map(|(omega, phase)| libm::sin(omega * t + phase)).sum::<f64>();
    let points = (32.0 * last) as usize;
    let step = duration / points as f64;
    let samples: Vec<f64> = (0..=points).map(|i| sum(i as f64 * step)).collect();
    let largest = samples.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let zero = rising_zero(&samples, step, sum);
    let terms = terms.iter().map(|(omega, phase)| (*omega, phase + omega * zero)).collect();
    Some(Shape::Sines {
        duration,
        terms,
        factor: f64::from(maneuver.polarity) * amplitude / largest,
    })
}

/// The first time at which `f`, sampled at multiples of `step`, rises through 0; 0 when it never
/// does.
fn rising_zero(samples: &[f64], step: f64, f: impl Fn(f64) -> f64) -> f64 {
    let Some(i) = samples.windows(2).position(|w| w[0] <= 0.0 && w[1] > 0.0) else { return 0.0 };
    let (mut low, mut high) = (i as f64 * step, (i + 1) as f64 * step);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if f(middle) <= 0.0 { low = middle } else { high = middle }
    }
    low
}
