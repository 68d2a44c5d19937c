//! Derivatives and vanes that another simulator alone knows: are they found again, is what its steps do
//! to them explained, and is a flight that no estimate has seen told?

use crate::flightdata::{copy, data, in_the_readme, koehler};
use crate::simulator::{campaign, flights, rows_of, truth};
use koehler::table::{Table, read_dataset};
use serde_json::Value;
use std::collections::BTreeMap;

/// Value and sd of the parameters of one estimate.
type Found<'a> = BTreeMap<&'a str, (f64, f64)>;

fn found<'a>(table: &'a Table, model: &str) -> Found<'a> {
    let (values, sds) = (table.f64("value").expect("values"), table.f64("sd").expect("sd"));
    let models = rows_of(table, "model");
    let rows = rows_of(table, "parameter").into_iter().enumerate();
    rows.filter(|(k, _)| models[*k] == model).map(|(k, name)| (name, (values[k], sds[k]))).collect()
}

/// A derivative of the simulator (by differences of its own forces and moments about the centre of
/// gravity) and what the model says of it.
struct Compared {
    name: &'static str,
    value: f64,
    sd: f64,
    truth: f64,
    /// What the simulator's difference over half a degree adds.
    slack: f64,
}

/// Reference lengths, as `aircraft.json` has them.
const CHORD: f64 = 3.349752;
const SPAN: f64 = 28.3464;

/// All derivatives of a flight: those that do not depend on it, and those that do through the arm of
/// the forces, Mach number and drag.
fn compared(found: &Found, flight: &Value) -> Vec<Compared> {
    let of = |coefficient: &str, by: &str| {
        flight["derivatives_baseline"][coefficient][by].as_f64().expect("a number")
    };
    let value = |name: &str| found[name].0;
    let mut all = Vec::new();
    for (name, coefficient, by) in [
        ("C_L_alpha", "CL", "alpha"),
        ("C_L_de", "CL", "de"),
        ("C_m_alphadot", "Cm", "adhat"),
        ("C_m_q", "Cm", "qhat"),
        ("C_l_p", "Cl", "phat"),
        ("C_l_r", "Cl", "rhat"),
        ("C_l_da", "Cl", "da"),
        ("C_l_dr", "Cl", "dr"),
        ("C_n_beta", "Cn", "beta"),
        ("C_n_p", "Cn", "phat"),
        ("C_n_r", "Cn", "rhat"),
        ("C_n_da", "Cn", "da"),
        ("C_n_dr", "Cn", "dr"),
    ] {
        let truth = of(coefficient, by);
        all.push(Compared { name, value: value(name), sd: found[name].1, truth, slack: 0.0 });
    }
    let (arm, arm_sd) = found["z_forces"];
    let mach = flight["trim"]["mach"].as_f64().expect("a number");
    let (cx_alpha, cx_de, cy_beta) = (of("CX", "alpha"), of("CX", "de"), of("CY", "beta"));
    let sd = |name: &str, arm: f64| (found[name].1.powi(2) + (arm * arm_sd).powi(2)).sqrt();
    let slope = 2.0 * value("C_D_k") * of("CL", "0");
    let damping =
        flight["derivatives_effective_no_alphadot"]["Cm"]["qhat"].as_f64().expect("a number");
    let mut more = |name, value, sd, truth, slack| {
        all.push(Compared { name, value, sd, truth, slack });
    };
    more(
        "C_m_alpha, with the arm",
        value("C_m_alpha") + arm / CHORD * cx_alpha,
        sd("C_m_alpha", cx_alpha / CHORD),
        of("Cm", "alpha"),
        0.0,
    );
    more(
        "C_m_de, with Mach and arm",
        value("C_m_de") + value("C_m_de_Mach") * mach + arm / CHORD * cx_de,
        sd("C_m_de", cx_de / CHORD),
        of("Cm", "de"),
        0.0,
    );
    more(
        "C_m_q + C_m_alphadot",
        value("C_m_q") + value("C_m_alphadot"),
        found["C_m_q"].1,
        damping,
        0.0,
    );
    more(
        "C_l_beta, with the arm",
        value("C_l_beta") - arm / SPAN * cy_beta,
        sd("C_l_beta", cy_beta / SPAN),
        of("Cl", "beta"),
        0.0,
    );
    more(
        "C_D_alpha, with lift",
        value("C_D_alpha") + slope * value("C_L_alpha"),
        found["C_D_alpha"].1,
        of("CD", "alpha"),
        0.0,
    );
    more(
        "C_D_de, with lift",
        value("C_D_de") + slope * value("C_L_de"),
        found["C_D_de"].1,
        of("CD", "de"),
        0.0,
    );
    // The simulator's difference is taken over half a degree, in which the drag of sideslip grows by
    // 0.002.
    more(
        "C_Y_beta, less drag",
        value("C_Y_beta") - of("CD", "0"),
        found["C_Y_beta"].1,
        of("CY", "beta"),
        0.002 * of("CY", "beta").abs(),
    );
    all
}

