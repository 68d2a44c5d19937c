//! A small model in the model language, estimated over simulated records: names, scopes, initial
//! states, messages.

use super::{normal, rng};
use crate::dynamics::{Channel, Directions, Propagator, Record};
use crate::estimate::{Estimation, Settings, Stop, estimate};
use crate::model::{Constants, Model};

const TEXT: &str = r#"
title = "First-order lag with a zero shift"

[inputs]
u = "rad"

[parameters]
T = { unit = "s", start = 0.5, min = 0.05 }
K = { unit = "-", start = 1.0 }
K_2 = { unit = "-", start = 0.0, fixed = true }
y_0 = { unit = "rad", start = 0.0, per = "segment" }

[states]
x = { unit = "rad", rate = "((K + K_2)*u - x)/T", start = 0.0 }

[outputs]
x = { unit = "rad", value = "x" }
y = { unit = "rad", value = "2*x + y_0" }
"#;

fn model() -> Model {
    Model::parse("lag", TEXT, &Constants::default()).unwrap()
}

/// Truth: T 0.3, K 1.2, y_0 0.1 (s + 1), x(0) 0.2 s; `x` at 50 Hz, `y` at about 21 Hz with stamps
/// of its own.
fn records(model: &Model, segments: usize) -> Vec<Record> {
    let mut rng = rng(11);
    let propagator =
        Propagator::new(model, Directions { parameters: vec![], starts: vec![0] }).unwrap();
    (0..segments)
        .map(|s| {
            let input = |k: usize| {
                if (50..200).contains(&k) {
                    1.0
                } else if (200..300).contains(&k) {
                    -1.0
                } else {
                    0.0
                }
            };
            let n = 400 + 50 * s;
            let stamps =
                |dt: f64, n: usize| (0..n).map(|k| 10.0 + k as f64 * dt).collect::<Vec<f64>>();
            let channel = |output: usize, t: Vec<f64>| Channel {
                output,
                z: vec![f64::NAN; t.len()].into(),
                t: t.into(),
            };
            let mut record = Record {
                t0: 10.0,
                dt: 0.02,
                n,
                inputs: (0..n).map(input).collect(),
                channels: vec![channel(0, stamps(0.02, n)), channel(1, stamps(0.047, 160))],
                ..Record::default()
            };
            let response = propagator.respond(
                &[0.3, 1.2, 0.0, 0.1 * (s + 1) as f64],
                &[0.2 * s as f64],
                &record,
                false,
            );
            for (channel, y) in record.channels.iter_mut().zip(response.y) {
                channel.z = y.iter().map(|y| y + 0.01 * normal(&mut rng)).collect();
            }
            record
        })
        .collect()
}

fn value(e: &Estimation, name: &str, segment: Option<usize>, truth: f64) {
    let row = e.rows.iter().find(|r| r.name == name && r.segment == segment).unwrap();
    let sd = row.sd.unwrap();
    assert!((row.value - truth).abs() < 4.0 * sd && sd < 0.02, "{row:?}, truth {truth}");
}

#[test]
fn campaign_segment_and_initial_values_come_back_with_their_names() {
    let model = model();
    let mut records = records(&model, 3);
    records[1].channels[1].z[20..30].fill(f64::NAN);
    let settings = Settings { initial: vec!["x".into()], ..Settings::default() };
    let e = estimate(&model, &records, &settings).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    let names: Vec<(&str, Option<usize>)> =
        e.rows.iter().map(|r| (r.name.as_str(), r.segment)).collect();
    assert_eq!(names[..4], [("T", None), ("K", None), ("y_0", Some(0)), ("x(0)", Some(0))]);
    assert_eq!(names.len(), 8);
    value(&e, "T", None, 0.3);
    value(&e, "K", None, 1.2);
    for s in 0..3 {
        value(&e, "y_0", Some(s), 0.1 * (s + 1) as f64);
        value(&e, "x(0)", Some(s), 0.2 * s as f64);
    }
    let counts: Vec<(&str, usize, usize)> =
        e.outputs.iter().map(|o| (o.name.as_str(), o.count, o.masked)).collect();
    assert_eq!(counts, [("x", 1350, 0), ("y", 470, 10)]);
    assert!(e.outputs.iter().all(|o| (o.r.sqrt() - 0.01).abs() < 1e-3));
    assert!((e.det_r - e.outputs[0].r * e.outputs[1].r).abs() < 1e-12 * e.det_r);
    // All pairs within the common parameters, and of each segment with itself and them.
    assert_eq!(e.correlations.len(), 1 + 3 * (2 * 2 + 1));
    assert!(e.correlations.iter().all(|c| c.a < c.b && c.value.abs() < 1.0 && c.crlb.abs() < 1.0));
    assert_eq!((e.responses.len(), e.responses[2].len()), (3, 2));
    assert_eq!(e.responses[2][1].t, records[2].channels[1].t);
    assert!(e.verdict.combinations.is_empty() && e.verdict.condition.is_finite());
}

