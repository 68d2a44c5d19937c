//! Friction and stops: against closed forms, and exact sensitivities against differences.

use super::{Directions, Interpolation, Lost, Propagator, Record};
use crate::model::{Constants, Model};

pub(super) fn model(text: &str) -> Model {
    Model::parse("test", text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"))
}

pub(super) fn record(n: usize, dt: f64, input: impl Fn(f64) -> f64) -> Record {
    let inputs = (0..n).map(|k| input(k as f64 * dt)).collect();
    Record { dt, n, inputs, ..Record::default() }
}

/// A sledge that is pulled: `x'' = u - F sign(x')`.
const SLEDGE: &str = r#"title = "sledge"
[inputs]
u = "m/s^2"
[parameters]
F = { unit = "m/s^2", start = 2.0, min = 0.0 }
v_0 = { unit = "m/s", start = 3.0 }
[states]
x = { unit = "m", rate = "v", start = 0.0 }
v = { unit = "m/s", rate = "u", start = "v_0", friction = "F" }
[outputs]
x = { unit = "m", value = "x" }
v = { unit = "m/s", value = "v" }
a = { unit = "m/s^2", value = "rate(v)" }
"#;

#[test]
fn truth_a_sledge_slides_to_its_rest_and_stays() {
    let model = model(SLEDGE);
    let all = Directions { parameters: vec![0, 1], starts: Vec::new() };
    let propagator = Propagator::new(&model, all).expect("a propagator");
    let grid = propagator.run(&model.parameter_starts(), &[], &record(1000, 0.01, |_| 0.0), true);
    let at = |k: usize, j: usize| grid.y[k * 3 + j];
    let slope = |k: usize, j: usize, p: usize| grid.dy[(k * 3 + j) * 2 + p];
    // v = v0 - F t until t = v0/F = 1.5 s; x = v0^2/(2 F)
    assert!((at(100, 1) - 1.0).abs() < 1e-12 && (at(100, 2) + 2.0).abs() < 1e-12);
    for k in [151, 400, 999] {
        assert!((at(k, 0) - 2.25).abs() < 1e-11, "{}", at(k, 0));
        assert_eq!((at(k, 1), at(k, 2)), (0.0, 0.0));
        assert!((slope(k, 0, 0) + 9.0 / 8.0).abs() < 1e-9, "dx/dF {}", slope(k, 0, 0));
        assert!((slope(k, 0, 1) - 1.5).abs() < 1e-9, "dx/dv0 {}", slope(k, 0, 1));
        assert_eq!((slope(k, 1, 0), slope(k, 1, 1)), (0.0, 0.0));
    }
}

#[test]
fn truth_a_force_below_friction_moves_nothing() {
    let model = model(&SLEDGE.replace("start = 3.0", "start = 0.0"));
    let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
    // A surface held to within 95% of its friction, one way and the other, for a minute.
    let pull = |t: f64| 1.9 * (if t.sin() > 0.0 { 1.0 } else { -1.0 });
    let grid = propagator.run(&model.parameter_starts(), &[], &record(6000, 0.01, pull), false);
    assert!(grid.finite && grid.y.chunks(3).all(|y| y[0] == 0.0 && y[1] == 0.0 && y[2] == 0.0));
    assert_eq!(grid.stuck, [1]);
    let more = |t: f64| if t > 3.0 { 2.1 } else { 1.9 };
    let grid = propagator.run(&model.parameter_starts(), &[], &record(600, 0.01, more), false);
    assert!(grid.stuck.is_empty() && grid.finite, "{:?}", grid.lost);
    // The input is a ramp from 1.9 to 2.1 over one sample: it is let go in its middle.
    let (t, from) = (5.99f64, 3.005);
    let wanted = 0.1 * (t - from - 0.005) + 0.5 * 20.0 * 0.005f64.powi(2);
    assert!((grid.y[599 * 3 + 1] - wanted).abs() < 1e-10, "{} {wanted}", grid.y[599 * 3 + 1]);
}

/// A surface on an elastic link, with friction, damping and stops; `more` goes into its states.
fn surface(more: &str) -> String {
    format!(
        r#"title = "surface"
[inputs]
u = "rad"
[parameters]
k = {{ unit = "1/s^2", start = 900.0 }}
c = {{ unit = "1/s", start = 6.0 }}
F = {{ unit = "1/s^2", start = 40.0, min = 0.0 }}
stop = {{ unit = "rad", start = 0.2 }}
[states]
d = {{ unit = "rad", rate = "w", start = 0.0 {more} }}
w = {{ unit = "rad/s", rate = "k*(u - d) - c*w", start = 0.0, friction = "F" }}
[outputs]
d = {{ unit = "rad", value = "d" }}
w = {{ unit = "rad/s", value = "w" }}
"#
    )
}

/// The largest difference between sensitivities and central differences, over the largest
/// sensitivity of each output and direction.
pub(super) fn worst(model: &Model, record: &Record) -> f64 {
    let n = model.parameters.len();
    let all = Directions { parameters: (0..n).collect(), starts: Vec::new() };
    let propagator = Propagator::new(model, all).expect("a propagator");
    let (theta, ny) = (model.parameter_starts(), model.outputs.len());
    let exact = propagator.run(&theta, &[], record, true);
    assert!(exact.finite, "{:?}", exact.lost);
    let mut worst = 0.0f64;
    for p in 0..n {
        let step = 1e-6 * theta[p].abs().max(1e-3);
        let moved = |by: f64| {
            let mut theta = theta.clone();
            theta[p] += by;
            propagator.run(&theta, &[], record, false).y
        };
        let (up, down) = (moved(step), moved(-step));
        for j in 0..ny {
            let of = |k: usize| exact.dy[(k * ny + j) * n + p];
            let size = (0..exact.n).map(|k| of(k).abs()).fold(0.0, f64::max);
            for k in 0..exact.n {
                let difference = (up[k * ny + j] - down[k * ny + j]) / (2.0 * step);
                let error = (of(k) - difference).abs();
                assert!(size > 0.0 || error < 1e-8, "{error} where nothing depends on it");
                worst = worst.max(if size > 0.0 { error / size } else { 0.0 });
            }
        }
    }
    worst
}

/// How often an output comes to rest.
fn stops(model: &Model, record: &Record, output: usize) -> usize {
    let propagator = Propagator::new(model, Directions::default()).expect("a propagator");
    let grid = propagator.run(&model.parameter_starts(), &[], record, false);
    let ny = model.outputs.len();
    let still: Vec<bool> = grid.y.chunks(ny).map(|y| y[output] == 0.0).collect();
    still.windows(2).filter(|w| !w[0] && w[1]).count()
}

#[test]
fn sensitivities_of_friction_agree_with_differences_over_ten_stops() {
    let model = model(&surface(""));
    let record = record(2000, 0.01, |t| 0.3 * (1.9 * t).sin() + 0.1 * (5.3 * t).sin());
    assert!(stops(&model, &record, 1) >= 10, "{}", stops(&model, &record, 1));
    let worst = worst(&model, &record);
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn sensitivities_of_friction_and_a_stop_on_one_surface_agree_with_differences() {
    let model = model(&surface(r#", min = "-stop", max = "stop""#));
    let record = record(2000, 0.01, |t| 0.4 * (1.9 * t).sin() + 0.1 * (5.3 * t).sin());
    let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
    let grid = propagator.run(&model.parameter_starts(), &[], &record, false);
    let on = |side: f64| grid.y.chunks(2).filter(|y| y[0] == 0.2 * side && y[1] == 0.0).count();
    assert!(on(1.0) > 50 && on(-1.0) > 50, "{} {}", on(1.0), on(-1.0));
    assert!(grid.y.chunks(2).all(|y| y[0].abs() <= 0.2));
    let worst = worst(&model, &record);
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn a_surface_leaves_its_stop_at_once_when_the_command_turns() {
    let model = model(&surface(r#", max = "stop""#).replace("start = 40.0", "start = 0.0"));
    let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
    let record = record(300, 0.01, |t| if t < 2.0 { 0.5 } else { 0.1 });
    let grid = propagator.run(&model.parameter_starts(), &[], &record, false);
    assert_eq!((grid.y[199 * 2], grid.y[199 * 2 + 1]), (0.2, 0.0));
    // A system of second order from rest at 0.2, led to 0.1: -90 rad/s^2 at once, after the last
    // quarter of the command's ramp over one sample.
    let w = grid.y[201 * 2 + 1];
    let expected = -90.0 * (0.01 + 0.5 * 0.0025);
    assert!((w / expected - 1.0).abs() < 0.06, "{w} {expected}");
}

#[test]
fn sensitivities_on_a_stop_that_moves_are_those_of_the_stop() {
    let text = surface(r#", min = "-stop", max = "stop - slower*s""#)
        .replace(", friction = \"F\"", "")
        .replace("F = { unit = \"1/s^2\", start = 40.0, min = 0.0 }\n", "")
        .replace("[parameters]", "[parameters]\nslower = { unit = \"rad\", start = 0.05 }")
        .replace(
            "[states]",
            "[states]\ns = { unit = \"-\", rate = \"(u_s - s)*rate_s\", start = 0.0 }",
        )
        .replace(
            "[outputs]",
            "[equations]\nu_s = \"u/0.4\"\n[outputs]\ns = { unit = \"-\", value = \"s\" }",
        )
        .replace("[inputs]", "[constants]\nrate_s = { unit = \"1/s\", value = 0.7 }\n[inputs]");
    let model = model(&text);
    let record = record(2000, 0.01, |t| 0.4 * (1.9 * t).sin() + 0.1 * (5.3 * t).sin());
    let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
    let grid = propagator.run(&model.parameter_starts(), &[], &record, false);
    let d = model.output("d").expect("an output");
    let s = model.output("s").expect("an output");
    let on = grid.y.chunks(3).filter(|y| (y[d] - (0.2 - 0.05 * y[s])).abs() < 1e-12).count();
    assert!(on > 50, "{on}");
    // The stop depends on both parameters by itself; on it, nothing else matters. What is let go has
    // no velocity, and a stop that goes on inwards pushes it meanwhile: how long is known to the
    // step, so that what follows is right to a percent.
    let all = Directions { parameters: (0..model.parameters.len()).collect(), starts: Vec::new() };
    let propagator = Propagator::new(&model, all).expect("a propagator");
    let exact = propagator.run(&model.parameter_starts(), &[], &record, true);
    let (n, slower) = (model.parameters.len(), model.parameter("slower").expect("a parameter"));
    for k in (0..exact.n)
        .filter(|k| (exact.y[k * 3 + d] - (0.2 - 0.05 * exact.y[k * 3 + s])).abs() < 1e-12)
    {
        let of = |p: usize| exact.dy[(k * 3 + d) * n + p];
        assert!((of(slower) + exact.y[k * 3 + s]).abs() < 1e-12, "{k}: {}", of(slower));
        assert!((of(model.parameter("stop").expect("one")) - 1.0).abs() < 1e-12);
    }
    let worst = worst(&model, &record);
    assert!(worst < 0.02, "{worst}");
}

/// Two inertias on an elastic shaft, each with friction.
const PAIR: &str = r#"title = "pair"
[inputs]
u = "rad/s^2"
[parameters]
k = { unit = "1/s^2", start = 400.0 }
c = { unit = "1/s", start = 2.0 }
F_1 = { unit = "rad/s^2", start = 3.0 }
F_2 = { unit = "rad/s^2", start = 10.0 }
[states]
a = { unit = "rad", rate = "v", start = 0.0 }
v = { unit = "rad/s", rate = "u - k*(a - b) - c*(v - w)", start = 0.0, friction = "F_1" }
b = { unit = "rad", rate = "w", start = 0.0 }
w = { unit = "rad/s", rate = "k*(a - b) + c*(v - w)", start = 0.0, friction = "F_2" }
[outputs]
v = { unit = "rad/s", value = "v" }
w = { unit = "rad/s", value = "w" }
"#;

#[test]
fn coupled_inertias_stick_separately_and_together() {
    let model = model(PAIR);
    let record = record(3000, 0.01, |t| 25.0 * (0.8 * t).sin() * (0.05 * t).cos());
    let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
    let grid = propagator.run(&model.parameter_starts(), &[], &record, false);
    let count = |is: fn(&[f64]) -> bool| grid.y.chunks(2).filter(|y| is(y)).count();
    let both = count(|y| y[0] == 0.0 && y[1] == 0.0);
    let (first, second) =
        (count(|y| y[0] == 0.0 && y[1] != 0.0), count(|y| y[0] != 0.0 && y[1] == 0.0));
    assert!(both > 20 && first + second > 20 && second > 5, "{both} {first} {second}");
    let worst = worst(&model, &record);
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn fault_a_motion_that_is_given_up_says_why() {
    let fast = model(
        &SLEDGE
            .replace("rate = \"u\"", "rate = \"u - v*q\"")
            .replace("[parameters]", "[parameters]\nq = { unit = \"1/s\", start = 1e6 }"),
    );
    let propagator = Propagator::new(&fast, Directions::default()).expect("a propagator");
    let grid = propagator.run(&fast.parameter_starts(), &[], &record(10, 0.01, |_| 0.0), false);
    let Some(Lost::Stiff { state: 1, time_constant }) = grid.lost else {
        panic!("{:?}", grid.lost)
    };
    assert!((time_constant - 1e-6).abs() < 1e-9);
    let negative = model(SLEDGE);
    let propagator = Propagator::new(&negative, Directions::default()).expect("a propagator");
    let grid = propagator.run(&[-1.0, 0.0], &[], &record(10, 0.01, |_| 0.0), false);
    assert_eq!(grid.lost, Some(Lost::Negative { state: 1 }));
}

#[test]
fn truth_a_held_command_is_a_step() {
    let lag = model(
        r#"title = "lag"
[inputs]
u = "rad"
[parameters]
T = { unit = "s", start = 0.05 }
[states]
x = { unit = "rad", rate = "(u - x)/T", start = 0.0 }
[outputs]
x = { unit = "rad", value = "x" }
"#,
    );
    let propagator = Propagator::new(&lag, Directions { parameters: vec![0], starts: Vec::new() });
    let propagator = propagator.expect("a propagator");
    let step = |interpolation| {
        let step = record(100, 0.01, |t| if t > 0.195 { 1.0 } else { 0.0 });
        propagator.run(&[0.05], &[], &Record { interpolation, ..step }, true)
    };
    let (held, linear) = (step(vec![Interpolation::Hold]), step(Vec::new()));
    // 1 - exp(-(t - 0.2)/T), known to the integration
    let exact = |k: usize| 1.0 - (-(k as f64 - 20.0) * 0.01 / 0.05).exp();
    for k in 20..100 {
        assert!((held.y[k] - exact(k)).abs() < 1e-5, "{k}: {} {}", held.y[k], exact(k));
    }
    // A ramp over the sample before is half a sample early.
    assert!(linear.y[21] - exact(21) > 0.07, "{}", linear.y[21]);
}
