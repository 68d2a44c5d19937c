//! Starts of a filter that are far off, integration steps too long for a limit, inputs sampled too slowly: is the
//! best minimum found, and is what steps and samples do told?

use super::{normal, rng};
use crate::dynamics::{Channel, Directions, Propagator, Record};
use crate::estimate::{Estimation, Settings, Stop, estimate};
use crate::model::{Constants, Model};

fn model(text: &str) -> Model {
    Model::parse("starts", text, &Constants::default()).unwrap()
}

/// A 3211 of unit `unit` from `from` on.
fn maneuver(t: f64, from: f64, unit: f64) -> f64 {
    match (t - from) / unit {
        s if !(0.0..7.0).contains(&s) => 0.0,
        s if s < 3.0 || (5.0..6.0).contains(&s) => 1.0,
        _ => -1.0,
    }
}

const SHORT_PERIOD: &str = r#"
title = "A short period in rough air, its angle of attack from the wrong zero"

[inputs]
de = "rad"

[parameters]
Za  = { unit = "1/s", start = -1.0 }
Ma  = { unit = "1/s^2", start = -5.0 }
Mq  = { unit = "1/s", start = -1.5 }
Mde = { unit = "1/s^2", start = -6.0 }
a_0 = { unit = "rad", start = 0.08 }
F_q = { unit = "rad/s^1.5", start = 0.02, min = 0.0 }

[states]
x = { unit = "rad", rate = "q + Za*x", start = 0.0 }
q = { unit = "rad/s", rate = "Ma*x + Mq*q + Mde*de", start = 0.0NOISE }

[outputs]
alpha = { unit = "rad", value = "x + a_0" }
q     = { unit = "rad/s", value = "q" }
"#;

