//! Campaigns of another simulator with something hidden in them, or nothing: is that named, and nothing else?
//!
//! Slow: needs `KOEHLER_SLOW=1`, in release mode, some minutes for each; `KOEHLER_FOREIGN=rudder-lag` takes one of them.

use crate::flightdata::{data, koehler};
use crate::real::{classes, diagnose, findings};
use crate::simulator::campaign;
use koehler::table::read_dataset;

/// A campaign, and what is hidden in it: candidates that are that, a parameter of it, and its value.
const CAMPAIGNS: [(&str, &[&str], &str, f64); 6] = [
    ("rudder-lag", &["actuator-lag:delta_r"], "T_delta_r", 0.1),
    ("damping-alpha", &["damping-changes-longitudinal:C_m,alpha"], "", 0.0),
    ("downwash-lag", &["downwash-lag-time:delta_e"], "tau_H_delta_e", 0.2),
    ("two-effects", &["control-coupling:delta_e,C_n", "actuator-lag:delta_e"], "", 0.0),
    ("turbulence-cubic", &["control-cubic-longitudinal:delta_e,C_m"], "C_m_delta_e3", -60.0),
    ("turbulence-nothing", &[], "", 0.0),
];

#[test]
fn recovery_what_is_hidden_in_flights_of_another_simulator() {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        println!("skipped: set KOEHLER_SLOW=1 (and use --release) for the six campaigns");
        return;
    }
    let wanted = std::env::var("KOEHLER_FOREIGN").ok();
    let mut wrong = Vec::new();
    for (name, hidden, parameter, value) in CAMPAIGNS {
        if wanted.as_ref().is_some_and(|wanted| wanted != name) {
            continue;
        }
        let Some(data) = data(&format!("jsbsim-effects/{name}/truth.json")) else { return };
        let folder = campaign(&["complete"], &[]);
        for file in ["pipeline.toml", "vanes.toml"] {
            let path = folder.path().join(file);
            let text = std::fs::read_to_string(&path).expect("a pipeline");
            let text = text
                .replace("jsbsim/logs/", &format!("jsbsim-effects/{name}/"))
                .replace("rate_hz = 100.0", "rate_hz = 50.0");
            std::fs::write(&path, text).expect("written");
        }
        every_flight(&folder.path().join("pipeline.toml"));
        koehler(folder.path(), &data, &["run", "vanes.toml"]);
        diagnose(folder.path(), &data, &["pipeline.toml", "--estimate", "complete"]);
        let out = folder.path().join("out");
        let (verdict, classes) = (findings(&out).0, classes(&out));
        println!("{name}: {verdict}, {classes:?}");
        // The noise of the recorded surfaces drives the model: that it did not happen is true.
        let is_true =
            |n: &String| hidden.contains(&n.as_str()) || n.starts_with("surface-noise:delta_");
        // Of a class that the flights do not separate one is the truth.
        let is_found = |h: &&str| classes.iter().any(|class| class.iter().any(|n| n == h));
        let right = (!hidden.is_empty() || verdict.starts_with("nothing missing"))
            && !verdict.starts_with("located")
            && hidden.iter().all(is_found)
            && classes.iter().all(|class| class.iter().any(is_true));
        if right && !parameter.is_empty() {
            let table = read_dataset(&out, "recommended").expect("values");
            let names = table.strings("parameter").expect("texts");
            let row = names.iter().position(|n| *n == parameter).expect("the parameter");
            let [found, sd] = ["value", "sd"].map(|c| table.f64(c).expect("numbers")[row]);
            println!("  {parameter} {found} +- {sd} for {value}");
            if (found - value).abs() > 3.0 * sd {
                wrong.push(format!("{name}: {parameter} {found} +- {sd} for {value}"));
            }
        }
        if !right {
            wrong.push(format!("{name}: {verdict}, {classes:?}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The estimate takes all flights of these campaigns.
fn every_flight(pipeline: &std::path::Path) {
    let text = std::fs::read_to_string(pipeline).expect("a pipeline");
    let mut settings: toml::Table = toml::from_str(&text).expect("a pipeline");
    for estimate in settings["estimate"].as_array_mut().expect("estimates") {
        estimate.as_table_mut().expect("an estimate").remove("flights");
    }
    std::fs::write(pipeline, toml::to_string(&settings).expect("TOML")).expect("written");
}
