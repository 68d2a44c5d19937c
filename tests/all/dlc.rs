//! Does the analysis of the simulated ATTAS campaign tell what the paper on its direct-lift-control
//! flaps tells? Logs go through the shipped pipeline; the truth is looked at here alone.
//!
//! Slow: needs `KOEHLER_SLOW=1`, in release mode. `KOEHLER_SEEDS` chooses how many recordings the
//! pooled coverage is judged by. The tables in the campaign's README are held against the results
//! of its run, where there are any.

use koehler::math::distribution::t_quantile;
use koehler::pipeline::{Plan, Store, run};
use koehler::simulate::{Campaign, Truth, write_log};
use koehler::table::{Table, read_dataset};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/attas")
}

fn slow() -> bool {
    let slow = std::env::var("KOEHLER_SLOW").as_deref() == Ok("1");
    if !slow {
        println!("skipped: set KOEHLER_SLOW=1 (some minutes in release mode)");
    }
    slow
}

/// The flights as they were, and the analysis of the shipped recording of them.
struct Flown {
    campaign: Campaign,
    truths: Vec<Truth>,
    shipped: Analysis,
}

fn flown() -> &'static Flown {
    static FLOWN: OnceLock<Flown> = OnceLock::new();
    FLOWN.get_or_init(|| {
        let campaign =
            Campaign::load(&folder().join("campaign.toml")).unwrap_or_else(|e| panic!("{e}"));
        let ids: Vec<String> = campaign.flights().iter().map(|f| f.to_string()).collect();
        let truths: Vec<Truth> =
            ids.par_iter().map(|id| campaign.truth(id).unwrap_or_else(|e| panic!("{e}"))).collect();
        let shipped = analyse(&campaign, &truths, campaign.sensor_seed(), &[]);
        Flown { campaign, truths, shipped }
    })
}

/// One analysed recording.
struct Analysis {
    out: TempDir,
    /// Constant errors of the sensors as drawn, SI: (flight, truth signal without `_imu`) to bias.
    biases: BTreeMap<(String, String), f64>,
}

/// One estimate of a parameter common to all maneuvers, or to a flight.
#[derive(Debug)]
struct Row {
    parameter: String,
    flight: Option<String>,
    value: f64,
    sd: f64,
}

/// Records the flights with the sensors' random numbers from `seed`, and runs the shipped pipeline,
/// or only its estimates `only`.
fn analyse(campaign: &Campaign, truths: &[Truth], seed: u64, only: &[&str]) -> Analysis {
    let out = tempfile::tempdir().expect("a temporary folder");
    for entry in std::fs::read_dir(folder()).expect("the campaign").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with(".toml") && !name.starts_with("truth") && name != "campaign.toml" {
            std::fs::copy(entry.path(), out.path().join(&name)).expect("copied");
        }
    }
    let text = std::fs::read_to_string(folder().join("pipeline.toml")).expect("the pipeline");
    let text =
        text.split("[report]").next().expect("text").replace("simulate = \"campaign.toml\"", "");
    let mut parts = text.split("[[estimate]]");
    let head = parts.next().expect("text").to_string();
    let wanted = |part: &&str| {
        only.is_empty() || only.iter().any(|name| part.contains(&format!("= \"{name}\"\n")))
    };
    let text = parts.filter(wanted).fold(head, |text, part| text + "[[estimate]]" + part);
    std::fs::write(out.path().join("pipeline.toml"), text).expect("written");
    let mut biases = BTreeMap::new();
    for truth in truths {
        let recording = campaign.record(truth, seed).expect("recorded");
        for error in recording.errors.iter().filter(|e| e.topic == "/imu") {
            let unit = koehler::units::Unit::parse(&error.unit).expect("a unit");
            let signal = &campaign.settings.topics["/imu"].fields[&error.field].truth;
            biases.insert(
                (truth.flight.clone(), signal.trim_end_matches("_imu").to_string()),
                unit.to_si(error.bias),
            );
        }
        write_log(&recording, &out.path().join(format!("logs/{}.mcap", truth.flight)), "koehler")
            .expect("a log");
    }
    let plan = Plan::read(&out.path().join("pipeline.toml")).unwrap_or_else(|e| panic!("{e}"));
    let result =
        run(&plan, &Store::open(&out.path().join("out")), &koehler::engine::Threads, &|_| {})
            .unwrap_or_else(|e| panic!("{e}"));
    let lost: Vec<_> =
        result.notes.iter().filter(|n| n.severity == koehler::stage::Severity::Missing).collect();
    assert!(result.complete() && lost.is_empty(), "seed {seed}: {lost:?} {}", result.errors);
    Analysis { out, biases }
}

