//! Modes of estimated models: are they those of the matrix, and do their sd follow from the estimates'?

use super::{noise, rng};
use crate::dynamics::{Channel, Directions, Propagator, Record};
use crate::estimate::{Estimation, Mode, Settings, Stop, estimate};
use crate::model::{Constants, Model};

/// A short period with a lag of the tail, and a divergence beside it.
const TEXT: &str = r#"title = "Short period and a divergence"
[inputs]
de = "rad"
[constants]
w = { unit = "1/s", value = 1.0 }
[parameters]
Z_a = { unit = "1/s", start = -0.9 }
M_a = { unit = "1/s^2", start = -5.5 }
M_q = { unit = "1/s", start = -1.8 }
M_d = { unit = "1/s^2", start = -9.0 }
L   = { unit = "1/s", start = 0.04 }
[states]
alpha = { unit = "rad", rate = "w*sin(q/w) + Z_a*alpha", start = 0.0 }
q = { unit = "rad/s", rate = "M_a*alpha + M_q*q + M_d*de", start = 0.0 }
x = { unit = "rad", rate = "L*x + w*de", start = 0.0 }
[outputs]
alpha = { unit = "rad", value = "alpha" }
q = { unit = "rad/s", value = "q" }
x = { unit = "rad", value = "x" }
"#;

const TRUTH: [f64; 5] = [-1.0, -6.0, -2.0, -10.0, 0.05];

fn model() -> Model {
    Model::parse("modes", TEXT, &Constants::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn estimated(seed: u64) -> Estimation {
    let model = model();
    let (n, dt) = (600, 0.02);
    let inputs: Vec<f64> =
        (0..n).map(|k| if (50..100).contains(&(k % 200)) { 0.05 } else { -0.01 }).collect();
    let mut record = Record { dt, n, inputs: inputs.into(), ..Record::default() };
    let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
    record.channels = (0..3)
        .map(|output| Channel { output, t: t.clone().into(), z: vec![0.0; n].into() })
        .collect();
    let propagator = Propagator::new(&model, Directions::default()).unwrap();
    let y = propagator.respond(&TRUTH, &[], &record, false).y;
    for (channel, (output, y)) in record.channels.iter_mut().zip(y.into_iter().enumerate()) {
        let noise = noise(&mut rng(seed + 1000 * output as u64), n, 2e-3, 0.5);
        channel.z = y.iter().zip(noise).map(|(y, v)| y + v).collect();
    }
    let e = estimate(&model, &[record], &Settings::default()).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    e
}

/// Frequency and damping of the oscillation, and the growing mode, from values of the parameters:
/// s^2 - (Z_a + M_q) s + (Z_a M_q - M_a) at q = 0.
fn by_hand(p: &[f64]) -> [f64; 4] {
    let w = (p[0] * p[2] - p[1]).sqrt();
    let zeta = -(p[0] + p[2]) / (2.0 * w);
    let period = 2.0 * std::f64::consts::PI / (w * (1.0 - zeta * zeta).sqrt());
    [w, zeta, period, -1.0 / p[4]]
}

fn told(modes: &[Mode]) -> [crate::estimate::Uncertain; 4] {
    [modes[0].frequency, modes[0].damping, modes[0].period, modes[1].time_constant]
}

#[test]
fn modes_and_their_sd_are_those_of_the_closed_form() {
    let e = estimated(1);
    assert_eq!(e.modes.len(), 2, "{:#?}", e.modes);
    let mut states = e.modes[0].states.clone();
    states.sort();
    assert_eq!(
        (states, &e.modes[1].states[..]),
        (vec!["alpha".into(), "q".into()], &["x".into()][..])
    );
    // The slope of sin(q) is that at the start of its segment.
    assert!(e.modes.iter().all(|m| m.segment == Some(0)) && e.modes[1].time_constant.value < 0.0);
    let values: Vec<f64> = e.rows.iter().map(|r| r.value).collect();
    let sd: Vec<f64> = e.rows.iter().map(|r| r.sd.unwrap()).collect();
    let correlation = |a: usize, b: usize| {
        let found = e.correlations.iter().find(|c| (c.a, c.b) == (a.min(b), a.max(b)));
        if a == b { 1.0 } else { found.unwrap().value }
    };
    let slopes: Vec<Vec<f64>> = (0..5)
        .map(|i| {
            let h = 1e-6 * values[i].abs();
            let at = |by: f64| {
                let mut p = values.clone();
                p[i] += by;
                by_hand(&p)
            };
            let (up, down) = (at(h), at(-h));
            (0..4).map(|k| (up[k] - down[k]) / (2.0 * h)).collect()
        })
        .collect();
    for (k, (told, value)) in told(&e.modes).iter().zip(by_hand(&values)).enumerate() {
        let mut variance = 0.0;
        for a in 0..5 {
            for b in 0..5 {
                variance += slopes[a][k] * slopes[b][k] * sd[a] * sd[b] * correlation(a, b);
            }
        }
        let sd = variance.sqrt();
        assert!((told.value / value - 1.0).abs() < 1e-9, "{k}: {told:?} {value}");
        assert!((told.sd / sd - 1.0).abs() < 1e-5, "{k}: {told:?} {sd}");
    }
}

#[test]
fn recovery_intervals_of_modes_cover_the_truth() {
    use rayon::prelude::*;
    let draws = 200u64;
    let truth = by_hand(&TRUTH);
    let one = |seed: u64| {
        let e = estimated(10 + seed);
        let hit = |(u, truth): (&crate::estimate::Uncertain, f64)| {
            f64::from((u.value - truth).abs() <= 1.96 * u.sd)
        };
        told(&e.modes).iter().zip(truth).map(hit).sum::<f64>() / 4.0
    };
    let all: Vec<f64> = (0..draws).into_par_iter().map(one).collect();
    let share = all.iter().sum::<f64>() / draws as f64;
    println!("{share:.3} of the intervals cover");
    assert!((0.915..=0.98).contains(&share), "{share}");
}
