//! Does phase 1 of the simulated ATTAS campaign find the actuators of its six flaps: dynamics, rate limit, limits that move
//! with airspeed and landing flap, with honest bands? The truth is looked at here alone.
//!
//! Slow: needs `KOEHLER_SLOW=1`, in release mode. `KOEHLER_SEEDS` chooses how many recordings the bands are judged by.

use crate::flightdata::slow;
use koehler::pipeline::{Plan, RunResult, Store, run};
use koehler::simulate::{Campaign, Truth, write_log};
use koehler::stage::Severity;
use koehler::table::{Table, read_dataset};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/attas")
}

fn campaign() -> &'static Campaign {
    static CAMPAIGN: OnceLock<Campaign> = OnceLock::new();
    CAMPAIGN.get_or_init(|| {
        Campaign::load(&folder().join("actuators-campaign.toml")).unwrap_or_else(|e| panic!("{e}"))
    })
}

/// The dynamic flights as they were.
fn dynamic() -> &'static [Truth] {
    static FLOWN: OnceLock<Vec<Truth>> = OnceLock::new();
    FLOWN.get_or_init(|| flown("dynamic"))
}

/// The flights of which the ids begin so, as they were.
fn flown(begin: &str) -> Vec<Truth> {
    let all = campaign().flights();
    let ids: Vec<String> =
        all.iter().map(ToString::to_string).filter(|id| id.starts_with(begin)).collect();
    ids.par_iter().map(|id| campaign().truth(id).unwrap_or_else(|e| panic!("{e}"))).collect()
}

/// The same with the recorder of the shipped campaign.
fn prepared(truths: &[Truth], seed: u64, wanted: impl Fn(&str, &str) -> bool) -> (TempDir, String) {
    recorded(campaign(), truths, seed, wanted)
}

/// A folder with the shipped models and channels, logs of these flights, and the shipped pipeline cut to the entries that
/// `wanted` keeps.
fn recorded(
    campaign: &Campaign,
    truths: &[Truth],
    seed: u64,
    wanted: impl Fn(&str, &str) -> bool,
) -> (TempDir, String) {
    let out = tempfile::tempdir().expect("a temporary folder");
    for name in [
        "actuator.model.toml",
        "actuator-steady.model.toml",
        "actuator-friction.model.toml",
        "actuators-channels.toml",
    ] {
        std::fs::copy(folder().join(name), out.path().join(name)).expect("copied");
    }
    for truth in truths {
        let recording = campaign.record(truth, seed).expect("recorded");
        let log = out.path().join(format!("actuators-logs/{}.mcap", truth.flight));
        write_log(&recording, &log, "koehler").expect("a log");
    }
    let text = std::fs::read_to_string(folder().join("actuators.toml")).expect("the pipeline");
    let text = text.replace("simulate = \"actuators-campaign.toml\"\n", "");
    let file: toml::Table = toml::from_str(&text).expect("a pipeline");
    let mut cut = toml::Table::new();
    for (key, value) in file {
        let toml::Value::Array(entries) = &value else {
            cut.insert(key, value);
            continue;
        };
        let name = |entry: &toml::Value| {
            let of = entry.get("name").or(entry.get("estimate"));
            of.and_then(toml::Value::as_str).unwrap_or_default().to_string()
        };
        let kept: Vec<toml::Value> =
            entries.iter().filter(|e| key == "logs" || wanted(&key, &name(e))).cloned().collect();
        if !kept.is_empty() {
            cut.insert(key, toml::Value::Array(kept));
        }
    }
    cut.remove("report");
    (out, toml::to_string(&cut).expect("text"))
}

/// Runs a pipeline in a prepared folder.
fn ran(out: &TempDir, pipeline: &str) -> RunResult {
    let path = out.path().join("pipeline.toml");
    std::fs::write(&path, pipeline).expect("written");
    let plan = Plan::read(&path).unwrap_or_else(|e| panic!("{e}"));
    run(
        &plan,
        &Store::open(&out.path().join("out")),
        &koehler::engine::Threads,
        &|_| {},
        &Default::default(),
    )
    .unwrap_or_else(|e| panic!("{e}"))
}

fn table(out: &TempDir, name: &str) -> Table {
    read_dataset(&out.path().join("out"), name).unwrap_or_else(|e| panic!("{e}"))
}

/// Value and sd of a parameter.
fn estimate(out: &TempDir, model: &str, parameter: &str) -> (f64, f64) {
    let estimates = table(out, "estimates");
    let (models, names) =
        (estimates.strings("model").unwrap(), estimates.strings("parameter").unwrap());
    let row = (0..names.len())
        .find(|&i| models[i] == model && names[i] == parameter)
        .unwrap_or_else(|| panic!("{model}: no {parameter}"));
    assert_eq!(estimates.strings("stop").unwrap()[row], "converged", "{model}");
    (estimates.f64("value").unwrap()[row], estimates.f64("sd").unwrap()[row])
}

