//! Limits of states: those that the motion reaches and those that it does not, limits that are started from what was
//! measured, limits that cross; and delays that reach back to before a record. Each on estimates.

use super::{normal, rng};
use crate::dynamics::{Channel, Propagator, Record};
use crate::error::Errors;
use crate::estimate::{Estimation, Idle, Settings, Stop, WithoutEffect, estimate};
use crate::model::{Constants, Model};

const DT: f64 = 0.02;
const NOISE: f64 = 0.002;

const ACTUATOR: &str = r#"
title = "An actuator that reaches less far at higher airspeed"

[inputs]
u = "rad"
V = "m/s"

[parameters]
T       = { unit = "s", start = 0.2, min = 0.02 }
K       = { unit = "-", start = 0.0, fixed = true }
tau     = { unit = "s", start = 0.1, min = 0.0, max = 1.0, fixed = true }
top_0   = { unit = "rad", start = 0.5 }
top_V   = { unit = "rad s/m", start = 0.0 }
fastest = { unit = "rad/s", start = 30.0, min = 0.1 }

[equations]
top = "top_0 + top_V*V"

[states]
x = { unit = "rad", rate = "(u + K*delay(u, tau) - x)/T", start = 0.0, min = "-top", max = "top", rate_max = "fastest" }

[outputs]
x = { unit = "rad", value = "x" }
"#;

fn model() -> Model {
    Model::parse("actuator", ACTUATOR, &Constants::default()).unwrap()
}

/// Steps of `size` either way at airspeed `v`, recorded with noise.
fn flown(truth: &[f64], size: f64, v: f64, seed: u64) -> Record {
    let u = |k: usize| match k % 200 {
        20..80 => size,
        100..160 => -size,
        _ => 0.0,
    };
    let n = 400;
    let t: Vec<f64> = (0..n).map(|k| k as f64 * DT).collect();
    let record = Record {
        dt: DT,
        n,
        inputs: (0..n).flat_map(|k| [u(k), v]).collect(),
        channels: vec![Channel { output: 0, z: vec![0.0; n].into(), t: t.into() }],
        ..Record::default()
    };
    let propagator = Propagator::new(&model(), Default::default()).unwrap();
    let y = propagator.run(truth, &[], &record, false).y;
    let mut rng = rng(seed);
    let z = y.iter().map(|y| y + NOISE * normal(&mut rng)).collect();
    let channels = vec![Channel { z, ..record.channels[0].clone() }];
    Record { channels, ..record }
}

/// T, K, tau, top_0, top_V, fastest.
const TRUTH: [f64; 6] = [0.15, 0.0, 0.1, 0.6, -0.002, 30.0];

fn three(size: f64) -> Vec<Record> {
    [50.0, 100.0, 150.0].into_iter().zip(1..).map(|(v, s)| flown(&TRUTH, size, v, s)).collect()
}

fn estimated(records: &[Record], settings: &Settings) -> Result<Estimation, Errors> {
    estimate(&model(), records, settings)
}

#[test]
fn limits_say_where_they_are_reached_and_how_near_the_motion_comes() {
    let e = estimated(&three(0.8), &Settings::default()).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    let limit = |name: &str| e.reached.iter().find(|r| r.limit == name).unwrap();
    let max = limit("max");
    assert_eq!(max.active.iter().map(|(s, _)| *s).collect::<Vec<_>>(), [0, 1, 2]);
    // 60 points of 200 each, less the way to the stop.
    assert!(max.active.iter().all(|(_, seconds)| (1.6..2.5).contains(seconds)), "{max:?}");
    let [over] = &max.inputs[..] else { panic!("of airspeed alone: {:?}", max.inputs) };
    assert_eq!((over.name.as_str(), over.lower, over.upper), ("V", 50.0, 150.0));
    assert!((max.extreme - 0.5).abs() < 0.01 && over.at == 50.0, "{max:?}");
    assert_eq!(max.parameters, ["top_0", "top_V"]);
    let plateau = max.pieces.iter().find(|p| p.place == 2).unwrap();
    assert!(
        (plateau.measured - 0.3).abs() < 0.002 && plateau.inputs == [[150.0, 0.0]],
        "{plateau:?}"
    );
    let rate = limit("rate_max");
    assert!(rate.active.is_empty() && rate.follows.unwrap().agrees(), "{rate:?}");
    // 0.8 rad against 0.15 s, from the other stop.
    assert!((4.5..9.0).contains(&rate.extreme), "{rate:?}");
    let row = e.rows.iter().find(|r| r.name == "fastest").unwrap();
    assert!(row.idle && matches!(e.why_idle(row), Idle::NotReached(r) if r.limit == "rate_max"));
}