/// The simulator turns by Euler's steps, which take the moments of their start: half a step late.
/// The moments of sideslip then act as moments of its rate, and yaw is that rate: `C_n_r` is off by
/// `C_n_beta h/2 2 V/b`, `C_l_r` by `C_l_beta h/2 2 V/b`. The model that has moments late by an
/// unknown time finds half a step, and derivatives as they are; the one that has not is off by just
/// that much.
#[test]
fn recovery_derivatives_of_another_simulator() {
    let Some(data) = flights() else { return };
    let folder = campaign(&["complete", "stepping"], &[]);
    koehler(folder.path(), &data, &["run", "pipeline.toml"]);
    let table = read_dataset(&folder.path().join("out"), "estimates").expect("estimates");
    let (complete, stepping) = (found(&table, "complete"), found(&table, "stepping"));
    let truth = truth(&data);
    let flights = truth["flights"].as_array().expect("flights");
    for flight in flights {
        for Compared { name, value, sd, truth, slack } in compared(&stepping, flight) {
            println!(
                "{name}: {value:.5} +- {sd:.5} for {truth:.5}, {:.1} sd",
                (value - truth) / sd
            );
            assert!(
                (value - truth).abs() < 3.0 * sd + slack,
                "{name}: {value} +- {sd} for {truth}"
            );
        }
    }
    let half = 0.5 / truth["args"]["rate"].as_f64().expect("steps in a second");
    let (tau, sd) = stepping["tau"];
    println!("moments are late by {tau:.6} +- {sd:.6} s for {half}");
    assert!((tau - half).abs() < 3.0 * sd && tau > 3.0 * sd, "{tau} +- {sd} for {half}");
    // the three flights of the estimate
    let speeds: Vec<f64> =
        [0, 1, 3].map(|k: usize| flights[k]["trim"]["V"].as_f64().expect("a number")).to_vec();
    let speed = speeds.iter().sum::<f64>() / speeds.len() as f64;
    let of = |coefficient: &str, by: &str| {
        flights[1]["derivatives_baseline"][coefficient][by].as_f64().expect("a number")
    };
    for (name, coefficient) in [("C_n_r", "Cn"), ("C_l_r", "Cl")] {
        let want = of(coefficient, "rhat") + half * 2.0 * speed / SPAN * of(coefficient, "beta");
        let (value, sd) = complete[name];
        println!("{name} without: {value:.5} +- {sd:.5} for {want:.5}");
        assert!((value - want).abs() < 3.0 * sd, "{name}: {value} +- {sd} for {want}");
    }
    in_the_readme("jsbsim", README, &[("derivatives", told(&complete, &stepping, &flights[1]))]);
}

/// What writes the README.
const README: &str =
    "`KOEHLER_SLOW=1 UPDATE_DOCS=1 cargo test --release --test all simulator_derivatives::`";

/// Truth and estimates, for the README.
fn told(complete: &Found, stepping: &Found, flight: &Value) -> String {
    let mut rows =
        "| | truth | `complete` | off by | `stepping` | off by |\n|---|---|---|---|---|---|\n"
            .to_string();
    for (one, other) in compared(complete, flight).iter().zip(compared(stepping, flight)) {
        let each = |c: &Compared| {
            let off = (c.value - c.truth) / c.sd;
            format!("{:.5} ± {:.5} | {off:+.1} sd", c.value, c.sd)
        };
        let (name, how) = one.name.split_once(',').unwrap_or((one.name, ""));
        let comma = if how.is_empty() { "" } else { "," };
        rows += &format!(
            "| `{name}`{comma}{how} | {:.5} | {} | {} |\n",
            one.truth,
            each(one),
            each(&other)
        );
    }
    for name in ["C_L_q", "C_Y_p", "C_Y_r", "C_Y_dr"] {
        let each =
            |(value, sd): (f64, f64)| format!("{value:.5} ± {sd:.5} | {:+.1} sd", value / sd);
        rows +=
            &format!("| `{name}` | 0 | {} | {} |\n", each(complete[name]), each(stepping[name]));
    }
    for name in ["tau", "tau_a"] {
        let (value, sd) = stepping[name];
        rows += &format!("| `{name}`, ms | | | | {:.2} ± {:.2} | |\n", 1e3 * value, 1e3 * sd);
    }
    rows
}

