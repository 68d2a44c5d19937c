//! Measured outputs of maneuvers in; the characteristic time of their motion, which lags, windows
//! and bands are counted in, out.
//!
//! What is fast for an aircraft is not said by seconds. Nor by its eigenvalues: a model has those
//! of actuators beside those of the phugoid, a thousand times as slow, and nothing in the matrix
//! tells which of them the maneuvers show. The maneuvers do: the characteristic time is the lag at
//! which the autocorrelation of a measured output has fallen to a half (a sixth of the period of a
//! sine), the median over outputs and maneuvers. It depends on the data alone, so that it stays
//! what it is while a model grows; it is 0.6 s for the short-period motion of a transport aircraft,
//! and goes with the unit of time. Sampling and the maneuvers' length bound it: lags shorter than
//! half a sample, or longer than a maneuver, say nothing.

use crate::diagnose::thresholds::Thresholds;
use crate::dynamics::{Channel, Record};
use crate::math::median;
use crate::math::products::dot;
use crate::signal::robust::noise_sd;

/// The characteristic time of these records, s; NaN where nothing is measured.
pub fn characteristic_time<'r>(
    records: impl Iterator<Item = &'r Record>,
    thresholds: &Thresholds,
) -> f64 {
    let (mut halves, mut steps, mut lengths) = (Vec::new(), Vec::new(), Vec::new());
    for channel in records.flat_map(|record| &record.channels) {
        let Some((length, step)) = extent(channel) else { continue };
        lengths.push(length);
        steps.push(step);
        halves.extend(half(&channel.z, thresholds.visible_motion).map(|lag| lag * step));
    }
    let [_, shortest, .., longest] = thresholds.lags;
    let (least, most) = (0.5 * median(&steps) / shortest, median(&lengths) / longest);
    let time = if halves.is_empty() { (least * most).sqrt() } else { median(&halves) };
    time.min(most).max(least)
}

/// Time from the first to the last sample of a channel, and from one to the next, s.
fn extent(channel: &Channel) -> Option<(f64, f64)> {
    let length = channel.t.last()? - channel.t.first()?;
    (length > 0.0).then(|| (length, length / (channel.t.len() - 1) as f64))
}

/// Lag, in samples, at which the autocorrelation falls to a half, white noise taken off; none where
/// the motion does not stand out of the noise by `visible` times.
fn half(z: &[f64], visible: f64) -> Option<f64> {
    let finite = || z.iter().filter(|z| z.is_finite());
    let mean = finite().sum::<f64>() / finite().count() as f64;
    let x: Vec<f64> = z.iter().map(|z| if z.is_finite() { z - mean } else { 0.0 }).collect();
    let square = |lag: usize| dot(&x[lag..], &x) / finite().count() as f64;
    let noise = noise_sd(z);
    let motion = square(0) - noise * noise;
    if !(motion > visible * visible * noise * noise && motion > 0.0) {
        return None;
    }
    let mut before = 1.0;
    for lag in 1..x.len() {
        let now = square(lag) / motion;
        if now <= 0.5 {
            // `before` is above a half.
            return Some((lag - 1) as f64 + (before - 0.5) / (before - now));
        }
        before = now;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Stream;

    fn record(of: impl Fn(f64) -> f64, noise: f64, dt: f64) -> Record {
        let mut stream = Stream::new(1, &["timescale"]);
        let t: Vec<f64> = (0..400).map(|k| 3.0 + f64::from(k) * dt).collect();
        let z = t.iter().map(|t| of(*t) + noise * stream.normal()).collect();
        Record { dt, channels: vec![Channel { output: 0, t: t.into(), z }], ..Record::default() }
    }

    fn time(record: &Record) -> f64 {
        characteristic_time([record].into_iter(), &Thresholds::default())
    }

    #[test]
    fn truth_it_is_a_sixth_of_the_period_of_a_sine_whatever_the_unit_of_time() {
        let sine = |dt: f64| {
            record(
                |t| 4.0 + libm::sin(std::f64::consts::PI / (3.0 * 15.0 * dt) * (t - 3.0)),
                0.1,
                dt,
            )
        };
        let slow = time(&sine(0.04));
        // Later lags have fewer products, which are not scaled up, and the record ends somewhere in
        // a period.
        assert!((slow / 0.6 - 1.0).abs() < 0.06, "{slow}");
        assert!((time(&sine(0.004)) / slow - 0.1).abs() < 1e-4);
    }

    #[test]
    fn sampling_and_length_bound_it_and_stand_in_where_nothing_moves() {
        let (least, most) = (6.0 * 0.04, 399.0 * 0.04 * 3.0 / 16.0);
        // A ramp is correlated with itself over a sixth of its length.
        let slow = time(&record(|t| t, 0.0, 0.04));
        assert!((slow / (399.0 * 0.04) - 0.17).abs() < 0.005 && slow < most, "{slow}");
        // Half of its autocorrelation is left after three samples.
        let fast = time(&record(|t| libm::sin(8.75 * t), 0.0, 0.04));
        assert!((fast - least).abs() < 1e-9, "{fast}");
        let still = time(&record(|_| 1.0, 0.1, 0.04));
        assert!((still - (least * most).sqrt()).abs() < 1e-9, "{still}");
        assert!(time(&Record::default()).is_nan());
    }
}
