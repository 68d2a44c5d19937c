//! Hazards of estimating: delays of any length, limits, pre-roll, stiff models; and data that say
//! nothing. Each on estimates.

use super::{normal, rng};
use crate::dynamics::{Channel, Directions, Interpolation, Propagator, Record};
use crate::estimate::{Estimation, Settings, Stop, estimate};
use crate::model::{Constants, Model};

const DT: f64 = 0.05;

pub fn model(text: &str) -> Model {
    Model::parse("hazard", text, &Constants::default()).unwrap()
}

pub const DELAYED: &str = r#"
title = "A lag driven late, and the same read late"

[inputs]
u = "rad"

[parameters]
K   = { unit = "1/s", start = 1.5 }
T   = { unit = "s", start = 0.5, min = 0.01 }
tau = { unit = "s", start = 0.02, min = 0.0, max = 3.0 }

[states]
x = { unit = "rad", rate = "K*OF - x/T", start = 0.0 }

[outputs]
x = { unit = "rad", value = "x" }
"#;

/// Delay of the input, and of the state in a feedback.
fn delayed() -> [Model; 2] {
    [DELAYED.replace("OF", "delay(u, tau)"), DELAYED.replace("OF", "(u - 0.4*delay(x, tau))")]
        .map(|text| model(&text))
}

/// A smooth input that is already moving when the record begins.
fn input(t: f64) -> f64 {
    (1.3 * t).sin() + 0.6 * (2.9 * t + 0.4).cos()
}

pub fn empty(n: usize, start: usize, count: usize) -> Record {
    let t = |k: usize| (start + k) as f64 * DT;
    let channels = (0..count)
        .map(|output| Channel {
            output,
            t: (0..n - start).map(t).collect(),
            z: vec![0.0; n - start].into(),
        })
        .collect();
    Record {
        dt: DT,
        n,
        start,
        inputs: (0..n).map(|k| input(k as f64 * DT)).collect(),
        channels,
        ..Record::default()
    }
}

/// A record of what the model says at `parameters`, with noise.
pub fn flown(model: &Model, parameters: &[f64], mut record: Record, seed: u64, sd: f64) -> Record {
    let propagator = Propagator::new(model, Directions::default()).unwrap();
    let y = propagator.respond(parameters, &[], &record, false).y;
    let mut rng = rng(seed);
    for (channel, y) in record.channels.iter_mut().zip(y) {
        channel.z = y.iter().map(|y| y + sd * normal(&mut rng)).collect();
    }
    record
}

fn within(e: &Estimation, name: &str, truth: f64, most: f64) {
    let row = e.rows.iter().find(|r| r.name == name).unwrap();
    let sd = row.sd.unwrap_or(f64::NAN);
    assert!((row.value - truth).abs() < 3.5 * sd && sd < most, "{row:?}, truth {truth}");
}

/// The exact derivative with respect to the delay is that of differences: shorter than a step, on
/// grid points, between them, longer than what was flown. On a grid point, where how the history is
/// read changes, it is that of one of the two sides.
/// A command that holds its value from one sample to the next, and a lag that answers exactly: the delay
/// comes out as it is, not half a sample longer, also where it is no whole number of samples.
#[test]
fn recovery_a_delay_of_a_held_command() {
    let model = model(&DELAYED.replace("OF", "delay(u, tau)"));
    // T and K T
    let (dt, n, lag, gain) = (0.025, 400, 0.3, 0.6);
    for tau in [0.02, 0.03, 0.06] {
        let u: Vec<f64> = (0..n).map(|k| [0.0, 1.0, -1.0, 0.5][(k / 23) % 4]).collect();
        // x' = (gain u - x)/lag between the edges, which come at k dt + tau.
        let (mut x, mut t, mut z) = (0.0, 0.0, Vec::new());
        let value = |t: f64| u[(((t - tau) / dt + 1e-9).floor().max(0.0) as usize).min(n - 1)];
        for k in 0..n {
            let end = k as f64 * dt;
            while t < end - 1e-12 {
                let edge = (((t - tau) / dt + 1e-9).floor() + 1.0) * dt + tau;
                let next = edge.min(end);
                let goal = gain * value(t);
                x = goal + (x - goal) * libm::exp(-(next - t) / lag);
                t = next;
            }
            z.push(x);
        }
        let stamps: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let record = Record {
            dt,
            n,
            inputs: u.clone().into(),
            channels: vec![Channel { output: 0, t: stamps.into(), z: z.into() }],
            interpolation: vec![Interpolation::Hold],
            ..Record::default()
        };
        let e = estimate(&model, &[record], &Settings::default()).unwrap();
        let found = e.rows.iter().find(|row| row.name == "tau").unwrap().value;
        println!("tau {tau}: {found:.5}");
        assert_eq!(e.stop, Stop::Converged);
        assert!((found - tau).abs() < 0.05 * dt, "{tau}: {found}");
    }
}

