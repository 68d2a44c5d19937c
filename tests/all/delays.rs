//! A delay of an input that is logged more slowly than it is delayed: is it said, and by how much may
//! the estimates be off?

use crate::campaign::Campaign;
use koehler::dynamics::{Channel, Directions, Propagator, Record};
use koehler::estimate::{Settings, Stop, estimate as estimated};
use koehler::log::{FieldSpec, LogWriter};
use koehler::model::{Constants, Model};
use koehler::table::{Table, read_dataset};

const MODEL: &str = r#"
title = "First-order system behind a delay"

[inputs]
u = "rad"

[parameters]
K = { unit = "-", start = 1.0 }
T = { unit = "s", start = 0.3, min = 0.01 }
tau = { unit = "s", start = 0.05, min = 0.0, max = 0.3 }

[states]
x = { unit = "rad", rate = "(K*delay(u, tau) - x)/T", start = 0.0 }

[outputs]
y = { unit = "rad", value = "x" }
"#;

const PIPELINE: &str = r#"
title = "A delayed drive"
channels = "channels.toml"
logs = ["logs/*.mcap"]

[derive]
rate_hz = 100.0

[[segment.input]]
name = "drive"
signal = "u"

[[estimate]]
name = "late"
model = "lag.model.toml"
input = "drive"
group = "all"
preroll_s = 0.5
"#;

const GAIN: f64 = 1.5;
const LAG: f64 = 0.25;
const DELAY: f64 = 0.07;

/// Two 3211s of a surface that moves at 20 deg/s, logged every `every` ms; what it drives, 70 ms
/// late, at 50 Hz.
pub(crate) fn campaign(every: u64) -> Campaign {
    let c = Campaign::new();
    for flight in 1..=3 {
        std::fs::remove_file(c.path(&format!("logs/flight-{flight}.mcap"))).expect("removed");
    }
    c.write("lag.model.toml", MODEL);
    c.write("pipeline.toml", PIPELINE);
    let command = |t: f64| match t % 20.0 - 5.0 {
        s if !(0.0..7.0).contains(&s) => 0.0,
        s if s < 3.0 => 2.0,
        s if s < 5.0 => -2.0,
        s if s < 6.0 => 2.0,
        _ => -2.0,
    };
    let mut writer = LogWriter::create(&c.path("logs/flight-1.mcap")).expect("created");
    let field = |name: &str, unit: &str| [FieldSpec::new(name, unit, "")];
    let drive = writer.add_topic("/drive", &field("command", "deg")).expect("topic");
    let sensor = writer.add_topic("/sensor", &field("angle", "deg")).expect("topic");
    let air = writer.add_topic("/air", &field("speed", "m/s")).expect("topic");
    let (mut x, mut surface) = (0.0f64, vec![0.0f64]);
    for k in 0..40_000u64 {
        let now = *surface.last().expect("one");
        let ns = 1_700_000_000_000_000_000 + k * 1_000_000;
        if k % every == 0 {
            writer.write(drive, ns, ns, &[now]).expect("written");
        }
        if k % 20 == 3 {
            // a sensor's steps of a hundredth of a degree are its noise
            writer.write(sensor, ns, ns, &[(x * 100.0).round() / 100.0]).expect("written");
        }
        if k % 100 == 7 {
            writer.write(air, ns, ns, &[80.0]).expect("written");
        }
        surface.push(now + (command(1e-3 * k as f64) - now).clamp(-0.02, 0.02));
        // exact for an input along a straight line over a step, but for h^2/12 of its rate
        let late = |k: u64| surface[k.saturating_sub((1e3 * DELAY) as u64) as usize];
        let stays = (-1e-3f64 / LAG).exp();
        x = x * stays + (1.0 - stays) * GAIN * 0.5 * (late(k) + late(k + 1));
    }
    writer.finish().expect("finished");
    c
}

/// The text of the notes about the delay.
fn notes(c: &Campaign) -> Vec<String> {
    let notes: Table = read_dataset(&c.path("out"), "notes").expect("notes");
    let texts = notes.strings("text").expect("texts");
    texts.iter().filter(|t| t.contains("is delayed by")).map(|t| t.to_string()).collect()
}

/// Estimate and sd of a parameter.
fn estimate(c: &Campaign, parameter: &str) -> (f64, f64) {
    let table = read_dataset(&c.path("out"), "estimates").expect("estimates");
    let names = table.strings("parameter").expect("names");
    let row = names.iter().position(|name| *name == parameter).expect("a row");
    let of = |column: &str| table.f64(column).expect("numbers")[row];
    (of("value"), of("sd"))
}

