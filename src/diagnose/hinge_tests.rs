//! A surface whose hinge has friction, stops, a slowest servo or a sensor with play, which the base model lacks, against the whole
//! library.

use super::effect::{self, Context};
use super::tests::{parsed, steps, told};
use super::*;
use crate::dynamics::{Channel, Directions, Propagator, Record};
use crate::estimate::{self, Segment};
use crate::model::Model;
use crate::simulate::Stream;

/// A surface at 30 rad/s under its servo and the angle of attack; `position` and `velocity` go into the lines of the states, `play` is the
/// line of a state `z`, to where the sensor was pushed: with play it is measured in place of the surface.
fn surface(position: &str, velocity: &str, play: &str) -> Model {
    let measured = if play.is_empty() { "delta" } else { "z + deadband(delta - z, 0.002*one)" };
    parsed(&format!(
        r#"title = "surface"
[inputs]
servo_current = "A"
alpha = "rad"
[constants]
M_i = {{ unit = "rad/(s^2 A)", value = 30.0 }}
one = {{ unit = "rad", value = 1.0 }}
slow = {{ unit = "s", value = 2e-4 }}
[parameters]
M_d = {{ unit = "1/s^2", start = -900.0 }}
M_v = {{ unit = "1/s", start = -25.0 }}
M_a = {{ unit = "1/s^2", start = -100.0 }}
M_0 = {{ unit = "rad/s^2", start = 0.0 }}
[states]
delta = {{ unit = "rad", rate = "delta_dot", start = "measured"{position} }}
delta_dot = {{ unit = "rad/s", rate = "M_i*servo_current + M_d*delta + M_v*delta_dot + M_a*alpha + M_0", start = 0.0{velocity} }}
{play}[outputs]
delta = {{ unit = "rad", value = "{measured}" }}
"#
    ))
}

/// Nine 3211s of four amplitudes, with an angle of attack that follows the servo slowly.
fn flown(truth: &Model, seed: u64) -> Vec<Segment> {
    let propagator = Propagator::new(truth, Directions::default()).expect("a propagator");
    let one = |s: usize| {
        let (dt, n) = (0.01, 1000);
        let amplitude = [1.0, -0.6, 0.8, -1.2][s % 4];
        let (mut inputs, mut alpha) = (Vec::new(), 0.0);
        for k in 0..n {
            let current = steps(f64::from(k) * dt, 1.0, amplitude);
            alpha += dt / 0.7 * (-0.05 * current - alpha);
            inputs.extend([current, alpha]);
        }
        let n = n as usize;
        let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let channels = vec![Channel { output: 0, t: t.into(), z: vec![0.0; n].into() }];
        let mut record =
            Record { dt, n, inputs: inputs.into(), channels, substeps: 128, ..Record::default() };
        let given = propagator.given().iter().map(|_| 0.0).collect::<Vec<_>>();
        let response = propagator.respond(&truth.parameter_starts(), &given, &record, false);
        record.substeps = 2;
        let mut stream = Stream::new(seed, &[&s.to_string()]);
        record.channels[0].z = response.y[0].iter().map(|y| y + 3e-4 * stream.normal()).collect();
        Segment {
            record,
            labels: [("input".to_string(), "servo".to_string())].into(),
            ..Segment::default()
        }
    };
    (0..9).map(one).collect()
}

fn diagnosed(truth: &Model, seed: u64) -> Diagnosis {
    with_noise(truth, seed, 0.0)
}

/// With noise of this sd in the record of the angle of attack, rad.
fn with_noise(truth: &Model, seed: u64, sd: f64) -> Diagnosis {
    let (base, mut segments, settings) =
        (surface("", "", ""), flown(truth, seed), Settings::default());
    for (s, segment) in segments.iter_mut().enumerate() {
        let mut stream = Stream::new(seed, &["vane", &s.to_string()]);
        let mut inputs = segment.record.inputs.to_vec();
        inputs.iter_mut().skip(1).step_by(2).for_each(|alpha| *alpha += sd * stream.normal());
        segment.record.inputs = inputs.into();
    }
    let names: Vec<String> = (0..segments.len()).map(|i| format!("s{i}")).collect();
    let held = held_out(&segments, &names, &settings);
    let records: Vec<&Record> = segments.iter().map(|s| &s.record).collect();
    let context = Context::of(&base, &records);
    let method = estimate::Settings::default();
    let subject = Subject {
        model: &base,
        segments: &segments,
        held_out: &held.held_out,
        method: &method,
        context: &context,
        settings: &settings,
    };
    let library = effect::load(&[]).expect("the library");
    let offer = |model: &Model, wanted: &effect::Wanted| {
        Ok((effect::candidates_of(model, &context, &library, wanted).candidates, Vec::new()))
    };
    diagnose(&subject, &offer, &|_| {}).unwrap_or_else(|e| panic!("{e}"))
}

