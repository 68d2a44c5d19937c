//! Zero shifts of sensors, feedback of measured states, and where states begin: as settings,
//! without a change of the model file.

use super::{normal, rng};
use crate::dynamics::{Channel, Directions, Propagator, Record};
use crate::estimate::{
    Estimation, InitialFrom, Row, Segment, Settings, Shifts, Stop, estimate, estimate_segments,
};
use crate::model::{Constants, Model};

/// Short period; the pilot's input reaches the tail late.
const PLAIN: &str = r#"
title = "Short period"

[inputs]
delta_e = "rad"

[parameters]
Z_alpha = { unit = "1/s", start = -0.8 }
M_alpha = { unit = "1/s^2", start = -3.0 }
M_q     = { unit = "1/s", start = -1.5 }
M_delta = { unit = "1/s^2", start = -5.0 }
tau     = { unit = "s", start = 0.05, fixed = true }

[states]
alpha = { unit = "rad", rate = "Z_alpha*alpha + q", start = 0.0 }
q     = { unit = "rad/s", rate = "M_alpha*alpha + M_q*q + M_delta*delay(delta_e, tau)", start = 0.0 }

[outputs]
alpha = { unit = "rad", value = "alpha" }
q     = { unit = "rad/s", value = "q" }
delta = { unit = "rad", value = "delta_e" }
"#;

fn model(text: &str) -> Model {
    Model::parse("short", text, &Constants::default()).unwrap()
}

fn multistep(t: f64) -> f64 {
    match t {
        1.0..2.5 => 0.04,
        2.5..3.5 => -0.04,
        3.5..4.0 => 0.04,
        4.0..4.5 => -0.04,
        _ => 0.0,
    }
}

fn channel(output: usize, dt: f64, n: usize) -> Channel {
    Channel { output, t: (0..n).map(|k| k as f64 * dt).collect(), z: vec![0.0; n].into() }
}

/// Segments whose elevator reads 0.01 (s + 1) too much, and whose alpha reads 0.02 too much in the
/// first half of them, q 0.003 in all.
fn shifted(count: usize) -> Vec<Segment> {
    let model = model(PLAIN);
    let propagator = Propagator::new(&model, Directions::default()).unwrap();
    let mut rng = rng(31);
    (0..count)
        .map(|s| {
            let n = 500;
            let inputs: Vec<f64> = (0..n).map(|k| multistep(k as f64 * 0.02)).collect();
            let mut record = Record {
                dt: 0.02,
                n,
                inputs: inputs.into(),
                channels: vec![channel(0, 0.02, n), channel(1, 0.02, n)],
                ..Record::default()
            };
            let y = propagator.respond(&[-1.0, -4.0, -2.0, -6.0, 0.05], &[], &record, false).y;
            let flight = if s < count / 2 { ("f1", 0.02) } else { ("f2", 0.0) };
            for (channel, (y, shift)) in
                record.channels.iter_mut().zip(y.into_iter().zip([flight.1, 0.003]))
            {
                channel.z = y.iter().map(|y| y + shift + 1e-3 * normal(&mut rng)).collect();
            }
            record.inputs.iter_mut().for_each(|u| *u += 0.01 * (s + 1) as f64);
            Segment {
                record,
                labels: [("flight".to_string(), flight.0.to_string())].into(),
                ..Segment::default()
            }
        })
        .collect()
}

fn settings() -> Settings {
    let shifts = Shifts {
        outputs: vec!["alpha".into(), "q".into()],
        inputs: vec!["delta_e".into()],
        ..Shifts::default()
    };
    let per =
        [("dz_alpha", "flight"), ("dz_q", "campaign")].map(|(a, b)| (a.to_string(), b.to_string()));
    Settings { shifts, per: per.into(), ..Settings::default() }
}

fn within(e: &Estimation, is: impl Fn(&Row) -> bool, truth: f64, most: f64) {
    let row = e.rows.iter().find(|r| is(r)).unwrap();
    let sd = row.sd.unwrap();
    assert!((row.value - truth).abs() < 3.5 * sd && sd < most, "{row:?}, truth {truth}");
}

#[test]
fn recovery_of_zero_shifts_component_by_component() {
    let e = estimate_segments(&model(PLAIN), &shifted(4), &settings()).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    let named = |name: &'static str| move |r: &Row| r.name == name;
    within(&e, named("M_delta"), -6.0, 0.1);
    within(&e, named("Z_alpha"), -1.0, 0.1);
    within(&e, named("dz_q"), 0.003, 1e-3);
    within(
        &e,
        |r| r.name == "dz_alpha" && r.group.as_ref().is_some_and(|g| g.value == "f1"),
        0.02,
        1e-3,
    );
    within(
        &e,
        |r| r.name == "dz_alpha" && r.group.as_ref().is_some_and(|g| g.value == "f2"),
        0.0,
        1e-3,
    );
    for s in 0..4 {
        within(&e, |r| r.name == "du_delta_e" && r.segment == Some(s), 0.01 * (s + 1) as f64, 1e-3);
    }
}

