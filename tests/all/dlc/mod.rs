//! Does the analysis of the simulated ATTAS campaign tell what the paper on its direct-lift-control
//! flaps tells? Logs go through the shipped pipeline; the truth is looked at here alone.
//!
//! Slow: needs `KOEHLER_SLOW=1`, in release mode. `KOEHLER_SEEDS` chooses the recordings that the
//! pooled coverage is judged by.

mod prediction;
mod proof;
mod readme;
mod results;

use crate::flightdata::{seeds, slow};
use koehler::math::distribution::t_quantile;
use koehler::pipeline::{Plan, Store, run};
use koehler::simulate::{Campaign, Truth, write_log};
use rayon::prelude::*;
use results::{Results, Row, folder};
use std::collections::BTreeMap;
use std::sync::OnceLock;
use tempfile::TempDir;

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

/// Records the flights with the sensors' random numbers from `seed`, and runs the shipped pipeline,
/// or only its estimates `only`.
fn analyse(campaign: &Campaign, truths: &[Truth], seed: u64, only: &[&str]) -> Analysis {
    let out = tempfile::tempdir().expect("a temporary folder");
    for entry in std::fs::read_dir(folder()).expect("the campaign").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_read = name.ends_with(".toml") || name.ends_with(".csv");
        if is_read && !name.starts_with("truth") && name != "campaign.toml" {
            std::fs::copy(entry.path(), out.path().join(&name)).expect("copied");
        }
    }
    if !only.is_empty() {
        // The flights of the proof of match are in no estimate, and are not recorded here.
        let path = out.path().join("pipeline.toml");
        let text = std::fs::read_to_string(&path).expect("the pipeline");
        std::fs::write(&path, text.replace("except  = [\"match-*\"]\n", "")).expect("written");
    }
    let mut biases = BTreeMap::new();
    let wanted = |truth: &&Truth| only.is_empty() || !truth.flight.starts_with("match-");
    for truth in truths.iter().filter(wanted) {
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
    let plan = Plan::read_with(&out.path().join("pipeline.toml"), |settings| {
        settings.simulate = None;
        settings.estimate.retain(|e| only.is_empty() || only.contains(&e.name().as_str()));
        // the path serves the report's checks of the sensors; no estimate takes anything from it
        settings.reconstruct = None;
        // curves are those of one of the estimates
        let without = if only.is_empty() { &["curve"; 0][..] } else { &["curve"] };
        let without = [&["report", "figure", "validate", "diagnose"], without].concat();
        without.iter().for_each(|stage| drop(settings.told.remove(*stage)));
    });
    let plan = plan.unwrap_or_else(|e| panic!("{e}"));
    let result = run(
        &plan,
        &Store::open(&out.path().join("out")),
        &koehler::engine::Threads,
        &|_| {},
        &Default::default(),
    )
    .unwrap_or_else(|e| panic!("{e}"));
    let lost: Vec<_> =
        result.notes.iter().filter(|n| n.severity == koehler::stage::Severity::Missing).collect();
    assert!(result.complete() && lost.is_empty(), "seed {seed}: {lost:?} {}", result.errors);
    Analysis { out, biases }
}

impl Analysis {
    fn results(&self) -> Results {
        Results::of(&self.out.path().join("out"))
    }

    /// (estimate - truth)/sd of what `model` has in common for maneuvers.
    fn normed(&self, model: &str) -> Vec<(String, f64)> {
        let off = |row: &Row| match (row.parameter.strip_prefix("dz_"), &row.of) {
            (Some(sensor), Some(flight)) => {
                (row.value - self.biases[&(flight.clone(), sensor.to_string())]) / row.sd
            }
            _ => row.off(),
        };
        let rows = self.results().rows(model);
        rows.iter().map(|r| (format!("{} {:?}", r.parameter, r.of), off(r))).collect()
    }
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
    // 23 values for all, 16 for each of two landing flaps, six biases for each of eight flights
    assert_eq!(normed.len(), 23 + 2 * 16 + 6 * 8);
    let enough = (0.88 * normed.len() as f64).ceil() as usize;
    assert!(inside >= enough && normed.iter().all(|(_, v)| v.abs() <= 4.0), "{inside} {normed:?}");
}

