//! Records that are late: are they told, by how much, and is nothing told where none is?

use super::{normal, rng};
use crate::dynamics::{Channel, Record};
use crate::estimate::{Estimation, Segment, Settings, estimate, estimate_segments};
use crate::model::{Constants, Model};

const PITCH: &str = r#"
title = "A rate that two surfaces drive"

[inputs]
elevator = "rad"
tab      = "rad"

[parameters]
M_q = { unit = "1/s", start = -1.0 }
M_e = { unit = "1/s^2", start = -4.0 }
M_t = { unit = "1/s^2", start = -1.0 }

[states]
q     = { unit = "rad/s", rate = "M_q*q + M_e*elevator + M_t*tab", start = 0.0 }
theta = { unit = "rad", rate = "q", start = 0.0 }

[outputs]
q     = { unit = "rad/s", value = "q" }
theta = { unit = "rad", value = "theta" }
"#;

/// So late is each record, s.
#[derive(Clone, Copy, Default)]
struct Times {
    elevator: f64,
    tab: f64,
    theta: f64,
}

/// The campaign's inputs: smooth, and none of them the other's.
fn elevator(t: f64) -> f64 {
    0.05 * ((2.0 * t).sin() + (3.7 * t + 0.4).sin())
}

fn tab(t: f64) -> f64 {
    0.1 * ((2.9 * t).sin() + (1.1 * t + 1.0).sin())
}

/// What comes of records that are so late, with white noise, or noise with a neighbour's part `colour`.
fn late(seed: u64, times: Times, colour: f64) -> Estimation {
    estimate(&model(), &[record(seed, times, colour)], &Settings::default()).unwrap()
}

/// What comes of flights that are so late.
fn of_flights(seed: u64, flights: &[Times], colour: f64) -> Estimation {
    let segment = |(i, times): (usize, &Times)| Segment {
        record: record(seed + i as u64, *times, colour),
        labels: [("flight".to_string(), format!("f{i}"))].into(),
        ..Segment::default()
    };
    let segments: Vec<Segment> = flights.iter().enumerate().map(segment).collect();
    estimate_segments(&model(), &segments, &Settings::default()).unwrap()
}

fn model() -> Model {
    Model::parse("pitch", PITCH, &Constants::default()).unwrap()
}

fn record(seed: u64, times: Times, colour: f64) -> Record {
    let mut rng = rng(seed);
    let (n, dt, fine) = (1500, 0.02, 20);
    let (mut q, mut theta) = (0.0, 0.0);
    let mut motion = Vec::new();
    for k in 0..n * fine {
        let (t, h) = (k as f64 * dt / fine as f64, dt / fine as f64);
        motion.push((q, theta));
        let rate = |t: f64, q: f64| -1.5 * q - 5.0 * elevator(t) - 1.2 * tab(t);
        let ahead = q + h * rate(t, q);
        let next = q + 0.5 * h * (rate(t, q) + rate(t + h, ahead));
        theta += 0.5 * h * (q + next);
        q = next;
    }
    let (mut inputs, mut measured) = (Vec::new(), [Vec::new(), Vec::new()]);
    let mut slow = [0.0; 2];
    for k in 0..n {
        let t = k as f64 * dt;
        inputs.extend([elevator(t - times.elevator), tab(t - times.tab)]);
        let back = (times.theta / dt * fine as f64).round() as usize;
        let clean = [motion[k * fine].0, motion[(k * fine).saturating_sub(back)].1];
        for j in 0..2 {
            slow[j] = colour * slow[j] + (1.0 - colour * colour).sqrt() * normal(&mut rng);
            measured[j].push(clean[j] + 0.003 * slow[j]);
        }
    }
    let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
    let channels = measured.into_iter().enumerate();
    let channels =
        channels.map(|(output, z)| Channel { output, t: t.clone().into(), z: z.into() }).collect();
    Record { dt, n, inputs: inputs.into(), channels, ..Record::default() }
}

#[test]
fn a_late_record_is_told_by_its_name_and_time() {
    let cases = [
        ("elevator", Times { elevator: 0.05, ..Times::default() }, 0.05),
        ("tab", Times { tab: -0.03, ..Times::default() }, -0.03),
        ("theta", Times { theta: 0.04, ..Times::default() }, 0.04),
        // so late that the residuals are coloured by it
        ("elevator", Times { elevator: 0.25, ..Times::default() }, 0.25),
        ("tab", Times { tab: -0.2, ..Times::default() }, -0.2),
    ];
    for (record, times, by) in cases {
        let mut z = Vec::new();
        for seed in 0..12 {
            let colour = if seed % 2 == 0 { 0.0 } else { 0.8 };
            let e = late(100 + seed, times, colour);
            let skewed = e.skewed.expect(record);
            assert_eq!(skewed.records.len(), 1, "{record}: {skewed:?}");
            let late = &skewed.records[0];
            assert_eq!(late.record, record);
            z.push((late.by - by) / late.sd);
        }
        let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        assert!(rms < 1.6, "{record}: {z:?}");
    }
}

#[test]
fn two_late_records_are_told_together() {
    let e = late(7, Times { elevator: 0.1, tab: 0.1, theta: 0.0 }, 0.0);
    let skewed = e.skewed.expect("both");
    let names: Vec<&str> = skewed.records.iter().map(|late| &*late.record).collect();
    assert!(names.contains(&"elevator") && names.contains(&"tab"), "{skewed:?}");
    assert!(skewed.records.iter().all(|late| (late.by - 0.1).abs() < 4.0 * late.sd), "{skewed:?}");
}

#[test]
fn a_record_that_is_late_in_one_flight_is_told_of_that_flight() {
    let elevator = Times { elevator: 0.06, ..Times::default() };
    // early ones would begin before the record does
    let tab = Times { tab: 0.06, ..Times::default() };
    let sound = Times::default();
    let all = [elevator; 3];
    for (flights, record, flight, by) in [
        ([sound, elevator, sound], "elevator", Some("f1"), 0.06),
        ([sound, sound, tab], "tab", Some("f2"), 0.06),
        (all, "elevator", None, 0.06),
    ] {
        for seed in 0..6 {
            let colour = if seed % 2 == 0 { 0.0 } else { 0.8 };
            let e = of_flights(500 + 10 * seed, &flights, colour);
            let skewed = e.skewed.expect(record);
            assert_eq!(skewed.records.len(), 1, "{record}: {skewed:?}");
            let late = &skewed.records[0];
            assert_eq!((&*late.record, late.flight.as_deref()), (record, flight), "{skewed:?}");
            assert!((late.by - by).abs() < 4.0 * late.sd, "{skewed:?}");
        }
    }
}

#[test]
fn where_no_flight_is_late_none_is_told() {
    for seed in 0..12 {
        let colour = [0.0, 0.5, 0.9, 0.98][seed as usize % 4];
        let e = of_flights(800 + 10 * seed, &[Times::default(); 4], colour);
        assert_eq!(e.skewed, None, "{seed}");
    }
}

#[test]
fn where_none_is_late_none_is_told() {
    for seed in 0..40 {
        let colour = [0.0, 0.5, 0.9, 0.98][seed as usize % 4];
        let e = late(1000 + seed, Times::default(), colour);
        assert_eq!(e.skewed, None, "{seed}");
    }
}