#[test]
fn sensitivities_to_a_delay_are_exact_at_any_length() {
    for (which, model) in delayed().into_iter().enumerate() {
        let propagator =
            Propagator::new(&model, Directions { parameters: vec![0, 1, 2], starts: vec![] })
                .unwrap();
        let record = Record { substeps: 4, ..empty(200, 40, 1) };
        for steps in [0.3, 0.999, 1.0, 1.001, 2.5, 7.0, 7.3, 39.9, 60.2, 500.0] {
            let at = |h: f64, exact: bool| {
                propagator.run(&[1.5, 0.5, steps * DT + h], &[], &record, exact)
            };
            let h = 1e-6;
            let (here, up, down) = (at(0.0, true), at(h, false), at(-h, false));
            let size = here.dy.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            for k in 0..here.n {
                let sides = [(up.y[k] - here.y[k]) / h, (here.y[k] - down.y[k]) / h];
                let exact = here.dy[3 * k + 2];
                let gap = sides.iter().map(|d| (exact - d).abs()).fold(f64::INFINITY, f64::min);
                assert!(
                    gap < 1e-5 * size + 1e-8,
                    "model {which}, {steps} steps, point {k}: {exact} and {sides:?}"
                );
            }
        }
    }
}

#[test]
fn recovery_of_delays_across_grid_points_and_below_a_step() {
    for (which, model) in delayed().into_iter().enumerate() {
        for (seed, tau) in [(1, 0.3 * DT), (2, 1.6 * DT), (3, 5.0 * DT), (4, 9.7 * DT)] {
            let record = Record { substeps: 4, ..empty(400, 40, 1) };
            let record = flown(&model, &[1.2, 0.6, tau], record, seed + 10 * which as u64, 0.001);
            for start in [0.0, 4.2 * DT] {
                let settings =
                    Settings { starts: [("tau".to_string(), start)].into(), ..Settings::default() };
                let e = estimate(&model, std::slice::from_ref(&record), &settings).unwrap();
                assert_eq!(e.stop, Stop::Converged, "{which} {tau} from {start}");
                within(&e, "tau", tau, 0.02);
                within(&e, "K", 1.2, 0.02);
                within(&e, "T", 0.6, 0.02);
            }
        }
    }
}

/// The delayed input reads what was flown before the segment, where that is known; without it, its
/// first value.
#[test]
fn recovery_of_a_delay_needs_the_preroll() {
    let [model, _] = delayed();
    let record =
        flown(&model, &[1.2, 0.6, 0.8], Record { substeps: 2, ..empty(120, 40, 1) }, 5, 0.002);
    let e = estimate(&model, std::slice::from_ref(&record), &Settings::default()).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    within(&e, "tau", 0.8, 0.01);
    let known = e.det_r;
    let cut = Record {
        inputs: record.inputs[40..].to_vec().into(),
        n: 80,
        start: 0,
        t0: 40.0 * DT,
        ..record
    };
    let e = estimate(&model, &[cut], &Settings::default()).unwrap();
    assert!(
        e.det_r > 10.0 * known,
        "without pre-roll the response cannot be met: {} and {known}",
        e.det_r
    );
}