/// The shifts are the same as those written into the model by hand, digit for digit.
#[test]
fn shifts_are_those_of_a_model_written_out() {
    let text = PLAIN
        .replace("delay(delta_e, tau)", "(delay(delta_e, tau) - du)")
        .replace("\"delta_e\" }", "\"delta_e - du\" }")
        .replace("value = \"alpha\"", "value = \"alpha + za\"")
        .replace("value = \"q\"", "value = \"q + zq\"")
        .replace(
            "[states]",
            "za = { unit = \"rad\", start = 0.0, per = \"flight\" }\nzq = { unit = \"rad/s\", start = 0.0 }\n\
             du = { unit = \"rad\", start = 0.0, per = \"segment\" }\n[states]",
        );
    let all = shifted(4);
    let by_hand = estimate_segments(&model(&text), &all, &Settings::default()).unwrap();
    let by_setting = estimate_segments(&model(PLAIN), &all, &settings()).unwrap();
    assert_eq!(by_hand.rows.len(), by_setting.rows.len());
    for (a, b) in by_hand.rows.iter().zip(&by_setting.rows) {
        assert!(
            (a.value - b.value).abs() <= 1e-9 * a.sd.unwrap()
                && (a.sd.unwrap() / b.sd.unwrap() - 1.0).abs() < 1e-9,
            "{a:?} {b:?}"
        );
    }
}

/// Exact sensitivities with respect to a shift of a delayed input, and of one that an output shows.
#[test]
fn sensitivities_of_shifts_are_exact() {
    let model = settings_model();
    let shift = model.parameter("du_delta_e").unwrap();
    let propagator =
        Propagator::new(&model, Directions { parameters: vec![shift], starts: vec![] }).unwrap();
    let record = &shifted(1)[0].record;
    let at = |h: f64, exact: bool| {
        let mut p = model.parameter_starts();
        p[shift] = 0.01 + h;
        propagator.run(&p, &[], record, exact)
    };
    let (exact, up, down) = (at(0.0, true), at(1e-4, false), at(-1e-4, false));
    for k in 0..exact.y.len() {
        let difference = (up.y[k] - down.y[k]) / 2e-4;
        assert!((exact.dy[k] - difference).abs() < 1e-8, "{k}: {} {difference}", exact.dy[k]);
    }
    assert_eq!(exact.dy[2], -1.0);
}

fn settings_model() -> Model {
    crate::estimate::extended(&model(PLAIN), &settings()).unwrap().into_owned()
}

#[test]
fn fault_shifts_of_what_is_not_there_are_all_named() {
    let shifts =
        Shifts { outputs: vec!["alfa".into()], inputs: vec!["q".into()], ..Shifts::default() };
    let text = estimate(&model(PLAIN), &[], &Settings { shifts, ..Settings::default() })
        .unwrap_err()
        .to_string();
    assert!(text.contains("no output \"alfa\"") && text.contains("no input \"q\""), "{text}");
    let twice = Shifts { outputs: vec!["alpha".into(), "alpha".into()], ..Shifts::default() };
    let text = estimate(&model(PLAIN), &[], &Settings { shifts: twice, ..Settings::default() })
        .unwrap_err()
        .to_string();
    assert!(text.contains("has a \"dz_alpha\" already"), "{text}");
    let stabilise = [("delta".to_string(), 1.0), ("alpha".to_string(), -1.0)].into();
    let text = estimate(&model(PLAIN), &[], &Settings { stabilise, ..Settings::default() })
        .unwrap_err()
        .to_string();
    assert!(text.contains("no state \"delta\"") && text.contains("at least zero"), "{text}");
}

/// An aircraft that doubles its angle of attack every second, flown for 30 s by a controller that
/// lags one sample.
fn unstable(seed: u64) -> Record {
    let (z_alpha, m_alpha, m_q, m_delta) = UNSTABLE;
    let rate =
        |x: [f64; 2], u: f64| [z_alpha * x[0] + x[1], m_alpha * x[0] + m_q * x[1] + m_delta * u];
    let along = |x: [f64; 2], f: [f64; 2], h: f64| [x[0] + h * f[0], x[1] + h * f[1]];
    let (n, dt) = (1500, 0.02);
    let (mut x, mut u, mut rng) = ([0.0; 2], 0.0, rng(seed));
    let mut record = Record {
        dt,
        n,
        channels: vec![channel(0, dt, n), channel(1, dt, n)],
        substeps: 1,
        ..Record::default()
    };
    for k in 0..n {
        record.inputs.append(&[u]);
        (record.channels[0].z[k], record.channels[1].z[k]) =
            (x[0] + 5e-4 * normal(&mut rng), x[1] + 1e-3 * normal(&mut rng));
        let next = multistep((k as f64 * dt) % 6.0) + 1.5 * x[0] + 0.5 * x[1];
        let mean = 0.5 * (u + next);
        let f1 = rate(x, u);
        let f2 = rate(along(x, f1, 0.5 * dt), mean);
        let f3 = rate(along(x, f2, 0.5 * dt), mean);
        let f4 = rate(along(x, f3, dt), next);
        for i in 0..2 {
            x[i] += dt / 6.0 * (f1[i] + 2.0 * f2[i] + 2.0 * f3[i] + f4[i]);
        }
        u = next;
    }
    record
}