/// A constant of the truth.
fn truth(name: &str) -> f64 {
    static TRUTH: OnceLock<toml::Table> = OnceLock::new();
    let file = TRUTH.get_or_init(|| {
        let path = folder().join("actuators-truth.model.toml");
        toml::from_str(&std::fs::read_to_string(path).expect("the truth")).expect("a model")
    });
    file["constants"][name]["value"].as_float().unwrap_or_else(|| panic!("the truth has no {name}"))
}

/// attas Eq. 3 with the true coefficients.
fn limit(side: &str, flap: usize, v: f64, k: f64) -> f64 {
    let c = |name: &str| truth(&format!("{side}_{name}_{flap}"));
    c("0") + c("V1") * v + c("V2") * v * v + c("k1") * k + c("k2") * k * k + c("Vk") * v * k
}

/// The landing flap in a label of `curves`: `eta_k = 0.01745 rad`.
fn landing_flap(label: &str) -> f64 {
    let number = label.split(' ').nth(2).expect("a number");
    number.parse().unwrap_or_else(|_| panic!("{label}"))
}

/// (estimate, truth, half of the band) of every point of the limits' curves.
fn surfaces(out: &TempDir) -> Vec<(String, f64, f64, f64)> {
    let curves = table(out, "curves");
    let text = |name: &str| curves.strings(name).unwrap();
    let number = |name: &str| curves.f64(name).unwrap();
    let (models, equations, at) = (text("model"), text("equation"), text("at"));
    let (x, value, upper) = (number("x"), number("value"), number("upper"));
    let point = |i: usize| {
        let flap = models[i].trim_start_matches("flap-").parse().expect("the number of a flap");
        let truth = limit(equations[i], flap, x[i], landing_flap(at[i]));
        (
            format!("{} {} {} {:.1}", models[i], equations[i], at[i], x[i]),
            value[i],
            truth,
            upper[i] - value[i],
        )
    };
    (0..curves.rows()).map(point).collect()
}

fn is_flap(name: &str) -> bool {
    name.strip_prefix("flap-").is_some_and(|rest| rest.parse::<usize>().is_ok())
}