impl Analysis {
    fn table(&self, name: &str) -> Table {
        read_dataset(&self.out.path().join("out"), name).unwrap_or_else(|e| panic!("{e}"))
    }

    /// The estimates of `model` that hold for more than one maneuver.
    fn rows(&self, model: &str) -> Vec<Row> {
        let table = self.table("estimates");
        let (models, names, per) = (
            table.strings("model").unwrap(),
            table.strings("parameter").unwrap(),
            table.strings("per").unwrap(),
        );
        let (of, stops) = (table.opt_strings("of").unwrap(), table.strings("stop").unwrap());
        let (values, sds) = (table.f64("value").unwrap(), table.f64("sd").unwrap());
        let rows = (0..table.rows())
            .filter(|i| models[*i] == model && per[*i] != "segment" && sds[*i].is_finite());
        let row = |i: usize| {
            assert_eq!(stops[i], "converged", "{model}");
            Row {
                parameter: names[i].to_string(),
                flight: of[i].map(str::to_string),
                value: values[i],
                sd: sds[i],
            }
        };
        rows.map(row).collect()
    }

    fn one(&self, model: &str, parameter: &str) -> (f64, f64) {
        let row = self
            .rows(model)
            .into_iter()
            .find(|r| r.parameter == parameter)
            .unwrap_or_else(|| panic!("{model}: {parameter}"));
        (row.value, row.sd)
    }

    /// Last determinant of R.
    fn det_r(&self, model: &str) -> f64 {
        let table = self.table("iterations");
        let (models, det) = (table.strings("model").unwrap(), table.f64("det_r").unwrap());
        (0..table.rows()).rfind(|i| models[*i] == model).map(|i| det[i]).expect("iterations")
    }

    /// (estimate - truth)/sd of the rows of `model`.
    fn normed(&self, model: &str) -> Vec<(String, f64)> {
        let truth = |row: &Row| match (row.parameter.strip_prefix("dz_"), &row.flight) {
            (Some(sensor), Some(flight)) => self.biases[&(flight.clone(), sensor.to_string())],
            _ => true_value(&row.parameter),
        };
        self.rows(model)
            .iter()
            .map(|r| (format!("{} {:?}", r.parameter, r.flight), (r.value - truth(r)) / r.sd))
            .collect()
    }
}

/// A constant of the truth's aerodynamics.
fn true_value(name: &str) -> f64 {
    static TRUTH: OnceLock<toml::Table> = OnceLock::new();
    let file = TRUTH.get_or_init(|| {
        let text = std::fs::read_to_string(folder().join("truth_aerodynamics.model.toml"))
            .expect("the truth");
        toml::from_str(&text).expect("a model")
    });
    file["constants"][name]["value"].as_float().unwrap_or_else(|| panic!("the truth has no {name}"))
}

#[test]
fn recovery_coverage_attas_intervals_of_model_b_hold_the_truth() {
    if !slow() {
        return;
    }
    let normed = flown().shipped.normed("b-all");
    let z = t_quantile(0.975, 1e6);
    let inside = normed.iter().filter(|(_, v)| v.abs() <= z).count();
    println!(
        "{inside} of {} inside: {:?}",
        normed.len(),
        normed.iter().filter(|(_, v)| v.abs() > z).collect::<Vec<_>>()
    );
    assert_eq!(normed.len(), 60);
    assert!(inside >= 53 && normed.iter().all(|(_, v)| v.abs() <= 4.0), "{inside} {normed:?}");
}