#[test]
fn fault_a_segment_shorter_than_the_delay_says_nothing_of_it() {
    let [model, _] = delayed();
    let long =
        flown(&model, &[1.2, 0.6, 0.8], Record { substeps: 2, ..empty(300, 40, 1) }, 6, 0.005);
    let short =
        flown(&model, &[1.2, 0.6, 0.8], Record { substeps: 2, ..empty(12, 0, 1) }, 7, 0.005);
    let settings = Settings { starts: [("tau".to_string(), 0.7)].into(), ..Settings::default() };
    let e = estimate(&model, std::slice::from_ref(&short), &settings).unwrap();
    assert_eq!((e.stop, e.verdict.combinations.len()), (Stop::Converged, 0));
    // The delay stays where it is; of the others the data say what they can.
    assert!(e.rows.iter().all(|r| r.idle == (r.name == "tau") && r.sd.is_none() == r.idle));
    let tau = e.rows.iter().find(|r| r.idle).unwrap();
    assert_eq!(tau.value, tau.start);
    let refuse =
        Settings { without_effect: crate::estimate::WithoutEffect::Refuse, ..settings.clone() };
    let e = estimate(&model, std::slice::from_ref(&short), &refuse).unwrap();
    assert_eq!(e.stop, Stop::Singular);
    assert_eq!(e.verdict.combinations[0].to_string(), "tau has no effect on the measured outputs");
    assert!(e.rows.iter().all(|r| r.sd.is_none()));
    // It costs nothing where another one knows the delay.
    let both = estimate(&model, &[short, long], &settings).unwrap();
    assert_eq!((both.stop, both.left_out.len()), (Stop::Converged, 0));
    within(&both, "tau", 0.8, 0.02);
}

const STOPPED: &str = r#"
title = "An actuator against its stop, and what it moves"

[inputs]
u = "rad"

[parameters]
K    = { unit = "-", start = 1.4 }
T    = { unit = "s", start = 0.3, min = 0.02 }
stop = { unit = "rad", start = 0.7 }

[states]
x = { unit = "rad", rate = "(K*u - x)/T", start = 0.0, max = "stop" }
w = { unit = "rad s", rate = "x - w/T", start = 0.0 }

[outputs]
x = { unit = "rad", value = "x" }
w = { unit = "rad s", value = "w" }
"#;

/// Sensitivities through contacts are those of differences, of what runs against the stop and of
/// what only sees it.
#[test]
fn sensitivities_through_contacts_are_exact() {
    let model = model(STOPPED);
    let propagator =
        Propagator::new(&model, Directions { parameters: vec![0, 1, 2], starts: vec![] }).unwrap();
    let record = Record { substeps: 2, ..empty(400, 0, 2) };
    let truth = [1.2, 0.4, 0.8];
    let here = propagator.run(&truth, &[], &record, true);
    let resting = (0..here.n).filter(|k| here.y[2 * k] == 0.8).count();
    assert!(resting > 50 && (0..here.n).all(|k| here.y[2 * k] <= 0.8), "{resting}");
    for which in 0..3 {
        let at = |h: f64| {
            let mut p = truth;
            p[which] += h;
            propagator.run(&p, &[], &record, false)
        };
        let (up, down) = (at(1e-7), at(-1e-7));
        for k in 0..here.y.len() {
            let (difference, exact) = ((up.y[k] - down.y[k]) / 2e-7, here.dy[3 * k + which]);
            assert!(
                (difference - exact).abs() < 1e-5,
                "parameter {which}, value {k}: {difference} {exact}"
            );
        }
    }
}

/// A finely integrated actuator runs against its stop several times.
#[test]
fn recovery_of_a_stop_and_of_what_moves_between() {
    let model = model(STOPPED);
    let fine =
        flown(&model, &[1.2, 0.4, 0.8], Record { substeps: 64, ..empty(400, 0, 2) }, 8, 0.003);
    assert!(fine.channels[0].z.iter().filter(|z| **z > 0.79).count() > 50);
    let e = estimate(&model, &[Record { substeps: 0, ..fine }], &Settings::default()).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    within(&e, "stop", 0.8, 0.005);
    within(&e, "K", 1.2, 0.01);
    within(&e, "T", 0.4, 0.01);
}

