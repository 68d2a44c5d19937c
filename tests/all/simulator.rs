//! Flights of another simulator, with sensor errors that it alone knows: are they found again, inside
//! their intervals, and is what its aircraft has besides found by name?

use crate::flightdata::{copy, data, koehler};
use crate::real::{diagnose, findings};
use koehler::table::{Table, read_dataset};
use serde_json::Value;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Sensor error and where `truth.json` has it.
const ERRORS: [(&str, &str, &str); 11] = [
    ("k_alpha", "scale", "alpha_rad"),
    ("b_alpha", "bias", "alpha_rad"),
    ("tau_alpha_vane", "delay", "alpha_rad"),
    ("k_beta", "scale", "beta_rad"),
    ("b_beta", "bias", "beta_rad"),
    ("b_ax", "bias", "ax_mps2"),
    ("b_ay", "bias", "ay_mps2"),
    ("b_az", "bias", "az_mps2"),
    ("b_p", "bias", "p_radps"),
    ("b_q", "bias", "q_radps"),
    ("b_r", "bias", "r_radps"),
];

/// The folder of the data; a printed reason where there is none, or no time.
pub fn flights() -> Option<PathBuf> {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        eprintln!("skipped: set KOEHLER_SLOW=1 (and use --release) for the four flights");
        return None;
    }
    data("jsbsim/truth.json")
}

pub fn truth(data: &Path) -> Value {
    let text = std::fs::read_to_string(data.join("jsbsim/truth.json")).expect("the truth");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn recovery_coverage_of_sensor_errors_in_flights_of_another_simulator() {
    let Some(data) = flights() else { return };
    let folder = copy("jsbsim");
    koehler(folder.path(), &data, &["run", "flight-path.toml"]);
    let out = folder.path().join("out/flight-path");

    let truth = truth(&data);
    let biases = read_dataset(&out, "biases").expect("biases");
    let column = |name: &str| biases.f64(name).expect("a column");
    let (mut inside, mut all) = (0, 0);
    for (parameter, kind, of) in ERRORS {
        let want = truth["sensor_errors"][kind][of].as_f64().expect("a number");
        let rows: Vec<usize> = (0..biases.rows())
            .filter(|&k| biases.strings("parameter").expect("names")[k] == parameter)
            .collect();
        assert_eq!(rows.len(), 4, "{parameter} is significant in every flight");
        let z: Vec<f64> =
            rows.iter().map(|&k| (column("value")[k] - want) / column("sd")[k]).collect();
        let weights: Vec<f64> =
            rows.iter().map(|&k| 1.0 / (column("sd")[k] * column("sd")[k])).collect();
        let sum: f64 = weights.iter().sum();
        let mean =
            rows.iter().zip(&weights).map(|(&k, w)| w * column("value")[k]).sum::<f64>() / sum;
        println!(
            "{parameter}: {mean:.6} +- {:.6} for {want:.6}, flights {z:.2?}",
            sum.sqrt().recip()
        );
        assert!(z.iter().all(|z| z.abs() < 3.5), "{parameter}: {z:?} standard deviations off");
        assert!(
            (mean - want).abs() < 2.6 / sum.sqrt(),
            "{parameter}: {mean} +- {} for {want}",
            sum.sqrt().recip()
        );
        inside += z.iter().filter(|z| z.abs() < 1.96).count();
        all += z.len();
    }
    let slack = 3.0 * (0.95f64 * 0.05 / f64::from(all as u32)).sqrt();
    assert!(inside as f64 / all as f64 > 0.95 - slack, "{inside} of {all}");

    // and no channel is accused of anything else
    let checks = read_dataset(&out, "consistency").expect("consistency");
    let wrong = ["dead", "sign reversed", "scaled", "late", "early", "clock jumps", "too large"];
    let accused: Vec<&str> = (0..checks.rows())
        .filter(|&k| wrong.contains(&checks.strings("verdict").expect("verdicts")[k]))
        .map(|k| checks.strings("text").expect("texts")[k])
        .collect();
    assert!(accused.is_empty(), "{accused:?}");
}

/// The shipped campaign with some of its estimates alone and no validation, after `change` of its
/// files.
pub fn campaign(kept: &[&str], change: &[(&str, &str, &str)]) -> TempDir {
    let folder = copy("jsbsim");
    let edit = |file: &str, how: &dyn Fn(String) -> String| {
        let path = folder.path().join(file);
        let text = std::fs::read_to_string(&path).expect("a file of the campaign");
        std::fs::write(&path, how(text)).expect("written");
    };
    for (file, old, new) in change {
        edit(file, &|text| {
            assert_eq!(text.matches(old).count(), 1, "{file} has {old:?} once");
            text.replace(old, new)
        });
    }
    edit("pipeline.toml", &|text| {
        let mut settings: toml::Table = toml::from_str(&text).expect("a pipeline");
        let estimates = settings["estimate"].as_array_mut().expect("estimates");
        estimates.retain(|e| kept.contains(&e["name"].as_str().expect("a name")));
        assert_eq!(estimates.len(), kept.len(), "{kept:?}");
        settings.remove("report");
        settings.remove("validate");
        toml::to_string(&settings).expect("TOML")
    });
    folder
}

pub fn rows_of<'a>(table: &'a Table, column: &str) -> Vec<&'a str> {
    table.strings(column).unwrap_or_else(|e| panic!("{e}"))
}

