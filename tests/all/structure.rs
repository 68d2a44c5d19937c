//! Settings of the estimator that say what differs between maneuvers, from the pipeline file to the
//! tables.

use crate::flightdata::{copy, data, koehler};
use koehler::table::read_dataset;

const PIPELINE: &str = r#"
title    = "ATTAS: short period, what differs between the two flights"
channels = "channels.toml"
logs     = ["logs/fAttasElv1.mcap", "logs/fAttasElv2.mcap"]

[derive]
rate_hz = 25.0

[[estimate]]
name  = "plain"
model = "short_period.model.toml"
group = "all"

[estimate.method]
initial = ["alpha", "q"]

[[estimate]]
name  = "apart"
model = "short_period.model.toml"
group = "all"

[estimate.method]
initial      = ["alpha", "q"]
noise        = "full"
noise_per    = "flight"
step_control = "levenberg-marquardt"
per          = { M0 = "flight", du_de = "flight" }
fixed        = ["Z0"]
starts       = { Z0 = 0.0 }

[estimate.method.shifts]
inputs = ["de"]
"#;

#[test]
fn what_differs_between_flights_is_told_apart_in_the_tables() {
    let Some(data) = data("attas/fAttasElv1.mat") else { return };
    let folder = copy("attas-real");
    koehler(folder.path(), &data, &["import", "import.toml"]);
    std::fs::write(folder.path().join("apart.toml"), PIPELINE).expect("written");
    koehler(folder.path(), &data, &["run", "apart.toml"]);
    let out = folder.path().join("out/apart");
    let estimates = read_dataset(&out, "estimates").expect("estimates");
    let text = |name: &str| estimates.strings(name).expect("column");
    let of = estimates.opt_strings("of").expect("column");
    let rows: Vec<(&str, &str, Option<&str>)> = (0..estimates.rows())
        .filter(|&i| text("model")[i] == "apart" && !text("parameter")[i].ends_with("(0)"))
        .map(|i| (text("parameter")[i], text("per")[i], of[i]))
        .collect();
    let per_flight = |name: &'static str| {
        ["fAttasElv1", "fAttasElv2"].map(|flight| (name, "flight", Some(flight)))
    };
    let campaign = |name: &'static str| (name, "campaign", None);
    let mut wanted: Vec<_> = ["Ma", "Md", "Mq", "Za", "Zd", "Zq"].map(campaign).to_vec();
    wanted.extend(per_flight("M0"));
    wanted.extend(per_flight("du_de"));
    wanted.sort_unstable();
    assert_eq!(rows, wanted);
    assert!((0..estimates.rows()).all(|i| text("stop")[i] == "converged"), "{:?}", text("stop"));
    // The start of a measured initial value, per segment.
    let initial = (0..estimates.rows())
        .filter(|&i| text("parameter")[i] == "q(0)" && text("per")[i] == "segment")
        .count();
    assert_eq!(initial, 4);
    let iterations = read_dataset(&out, "iterations").expect("iterations");
    let models = iterations.strings("model").expect("column");
    let last = |model: &str, name: &str| {
        let mut rows = (0..iterations.rows()).filter(|&i| models[i] == model);
        iterations.f64(name).expect("column")[rows.next_back().expect("a row")]
    };
    assert!(last("apart", "damping") > 0.0 && last("plain", "damping") == 0.0);
    for model in ["apart", "plain"] {
        assert!(
            last(model, "gradient") <= 0.01
                && last(model, "change") < 1e-6
                && last(model, "det_r") > 0.0
        );
    }
    // Noise of its own, correlated, and an input shift fit the records better.
    assert!(last("apart", "cost") < last("plain", "cost"));
}

#[test]
fn fault_columns_and_names_are_checked_before_any_log_is_read() {
    let folder = copy("attas-real");
    let wrong = PIPELINE
        .replace("M0 = \"flight\"", "M0 = \"flights\", Mx = \"flight\"")
        .replace("noise_per    = \"flight\"", "noise_per    = \"kind\"")
        .replace("[derive]", "# no logs here\n[derive]")
        .replace("inputs = [\"de\"]", "inputs = [\"de\"]\nper = \"flap\"");
    std::fs::write(folder.path().join("wrong.toml"), &wrong).expect("written");
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
    let output =
        command.current_dir(folder.path()).args(["check", "wrong.toml"]).output().expect("started");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    for part in [
        "no column of the segments \"flights\"",
        "no parameter of the model \"Mx\"",
        "no column of the segments \"kind\"",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(text.contains("did you mean \"flight\""), "{text}");
}
