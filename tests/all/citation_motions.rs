//! The estimation models of the Citation against its truth: small motions without friction, in
//! which elevator and ailerons must move alike, whoever the servo's current comes from.

use koehler::dynamics::{Channel, Interpolation, Record};
use koehler::estimate::{Settings, Stop, estimate};
use koehler::model::{Constants, Model};
use koehler::simulate::{Campaign, Truth};
use std::path::{Path, PathBuf};

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/citation")
}

/// What the estimation models are driven by, as the truth model names it.
const ASKED: &str = r#"
qbar         = { unit = "Pa", value = "qbar" }
V            = { unit = "m/s", value = "V" }
beta         = { unit = "rad", value = "beta" }
alpha_h_star = { unit = "rad", value = "alpha_h_star" }
alphadot_h   = { unit = "rad/s", value = "alphadot_h" }
az_bw        = { unit = "m/s^2", value = "az_bw" }
alpha_l      = { unit = "rad", value = "alpha_l" }
alpha_r      = { unit = "rad", value = "alpha_r" }
C_ha_0_true  = { unit = "-", value = "C_ha_0" }
"#;

/// One maneuver of `amplitude` volts at `speed_kt`, without friction.
fn flown(speed_kt: f64, maneuver: &str, amplitude: f64) -> Truth {
    let folder = tempfile::tempdir().expect("a folder");
    for entry in std::fs::read_dir(shipped()).expect("the campaign").flatten() {
        if entry.path().extension().is_some_and(|e| e == "toml") {
            std::fs::copy(entry.path(), folder.path().join(entry.file_name())).expect("copied");
        }
    }
    let edit = |name: &str, change: &dyn Fn(String) -> String| {
        let file = folder.path().join(name);
        let text = std::fs::read_to_string(&file).expect("read");
        std::fs::write(&file, change(text)).expect("written");
    };
    edit("truth.model.toml", &|text| text.replace("[outputs]\n", &format!("[outputs]\n{ASKED}")));
    edit("campaign.toml", &|text| {
        let flight = format!(
            "[flights.small]\naltitude_ft = 17000\nspeeds_kt = [{speed_kt}]\nat_each = [\"{maneuver}\"]\n\n"
        );
        text.replace("amplitude = 2.5", &format!("amplitude = {amplitude}")).replacen(
            "[flights.flight-1]",
            &format!("{flight}[flights.flight-1]"),
            1,
        )
    });
    let none: Constants = toml::from_str(
        "F_c_flight = { value = 0.0, unit = \"N\", sd = 0.0, source = \"none\" }\n\
         kept = { value = 0.0, unit = \"-\", sd = 0.0, source = \"none\" }\n",
    )
    .expect("constants");
    let campaign = Campaign::load_with(&folder.path().join("campaign.toml"), &none);
    campaign.unwrap_or_else(|e| panic!("{e}")).truth("small").unwrap_or_else(|e| panic!("{e}"))
}

/// Largest difference over the largest deflection, once the model has the true coefficients and the
/// offset `offset` alone is adjusted: trim and assumed preload are round numbers.
fn apart(truth: &Truth, model: &str, output: &str, friction: &str, offset: &str) -> f64 {
    let constants: Constants =
        toml::from_str(&std::fs::read_to_string(shipped().join("aircraft.toml")).expect("read"))
            .expect("constants");
    let model = Model::load(&shipped().join(model), &constants).unwrap_or_else(|e| panic!("{e}"));
    let flown = &truth.maneuvers[0];
    let from = ((flown.t_start_s - 1.0) / truth.dt).round() as usize;
    let to = ((flown.t_end_s + 2.0) / truth.dt).round() as usize;
    let column = |name: &str| &truth.signals[name].values[from..to];
    let inputs: Vec<&[f64]> = model.inputs.iter().map(|q| column(&q.name)).collect();
    let n = to - from;
    let record = Record {
        dt: truth.dt,
        n,
        inputs: (0..n).flat_map(|k| inputs.iter().map(move |x| x[k])).collect(),
        channels: vec![Channel {
            output: model.outputs.iter().position(|o| o.name == output).expect("an output"),
            t: (0..n).map(|k| k as f64 * truth.dt).collect(),
            z: column(output).to_vec().into(),
        }],
        interpolation: vec![Interpolation::Cubic; inputs.len()],
        ..Record::default()
    };
    let start = |name: &str| match name {
        _ if name == friction => 0.0,
        _ => column(&format!("{name}_true"))[0],
    };
    let names = || model.parameters.iter().map(|p| p.quantity.name.clone());
    let settings = Settings {
        fixed: names().filter(|name| name != offset).collect(),
        starts: names().map(|name| (name.clone(), start(&name))).collect(),
        ..Settings::default()
    };
    let found = estimate(&model, &[record], &settings).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(found.stop, Stop::Converged);
    let trace = &found.responses[0][0];
    let largest = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0, |m: f64, x| m.max(x.abs()));
    let difference = largest(&mut trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y));
    let rest = trace.measured[0];
    let travel = largest(&mut trace.measured.iter().map(|z| z - rest));
    println!("{output}: {difference:.2e} of {travel:.2e} rad");
    difference / travel
}

#[test]
fn truth_small_motions_of_the_estimation_models_are_those_of_the_truth() {
    for speed_kt in [130.0, 220.0] {
        let elevator = flown(speed_kt, "longitudinal", 0.2);
        let apart_e = apart(&elevator, "elevator.model.toml", "delta_e", "F_c", "C_h_0");
        let aileron = flown(speed_kt, "lateral", 0.2);
        let apart_a = apart(&aileron, "aileron.model.toml", "delta_a", "F_ca", "C_ha_0");
        println!("{speed_kt} kt: elevator {apart_e:.4}, ailerons {apart_a:.4}");
        assert!(apart_e < 0.01 && apart_a < 0.01, "{speed_kt} kt: {apart_e} {apart_a}");
    }
}