#[test]
fn recovery_coverage_attas_intervals_of_model_b_over_recordings() {
    if !slow() {
        return;
    }
    let seeds: u64 = std::env::var("KOEHLER_SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(4);
    let flown = flown();
    let all: Vec<f64> = (0..seeds)
        .flat_map(|seed| {
            analyse(&flown.campaign, &flown.truths, 2000 + seed, &["b-all"]).normed("b-all")
        })
        .map(|(_, v)| v)
        .collect();
    let n = all.len() as f64;
    let share = all.iter().filter(|v| v.abs() <= t_quantile(0.975, 1e6)).count() as f64 / n;
    println!(
        "{seeds} recordings: {:.1}% of {n} intervals hold the truth, rms/sd {:.3}",
        100.0 * share,
        (all.iter().map(|v| v * v).sum::<f64>() / n).sqrt()
    );
    assert!((0.93..=0.97).contains(&share), "{share}");
}

/// Paper: "the estimate of pitch-damping derivative C_mq is much higher than would otherwise be
/// obtained from the pure longitudinal maneuvers"; "only by including the downwash lag due to
/// DLC-flap deflection, is this derivative ... accurately estimated".
#[test]
fn recovery_coverage_attas_pitch_damping_returns_with_the_downwash_lag() {
    if !slow() {
        return;
    }
    let estimates = |model| flown().shipped.one(model, "C_m_q");
    let ((a, a_sd), (b, b_sd), (elevator, elevator_sd)) =
        (estimates("a-dlc"), estimates("b-dlc"), estimates("elevator"));
    println!(
        "C_m_q: model A {a} +- {a_sd}, model B {b} +- {b_sd}, elevator maneuvers {elevator} +- {elevator_sd}"
    );
    let apart = |x: f64, x_sd: f64, y: f64, y_sd: f64| (x - y).abs() / x_sd.hypot(y_sd);
    assert!(a / elevator > 1.1 && apart(a, a_sd, elevator, elevator_sd) > 10.0);
    assert!(apart(b, b_sd, elevator, elevator_sd) < 3.0);
    assert!((b - true_value("C_m_q")).abs() < 3.0 * b_sd);
}

#[test]
fn recovery_coverage_attas_lever_arm_of_the_flaps() {
    if !slow() {
        return;
    }
    let (arm, sd) = flown().shipped.one("b-all", "l_DLC");
    println!("l_DLC {arm} +- {sd} m");
    assert!((arm - true_value("l_DLC")).abs() < 3.0 * sd && sd < 0.02 * arm);
}

/// Paper, Figs. 8 and 9: with model B the pitch rate follows every change of level, and roll and
/// yaw rate no longer show unmodelled motion.
#[test]
fn recovery_coverage_attas_model_b_closes_the_gap() {
    if !slow() {
        return;
    }
    let shipped = &flown().shipped;
    let (a, b) = (shipped.det_r("a-all"), shipped.det_r("b-all"));
    let residuals = shipped.table("residuals");
    let (models, outputs) =
        (residuals.strings("model").unwrap(), residuals.strings("output").unwrap());
    let (sd, n) = (residuals.f64("sd").unwrap(), residuals.i64("n").unwrap());
    let rms = |model: &str, output: &str| {
        let rows = (0..residuals.rows()).filter(|i| models[*i] == model && outputs[*i] == output);
        let (square, count) =
            rows.fold((0.0, 0.0), |s, i| (s.0 + sd[i] * sd[i] * n[i] as f64, s.1 + n[i] as f64));
        (square / count).sqrt().to_degrees()
    };
    println!("det R: A {a:e}, B {b:e}");
    for (output, noise, ratio) in [("p", 0.1, 4.0), ("q", 0.05, 2.0), ("r", 0.08, 4.0)] {
        let (a, b) = (rms("a-all", output), rms("b-all", output));
        println!("{output}: residual sd {a:.3} deg/s with A, {b:.3} with B, sensor noise {noise}");
        assert!(a > ratio * b && (b / noise - 1.0).abs() < 0.1, "{output}");
    }
    assert!(a > 1e6 * b);
}

/// Four significant digits.
fn short(value: f64) -> String {
    let digits =
        if value == 0.0 { 0 } else { (3 - value.abs().log10().floor() as i32).clamp(0, 9) };
    format!("{value:.0$}", digits as usize)
}

/// The tables of the README from the tables of a run.
fn results(shipped: &Path) -> String {
    let table = |name: &str| read_dataset(shipped, name).unwrap_or_else(|e| panic!("{e}"));
    let estimates = table("estimates");
    let text = |name: &str| estimates.strings(name).expect("a column");
    let (models, names, units, per, stops) =
        (text("model"), text("parameter"), text("unit"), text("per"), text("stop"));
    let (values, sds) = (estimates.f64("value").expect("values"), estimates.f64("sd").expect("sd"));
    let find = |model: &str, name: &str| {
        let row = (0..names.len()).find(|&i| {
            models[i] == model && names[i] == name && per[i] == "campaign" && sds[i].is_finite()
        })?;
        assert_eq!(stops[row], "converged", "{model}");
        Some((values[row], sds[row]))
    };
    let both = |found: Option<(f64, f64)>| {
        found.map_or(String::new(), |(value, sd)| format!("{} ({})", short(value), short(sd)))
    };
    let mut lines = vec![
        "| parameter | unit | truth | model A (sd) | model B (sd) | B - truth, sd |".to_string(),
        "|---|---|---|---|---|---|".into(),
    ];
    let (mut inside, mut all) = (0, 0);
    for i in (0..names.len())
        .filter(|&i| models[i] == "b-all" && per[i] == "campaign" && sds[i].is_finite())
    {
        let truth = true_value(names[i]);
        let off = (values[i] - truth) / sds[i];
        let (a, b) = (both(find("a-all", names[i])), both(find("b-all", names[i])));
        lines.push(format!(
            "| {} | {} | {} | {a} | {b} | {off:.1} |",
            names[i],
            units[i],
            short(truth)
        ));
        all += 1;
        inside += usize::from(off.abs() <= t_quantile(0.975, 1e6));
    }
    lines.extend([
        String::new(),
        format!("{inside} of these {all} intervals of 95% hold the truth."),
        String::new(),
    ]);
    lines.extend(["| | model A | model B | truth |".to_string(), "|---|---|---|---|".into()]);
    let mut line = |what: &str, a: String, b: String, truth: &str| {
        lines.push(format!("| {what} | {a} | {b} | {truth} |"))
    };
    let damping = short(true_value("C_m_q"));
    line(
        "C_m_q (sd), all maneuvers",
        both(find("a-all", "C_m_q")),
        both(find("b-all", "C_m_q")),
        &damping,
    );
    line(
        "C_m_q (sd), the flaps' maneuvers alone",
        both(find("a-dlc", "C_m_q")),
        both(find("b-dlc", "C_m_q")),
        &damping,
    );
    let elevator = both(find("elevator", "C_m_q"));
    line("C_m_q (sd), the elevator's maneuvers alone", elevator.clone(), elevator, &damping);
    let residuals = table("residuals");
    let (models, outputs) = (
        residuals.strings("model").expect("models"),
        residuals.strings("output").expect("outputs"),
    );
    let (rms, n) = (residuals.f64("rms").expect("rms"), residuals.i64("n").expect("n"));
    for (output, noise) in [("p", "0.1"), ("q", "0.05"), ("r", "0.08")] {
        let of = |model: &str| {
            let rows =
                (0..residuals.rows()).filter(|i| models[*i] == model && outputs[*i] == output);
            let (square, count) = rows
                .fold((0.0, 0.0), |s, i| (s.0 + rms[i] * rms[i] * n[i] as f64, s.1 + n[i] as f64));
            format!("{:.3}", (square / count).sqrt().to_degrees())
        };
        line(
            &format!("r.m.s. residual of {output}, deg/s"),
            of("a-all"),
            of("b-all"),
            &format!("{noise} (sensor noise)"),
        );
    }
    lines.join("\n") + "\n"
}

#[test]
fn the_results_in_the_readme_of_the_attas_are_those_of_its_run() {
    const START: &str = "<!-- written by `UPDATE_DOCS=1 cargo test --test all the_results_in_the_readme` after a run -->\n";
    const END: &str = "<!-- until here -->\n";
    let path = folder().join("README.md");
    let readme = std::fs::read_to_string(&path).expect("the README");
    assert!(!readme.contains('@'), "a place in the README is not filled in");
    let (before, rest) = readme.split_once(START).expect("the marker of the results");
    let (_, after) = rest.split_once(END).expect("its end");
    let out = folder().join("out");
    if !out.join("estimates").is_dir() {
        println!(
            "skipped: `koehler run pipelines/attas/pipeline.toml` has not been run (some minutes)"
        );
        return;
    }
    let wanted = format!("{before}{START}{}{END}{after}", results(&out));
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, &wanted).expect("written");
    } else {
        assert!(
            readme == wanted,
            "pipelines/attas/README.md is behind pipelines/attas/out: run the pipeline again if it is old, then UPDATE_DOCS=1 cargo test --test all \
             the_results_in_the_readme"
        );
    }
}
