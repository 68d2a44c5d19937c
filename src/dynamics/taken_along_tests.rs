//! States that stops take along: play and rate limits against closed forms and against stiff
//! followers, and exact sensitivities against differences.

use super::contact_tests::{model, record, worst};
use super::{Directions, Interpolation, Propagator, Record};
use crate::model::Model;

/// A surface that its servo moves through play, the servo with a limited rate; what comes of both
/// moves a first-order lag. `told`: what the servo is told.
fn chain(told: &str) -> Model {
    model(&format!(
        r#"title = "chain"
[inputs]
u = "rad"
[parameters]
R = {{ unit = "rad/s", start = 0.8 }}
b = {{ unit = "rad", start = 0.03 }}
T = {{ unit = "s", start = 0.037 }}
[states]
surface = {{ unit = "rad", rate = "0", min = "servo - b", max = "servo + b", start = "servo" }}
servo = {{ unit = "rad", rate = "0", min = "{told}", max = "{told}", rate_max = "R", start = "u" }}
q = {{ unit = "rad", rate = "(surface - q)/one", start = 0.0 }}
[constants]
one = {{ unit = "s", value = 1.0 }}
[outputs]
servo = {{ unit = "rad", value = "servo" }}
surface = {{ unit = "rad", value = "surface" }}
q = {{ unit = "rad", value = "q" }}
"#
    ))
}

fn values(model: &Model, record: &Record) -> Vec<[f64; 3]> {
    let propagator = Propagator::new(model, Directions::default()).expect("a propagator");
    let grid = propagator.run(&model.parameter_starts(), &[], record, false);
    assert!(grid.finite, "{:?}", grid.lost);
    grid.y.chunks(3).map(|y| [y[0], y[1], y[2]]).collect()
}

#[test]
fn truth_a_step_becomes_a_ramp_and_play_takes_its_share_of_it() {
    let model = chain("u");
    // One second at rest, a step of 1 rad within a sample, back after three seconds.
    let record = record(600, 0.01, |t| if (1.0..4.0).contains(&t) { 1.0 } else { 0.0 });
    for (k, [servo, surface, _]) in values(&model, &record).into_iter().enumerate() {
        let t = k as f64 * 0.01;
        // The ramp begins with the sample in which the record steps.
        let up = (0.8 * (t - 0.99)).clamp(0.0, 1.0);
        let down = (0.8 * (t - 3.99)).clamp(0.0, 1.0);
        assert!((servo - (up - down)).abs() < 1e-12, "{t}: {servo}");
        let wanted = match t < 3.99 {
            true => (up - 0.03).max(0.0),
            false => (1.0 - down + 0.03).min(0.97),
        };
        assert!((surface - wanted).abs() < 1e-12, "{t}: {surface} {wanted}");
    }
}

#[test]
fn a_delay_reads_what_is_smoothed_and_ramps_as_they_are() {
    let model = model(
        r#"title = "late"
[inputs]
u = "rad"
[parameters]
T = { unit = "s", start = 0.3 }
w = { unit = "rad", start = 0.2 }
tau = { unit = "s", start = 0.1 }
[states]
x = { unit = "rad", rate = "0/one", start = 0.0 }
[constants]
one = { unit = "s", value = 1.0 }
[outputs]
now = { unit = "rad", value = "smooth(u, T, w)" }
late = { unit = "rad", value = "delay(smooth(u, T, w), tau)" }
ago = { unit = "rad", value = "delay(u, tau)" }
"#,
    );
    // A ramp that begins at a sample; a tenth of a second are five samples, and 0.11 s five and a half.
    let ramp = record(200, 0.02, |t| (t - 1.0).clamp(0.0, 1.0));
    let y = values(&model, &ramp);
    (5..200).for_each(|k| assert!((y[k][1] - y[k - 5][0]).abs() < 1e-12, "{k}"));
    let mut between = model.clone();
    between.parameters[2].start = 0.11;
    let corner = |kind: Interpolation| {
        let ramps = Record { interpolation: vec![kind], ..ramp.clone() };
        (0..200)
            .map(|k| {
                let truth = (k as f64 * 0.02 - 1.11).clamp(0.0, 1.0);
                (values(&between, &ramps)[k][2] - truth).abs()
            })
            .fold(0.0, f64::max)
    };
    assert!(corner(Interpolation::Ramps) < 1e-12);
    assert!(corner(Interpolation::Linear) > 1e-3);
}

#[test]
fn what_is_slow_is_followed_and_nothing_asks_for_short_steps() {
    let model = chain("u");
    let slow = record(900, 0.02, |t| 0.3 * (2.0 * t).sin());
    let now = values(&model, &slow);
    now.iter().zip(slow.inputs.iter()).for_each(|(y, u)| assert!((y[0] - u).abs() < 1e-15));
    let directions = Directions { parameters: vec![0, 1, 2], starts: Vec::new() };
    let propagator = Propagator::new(&model, directions).expect("a propagator");
    // Four because the surface depends on the servo, and no more.
    assert_eq!(propagator.substeps(&model.parameter_starts(), &[], &slow), 4);
}

