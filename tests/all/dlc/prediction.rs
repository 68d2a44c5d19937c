//! What flight shows of the flaps beside what a wind tunnel predicts (paper, Fig. 11), and what a simulation with the
//! predicted values lacks.

use super::flown;
use super::results::{folder, true_value};
use crate::flightdata::slow;
use koehler::table::{Table, read_dataset};

/// Both curves at both settings: equation, deflection, landing flap.
fn truth(equation: &str, eta: f64, at: &str) -> f64 {
    let of = |name: &str| match at.contains("0.244") {
        true => true_value(&format!("{name}_14")),
        false => true_value(name),
    };
    match equation {
        "C_L_DLC" => {
            let beyond = (eta - true_value("eta_sep")).max(0.0);
            let cubic = of("A_1") * eta + of("A_2") * eta * eta + of("A_3") * eta.powi(3);
            2.0 * (cubic + of("A_sep") * beyond * beyond)
        }
        _ => {
            let cubic = of("M_1") * eta + of("M_2") * eta * eta + of("M_3") * eta.powi(3);
            2.0 * cubic + of("C_m_eta_lag") * eta
        }
    }
}

#[test]
fn recovery_attas_curves_of_the_flaps_hold_the_truth_and_miss_the_wind_tunnel() {
    if !slow() {
        return;
    }
    let out = flown().shipped.out.path().join("out");
    let table =
        |name: &str| -> Table { read_dataset(&out, name).unwrap_or_else(|e| panic!("{e}")) };
    let curves = table("curves");
    let text = |name: &str| curves.strings(name).expect("texts");
    let number = |name: &str| curves.f64(name).expect("numbers");
    let (equations, at, x, sd) = (text("equation"), text("at"), number("x"), number("sd"));
    let [value, lower, upper] = ["value", "simultaneous_lower", "simultaneous_upper"].map(number);
    for k in 0..curves.rows() {
        let truth = truth(equations[k], x[k], at[k]);
        assert!((lower[k]..=upper[k]).contains(&truth), "{} at {}: {truth}", equations[k], x[k]);
        // the assumed constants are exact in a simulation: four standard deviations of the noise
        assert!((value[k] - truth).abs() <= 4.0 * sd[k], "{} at {}", equations[k], x[k]);
    }
    let predictions = table("predictions");
    let beyond = predictions.bools("beyond").expect("flags");
    let (equations, x) =
        (predictions.strings("equation").expect("texts"), predictions.f64("x").expect("numbers"));
    let at = predictions.strings("at").expect("texts");
    let of = |equation: &str, setting: &str| -> Vec<bool> {
        let rows = (0..x.len()).filter(|&k| equations[k] == equation && x[k] != 0.0);
        rows.filter(|&k| at[k].contains(setting)).map(|k| beyond[k]).collect()
    };
    // more lift is predicted than there is; moments agree, but for a shift at 14 deg
    assert!(of("C_L_DLC", "0.01745").iter().all(|beyond| *beyond));
    assert!(of("C_m_DLC", "0.01745").iter().all(|beyond| !*beyond));
    assert!(of("C_m_DLC", "0.24435").iter().all(|beyond| *beyond));
}

#[test]
fn recovery_attas_what_the_predicted_flaps_lack_is_named_and_nothing_else() {
    if !slow() {
        return;
    }
    let copy = tempfile::tempdir().expect("a folder");
    for entry in std::fs::read_dir(folder()).expect("the campaign").flatten() {
        if entry.path().extension().is_some_and(|e| e == "toml") {
            std::fs::copy(entry.path(), copy.path().join(entry.file_name())).expect("copied");
        }
    }
    // 3: something is missing
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
    let run = command.current_dir(copy.path()).args(["diagnose", "prediction.toml"]);
    let run = run.output().expect("started");
    assert_eq!(run.status.code(), Some(3), "{}", String::from_utf8_lossy(&run.stderr));
    let out = copy.path().join("out/prediction");
    let findings = read_dataset(&out, "findings").unwrap_or_else(|e| panic!("{e}"));
    let verdicts = findings.strings("verdict").expect("texts");
    let candidates = findings.opt_strings("candidate").expect("texts");
    let mut named: Vec<&str> = candidates.into_iter().flatten().collect();
    named.sort_unstable();
    println!("{verdicts:?} {named:?}");
    let wanted = [
        "control-effect-longitudinal:eta,C_L",
        "control-interference:eta,xi,C_l",
        "control-interference:eta,xi,C_n",
        "downwash-lag:eta",
        "unsymmetric-drag:eta",
        "unsymmetric-lift:eta",
    ];
    assert_eq!(named, wanted);
    assert!(verdicts.iter().all(|verdict| *verdict == "named"), "{verdicts:?}");
    // With them the gap is noise on held-out maneuvers, but for the bank that noise of measured surfaces adds up to.
    let gaps = read_dataset(&out, "gaps").unwrap_or_else(|e| panic!("{e}"));
    let of = |name: &str| gaps.strings(name).expect("texts");
    let (when, output, by) = (of("when"), of("output"), of("by"));
    let ratios = gaps.f64("ratio").expect("numbers");
    let largest = |at: &str| {
        let rows = (0..ratios.len()).filter(|&k| when[k] == at && by[k] == "all");
        rows.filter(|&k| output[k] != "phi").map(|k| ratios[k]).fold(0.0, f64::max)
    };
    println!(
        "r.m.s. over noise, at most: {:.1} before, {:.2} after",
        largest("before"),
        largest("after")
    );
    assert!(largest("before") > 10.0 && largest("after") < 1.3);
    // Estimated from all maneuvers, each value is the truth's.
    let again = read_dataset(&out, "estimates").unwrap_or_else(|e| panic!("{e}"));
    let arm = true_value("l_DLC") / true_value("s");
    for (parameter, truth) in [
        ("C_L_eta", 2.0 * (true_value("A_1") - 0.67)),
        ("C_m_eta_lag", true_value("C_m_eta_lag")),
        ("r_H_eta", true_value("r_H")),
        ("arm_roll_eta", arm),
        ("arm_yaw_eta", arm),
        ("C_l_xi_eta", true_value("C_l_xi_eta")),
        ("C_n_xi_eta", true_value("C_n_xi_eta")),
    ] {
        let of = |name: &str| again.strings(name).expect("texts");
        let is =
            |&k: &usize| of("model")[k] == "prediction.next" && of("parameter")[k] == parameter;
        let row = (0..again.rows()).find(is).unwrap_or_else(|| panic!("no {parameter}"));
        let get = |name: &str| again.f64(name).expect("numbers")[row];
        println!("{parameter} {} +- {} for {truth}", get("value"), get("sd"));
        assert!((get("value") - truth).abs() <= 3.0 * get("sd"), "{parameter}");
    }
}
