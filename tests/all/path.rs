//! Is the reconstructed path near the true one, and as near as its standard deviations say? Short
//! simulated Citation flights; the truth is looked at here alone.

use crate::flightdata::{copy, data, koehler};
use koehler::pipeline::{Plan, Store, run};
use koehler::simulate::{Campaign, Truth, write_log};
use koehler::table::{Table, read_dataset};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn citation() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/citation")
}

/// One flight of a lateral and a longitudinal 3211 at two speeds; `turbulence` in m/s.
fn fly(turbulence: f64) -> (Campaign, Truth) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for entry in std::fs::read_dir(citation()).expect("the campaign").flatten() {
        if entry.path().is_file() {
            std::fs::copy(entry.path(), folder.path().join(entry.file_name())).expect("copied");
        }
    }
    let text = std::fs::read_to_string(citation().join("campaign.toml")).expect("the campaign");
    let (head, rest) = text.split_once("[flights.flight-1]").expect("flights");
    let (_, topics) = rest.split_once("# --- the recorder").expect("topics");
    let flight = format!(
        "[flights.short]\naltitude_ft = 17000.0\nspeeds_kt = [150.0, 190.0]\nat_each = [\"lateral\", \"longitudinal\"]\nturbulence = {turbulence}\n\n# ---"
    );
    std::fs::write(folder.path().join("campaign.toml"), format!("{head}{flight}{topics}"))
        .expect("written");
    let campaign =
        Campaign::load(&folder.path().join("campaign.toml")).unwrap_or_else(|e| panic!("{e}"));
    let truth = campaign.truth("short").unwrap_or_else(|e| panic!("{e}"));
    (campaign, truth)
}

/// The tables of the reconstruction of one recording.
fn reconstruct(
    campaign: &Campaign,
    truth: &Truth,
    seed: u64,
    method: &str,
) -> (tempfile::TempDir, Table) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in ["aircraft.toml", "channels.toml"] {
        std::fs::copy(citation().join(name), folder.path().join(name)).expect("copied");
    }
    let pipeline = format!(
        "title = \"Path\"\naircraft = \"aircraft.toml\"\nchannels = \"channels.toml\"\nlogs = [\"logs/*.mcap\"]\n\
         [reconstruct.method]\n{method}\n[derive]\nrate_hz = 100.0\n"
    );
    std::fs::write(folder.path().join("pipeline.toml"), pipeline).expect("written");
    let recording = campaign.record(truth, seed).expect("recorded");
    write_log(&recording, &folder.path().join("logs/short.mcap"), "koehler").expect("a log");
    let plan = Plan::read(&folder.path().join("pipeline.toml")).unwrap_or_else(|e| panic!("{e}"));
    let out = folder.path().join("out");
    let result =
        run(&plan, &Store::open(&out), &koehler::engine::Threads, &|_| {}, &Default::default())
            .unwrap_or_else(|e| panic!("{e}"));
    assert!(result.complete(), "{}", result.errors);
    let table = read_dataset(&out, "flightpath").unwrap_or_else(|e| panic!("{e}"));
    (folder, table)
}

/// Errors of a path against the truth at ten points a second, the ends left out: root mean square
/// and the share inside 1.96 sd.
fn errors(truth: &Truth, table: &Table) -> BTreeMap<&'static str, (f64, f64)> {
    let at = |t: f64, name: &str| truth.at(t)[name];
    let u = |t: f64| at(t, "true_airspeed") * libm::cos(at(t, "alpha_true"));
    let w = |t: f64| at(t, "true_airspeed") * libm::sin(at(t, "alpha_true"));
    let slope = |f: &dyn Fn(f64) -> f64, t: f64| (f(t + 0.01) - f(t - 0.01)) / 0.02;
    let signals: [(&str, &dyn Fn(f64) -> f64); 5] = [
        ("V", &|t| at(t, "true_airspeed")),
        ("alpha", &|t| at(t, "alpha_true")),
        ("theta", &|t| at(t, "theta")),
        ("udot", &|t| slope(&u, t)),
        ("wdot", &|t| slope(&w, t)),
    ];
    let t = table.f64("t_s").unwrap();
    let rows: Vec<usize> = (200..t.len() - 200).step_by(10).collect();
    let judge = |(name, truth): (&'static str, &dyn Fn(f64) -> f64)| {
        let (value, sd) = (table.f64(name).unwrap(), table.f64(&format!("{name}_sd")).unwrap());
        let e: Vec<f64> = rows.iter().map(|&k| value[k] - truth(t[k])).collect();
        let inside = rows.iter().zip(&e).filter(|(k, e)| e.abs() < 1.96 * sd[**k]).count();
        (
            name,
            (
                (e.iter().map(|e| e * e).sum::<f64>() / e.len() as f64).sqrt(),
                inside as f64 / e.len() as f64,
            ),
        )
    };
    signals.into_iter().map(judge).collect()
}