/// What the kinematics alone finds of the vanes is what the estimates are given.
#[test]
fn recovery_of_the_vanes_that_the_estimates_take() {
    let Some(data) = data("jsbsim/truth.json") else { return };
    let folder = copy("jsbsim");
    koehler(folder.path(), &data, &["run", "vanes.toml"]);
    let table = read_dataset(&folder.path().join("out/vanes"), "estimates").expect("estimates");
    let (found, truth) = (found(&table, "vanes"), truth(&data));
    let mut rows = "| | truth | found | off by |\n|---|---|---|---|\n".to_string();
    for (name, kind, of) in [
        ("k_alpha", "scale", "alpha_rad"),
        ("b_alpha", "bias", "alpha_rad"),
        ("tau_alpha", "delay", "alpha_rad"),
        ("k_beta", "scale", "beta_rad"),
        ("b_beta", "bias", "beta_rad"),
    ] {
        let want = truth["sensor_errors"][kind][of].as_f64().expect("a number");
        let (value, sd) = found[name];
        println!("{name}: {value:.6} +- {sd:.6} for {want:.6}");
        assert!((value - want).abs() < 3.0 * sd, "{name}: {value} +- {sd} for {want}");
        rows += &format!(
            "| `{name}` | {want:.6} | {value:.6} ± {sd:.6} | {:+.1} sd |\n",
            (value - want) / sd
        );
    }
    in_the_readme("jsbsim", README, &[("vanes", rows)]);
}

/// The flight that no estimate has seen is told to the noise of its sensors.
#[test]
fn recovery_of_a_flight_held_out() {
    let Some(data) = flights() else { return };
    let folder = copy("jsbsim");
    let path = folder.path().join("pipeline.toml");
    let text = std::fs::read_to_string(&path).expect("the pipeline");
    let mut settings: toml::Table = toml::from_str(&text).expect("a pipeline");
    let estimates = settings["estimate"].as_array_mut().expect("estimates");
    estimates.retain(|e| e["name"].as_str() == Some("complete"));
    settings.remove("report");
    std::fs::write(&path, toml::to_string(&settings).expect("TOML")).expect("written");
    koehler(folder.path(), &data, &["run", "pipeline.toml"]);
    let table = read_dataset(&folder.path().join("out"), "validation").expect("validation");
    let number = |name: &str| table.f64(name).expect("column");
    let outputs = rows_of(&table, "output");
    assert!(rows_of(&table, "flight").iter().all(|flight| *flight == "flight_03"));
    let mut rows =
        "| channel | r.m.s. | sensor's noise | within, at least | good |\n|---|---|---|---|---|\n"
            .to_string();
    for output in outputs.iter().collect::<std::collections::BTreeSet<_>>() {
        let of: Vec<usize> = (0..table.rows()).filter(|&k| outputs[k] == *output).collect();
        let rms = |name: &str| {
            (of.iter().map(|&k| number(name)[k].powi(2)).sum::<f64>() / of.len() as f64).sqrt()
        };
        let least = of.iter().map(|&k| number("within")[k]).fold(1.0, f64::min);
        let verdicts = rows_of(&table, "verdict");
        let good = of.iter().filter(|&&k| verdicts[k] == "good").count();
        println!("{output}: {} of {}, {:.4e}, {:.4e}", good, of.len(), rms("rms"), rms("noise_sd"));
        // nothing but noise, and what the verdict misses is a channel that rests (Theil alone)
        assert!(rms("rms") < 1.1 * rms("noise_sd"), "{output}");
        assert!(of.iter().all(|&k| !verdicts[k].contains("within")), "{output}");
        rows += &format!(
            "| {output} | {:.5} | {:.5} | {:.0}% | {good} of {} |\n",
            rms("rms"),
            rms("noise_sd"),
            100.0 * least,
            of.len()
        );
    }
    in_the_readme("jsbsim", README, &[("held-out", rows)]);
}