#[test]
fn a_limit_that_is_not_reached_and_not_followed_is_told_apart() {
    let held = Settings {
        fixed: vec!["top_0".into(), "top_V".into()],
        starts: [("top_0".to_string(), 2.0)].into(),
        ..Settings::default()
    };
    let limit = |size: f64| {
        let e = estimated(&three(size), &held).unwrap();
        e.reached.into_iter().find(|r| r.limit == "max").unwrap()
    };
    let (short, far) = (limit(0.25), limit(0.8));
    assert!(short.active.is_empty() && far.active.is_empty());
    assert!(short.follows.unwrap().agrees(), "{:?}", short.follows);
    assert!(!far.follows.unwrap().agrees(), "{:?}", far.follows);
}

#[test]
fn the_delay_of_a_term_that_is_zero_is_not_determined() {
    let free = ["T", "tau", "top_0", "top_V"].map(String::from).to_vec();
    let settings = Settings { free: Some(free), ..Settings::default() };
    let e = estimated(&three(0.8), &settings).unwrap();
    let row = e.rows.iter().find(|r| r.name == "tau").unwrap();
    assert!(row.idle && e.stop == Stop::Converged);
    assert_eq!(e.why_idle(row), Idle::Delays);
    let refused = Settings { without_effect: WithoutEffect::Refuse, ..settings };
    assert_eq!(estimated(&three(0.8), &refused).unwrap().stop, Stop::Singular);
}

/// Steps of 0.8 rad: nothing shows a limit at 40 rad, nor at a quarter of that.
#[test]
fn recovery_of_a_surface_from_a_start_that_is_far_too_large() {
    let starts = [("top_0".to_string(), 40.0), ("fastest".to_string(), 500.0)].into();
    let e = estimated(&three(0.8), &Settings { starts, ..Settings::default() }).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    for (name, truth) in [("top_0", 0.6), ("top_V", -0.002)] {
        let row = e.rows.iter().find(|r| r.name == name).unwrap();
        assert!((row.value - truth).abs() < 3.0 * row.sd.unwrap(), "{row:?}");
    }
    let fastest = e.rows.iter().find(|r| r.name == "fastest").unwrap();
    assert!(fastest.idle && fastest.value == 500.0, "{fastest:?}");
}

#[test]
fn fault_limits_that_cross_at_the_starts() {
    let starts = [("top_0".to_string(), 0.1), ("top_V".to_string(), -0.001)].into();
    let refused = estimated(&three(0.8), &Settings { starts, ..Settings::default() }).unwrap_err();
    let said = refused.to_string();
    let wanted = "the limits of x cross: min 0.0500 rad is above max -0.0500 rad at V = 150.0000 m/s, at the starts of model actuator";
    assert!(said.contains(wanted) && said.contains("leave room"), "{said}");
}

#[test]
fn fault_a_delay_that_reaches_back_to_before_the_record() {
    let truth = [0.15, 0.5, 0.3, 9.0, 0.0, 30.0];
    let record = flown(&truth, 0.8, 50.0, 4);
    let settings = Settings {
        free: Some(["T", "K", "tau"].map(String::from).to_vec()),
        starts: [("tau".to_string(), 0.25), ("K".to_string(), 0.4), ("top_0".to_string(), 9.0)]
            .into(),
        ..Settings::default()
    };
    // The first step is behind the delay: nothing moves before it.
    assert_eq!(estimated(std::slice::from_ref(&record), &settings).unwrap().too_short, []);
    // Cut 0.1 s before the step comes: it lies in the 0.3 s of the delay.
    let cut = |start: usize, from: usize| Record {
        inputs: record.inputs[2 * from..].to_vec().into(),
        n: record.n - from,
        start,
        t0: from as f64 * DT,
        ..record.clone()
    };
    let e = estimated(&[cut(0, 15)], &settings).unwrap();
    let [short] = &e.too_short[..] else { panic!("{:?}", e.too_short) };
    assert_eq!((short.segment, short.input.as_str(), short.preroll), (0, "u", 0.0));
    assert!((short.delay - 0.3).abs() < 0.02, "{short:?}");
    assert_eq!(estimated(&[cut(20, 0)], &settings).unwrap().too_short, []);
}