#[test]
fn recovery_a_filter_finds_its_best_minimum_from_a_zero_that_is_fifteen_sd_off() {
    let driven = model(&SHORT_PERIOD.replace("NOISE", r#", noise = "F_q""#));
    let calm = model(&SHORT_PERIOD.replace("NOISE", "").replace("min = 0.0 }", "fixed = true }"));
    let (dt, n) = (0.05, 401);
    let times: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
    let de = |t: &f64| 0.03 * (maneuver(*t, 2.0, 0.6) - maneuver(*t, 11.0, 0.6));
    let channel = |output: usize| Channel { output, t: times.clone().into(), z: vec![].into() };
    let empty = Record {
        dt,
        n,
        inputs: times.iter().map(de).collect(),
        channels: vec![channel(0), channel(1)],
        ..Record::default()
    };
    let truth = [-1.0, -5.0, -1.5, -6.0, 0.05, 0.0];
    let y = Propagator::new(&calm, Directions::default())
        .unwrap()
        .respond(&truth, &[], &empty, false)
        .y;
    for seed in 0..12 {
        let mut random = rng(seed);
        let mut record = empty.clone();
        for ((channel, y), sd) in record.channels.iter_mut().zip(&y).zip([0.002, 0.004]) {
            channel.z = y.iter().map(|y| y + sd * normal(&mut random)).collect();
        }
        let from = |zero: f64| -> Estimation {
            let starts = [("a_0".to_string(), zero)].into_iter().collect();
            estimate(&driven, &[record.clone()], &Settings { starts, ..Settings::default() })
                .unwrap()
        };
        let (far, near) = (from(0.08), from(0.05));
        let cost = |e: &Estimation| e.iterations.last().unwrap().cost;
        assert_eq!((far.stop, near.stop), (Stop::Converged, Stop::Converged), "{seed}");
        assert!((cost(&far) - cost(&near)).abs() < 0.5, "{seed}: {} {}", cost(&far), cost(&near));
    }
}

const ACTUATOR: &str = r#"
title = "An actuator whose velocity is limited"

[inputs]
u = "rad"

[parameters]
w    = { unit = "1/s", start = 15.0 }
zeta = { unit = "1", start = 0.7 }
most = { unit = "rad/s", start = 0.45 }

[states]
eta = { unit = "rad", rate = "v", start = 0.0 }
v   = { unit = "rad/s", rate = "w^2*(u - eta) - 2*zeta*w*v", start = 0.0, min = "-most", max = "most" }

[outputs]
eta = { unit = "rad", value = "eta" }
"#;

#[test]
fn an_estimate_that_finer_steps_would_move_says_so() {
    let model = model(ACTUATOR);
    let (dt, n) = (0.02, 1001);
    let times: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
    let u = |t: &f64| 0.15 * (maneuver(*t, 2.013, 0.611) + maneuver(*t, 11.007, 0.523));
    let mut record = Record {
        dt,
        n,
        substeps: 32,
        inputs: times.iter().map(u).collect(),
        channels: vec![Channel { output: 0, t: times.clone().into(), z: vec![].into() }],
        ..Record::default()
    };
    let propagator = Propagator::new(&model, Directions::default()).unwrap();
    let y = propagator.respond(&[18.0, 0.65, 0.5], &[], &record, false).y;
    let mut random = rng(3);
    record.channels[0].z = y[0].iter().map(|y| y + 2e-4 * normal(&mut random)).collect();
    let by = |substeps: usize| {
        let e = estimate(&model, &[Record { substeps, ..record.clone() }], &Settings::default());
        let e = e.unwrap();
        assert_eq!(e.stop, Stop::Converged);
        e
    };
    let (long, short) = (by(1), by(16));
    let coarse = long.coarse.as_ref().expect("it is told");
    let (name, sds) = &coarse.moved[0];
    let row = |e: &Estimation| e.rows.iter().find(|row| row.name == *name).unwrap().clone();
    let moved = (row(&short).value - row(&long).value).abs() / row(&long).sd.unwrap();
    assert!((sds / moved - 1.0).abs() < 0.5, "{name}: {sds} of {moved}");
    assert_eq!(short.coarse, None);
}

/// A command that steps between its samples, by how it is recorded: every `every` of the points on which
/// the truth moves, which holds it.
fn stepped(every: usize) -> Estimation {
    let model = model(
        r#"
title = "A lag"
[inputs]
u = "rad"
[parameters]
a = { unit = "1/s", start = 3.0 }
k = { unit = "1", start = 0.8 }
[states]
x = { unit = "rad", rate = "a*(k*u - x)", start = 0.0 }
[outputs]
x = { unit = "rad", value = "x" }
"#,
    );
    let (dt, n) = (0.01, 1001);
    let times: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
    // each step just behind a sample, where the straight line has it half a sample later
    let u: Vec<f64> = times.iter().map(|t| 0.1 * maneuver(*t, 1.005, 0.8)).collect();
    let record = Record {
        dt,
        n,
        inputs: u.clone().into(),
        interpolation: vec![crate::dynamics::Interpolation::Hold],
        channels: vec![Channel { output: 0, t: times.clone().into(), z: vec![].into() }],
        ..Record::default()
    };
    let propagator = Propagator::new(&model, Directions::default()).unwrap();
    let y = propagator.respond(&[4.0, 1.0], &[], &record, false).y;
    let mut random = rng(5);
    let z = y[0].iter().map(|y| y + 2e-4 * normal(&mut random)).collect();
    let record = Record {
        dt: dt * every as f64,
        n: n.div_ceil(every),
        inputs: u.into_iter().step_by(every).collect::<Vec<f64>>().into(),
        interpolation: Vec::new(),
        channels: vec![Channel { output: 0, t: times.into(), z }],
        ..record
    };
    let e = estimate(&model, &[record], &Settings::default()).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    e
}

#[test]
fn an_input_that_steps_between_its_samples_says_what_hangs_on_it() {
    let slow = stepped(20);
    let edges = slow.edges.as_ref().expect("it is told");
    assert_eq!(edges.inputs, [("u".to_string(), 0.2)]);
    let a = &slow.rows[0];
    let off = (a.value - 4.0).abs() / a.sd.unwrap();
    let by = edges.moved.iter().find(|(name, _)| name == "a").expect("a hangs on it").1;
    // of the order of what is off, which half a sample bounds
    assert!(off > 3.0 && by > 0.3 * off && by < 30.0 * off, "{off} {by}");
}
