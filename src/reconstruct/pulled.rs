//! A flight and its gusts in; how far at most these pull the scale of the airspeed, out.
//!
//! Gusts are random walks to the filter, `dw = (a_z + q V) dt + s dn` for the velocity along z. Real ones come back to
//! nothing: of a first-order gust `w_g` that lasts `T`, the noise has the mean `-w_g/T`, and as the aircraft answers
//! to gusts like to any other angle of attack, `a_z = -L V alpha`, that mean goes with the specific force from which
//! the scale is read. It gives way to them as well, so that `V E[w_g alpha] = sigma^2/(1 + L T)`, and least squares of
//! `V (alphadot - q)` against `a_z` is off by
//!
//! `E[w_g/T L V alpha] / E[a_z^2] = s^2 / (2 V |E[a_z alpha]|) / (1 + L T)`
//!
//! since `s^2 = 2 sigma^2/T`. The scale reads too much by as much. How long gusts last is not known: without the last
//! factor it is a bound, and what the other gusts (along x, of higher order) do is below it in simulated flights. Each
//! axis (`v` with `a_y` and `beta` likewise) counts by what it knows of the scale, `E[a^2]/s^2`.

use super::smoother::flight::Flight;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use crate::math::interpolate::held;

/// What the fragments of the path call a velocity that gusts disturb, the specific force along it, and the angle of
/// the flow to it.
const AXES: [[&str; 3]; 2] = [["w", "az_imu", "alpha_vane"], ["v", "ay_imu", "beta_vane"]];
/// Forces and angles are what differs from their means over so long, s: what is slower is trim, in which lift is
/// weight at every angle of attack.
const WINDOW: f64 = 20.0;

/// Specific force and angle of an axis, and its gusts.
struct Axis {
    /// Variance that the velocity gains per second, m^2/s^3.
    walk: f64,
    /// Of the specific force, m^2/s^4.
    variance: f64,
    /// Of specific force and angle, m/s^2.
    covariance: f64,
}

/// By how much gusts pull the scale of the airspeed at most, which is `speed` m/s in the mean; 0 where the axes do
/// not tell.
pub fn pulled(
    kinematics: &Kinematics,
    flight: &Flight,
    levels: &Levels,
    (part, speed): ([f64; 2], f64),
) -> f64 {
    let axes = AXES.iter().filter_map(|axis| Axis::of(kinematics, flight, levels, part, *axis));
    by_axes(speed, axes)
}

fn by_axes(speed: f64, axes: impl Iterator<Item = Axis>) -> f64 {
    let (mut pulled, mut known) = (0.0, 0.0);
    for axis in axes.filter(|axis| axis.covariance < 0.0) {
        pulled += axis.variance / (2.0 * speed * -axis.covariance);
        known += axis.variance / axis.walk;
    }
    if known > 0.0 { pulled / known } else { 0.0 }
}

impl Axis {
    fn of(
        kinematics: &Kinematics,
        flight: &Flight,
        levels: &Levels,
        part: [f64; 2],
        [velocity, force, angle]: [&str; 3],
    ) -> Option<Axis> {
        let model = kinematics.model;
        let walk = levels.walk[kinematics.place(velocity)?];
        let input = &flight.inputs[model.input(force)?];
        let output = model.output(angle)?;
        let is_used = |k: usize| flight.channels[k].output == output && levels.r[k].is_finite();
        let channel = (0..flight.channels.len()).find(|&k| is_used(k))?;
        let packet = flight.packets.iter().find(|packet| packet.channels.contains(&channel))?;
        let t = &flight.clocks[input.clock].t;
        let known = packet.t.iter().zip(&flight.channels[channel].z);
        let both: Vec<[f64; 3]> = known
            .filter(|(time, z)| **time >= part[0] && **time <= part[1] && z.is_finite())
            .map(|(&time, &z)| [time, held(t, &input.value, time), z])
            .collect();
        let [variance, covariance] = moments(&both);
        Some(Axis { walk, variance, covariance })
    }
}

/// Variance of the first, and covariance of both, without the mean over each window.
fn moments(both: &[[f64; 3]]) -> [f64; 2] {
    let (mut variance, mut covariance) = (0.0, 0.0);
    for window in both.chunk_by(|a, b| (a[0] / WINDOW).floor() == (b[0] / WINDOW).floor()) {
        let n = window.len() as f64;
        let mean = |j: usize| window.iter().map(|row| row[j]).sum::<f64>() / n;
        let (force, angle) = (mean(1), mean(2));
        for row in window {
            variance += (row[1] - force) * (row[1] - force);
            covariance += (row[1] - force) * (row[2] - angle);
        }
    }
    [variance / both.len().max(1) as f64, covariance / both.len().max(1) as f64]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    /// Of the aircraft's lift, 1/s.
    const LIFT: f64 = 1.0;

    /// An aircraft that only its lift moves up and down, through a gust that lasts `lasts` s, with its elevator at work:
    /// how much too large the airspeed comes out by least squares, and what it is at most.
    fn flown(lasts: f64, sigma: f64) -> [f64; 2] {
        let (v, h, n) = (100.0, 0.02, 2_000_000);
        let mut rng = Pcg64::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let walk = 2.0 * sigma * sigma / lasts;
        let (mut gust, mut motion) = (0.0, 0.0);
        let (mut with, mut square, mut rows) = (0.0, 0.0, Vec::new());
        for k in 0..n {
            let t = k as f64 * h;
            let q = 0.01 * (0.9 * t).sin() + 0.01 * (2.3 * t).sin();
            let alpha = (motion + gust) / v;
            let force = -LIFT * v * alpha;
            let step = -gust / lasts * h + (walk * h).sqrt() * normal();
            let rate = force + q * v;
            // V (alphadot - q) and what the accelerometer has of it, over this step
            let turned = rate * h + step - q * v * h;
            with += turned * force * h;
            square += force * force * h * h;
            rows.push([t, force, alpha]);
            motion += rate * h;
            gust += step;
        }
        let [variance, covariance] = moments(&rows);
        let axis = Axis { walk, variance, covariance };
        [with / square - 1.0, by_axes(v, [axis].into_iter())]
    }

    #[test]
    fn gusts_that_end_pull_the_scale_by_what_they_gain_in_a_second_less_what_the_aircraft_gives_way()
     {
        for (lasts, sigma) in [(0.5, 0.5), (2.0, 0.5), (5.0, 1.0)] {
            let [pulled, most] = flown(lasts, sigma);
            let expected = most / (1.0 + LIFT * lasts);
            assert!((pulled / expected - 1.0).abs() < 0.3, "{lasts} {sigma}: {pulled} {expected}");
        }
        let [_, calm] = flown(5.0, 1e-4);
        assert!(calm < 1e-5, "{calm}");
    }

    #[test]
    fn an_axis_that_tells_more_counts_for_more() {
        let axis = |walk: f64| Axis { walk, variance: 0.5, covariance: -0.005 };
        let alone = by_axes(100.0, [axis(0.02)].into_iter());
        assert!((alone - 0.02 / (2.0 * 100.0 * 0.005)).abs() < 1e-12, "{alone}");
        let calm = by_axes(100.0, [axis(0.02), axis(0.0002)].into_iter());
        assert!(calm < 0.05 * alone, "{calm}");
        let turned = Axis { covariance: 0.005, ..axis(0.02) };
        assert_eq!(by_axes(100.0, [turned].into_iter()), 0.0);
    }
}