#[test]
fn the_same_bytes_for_any_number_of_threads() {
    let model = model();
    let records = records(&model, 4);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = Settings { initial: vec!["x".into()], ..Settings::default() };
        format!("{:?}", pool.install(|| estimate(&model, &records, &settings)).unwrap())
    };
    assert_eq!(run(1), run(4));
}

#[test]
fn what_cannot_be_told_apart_is_named() {
    let model = model();
    let free = Some(["T", "K", "K_2", "y_0"].map(String::from).to_vec());
    let e =
        estimate(&model, &records(&model, 1), &Settings { free, ..Settings::default() }).unwrap();
    assert_eq!((e.stop, e.correlations.len()), (Stop::Singular, 0));
    assert_eq!(e.verdict.combinations[0].to_string(), "K, K_2 are not distinguishable");
    assert!(e.rows.iter().all(|r| r.sd.is_none() && r.sd_crlb.is_none()));
}

#[test]
fn mistakes_are_reported_all_at_once() {
    let model = model();
    let settings = Settings {
        free: Some(vec!["T".into(), "KK".into()]),
        fixed: vec!["Q".into()],
        starts: [("T".to_string(), 0.01), ("y_0".to_string(), f64::NAN)].into_iter().collect(),
        initial: vec!["z".into()],
        ..Settings::default()
    };
    let errors = estimate(&model, &records(&model, 1), &settings).unwrap_err();
    let text = errors.to_string();
    assert_eq!(errors.0.len(), 5, "{text}");
    for part in [
        "no parameter \"KK\"",
        "did you mean \"K\"",
        "no state \"z\"",
        "outside its bounds",
        "not at a number",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn no_records_and_nothing_measured_is_no_data() {
    let model = model();
    assert_eq!(estimate(&model, &[], &Settings::default()).unwrap().stop, Stop::NoData);
    let mut records = records(&model, 1);
    records[0].channels.iter_mut().for_each(|c| c.z.fill(f64::NAN));
    let e = estimate(&model, &records, &Settings::default()).unwrap();
    assert_eq!((e.stop, e.outputs[0].count, e.outputs[0].masked), (Stop::NoData, 0, 400));
}

/// Where an iteration starts says nothing about a parameter: its prior stays where the model has it.
#[test]
fn a_start_does_not_move_a_prior() {
    let text = TEXT.replace(
        "K = { unit = \"-\", start = 1.0 }",
        "K = { unit = \"-\", start = 1.0, sd = 1e-4 }",
    );
    let model = Model::parse("lag", &text, &Constants::default()).unwrap();
    let records = records(&model, 1);
    let from = |start: Option<f64>| {
        let starts = start.map(|value| ("K".to_string(), value)).into_iter().collect();
        let settings = Settings { starts, tolerance: 1e-12, ..Settings::default() };
        let e = estimate(&model, &records, &settings).unwrap();
        let k = e.rows.iter().find(|row| row.name == "K").unwrap().clone();
        (k.value, k.sd_crlb.unwrap())
    };
    let (as_it_is, moved) = (from(None), from(Some(1.4)));
    assert!((as_it_is.0 - moved.0).abs() < 1e-3 * as_it_is.1, "{as_it_is:?} {moved:?}");
    // The truth is 1.2, and the prior is strong.
    assert!((as_it_is.0 - 1.0).abs() < 0.15 && as_it_is.1 < 1e-4, "{as_it_is:?}");
}

/// A model that is held against data as it is, without anything free.
#[test]
fn nothing_free_is_the_minimum() {
    let model = model();
    let nothing = Settings { free: Some(vec![]), ..Settings::default() };
    let e = estimate(&model, &records(&model, 1), &nothing).unwrap();
    assert_eq!((e.stop, e.rows.len(), e.outputs[0].count), (Stop::Converged, 0, 400));
    assert!(e.det_r > 0.0 && e.responses[0][0].modelled.iter().all(|y| y.is_finite()));
}