/// Decides which method is the default: in calm air both are as good as the sensors allow, in
/// turbulence the smoother is far nearer.
#[test]
fn recovery_coverage_of_the_flight_path() {
    if std::env::var("KOEHLER_SLOW").as_deref() != Ok("1") {
        eprintln!("skipped: set KOEHLER_SLOW=1 (and use --release) for the two simulated flights");
        return;
    }
    for turbulence in [0.0, 0.3] {
        let (campaign, truth) = fly(turbulence);
        let windows = errors(&truth, &reconstruct(&campaign, &truth, 1, "by = \"windows\"").1);
        let (folder, table) = reconstruct(&campaign, &truth, 1, "by = \"smoother\"");
        let smoother = errors(&truth, &table);
        println!("turbulence {turbulence} m/s\n  windows {windows:?}\n  smoother {smoother:?}");
        for name in ["alpha", "udot", "wdot"] {
            assert!(
                smoother[name].0 < 1.03 * windows[name].0,
                "{name} in turbulence of {turbulence} m/s"
            );
        }
        if turbulence > 0.0 {
            assert!(
                smoother["alpha"].0 < 0.3 * windows["alpha"].0
                    && smoother["V"].0 < 0.3 * windows["V"].0
            );
        }
        for name in ["V", "alpha", "theta"] {
            assert!((0.8..1.0).contains(&smoother[name].1), "{name}: {}", smoother[name].1);
        }
        let checks = read_dataset(&folder.path().join("out"), "consistency")
            .unwrap_or_else(|e| panic!("{e}"));
        let words = checks.strings("verdict").unwrap();
        let wrong = ["dead", "frozen", "sign reversed", "scaled", "late", "early"];
        let named: Vec<usize> = (0..checks.rows()).filter(|&k| wrong.contains(&words[k])).collect();
        let texts: Vec<_> = named
            .iter()
            .map(|&k| (checks.strings("channel").unwrap()[k], checks.strings("text").unwrap()[k]))
            .collect();
        assert!(named.is_empty(), "{texts:?}");
    }
}

/// A flight of another simulator whose channel map has the names that a person would give: the
/// sensors' errors are found all the same, and none of the inertial sensors is compared with
/// itself.
#[test]
fn recovery_of_inertial_biases_with_natural_names() {
    let Some(data) = data("jsbsim/logs/flight_01.mcap") else { return };
    let folder = copy("jsbsim");
    let edit = |file: &str, edits: &[(&str, &str)]| {
        let path = folder.path().join(file);
        let mut text = std::fs::read_to_string(&path).expect("the file");
        for (from, to) in edits {
            assert!(text.contains(from), "{file}: {from}");
            text = text.replace(from, to);
        }
        std::fs::write(&path, text).expect("written");
    };
    let names = ["ax", "ay", "az", "p", "q", "r"]
        .map(|name| (format!("[signal.{name}_imu]"), format!("[signal.{name}]")));
    let vanes =
        ["alpha", "beta"].map(|name| (format!("[signal.{name}_vane]"), format!("[signal.{name}]")));
    let natural: Vec<(&str, &str)> =
        names.iter().chain(&vanes).map(|(from, to)| (from.as_str(), to.as_str())).collect();
    edit("channels.toml", &natural);
    let signals = "gusts = []\nsignals = { ax_imu = \"ax\", ay_imu = \"ay\", az_imu = \"az\", p_imu = \"p\", q_imu = \"q\", r_imu = \"r\", \
                   alpha_vane = \"alpha\", beta_vane = \"beta\" }";
    edit("flight-path.toml", &[("flight_*.mcap", "flight_01.mcap"), ("gusts      = []", signals)]);
    koehler(folder.path(), &data, &["run", "flight-path.toml"]);
    let out = folder.path().join("out/flight-path");

    let truth = std::fs::read_to_string(data.join("jsbsim/truth.json")).expect("the truth");
    let truth: serde_json::Value = serde_json::from_str(&truth).expect("JSON");
    let biases = read_dataset(&out, "biases").expect("biases");
    let (parameters, values, sds) = (
        biases.strings("parameter").unwrap(),
        biases.f64("value").unwrap(),
        biases.f64("sd").unwrap(),
    );
    for (parameter, field) in [
        ("b_ax", "ax_mps2"),
        ("b_ay", "ay_mps2"),
        ("b_az", "az_mps2"),
        ("b_p", "p_radps"),
        ("b_q", "q_radps"),
        ("b_r", "r_radps"),
    ] {
        let row = parameters.iter().position(|p| *p == parameter).expect("a bias");
        let expected = truth["sensor_errors"]["bias"][field].as_f64().expect("a number");
        let z = (values[row] - expected) / sds[row];
        println!(
            "{parameter}: {} +- {}, in truth {expected}: {z:.2} sd off",
            values[row], sds[row]
        );
        assert!(z.abs() < 4.0, "{parameter}");
    }
    let matched = read_dataset(&out, "pathmatch").expect("pathmatch");
    let compared = matched.strings("channel").unwrap();
    assert!(
        ["ax", "q", "alpha"].iter().all(|name| !compared.contains(name))
            && compared.contains(&"alpha_vane")
    );
    let notes = read_dataset(&out, "notes").expect("notes");
    assert!(
        notes
            .strings("text")
            .unwrap()
            .iter()
            .any(|t| t.contains("drive the kinematics: p, q, r, ax, ay, az"))
    );
}