#[test]
fn it_is_what_a_stiff_follower_tends_to() {
    let stiff = model(
        r#"title = "stiff"
[inputs]
u = "rad"
[parameters]
R = { unit = "rad/s", start = 0.8 }
b = { unit = "rad", start = 0.03 }
T = { unit = "s", start = 0.037 }
tau = { unit = "s", start = 2e-4 }
[states]
servo = { unit = "rad", rate = "clamp((u - servo)/tau, -R, R)", start = "u" }
surface = { unit = "rad", rate = "deadband(servo - surface, b)/tau", start = "u" }
q = { unit = "rad", rate = "(surface - q)/one", start = 0.0 }
[constants]
one = { unit = "s", value = 1.0 }
[outputs]
servo = { unit = "rad", value = "servo" }
surface = { unit = "rad", value = "surface" }
q = { unit = "rad", value = "q" }
"#,
    );
    let motion = |t: f64| 0.4 * (1.7 * t).sin() + 0.2 * (6.1 * t).sin();
    // Four steps to a sample, as the program takes them here by itself.
    let finer = Record { substeps: 4, ..record(500, 0.02, motion) };
    let (exact, near) = (values(&chain("u"), &finer), values(&stiff, &record(500, 0.02, motion)));
    for (k, (a, b)) in exact.iter().zip(&near).enumerate() {
        // The follower is tau late where it follows; where the servo turns inside a step the surface
        // is taken along to the parabola's turn and not to the corner's, a part of R h.
        let far = |j: usize| (a[j] - b[j]).abs();
        assert!(far(0) < 3.0 * 2e-4 * 0.8 && far(2) < 1e-3, "{k}: {a:?} {b:?}");
        assert!(far(1) < 0.4 * 0.8 * 0.005 + 2e-4, "{k}: {a:?} {b:?}");
    }
}

#[test]
fn sensitivities_of_play_and_rate_limits_agree_with_differences() {
    let motion = |t: f64| 0.4 * (1.7 * t).sin() + 0.2 * (6.1 * t).sin();
    for told in [
        "u",
        "delay(u, T)",
        "u + 0.1*smooth(u, 10*T, b) + 0.2*q",
        "delay(q, 2*T) + 0.5*u",
        "delay(smooth(u, 10*T, b), 2*T) + 0.2*q",
    ] {
        let worst = worst(&chain(told), &record(700, 0.02, motion));
        assert!(worst < 1e-4, "{told}: {worst}");
    }
}

/// A servo that follows a lag of the input no faster than it can.
const LAGGED: &str = r#"title = "lagged"
[inputs]
u = "rad"
[parameters]
R = { unit = "rad/s", start = 0.8 }
T = { unit = "s", start = 0.12 }
[states]
c = { unit = "rad", rate = "(u - c)/T", start = "u" }
z = { unit = "rad", rate = "0", min = "c", max = "c", rate_max = "R", start = "u" }
q = { unit = "rad", rate = "(z - q)/one", start = 0.0 }
[constants]
one = { unit = "s", value = 1.0 }
[outputs]
z = { unit = "rad", value = "z" }
c = { unit = "rad", value = "c" }
q = { unit = "rad", value = "q" }
"#;

#[test]
fn where_a_stop_becomes_too_fast_inside_a_step_it_is_left_there() {
    let (model, motion) = (model(LAGGED), |t: f64| 0.5 * (2.3 * t).sin() + 0.3 * (5.9 * t).sin());
    let fine = values(&model, &record(20_000, 0.0005, motion));
    let off = |every: usize| {
        let dt = 0.0005 * every as f64;
        let coarse = values(&model, &record(20_000 / every, dt, motion));
        let far = |(k, y): (usize, &[f64; 3])| (y[0] - fine[k * every][0]).abs();
        coarse.iter().enumerate().map(far).fold(0.0, f64::max)
    };
    // R h is 16 mrad and 8 mrad: a third of that where the servo stayed on the stop to the step's end.
    let (at_20_ms, at_10_ms) = (off(40), off(20));
    assert!(at_20_ms < 1e-3 && at_10_ms < 0.4 * at_20_ms, "{at_20_ms} {at_10_ms}");
    let worst = worst(&model, &record(500, 0.02, motion));
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn hazard_stops_that_cross_and_a_rate_below_zero_end_no_program() {
    let crossed = model(
        r#"title = "crossed"
[inputs]
u = "m"
[parameters]
b = { unit = "m", start = -0.1 }
[states]
x = { unit = "m", rate = "0", min = "u - b", max = "u + b", start = "u" }
[outputs]
x = { unit = "m", value = "x" }
"#,
    );
    let directions = Directions { parameters: vec![0], starts: Vec::new() };
    let propagator = Propagator::new(&crossed, directions).expect("a propagator");
    let slow = record(100, 0.02, |t| t.sin());
    let grid = propagator.run(&crossed.parameter_starts(), &[], &slow, true);
    assert!(grid.finite && grid.dy.iter().all(|s| s.is_finite()));
    let negative = model(&LAGGED.replace("start = 0.8", "start = -0.8"));
    let propagator = Propagator::new(&negative, Directions::default()).expect("a propagator");
    assert!(!propagator.run(&negative.parameter_starts(), &[], &slow, false).finite);
}

#[test]
fn hazard_limits_that_depend_on_each_other_are_an_error() {
    let text = r#"title = "circle"
[inputs]
u = "m"
[states]
x = { unit = "m", rate = "0", min = "y", start = 0.0 }
y = { unit = "m", rate = "0", max = "x + u", start = 0.0 }
[outputs]
x = { unit = "m", value = "x" }
"#;
    let told = Model::parse("circle", text, &Default::default()).expect_err("an error").to_string();
    assert!(told.contains("the limits of \"x\", \"y\" depend on each other"), "{told}");
}
