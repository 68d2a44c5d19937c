//! The proof of match (paper, Fig. 10) with model B as shipped, and with model A by the same sections: which tolerances are kept,
//! where is the rest noise? The two tables of the README are held against it.

use super::flown;
use super::results::folder;
use crate::flightdata::slow;
use koehler::pipeline::{Plan, Store, run};
use koehler::table::{Table, read_dataset};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

const START: &str = "<!-- written by `KOEHLER_SLOW=1 UPDATE_DOCS=1 cargo test --release --test all -- dlc::proof` -->\n";
const END: &str = "<!-- until here -->\n";
const OUTPUTS: [&str; 11] = ["V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az"];

/// Adds to every `[[validate]]` the same of model A, named `a-...`.
fn with_model_a(told: &mut serde_json::Value) {
    let all = told.as_array_mut().expect("validations");
    let of_a = |entry: &serde_json::Value| {
        let mut entry = entry.clone();
        entry["name"] = format!("a-{}", entry["name"].as_str().expect("a name")).into();
        entry["estimate"] = "a-all".into();
        entry
    };
    let more: Vec<serde_json::Value> = all.iter().map(of_a).collect();
    all.extend(more);
}

fn table(out: &Path, name: &str) -> Table {
    read_dataset(out, name).unwrap_or_else(|e| panic!("{e}"))
}

/// What one model makes of one tolerance over all maneuvers of a test.
#[derive(Default)]
struct Used {
    tolerance: String,
    most: [f64; 2],
    outside: [usize; 2],
    maneuvers: usize,
}

/// Test, output, what of it, unit.
type Key = [String; 4];

fn tolerances(out: &Path) -> (String, BTreeMap<Key, Used>) {
    let table = table(out, "tolerances");
    let text = |name: &str| table.strings(name).expect("texts");
    let number = |name: &str| table.f64(name).expect("numbers");
    let (tests, outputs, of, units) = (text("test"), text("output"), text("of"), text("unit"));
    let (by, verdicts) = (text("validation"), text("verdict"));
    let (used, tolerance) = (number("used"), number("tolerance"));
    let mut all = BTreeMap::<Key, Used>::new();
    for k in 0..table.rows() {
        let model = usize::from(by[k].starts_with("a-"));
        let key = [tests[k], outputs[k], of[k], units[k]].map(str::to_string);
        let row = all.entry(key).or_default();
        row.most[model] =
            row.most[model].max(if used[k].is_nan() { f64::INFINITY } else { used[k] });
        row.outside[model] += usize::from(verdicts[k] != "within");
        row.maneuvers += usize::from(model == 0);
        // Shares of what was measured have a tolerance of each maneuver's own.
        let this = format!("{:.3} {}", tolerance[k], units[k]);
        if row.tolerance.is_empty() || row.tolerance == this {
            row.tolerance = this;
        } else {
            row.tolerance = "a share of what was measured".to_string();
        }
    }
    let mut told = String::from(
        "| test | output | of it | tolerance, SI | maneuvers | model B uses | model A uses |\n|---|---|---|---|---|---|---|\n",
    );
    for ([test, output, what, _], row) in &all {
        let cell = |model: usize| {
            let most = 100.0 * row.most[model];
            match row.outside[model] {
                0 => format!("{most:.1} %"),
                n => format!("{most:.0} %, outside in {n}"),
            }
        };
        writeln!(
            told,
            "| {test} | {output} | {what} | {} | {} | {} | {} |",
            row.tolerance,
            row.maneuvers,
            cell(0),
            cell(1)
        )
        .expect("text");
    }
    (told, all)
}

/// In how many maneuvers of `match-1` to `match-3` the rest of each output is noise: models B and A.
fn noise(out: &Path) -> (String, [BTreeMap<String, [usize; 2]>; 2]) {
    let table = table(out, "validation");
    let text = |name: &str| table.strings(name).expect("texts");
    let (by, outputs) = (text("validation"), text("output"));
    let verdicts = table.opt_strings("noise_verdict").expect("texts");
    let mut all = [BTreeMap::new(), BTreeMap::new()];
    for k in (0..table.rows()).filter(|&k| !by[k].contains("phugoid")) {
        let model = usize::from(by[k].starts_with("a-"));
        let counts: &mut [usize; 2] = all[model].entry(outputs[k].to_string()).or_default();
        counts[0] += usize::from(verdicts[k] == Some("noise"));
        counts[1] += 1;
    }
    let mut told =
        format!("| | {} |\n|---|{}\n", OUTPUTS.join(" | "), "---|".repeat(OUTPUTS.len()));
    for (model, counts) in ["model B: noise in", "model A: noise in"].iter().zip(&all) {
        let cells: Vec<String> = OUTPUTS.iter().map(|o| counts[*o][0].to_string()).collect();
        writeln!(told, "| {model} | {} |", cells.join(" | ")).expect("text");
    }
    (told, all)
}

#[test]
fn recovery_attas_proof_of_match_by_both_models() {
    if !slow() {
        return;
    }
    let shipped = &flown().shipped;
    let plan = Plan::read_with(&shipped.out.path().join("pipeline.toml"), |settings| {
        settings.simulate = None;
        settings.reconstruct = None;
        settings.estimate.retain(|e| ["a-all", "b-all"].contains(&e.name().as_str()));
        ["report", "figure", "curve", "diagnose"]
            .iter()
            .for_each(|s| drop(settings.told.remove(*s)));
        with_model_a(settings.told.get_mut("validate").expect("validations"));
    });
    let plan = plan.unwrap_or_else(|e| panic!("{e}"));
    let out = shipped.out.path().join("proof");
    let result =
        run(&plan, &Store::open(&out), &koehler::engine::Threads, &|_| {}, &Default::default())
            .unwrap_or_else(|e| panic!("{e}"));
    // Model A is outside of tolerances, which makes the run one with problems.
    assert!(result.errors.is_empty(), "{}", result.errors);
    let ((kept, used), (rest, counts)) = (tolerances(&out), noise(&out));
    println!("{kept}\n{rest}");
    // Model B keeps every tolerance, and the rest is noise nearly everywhere (95 of 100 are meant).
    assert!(used.values().all(|u| u.outside[0] == 0 && u.most[0] < 1.0 && u.maneuvers > 0));
    let sum =
        |model: usize| counts[model].values().fold((0, 0), |sum, c| (sum.0 + c[0], sum.1 + c[1]));
    let (b, a) = (sum(0), sum(1));
    assert!(b.1 == a.1 && b.0 as f64 >= 0.95 * b.1 as f64, "{b:?}");
    // Tolerances hardly separate the models, the noise does.
    assert!(counts[1]["q"][0] * 2 < counts[1]["q"][1], "{a:?}");
    let path = folder().join("README.md");
    let readme = std::fs::read_to_string(&path).expect("the README");
    let (before, from) = readme.split_once(START).expect("a place for the proof of match");
    let (_, after) = from.split_once(END).expect("its end");
    let wanted = format!(
        "{before}{START}{kept}\nCounts of maneuvers in which the rest is noise:\n\n{rest}{END}{after}"
    );
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, wanted).expect("written");
    } else {
        assert!(readme == wanted, "pipelines/attas/README.md is behind the proof of match");
    }
}