/// `s^2 + 2.2 s + 1.2 - M_alpha` has a root at ln 2.
const UNSTABLE: (f64, f64, f64, f64) = (-1.0, 3.2054, -1.2, -6.0);

fn unstable_model() -> Model {
    let text =
        PLAIN.replace("delay(delta_e, tau)", "delta_e").replace("start = -3.0", "start = 2.5");
    model(&text)
}

#[test]
fn recovery_of_an_unstable_aircraft_by_feedback() {
    let (model, record) = (unstable_model(), unstable(41));
    let largest = record.channels[0].z.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    assert!(largest < 0.2, "the controller holds it: {largest}");
    let truth = [
        ("Z_alpha", UNSTABLE.0),
        ("M_alpha", UNSTABLE.1),
        ("M_q", UNSTABLE.2),
        ("M_delta", UNSTABLE.3),
    ];
    let plain = estimate(&model, std::slice::from_ref(&record), &Settings::default()).unwrap();
    let right = |e: &Estimation| {
        truth.iter().all(|(name, value)| {
            let row = e.rows.iter().find(|r| r.name == *name).unwrap();
            (row.value - value).abs() < 0.05 * value.abs()
        })
    };
    println!(
        "plain: {} after {} iterations, det R {:e}",
        plain.stop,
        plain.iterations.len() - 1,
        plain.det_r
    );
    assert!(plain.stop != Stop::Converged || !right(&plain));
    let stabilise = [("alpha", 4.0), ("q", 4.0)].map(|(a, k)| (a.to_string(), k)).into();
    let e = estimate(&model, &[record], &Settings { stabilise, ..Settings::default() }).unwrap();
    println!(
        "fed back: {} after {} iterations, det R {:e}",
        e.stop,
        e.iterations.len() - 1,
        e.det_r
    );
    assert_eq!(e.stop, Stop::Converged);
    for (name, value) in truth {
        let row = e.rows.iter().find(|r| r.name == name).unwrap();
        println!("{name}: {:.4}, truth {value}", row.value);
        // Feedback of noise biases what residuals would call exact.
        assert!(row.sd.is_none() && (row.value / value - 1.0).abs() < 0.05, "{row:?}");
    }
}

#[test]
fn no_feedback_is_plain_output_error() {
    let all = shifted(2);
    let plain = estimate_segments(&model(PLAIN), &all, &Settings::default()).unwrap();
    let stabilise = [("alpha".to_string(), 0.0)].into();
    let fed =
        estimate_segments(&model(PLAIN), &all, &Settings { stabilise, ..Settings::default() })
            .unwrap();
    assert_eq!(
        (&plain.rows, &plain.iterations, &plain.responses),
        (&fed.rows, &fed.iterations, &fed.responses)
    );
}

#[test]
fn states_begin_at_their_own_first_sample_or_at_that_of_the_first_segment() {
    let text = PLAIN.replace("+ q\", start = 0.0", "+ q\", start = \"measured\"");
    let mut all = shifted(2);
    all[1].record.channels[0].z[0] = 0.5;
    let from = |initial_from| {
        let settings = Settings { initial_from, max_iterations: 0, ..Settings::default() };
        let e = estimate_segments(&model(&text), &all, &settings).unwrap();
        [0, 1].map(|s: usize| e.responses[s][0].modelled[0])
    };
    let first = all[0].record.channels[0].z[0];
    assert_eq!(from(InitialFrom::Own), [first, 0.5]);
    assert_eq!(from(InitialFrom::First), [first, first]);
}

#[test]
fn fault_a_state_that_starts_measured_without_a_sample_leaves_its_segment_out() {
    let text = PLAIN.replace("+ q\", start = 0.0", "+ q\", start = \"measured\"");
    let mut all = shifted(3);
    all[2].record.channels[0].z.fill(f64::NAN);
    let e = estimate_segments(&model(&text), &all, &Settings::default()).unwrap();
    assert_eq!((e.stop, e.left_out.len(), e.left_out[0].segment), (Stop::Converged, 1, 2));
    assert!(
        e.left_out[0].why.contains("starts at its first measured value"),
        "{}",
        e.left_out[0].why
    );
    // The same where no segment has one: an outcome, not a mistake of the caller.
    all.iter_mut().for_each(|s| s.record.channels[0].z.fill(f64::NAN));
    let e = estimate_segments(&model(&text), &all, &Settings::default()).unwrap();
    assert_eq!((e.stop, e.left_out.len()), (Stop::NoData, 3));
}