/// Half of the records' rate, in half the time: it clips the corners of the surfaces' ramps, which
/// a large effect that is withheld stands above.
const HALF: (&str, &str, &str) = ("pipeline.toml", "rate_hz = 100.0", "rate_hz = 50.0");

/// The noise of the recorded surfaces (0.02 deg) drives the model as if it were real: that it did
/// not happen is true.
fn is_of_the_record(name: &str) -> bool {
    name.starts_with("surface-noise:delta_")
}

#[test]
fn recovery_nothing_but_the_noise_of_recorded_surfaces_is_named_where_the_model_fits() {
    let Some(data) = flights() else { return };
    let folder = campaign(&["complete"], &[]);
    diagnose(folder.path(), &data, &["pipeline.toml", "--estimate", "complete"]);
    let (verdict, named) = findings(&folder.path().join("out"));
    println!("{verdict}, {named:?}");
    let nothing = ["nothing missing", "nothing missing but noise of records"];
    assert!(nothing.contains(&&*verdict), "{verdict}");
    assert!(named.iter().all(|name| is_of_the_record(name)), "{named:?}");
}

/// `C_n_r r b/(2 V)` is brought back as `C_n_r_more r/V`.
#[test]
fn recovery_a_derivative_that_is_withheld_is_named() {
    let Some(data) = flights() else { return };
    let declared = ("linear.model.toml", "C_n_r    = { unit = \"1/rad\", start = -0.2 }\n", "");
    let folder =
        campaign(&["complete"], &[HALF, declared, ("linear.model.toml", " + C_n_r*r_norm", "")]);
    diagnose(folder.path(), &data, &["pipeline.toml", "--estimate", "complete"]);
    let out = folder.path().join("out");
    let (verdict, named) = findings(&out);
    println!("{verdict}, {named:?}");
    assert!(["named", "one of these"].contains(&&*verdict), "{verdict}");
    assert_eq!(named[0], "rate-derivative-lateral:C_n,r");
    assert!(named[1..].iter().all(|name| is_of_the_record(name)), "{named:?}");
    let table = read_dataset(&out, "additions").expect("additions");
    let row = rows_of(&table, "candidate")
        .iter()
        .rposition(|name| *name == named[0])
        .expect("it was refitted");
    let at = |column: &str| table.f64(column).expect("column")[row];
    let per_half_span = 2.0 / 28.3464;
    let (value, sd) = (at("value") * per_half_span, at("sd") * per_half_span);
    println!("C_n_r: {value:.5} +- {sd:.5}");
    // Half a percent for what the simulator's steps take, as above.
    assert!((value - -0.15).abs() < 3.0 * sd + 0.005 * 0.15, "{value} +- {sd}");
}