/// Paper: limits to 2 to 5%, linear dynamics below 0.5%.
#[test]
fn recovery_coverage_attas_actuators_bands_of_both_surfaces_hold_the_truth() {
    if !slow() {
        return;
    }
    let seeds: u64 = std::env::var("KOEHLER_SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(20);
    let (mut inside, mut all, mut worst) = (0, 0, 0.0_f64);
    let mut normed: Vec<(String, f64)> = Vec::new();
    for seed in 0..seeds {
        let (out, pipeline) = prepared(dynamic(), 3000 + seed, |key, name| {
            ["estimate", "curve"].contains(&key) && is_flap(name)
        });
        let result = ran(&out, &pipeline);
        assert!(result.complete(), "seed {seed}: {}", result.errors);
        let points = surfaces(&out);
        assert_eq!(points.len(), 6 * 2 * 3 * 40);
        for (place, value, truth, half) in points {
            inside += usize::from((value - truth).abs() <= half);
            all += 1;
            let off = (value / truth - 1.0).abs();
            assert!(off < 0.05, "seed {seed}: {place}: {value} for {truth}");
            worst = worst.max(off);
        }
        for flap in 1..=6 {
            for (name, of) in [
                ("w_n", "w_n"),
                ("zeta", "zeta"),
                ("fastest", "rate"),
                ("K_0", "K_0"),
                ("K_q", "K_q"),
            ] {
                let (value, sd) = estimate(&out, &format!("flap-{flap}"), name);
                let truth = truth(&format!("{of}_{flap}"));
                normed.push((name.to_string(), (value - truth) / sd));
                if ["w_n", "zeta", "fastest"].contains(&name) {
                    assert!(
                        (value / truth - 1.0).abs() < 0.005 && sd < 0.005 * truth,
                        "seed {seed}, flap {flap}: {name} {value} +- {sd} for {truth}"
                    );
                }
            }
            for v in [72.0, 85.0, 98.0, 111.0] {
                let [k_0, k_q] = ["K_0", "K_q"].map(|name| {
                    [
                        estimate(&out, &format!("flap-{flap}"), name).0,
                        truth(&format!("{name}_{flap}")),
                    ]
                });
                let gain = |i: usize| k_0[i] + k_q[i] * 0.5 * 1.225 * v * v;
                assert!(
                    (gain(0) / gain(1) - 1.0).abs() < 0.005,
                    "seed {seed}, flap {flap}: K {} for {} at {v} m/s",
                    gain(0),
                    gain(1)
                );
            }
        }
    }
    for name in ["w_n", "zeta", "fastest", "K_0", "K_q"] {
        let of: Vec<f64> = normed.iter().filter(|(n, _)| n == name).map(|(_, v)| *v).collect();
        let n = of.len() as f64;
        let (mean, rms) =
            (of.iter().sum::<f64>() / n, (of.iter().map(|v| v * v).sum::<f64>() / n).sqrt());
        println!("{name}: mean {mean:.2} sd, rms {rms:.2} sd of {n}");
    }
    let share = inside as f64 / all as f64;
    println!(
        "{seeds} recordings: {:.1}% of {all} points of the surfaces inside, largest error {:.2}%",
        100.0 * share,
        100.0 * worst
    );
    assert!((0.93..=0.97).contains(&share), "{share}");
}

/// All of one limit half as large to half as large again, and likewise the rest, at random.
#[test]
fn recovery_attas_actuators_from_ten_random_starts() {
    if !slow() {
        return;
    }
    let (out, pipeline) =
        prepared(dynamic(), 77, |key, name| key == "estimate" && name == "flap-1");
    let file: toml::Table = toml::from_str(&pipeline).expect("a pipeline");
    let entry = file["estimate"][0].as_table().expect("an estimate").clone();
    let mut state = 20_260_101_u64;
    let mut within = || {
        // A linear congruential generator (Knuth): 0.5 to 1.5.
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        0.5 + (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut entries = vec![toml::Value::Table(entry.clone())];
    for k in 0..10 {
        let mut one = entry.clone();
        one.insert("name".into(), format!("start-{k}").into());
        let mut starts = toml::Table::new();
        for (name, start) in [
            ("down_0", 0.3),
            ("up_0", -0.3),
            ("fastest", 1.0),
            ("w_n", 20.0),
            ("zeta", 0.6),
            ("K_0", 0.9),
        ] {
            starts.insert(name.into(), (start * within()).into());
        }
        println!("start-{k}: {starts:?}");
        let method = one["method"].as_table_mut().expect("a method");
        method.insert("starts".into(), toml::Value::Table(starts));
        entries.push(toml::Value::Table(one));
    }
    let mut file = file.clone();
    file.insert("estimate".into(), toml::Value::Array(entries));
    let result = ran(&out, &toml::to_string(&file).expect("text"));
    assert!(result.complete(), "{}", result.errors);
    let mut off = Vec::new();
    for p in [
        "w_n", "zeta", "K_0", "K_q", "fastest", "down_0", "down_V1", "down_V2", "down_k1",
        "down_k2", "down_Vk", "up_0", "up_V1", "up_V2", "up_k1", "up_k2", "up_Vk",
    ] {
        let (value, sd) = estimate(&out, "flap-1", p);
        for k in 0..10 {
            let (other, _) = estimate(&out, &format!("start-{k}"), p);
            off.push((format!("start-{k} {p}"), (other - value).abs() / sd));
        }
    }
    let worst = off.iter().max_by(|a, b| a.1.total_cmp(&b.1)).expect("some");
    println!("farthest apart: {} by {:.3} sd", worst.0, worst.1);
    assert!(off.iter().all(|(_, v)| *v < 0.1), "{off:?}");
}

/// Tests of half a minute beside others of three minutes, in which hardly anything but the limits shows.
#[test]
fn recovery_attas_actuators_slow_and_fast_tests_in_one_estimate() {
    if !slow() {
        return;
    }
    let mut truths: Vec<Truth> = dynamic().iter().step_by(5).cloned().collect();
    truths.extend(flown("speed-").into_iter().take(2));
    truths.extend(flown("flap-").into_iter().take(1));
    let (out, pipeline) = prepared(&truths, 78, |key, name| key == "estimate" && name == "flap-1");
    let mut file: toml::Table = toml::from_str(&pipeline).expect("a pipeline");
    let entry = file["estimate"][0].as_table_mut().expect("an estimate");
    entry.insert("model".into(), "actuator.model.toml".into());
    entry.remove("flights");
    entry.remove("inputs");
    let result = ran(&out, &toml::to_string(&file).expect("text"));
    assert!(result.complete(), "{}", result.errors);
    for (name, of) in [("w_n", "w_n"), ("zeta", "zeta"), ("fastest", "rate")] {
        let ((value, sd), truth) = (estimate(&out, "flap-1", name), truth(&format!("{of}_1")));
        println!("{name}: {value} +- {sd} for {truth}");
        assert!((value / truth - 1.0).abs() < 0.005, "{name}: {value} +- {sd} for {truth}");
    }
}

/// Friction at the force limit: what was measured while airspeed rises and falls brackets the limit, and the model with a dead
/// band finds it.
#[test]
fn recovery_attas_actuators_friction_from_the_loop() {
    if !slow() {
        return;
    }
    let truths = flown("friction");
    let (out, pipeline) = prepared(&truths, 78, |key, name| {
        key == "estimate" && ["flap-1-loop", "flap-1-friction"].contains(&name)
    });
    let result = ran(&out, &pipeline);
    assert!(result.complete(), "{}", result.errors);
    for name in ["d_0", "d_1"] {
        let (value, sd) = estimate(&out, "flap-1-friction", name);
        println!("{name}: {value} +- {sd}, truth {}", truth(name));
        assert!((value - truth(name)).abs() < 3.0 * sd, "{name}: {value} +- {sd}");
    }
    let plateaus = table(&out, "plateaus");
    let text = |name: &str| plateaus.strings(name).unwrap();
    let (models, inputs, ways, sides) = (text("model"), text("input"), text("way"), text("limit"));
    let (x, measured, segments) =
        (plateaus.f64("x").unwrap(), plateaus.f64("measured").unwrap(), text("segment"));
    let mut seen = 0;
    for i in 0..plateaus.rows() {
        if models[i] != "flap-1-loop" || inputs[i] != "V_c" || segments[i] != "friction-1" {
            continue;
        }
        let (side, sign) = if sides[i] == "max" { ("down", 1.0) } else { ("up", -1.0) };
        let surface = limit(side, 1, x[i], 0.01745);
        let d = truth("d_0") + truth("d_1") * surface.abs();
        let beyond = sign * (measured[i] - surface);
        // Behind each turn of the airspeed the flap waits in the dead band; in its middle the loop has both sides.
        if !(80.0..100.0).contains(&x[i]) || ways[i] == "steady" {
            continue;
        }
        let wanted = if ways[i] == "rises" { d } else { -d };
        assert!((beyond - wanted).abs() < 0.3 * d, "{side} at {}: {beyond} for {wanted}", x[i]);
        seen += 1;
    }
    assert!(seen > 20, "{seen}");
}

/// What is said where the logs do not tell enough.
#[test]
fn fault_attas_actuators_without_a_change_of_the_landing_flap() {
    if !slow() {
        return;
    }
    let one: Vec<Truth> = dynamic().iter().filter(|t| t.flight.ends_with("-1")).cloned().collect();
    assert_eq!(one.len(), 4);
    let (out, pipeline) = prepared(&one, 79, |key, name| key == "estimate" && name == "flap-1");
    let result = ran(&out, &pipeline);
    assert!(
        result.notes.iter().any(|n| n.severity == Severity::Warning && n.text.contains("down_Vk"))
    );
    let told = table(&out, "separability");
    let (parameters, verdicts) =
        (told.opt_strings("parameter").unwrap(), told.strings("verdict").unwrap());
    println!("{parameters:?} {verdicts:?}");
    // What the noise of the recorded landing flap tells is less than a millionth of what a change of it would.
    let not = ["not separable", "hardly separable"];
    for name in ["down_k1", "down_k2", "down_Vk", "up_k1", "up_k2", "up_Vk"] {
        let of = |(p, v): (&Option<&str>, &&str)| *p == Some(name) && not.contains(v);
        assert!(parameters.iter().zip(&verdicts).any(of), "{name}");
    }
    for name in ["down_k1", "up_k1"] {
        let of = |(p, v): (&Option<&str>, &&str)| *p == Some(name) && *v == not[0];
        assert!(parameters.iter().zip(&verdicts).any(of), "{name}");
    }
}

/// Five flaps are estimated, of the sixth it is said why not.
#[test]
fn fault_attas_actuators_without_the_log_of_one_flap() {
    if !slow() {
        return;
    }
    let mut campaign =
        Campaign::load(&folder().join("actuators-campaign.toml")).unwrap_or_else(|e| panic!("{e}"));
    let fields = &mut campaign.settings.topics["/dlc"].fields;
    assert!(fields.shift_remove("flap_3").is_some());
    let (out, pipeline) = recorded(&campaign, dynamic(), 80, |key, name| {
        ["estimate", "curve"].contains(&key) && is_flap(name)
    });
    let result = ran(&out, &pipeline);
    for flap in [1, 2, 4, 5, 6] {
        let (w_n, sd) = estimate(&out, &format!("flap-{flap}"), "w_n");
        assert!((w_n - truth(&format!("w_n_{flap}"))).abs() < 4.0 * sd, "{flap}: {w_n} +- {sd}");
    }
    let said: Vec<&str> = result.notes.iter().map(|n| n.text.as_str()).collect();
    let of = |words: &[&str]| said.iter().any(|text| words.iter().all(|word| text.contains(word)));
    assert!(of(&["eta_3 has no sample", "flap_3"]), "{said:?}");
    assert!(of(&["no estimate of flap-3 converged"]), "{said:?}");
    assert!(of(&["no curve of flap-3"]), "{said:?}");
}