/// Where contacts come and go as a parameter changes, the cost has no jump as large as that of one
/// standard deviation (0.5), and finer steps make it vanish.
#[test]
fn the_cost_is_continuous_where_contacts_come_and_go() {
    let model = model(STOPPED);
    let propagator = Propagator::new(&model, Directions::default()).unwrap();
    for (substeps, most) in [(1, 0.05), (8, 0.05)] {
        let record =
            flown(&model, &[1.2, 0.4, 0.8], Record { substeps, ..empty(400, 0, 2) }, 9, 0.003);
        for which in 0..3 {
            let cost = |i: usize| {
                let mut p = [1.2, 0.4, 0.8];
                p[which] *= 1.0 + 4e-5 * (i as f64 - 300.0);
                let y = propagator.respond(&p, &[], &record, false).y;
                let one = |(c, y): (&Channel, &Vec<f64>)| {
                    c.z.iter().zip(y).map(|(z, y)| (z - y) * (z - y)).sum::<f64>()
                };
                0.5 * record.channels.iter().zip(&y).map(one).sum::<f64>() / (0.003 * 0.003)
            };
            let costs: Vec<f64> = (0..600).map(cost).collect();
            // Along a smooth curve second differences are tiny; a jump stands out as it is.
            let jump =
                costs.windows(3).map(|c| (c[0] - 2.0 * c[1] + c[2]).abs()).fold(0.0, f64::max);
            println!("{substeps} sub-steps, parameter {which}: largest jump of the cost {jump:.4}");
            assert!(jump < most, "{substeps} sub-steps, parameter {which}: {jump}");
        }
    }
}

const STIFF: &str = r#"
title = "A slow state behind a fast one"

[inputs]
u = "rad"

[parameters]
T_fast = { unit = "s", start = 0.3, min = 0.0005 }
T_slow = { unit = "s", start = 1.0, min = 0.05 }

[states]
f = { unit = "rad", rate = "(u - f)/T_fast", start = 0.0 }
s = { unit = "rad", rate = "(f - s)/T_slow", start = 0.0 }

[outputs]
f = { unit = "rad", value = "f" }
s = { unit = "rad", value = "s" }
"#;

/// The start asks for one step per sample, the truth for many: the estimation notices and goes on
/// with them.
#[test]
fn recovery_of_a_stiff_model_from_a_slow_start() {
    let model = model(STIFF);
    let fine = flown(&model, &[0.004, 0.8], Record { substeps: 64, ..empty(400, 0, 2) }, 10, 0.002);
    let e = estimate(&model, &[Record { substeps: 0, ..fine }], &Settings::default()).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    within(&e, "T_fast", 0.004, 0.001);
    within(&e, "T_slow", 0.8, 0.01);
}

/// One slow state, seen by two outputs, with a parameter that does nothing and one that does what
/// another does.
const POOR: &str = r#"
title = "A lag with idle parameters"

[inputs]
u = "rad"

[parameters]
K    = { unit = "-", start = 1.0 }
K_2  = { unit = "-", start = 0.1, fixed = true }
T    = { unit = "s", start = 0.5, min = 0.05 }
idle = { unit = "-", start = 1.0, fixed = true }

[states]
x = { unit = "rad", rate = "((K + K_2)*u - x)/T", start = 0.0 }

[outputs]
x = { unit = "rad", value = "x" }
y = { unit = "rad", value = "3*x" }
c = { unit = "rad", value = "0.25*idle/idle" }
"#;

fn poor() -> (Model, Record) {
    let model = model(POOR);
    let mut record = flown(&model, &[1.3, 0.1, 0.4, 1.0], empty(300, 0, 3), 12, 0.01);
    record.channels[2].z.fill(0.25);
    (model, record)
}

fn free(names: &[&str]) -> Settings {
    Settings { free: Some(names.iter().map(ToString::to_string).collect()), ..Settings::default() }
}

#[test]
fn fault_a_parameter_without_effect_and_one_twice_are_named_together() {
    let (model, record) = poor();
    for step_control in
        [crate::estimate::StepControl::Halving, crate::estimate::StepControl::LevenbergMarquardt]
    {
        let settings = Settings { step_control, ..free(&["K", "K_2", "T", "idle"]) };
        let e = estimate(&model, std::slice::from_ref(&record), &settings).unwrap();
        assert_eq!(e.stop, Stop::Singular);
        let named: Vec<String> = e.verdict.combinations.iter().map(ToString::to_string).collect();
        assert_eq!(named, ["K, K_2 are not distinguishable"]);
        let idle: Vec<&str> = e.rows.iter().filter(|r| r.idle).map(|r| r.name.as_str()).collect();
        assert_eq!(idle, ["idle"]);
        assert!(e.rows.iter().all(|r| r.sd.is_none() && r.value.is_finite()));
    }
    let e = estimate(&model, &[record], &free(&["K", "T"])).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    within(&e, "K", 1.3, 0.01);
}

