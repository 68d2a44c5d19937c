//! Flights of another simulator, with sensor errors that it alone knows: are they found again, inside their intervals?

use crate::flightdata::{copy, data, koehler};
use koehler::table::read_dataset;

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

#[test]
fn recovery_coverage_of_sensor_errors_in_flights_of_another_simulator() {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        eprintln!("skipped: set KOEHLER_SLOW=1 (and use --release) for the four flights");
        return;
    }
    let Some(data) = data("jsbsim/truth.json") else { return };
    let folder = copy("jsbsim");
    koehler(folder.path(), &data, &["run", "flight-path.toml"]);
    let out = folder.path().join("out/flight-path");

    let text = std::fs::read_to_string(data.join("jsbsim/truth.json")).expect("the truth");
    let truth: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let biases = read_dataset(&out, "biases").expect("biases");
    let column = |name: &str| biases.f64(name).expect("a column");
    let (mut inside, mut all) = (0, 0);
    for (parameter, kind, of) in ERRORS {
        let want = truth["sensor_errors"][kind][of].as_f64().expect("a number");
        let rows: Vec<usize> =
            (0..biases.rows()).filter(|&k| biases.strings("parameter").expect("names")[k] == parameter).collect();
        assert_eq!(rows.len(), 4, "{parameter} is significant in every flight");
        let z: Vec<f64> = rows.iter().map(|&k| (column("value")[k] - want) / column("sd")[k]).collect();
        let weights: Vec<f64> = rows.iter().map(|&k| 1.0 / (column("sd")[k] * column("sd")[k])).collect();
        let sum: f64 = weights.iter().sum();
        let mean = rows.iter().zip(&weights).map(|(&k, w)| w * column("value")[k]).sum::<f64>() / sum;
        println!("{parameter}: {mean:.6} +- {:.6} for {want:.6}, flights {z:.2?}", sum.sqrt().recip());
        assert!(z.iter().all(|z| z.abs() < 3.5), "{parameter}: {z:?} standard deviations off");
        assert!((mean - want).abs() < 2.6 / sum.sqrt(), "{parameter}: {mean} +- {} for {want}", sum.sqrt().recip());
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