/// The effects of the class that comes first, what it adds, and the values of the first of them.
fn first(d: &Diagnosis, effect: &str) -> Vec<crate::diagnose::Value> {
    let round = d.rounds.first().expect("a round");
    let class: Vec<&str> = round.class.iter().map(|&i| round.judged[i].effect.as_str()).collect();
    assert!(class.contains(&effect) && class.len() <= 2, "{effect}: {class:?}\n{}", told(d));
    assert_eq!(d.added.len(), 1, "{}", told(d));
    let judged = round.judged.iter().find(|j| j.effect == effect).expect("judged");
    judged.refit.as_ref().expect("refitted").values.clone()
}

fn near(value: &crate::diagnose::Value, truth: f64) {
    let sd = value.sd.expect("sd");
    assert!((value.value - truth).abs() < 4.0 * sd, "{value:?} for {truth}");
}

#[test]
fn recovery_friction_that_the_model_lacks_is_named() {
    for (seed, friction) in [(1, 2.0), (2, 6.0)] {
        let d = diagnosed(&surface("", &format!(", friction = {friction:?}"), ""), seed);
        println!("{}", told(&d));
        near(&first(&d, "hinge-friction")[0], friction);
    }
}

/// A model that follows every small movement of a vane does what friction would have held; that is not named.
#[test]
fn recovery_noise_of_a_vane_is_no_friction() {
    for seed in 11..15 {
        let d = with_noise(&surface("", "", ""), seed, 6e-3);
        println!("{}", told(&d));
        let named: Vec<&str> = d.added.iter().map(|a| a.effect.as_str()).collect();
        // (With so much noise a skew of 0.2 ms has been named beside that of the vane.)
        assert!(named.contains(&"input-noise") || !d.is_named(), "{seed}: {named:?}");
        assert!(named.iter().all(|effect| !effect.starts_with("hinge")), "{seed}: {named:?}");
    }
}

#[test]
fn recovery_friction_beside_noise_of_a_vane_is_named() {
    let d = with_noise(&surface("", ", friction = 2.0", ""), 21, 6e-3);
    println!("{}", told(&d));
    let friction = d.rounds.iter().flat_map(|r| &r.judged).filter(|j| j.effect == "hinge-friction");
    let friction = friction.filter_map(|j| j.refit.as_ref().map(|r| (j.standing, &r.values[0])));
    let all: Vec<_> = friction.collect();
    assert!(all.iter().any(|(_, v)| (v.value - 2.0).abs() < 0.2), "{all:?}");
    assert!(d.added.iter().any(|a| a.effect == "hinge-friction"), "{}", told(&d));
}

#[test]
fn recovery_a_stop_that_the_model_lacks_is_named() {
    let d = diagnosed(&surface(", min = -0.028, max = 0.026", "", ""), 4);
    println!("{}", told(&d));
    let values = first(&d, "hinge-stop");
    let of = |name: &str| values.iter().find(|v| v.name.starts_with(name)).expect(name);
    near(of("low"), -0.028);
    near(of("high"), 0.026);
}

#[test]
fn recovery_a_limit_of_the_velocity_that_the_model_lacks_is_named() {
    let d = diagnosed(&surface("", ", min = -0.5, max = 0.5", ""), 5);
    println!("{}", told(&d));
    let values = first(&d, "hinge-rate-limit");
    near(values.iter().find(|v| v.name.starts_with('R')).expect("R"), 0.5);
}

#[test]
fn recovery_play_of_a_sensor_that_the_model_lacks_is_named() {
    let play = "z = { unit = \"rad\", rate = \"deadband(delta - z, 0.002*one)/slow\", start = \"delta\" }\n";
    let d = diagnosed(&surface("", "", play), 6);
    println!("{}", told(&d));
    let values = first(&d, "sensor-play");
    near(values.iter().find(|v| v.name.starts_with('b')).expect("b"), 0.002);
}

#[test]
fn recovery_nothing_is_named_where_nothing_is_missing() {
    let d = diagnosed(&surface("", "", ""), 3);
    assert_eq!(d.verdict, Verdict::NothingMissing, "{}", told(&d));
}