#[test]
fn fault_a_constant_output_is_named_and_the_rest_goes_on() {
    let (model, mut record) = poor();
    // `c` is constant and modelled so: the floor holds its variance. `y` is stuck while its model
    // moves.
    let e = estimate(&model, std::slice::from_ref(&record), &free(&["K", "T"])).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    let why: Vec<(&str, &str)> =
        e.doubtful.iter().map(|d| (d.output.as_str(), d.why.as_str())).collect();
    assert_eq!(why, [("c", "all its samples have the same value")]);
    assert!(e.det_r > 0.0 && e.outputs[2].r > 0.0);
    within(&e, "T", 0.4, 0.01);
    record.channels[1].z.fill(0.7);
    let e = estimate(&model, &[record], &free(&["K", "T"])).unwrap();
    assert_eq!((e.stop, e.doubtful.len()), (Stop::Converged, 2));
    // It gets the variance that it deserves, and hardly any weight.
    assert!(
        e.outputs[1].r.sqrt() > 0.5 && (e.outputs[0].r.sqrt() - 0.01).abs() < 2e-3,
        "{:?}",
        e.outputs
    );
}

#[test]
fn fault_an_output_without_a_sample_is_named_and_the_rest_goes_on() {
    let (model, mut record) = poor();
    record.channels[1].z.fill(f64::NAN);
    for noise in [crate::estimate::NoiseKind::Diagonal, crate::estimate::NoiseKind::Full] {
        let e = estimate(
            &model,
            std::slice::from_ref(&record),
            &Settings { noise, ..free(&["K", "T"]) },
        )
        .unwrap();
        assert_eq!(e.stop, Stop::Converged);
        assert_eq!(
            (e.doubtful[0].output.as_str(), e.doubtful[0].why.as_str()),
            ("y", "it has no sample that is not masked")
        );
        assert_eq!((e.outputs[1].count, e.outputs[1].masked), (0, 300));
        within(&e, "K", 1.3, 0.01);
    }
}

/// Masked samples are absent: whatever stands in their place, the estimate is the same to the bit,
/// and they are counted.
#[test]
fn fault_masked_samples_are_never_averaged_in() {
    let (model, record) = poor();
    for noise in [crate::estimate::NoiseKind::Diagonal, crate::estimate::NoiseKind::Full] {
        let settings = Settings { noise, ..free(&["K", "T"]) };
        let with = |bad: f64| {
            let mut record = record.clone();
            record.channels[0].z[50..80].fill(bad);
            estimate(&model, &[record], &settings).unwrap()
        };
        let (a, b) = (with(f64::NAN), with(f64::INFINITY));
        assert_eq!((&a.rows, a.outputs[0].masked, a.outputs[0].count), (&b.rows, 30, 270));
        let e = with(0.4);
        assert!(e.rows[0].value != a.rows[0].value && e.outputs[0].masked == 0);
        within(&a, "T", 0.4, 0.01);
    }
}

/// A first-order lag of a signal that the record follows at once: the shorter the time constant, the better, without end.
#[test]
fn fault_a_fit_that_leads_to_motions_no_sample_shows_runs_away() {
    let model = model(
        r#"
title = "A lag"
[inputs]
u = "rad"
[parameters]
a = { unit = "1/s", start = 4.0 }
[states]
x = { unit = "rad", rate = "a*(u - x)", start = 0.0 }
[outputs]
x = { unit = "rad", value = "x" }
"#,
    );
    let mut record = empty(300, 0, 1);
    record.inputs[0] = 0.0;
    record.channels[0].z = record.inputs.clone();
    let e = estimate(&model, &[record], &free(&["a"])).unwrap();
    assert_eq!(e.stop, Stop::RunsAway, "{:?}", e.rows);
    assert!(e.rows[0].sd.is_none() && e.rows[0].value > 160.0, "{:?}", e.rows);
}