#[test]
fn fault_a_delay_shorter_than_a_sample_is_told_with_what_estimates_owe_to_it() {
    let c = campaign(80);
    c.run().ended(0);
    let texts = notes(&c);
    println!("{texts:?}");
    let [text] = &texts[..] else { panic!("{texts:?}") };
    for part in ["late: all: u is delayed by 0.0", "less than a sample of it (0.080 s)", "faster"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let told = text.split("tau = ").nth(1).expect("what the delay owes to it");
    let values: Vec<f64> = told
        .split(" (")
        .next()
        .expect("values")
        .split(", ")
        .map(|value| value.parse().expect("a number"))
        .collect();
    assert_eq!(values.len(), 3, "straight, cubic, held: {text}");
    let (value, sd) = estimate(&c, "tau");
    let half = 0.5
        * (values.iter().fold(f64::MIN, |a, b| a.max(*b))
            - values.iter().fold(f64::MAX, |a, b| a.min(*b)));
    println!("tau {value} +- {sd} and {half} for {DELAY}");
    assert!((value - DELAY).abs() < 2.0 * (sd * sd + half * half).sqrt());
    // a held input is half a sample late by itself
    assert!(half > 0.01, "{half}");
}

#[test]
fn a_delay_longer_than_a_sample_is_nothing_to_tell() {
    let c = campaign(10);
    c.run().ended(0);
    assert!(notes(&c).is_empty(), "{:?}", notes(&c));
    let (value, sd) = estimate(&c, "tau");
    println!("tau {value} +- {sd} for {DELAY}");
    // a twentieth of a sample: what the corners of the surface's ramps lose between samples
    assert!((value - DELAY).abs() < 3.0 * sd + 5e-4, "{value} +- {sd}");
}

/// Nothing shows the delay of a term that is zero, as this one is at the start; nor the lag behind it.
#[test]
fn a_delay_is_found_where_what_it_delays_starts_at_zero() {
    let text = MODEL.replace("start = 1.0", "start = 0.0");
    let model = Model::parse("late", &text, &Constants::default()).expect("a model");
    let truth = [("K", 0.6), ("T", LAG), ("tau", 0.13)];
    let values: Vec<f64> = model
        .parameters
        .iter()
        .map(|p| truth.iter().find(|(name, _)| *name == p.quantity.name).expect("a value").1)
        .collect();
    let (dt, n, start) = (0.02, 1000, 25);
    let drive = |t: f64| libm::sin(1.3 * t) + 0.7 * libm::sin(2.9 * t) + 0.4 * libm::sin(0.4 * t);
    let inputs: Vec<f64> = (0..n).map(|k| drive(dt * k as f64)).collect();
    let mut record = Record { dt, n, start, inputs: inputs.into(), ..Record::default() };
    let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
    let grid = propagator.run(&values, &[], &record, false);
    let noise = |k: usize| 1e-3 * libm::sin(1e3 * (k as f64 + 0.3) * (k as f64 + 0.7));
    record.channels = vec![Channel {
        output: 0,
        t: (0..grid.n).map(|k| (k + start) as f64 * dt).collect(),
        z: grid.y.iter().enumerate().map(|(k, y)| y + noise(k)).collect(),
    }];
    let found = estimated(&model, &[record], &Settings::default()).expect("an estimate");
    assert_eq!(found.stop, Stop::Converged);
    for (name, truth) in truth {
        let row = found.rows.iter().find(|row| row.name == name).expect("a row");
        let sd = row.sd.unwrap_or_else(|| panic!("no standard deviation: {:?}", found.rows));
        assert!((row.value - truth).abs() < 4.0 * sd, "{name}: {} +- {sd} for {truth}", row.value);
    }
}

/// A transit distance over the airspeed that reaches back behind the beginning of the record.
#[test]
fn fault_a_delay_longer_than_the_preroll_is_told() {
    let c = campaign(20);
    c.edit("lag.model.toml", "u = \"rad\"", "u = \"rad\"\nV = \"m/s\"");
    c.edit("lag.model.toml", "delay(u, tau)", "delay(u, r_H/V)");
    c.edit(
        "lag.model.toml",
        "tau = { unit = \"s\", start = 0.05, min = 0.0, max = 0.3 }",
        "r_H = { unit = \"m\", start = 4.0, min = 0.0, max = 24.0 }",
    );
    c.edit("pipeline.toml", "preroll_s = 0.5", "preroll_s = 0.04\npre_s = 0.0");
    let outcome = c.run();
    let notes: Table = read_dataset(&c.path("out"), "notes").expect("notes");
    let texts = notes.strings("text").expect("texts");
    let told = ["a delay of u is 0.07", "the record has 0.040 s before its start", "preroll_s"];
    let is = |text: &&str| told.iter().all(|part| text.contains(part));
    assert!(texts.iter().any(is), "{texts:?}\n{}{}", outcome.out, outcome.err);
}
