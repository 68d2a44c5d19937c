//! Does one command tell what the paper on the direct-lift-control flaps of the ATTAS tells? The
//! shipped pipeline, with model A; the truth is looked at here alone. Slow: needs `KOEHLER_SLOW=1`,
//! in release mode. And does it tell of nothing in the main job, whose model is the truth's?

use koehler::pipeline::{Plan, Store, run};
use koehler::stage::diagnose;
use koehler::table::{Table, read_dataset};
use std::path::Path;
use std::sync::OnceLock;
use tempfile::TempDir;

/// The findings of the shipped diagnoses, of all flights.
fn out() -> Option<&'static TempDir> {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        println!("skipped: set KOEHLER_SLOW=1 (some minutes in release mode)");
        return None;
    }
    static OUT: OnceLock<TempDir> = OnceLock::new();
    Some(OUT.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for entry in
            std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/attas"))
                .expect("the campaign")
                .flatten()
        {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.ends_with(".toml") {
                std::fs::copy(entry.path(), folder.path().join(&name)).expect("copied");
            }
        }
        let plan = Plan::read_with(&folder.path().join("diagnosis.toml"), |settings| {
            let diagnoses: Vec<diagnose::Settings> =
                settings.read("diagnose").expect("as its schema");
            let wanted: Vec<String> = diagnoses.into_iter().map(|d| d.estimate).collect();
            settings.estimate.retain(|e| wanted.contains(&e.name()));
            settings.told.remove("report");
        });
        let plan = plan.unwrap_or_else(|e| panic!("{e}"));
        let simulation = plan.simulation.as_ref().expect("logs are simulated");
        simulation.fly(&simulation.missing, &|_| {}).unwrap_or_else(|e| panic!("{e}"));
        let result = run(
            &plan,
            &Store::open(&folder.path().join("out")),
            &koehler::engine::Threads,
            &|_| {},
            &Default::default(),
        )
        .unwrap_or_else(|e| panic!("{e}"));
        assert!(result.errors.is_empty(), "{}", result.errors);
        folder
    }))
}

fn table(out: &TempDir, name: &str) -> Table {
    read_dataset(&out.path().join("out"), name).unwrap_or_else(|e| panic!("{e}"))
}

/// The hinge-moment coefficients of the main job are lines in the trimmed angle of attack, as its
/// `[[fit]]` says; its model lacks nothing. Taken as one number each, a damping that grows with
/// rate was named.
#[test]
fn recovery_nothing_is_missing_in_the_main_job() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let campaign = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/citation");
    for entry in std::fs::read_dir(campaign).expect("the campaign").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with(".toml") {
            std::fs::copy(entry.path(), folder.path().join(&name)).expect("copied");
        }
    }
    // One flight of ten, and of its estimates that of the elevator.
    let edit = |name: &str, from: &str, to: &str| {
        let path = folder.path().join(name);
        let text = std::fs::read_to_string(&path).expect("readable");
        let (before, rest) = text.split_once(from).expect(from);
        let (_, after) = rest.split_once(to).expect(to);
        std::fs::write(&path, format!("{before}{to}{after}")).expect("written");
    };
    edit("campaign.toml", "[flights.flight-2]", "# --- the recorder");
    edit("pipeline.toml", "# --- the same lines in one fit", "[report]");
    edit("pipeline.toml", "except = [\"flight-4\"]\n", "");
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
    let output = command
        .current_dir(folder.path())
        .args(["diagnose", "pipeline.toml"])
        .output()
        .expect("started");
    let (out, err) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(0), "{out}\n{err}");
    assert!(
        out.contains("elevator: NOTHING MISSING") && out.contains("C_h_0 are lines in alpha"),
        "{out}"
    );
    // It was looked for: many candidates that the flights could have shown, and maneuvers held out.
    let t = read_dataset(&folder.path().join("out"), "candidates").expect("candidates");
    let standings = t.strings("standing").expect("column");
    assert!(standings.iter().filter(|s| **s == "within chance").count() >= 10, "{standings:?}");
}

/// Effects named by one diagnosis, with those that are not distinguishable from them.
fn named(out: &TempDir, diagnosis: &str) -> Vec<String> {
    let t = table(out, "findings");
    let (names, candidates) =
        (t.strings("diagnosis").unwrap(), t.opt_strings("candidate").unwrap());
    let (verdicts, texts) = (t.strings("verdict").unwrap(), t.strings("text").unwrap());
    let rows: Vec<usize> = (0..t.rows()).filter(|&i| names[i] == diagnosis).collect();
    rows.iter().for_each(|&i| println!("{diagnosis} {}: {}", verdicts[i], texts[i]));
    assert_eq!(verdicts[rows[0]], "named", "{}", texts[rows[0]]);
    rows.iter().filter_map(|&i| candidates[i].map(str::to_string)).collect()
}

/// Paper, Eqs. 6 and 7: the downwash after its transit time, the rolling moment of unequal lift,
/// the interference with the ailerons.
#[test]
fn recovery_coverage_attas_what_model_a_lacks_is_named() {
    let Some(out) = out() else { return };
    let named = named(out, "model-a");
    for wanted in [
        "downwash-lag:eta",
        "unsymmetric-lift:eta",
        "control-interference:eta,xi,C_l",
        "control-interference:eta,xi,C_n",
    ] {
        assert!(named.iter().any(|n| n == wanted), "{wanted} is not among {named:?}");
    }
    // The data prefer the delay to the rate derivative.
    assert!(named.iter().all(|n| !n.starts_with("control-rate")), "{named:?}");
    let t = table(out, "additions");
    let (diagnoses, parameters) =
        (t.strings("diagnosis").unwrap(), t.strings("parameter").unwrap());
    let (values, sds) = (t.f64("value").unwrap(), t.f64("sd").unwrap());
    let arm = (0..t.rows())
        .rfind(|&i| diagnoses[i] == "model-a" && parameters[i] == "r_H_eta")
        .expect("a transit distance");
    println!("r_H = {} +- {} m", values[arm], sds[arm]);
    assert!((values[arm] - 8.5).abs() < 3.0 * sds[arm] && sds[arm] < 0.5);
}

/// "Only by including the downwash lag due to DLC-flap deflection, is this derivative ...
/// accurately estimated": on the flaps' maneuvers alone C_m_q moves by many standard deviations, to
/// its true value.
#[test]
fn recovery_coverage_attas_pitch_damping_returns_when_the_lag_is_added() {
    let Some(out) = out() else { return };
    assert!(named(out, "model-a-flaps-alone").iter().any(|n| n == "downwash-lag:eta"));
    let t = table(out, "shifts");
    let (diagnoses, parameters) =
        (t.strings("diagnosis").unwrap(), t.strings("parameter").unwrap());
    let at = (0..t.rows())
        .find(|&i| diagnoses[i] == "model-a-flaps-alone" && parameters[i] == "C_m_q")
        .expect("C_m_q");
    let column = |name: &str| t.f64(name).unwrap()[at];
    println!(
        "C_m_q: {} before, {} +- {} after",
        column("before"),
        column("after"),
        column("after_sd")
    );
    let text = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/attas/truth_aerodynamics.model.toml"),
    );
    let truth: toml::Table = toml::from_str(&text.expect("the truth")).expect("a model");
    let truth = truth["constants"]["C_m_q"]["value"].as_float().expect("a number");
    assert!(
        column("shift").abs() > 5.0 && (column("after") - truth).abs() < 4.0 * column("after_sd")
    );
}