#[test]
fn recovery_coverage_attas_intervals_of_model_b_over_recordings() {
    if !slow() {
        return;
    }
    let seeds = seeds();
    let count = seeds.clone().count();
    let (flown, z) = (flown(), t_quantile(0.975, 1e6));
    let one = |seed: u64| {
        let normed =
            analyse(&flown.campaign, &flown.truths, 2000 + seed, &["b-all"]).normed("b-all");
        let inside = normed.iter().filter(|(_, v)| v.abs() <= z).count();
        println!("seed {}: {inside} of {} inside", 2000 + seed, normed.len());
        normed
    };
    let all: Vec<(String, f64)> = seeds.flat_map(one).collect();
    let n = all.len() as f64;
    let share = all.iter().filter(|(_, v)| v.abs() <= z).count() as f64 / n;
    println!(
        "{count} recordings: {:.1}% of {n} intervals hold the truth, rms/sd {:.3}",
        100.0 * share,
        (all.iter().map(|(_, v)| v * v).sum::<f64>() / n).sqrt()
    );
    let mut by_name = BTreeMap::<&str, Vec<f64>>::new();
    all.iter().for_each(|(name, v)| by_name.entry(name).or_default().push(*v));
    for (name, values) in &by_name {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let rms = (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
        println!("{name}: mean {mean:.2}, rms {rms:.2}");
    }
    assert!((0.92..=0.97).contains(&share), "{share}");
}

/// Paper: "the estimate of pitch-damping derivative C_mq is much higher than would otherwise be
/// obtained from the pure longitudinal maneuvers"; "only by including the downwash lag due to
/// DLC-flap deflection, is this derivative ... accurately estimated".
#[test]
fn recovery_coverage_attas_pitch_damping_returns_with_the_downwash_lag() {
    if !slow() {
        return;
    }
    let results = flown().shipped.results();
    let [a, b, elevator] = ["a-dlc", "b-dlc", "elevator"].map(|model| results.one(model, "C_m_q"));
    println!(
        "C_m_q: model A {} +- {}, model B {} +- {}, elevator maneuvers {} +- {}",
        a.value, a.sd, b.value, b.sd, elevator.value, elevator.sd
    );
    let apart = |x: &Row, y: &Row| (x.value - y.value).abs() / x.sd.hypot(y.sd);
    // the sd of model A is that of its coloured residuals: nine times the Cramer-Rao bound
    assert!(a.value / elevator.value > 1.1 && apart(&a, &elevator) > 5.0);
    assert!(apart(&b, &elevator) < 3.0 && b.off().abs() < 3.0);
}

#[test]
fn recovery_coverage_attas_lever_arm_and_transit_distance() {
    if !slow() {
        return;
    }
    let results = flown().shipped.results();
    for (model, name) in [("b-all", "l_DLC"), ("b-distance", "r_H_free")] {
        let row = results.one(model, name);
        println!("{name} {} +- {} m", row.value, row.sd);
        assert!(row.off().abs() < 3.0 && row.sd < 0.02 * row.value, "{name}");
    }
}

/// Paper, Figs. 8 and 9: with model B the pitch rate follows every change of level, and roll and
/// yaw rate no longer show unmodelled motion.
#[test]
fn recovery_coverage_attas_model_b_closes_the_gap() {
    if !slow() {
        return;
    }
    let results = flown().shipped.results();
    let (a, b) = (results.det_r("a-all"), results.det_r("b-all"));
    println!("det R: A {a:e}, B {b:e}");
    for (output, noise, ratio) in [("p", 0.1, 4.0), ("q", 0.05, 2.0), ("r", 0.08, 4.0)] {
        let rms = |model| results.rms(model, output).to_degrees();
        let (a, b) = (rms("a-all"), rms("b-all"));
        println!("{output}: residual {a:.3} deg/s with A, {b:.3} with B, sensor noise {noise}");
        assert!(a > ratio * b && (b / noise - 1.0).abs() < 0.1, "{output}");
    }
    assert!(a > 1e6 * b);
    let ([a_near, a_steady], [b_near, b_steady]) =
        (results.pitch_rate("a-dlc"), results.pitch_rate("b-dlc"));
    println!("q near changes: A {a_near:e}, B {b_near:e}; steady: A {a_steady:e}, B {b_steady:e}");
    assert!(a_near > 3.0 * b_near && a_steady < 1.5 * b_steady);
}

/// The paper takes the delay, and calls rate derivative and lag approximations: the data agree.
#[test]
fn recovery_coverage_attas_the_delay_is_preferred_to_its_approximations() {
    if !slow() {
        return;
    }
    let results = flown().shipped.results();
    let det = |model| results.det_r(model) / results.det_r("b-all");
    let ratios = ["b-rate", "b-lag", "b-no-interference", "b-constant-mass", "b-distance"].map(det);
    println!("det R over that of model B: {ratios:?}");
    assert!(ratios[..4].iter().all(|ratio| *ratio > 1.01));
    // one more parameter, which has found its value, gains nothing
    assert!((ratios[4] - 1.0).abs() < 1e-3);
}
