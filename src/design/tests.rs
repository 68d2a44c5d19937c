//! A made-up aircraft of one state: designs that determine everything, that leave a parameter
//! without effect, and that make it diverge.

use super::estimated::{Parameter, Run};
use super::flown::{Excursions, Facts};
use super::judged::{Judged, Outcome, judge, rank};
use super::rows::expand;
use super::settings::Settings;
use super::{Results, Study, designs, run};
use crate::error::Errors;
use crate::estimate::Stop;
use std::path::Path;

const TRUTH: &str = r#"
title = "One state with a spring that hardens, and runs away beyond 4"
source = "made up"
[inputs]
u = { unit = "V" }
[constants]
b = { unit = "1/s", value = 1.0 }
[equations]
beyond = "max(x/x_1 - 4, 0)"
[constants.x_1]
unit = "V"
value = 1.0
[constants.T_1]
unit = "s"
value = 1.0
[states]
x = { unit = "V", rate = "b*u - 1.5*x/T_1 + 0.5*max(x - x_1, 0*x)/T_1 + 20*beyond^3*x_1/T_1", start = 0.0 }
[outputs]
x = { unit = "V", value = "x" }
u_given = { unit = "V", value = "u" }
b_true = { unit = "1/s", value = "b" }
"#;

/// `c` has no effect unless `x` goes beyond 1 V.
const MODEL: &str = r#"
title = "The same without the run-away"
source = "made up"
[inputs]
u = { unit = "V" }
[constants]
x_1 = { unit = "V", value = 1.0 }
[parameters]
a = { unit = "1/s", start = -1.2 }
b = { unit = "1/s", start = 0.8 }
c = { unit = "1/s", start = 0.0 }
[states]
x = { unit = "V", rate = "b*u + a*x + c*max(x - x_1, 0*x)", start = 0.0 }
[outputs]
x = { unit = "V", value = "x" }
"#;

const CAMPAIGN: &str = r#"
title = "made up"
seed = 1
truth = "truth.model.toml"
start_unix_s = 1000000000
rate_hz = 100.0
[drive]
[timing]
settle_s = 1.0
hold_before_s = 2.0
hold_after_s = 3.0
recover_s = 5.0
end_s = 1.0
[maneuvers.any]
input = "u"
kind = "step"
unit_time_s = 1.0
amplitude = 1.0
[flights.any]
altitude_ft = 0.0
speeds_kt = [100.0]
at_each = ["any"]
[topics."/all"]
rate_hz = 50.0
jitter_s = 1e-3
[topics."/all".fields]
x = { truth = "x", unit = "V", noise = 0.01 }
u = { truth = "u_given", unit = "mV", noise = 0.1 }
"#;

const CHANNELS: &str = r#"
[defaults]
time = "publish"
[signal]
x = { topic = "/all", field = "x", unit = "V" }
u = { topic = "/all", field = "u", unit = "mV" }
"#;

const STUDY: &str = r#"
title = "made up"
campaign = "campaign.toml"
channels = "channels.toml"
input = "u"
speed_kt = 100.0
altitude_ft = 0.0
seed = 7
seeds = 3
true_values = { b = "b_true" }
watch = { current = "u_given" }
grid = { rate_hz = 50.0 }
[estimate.plain]
model = "one.model.toml"
[[row]]
kind = "211"
unit_time_s = 1.0
amplitude = [2.0, 0.5, 20.0]
[[row]]
name = "other"
kind = "step"
unit_time_s = 2.0
amplitude = 2.0
repeats = 2
"#;

/// The files of the study in a folder of their own.
fn folder(study: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("truth.model.toml", TRUTH);
    put("one.model.toml", MODEL);
    put("campaign.toml", CAMPAIGN);
    put("channels.toml", CHANNELS);
    put("design.toml", study);
    folder
}

fn results(study: &str, threads: usize) -> (tempfile::TempDir, Results) {
    let folder = folder(study);
    let study = Study::load(&folder.path().join("design.toml")).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let results = pool.install(|| run(&study, &|_, _| {})).unwrap();
    (folder, results)
}

fn mistakes(study: &str) -> Vec<String> {
    let folder = folder(study);
    let Err(Errors(found)) = Study::load(&folder.path().join("design.toml")) else {
        return Vec::new();
    };
    let here = format!("{}/", folder.path().display());
    found.iter().map(|e| e.to_string().replace(&here, "")).collect()
}

#[test]
fn a_list_stands_for_all_combinations_in_order() {
    let text = STUDY
        .replace("amplitude = [2.0, 0.5, 20.0]", "amplitude = [2.0, 0.5]\npolarity = [1, -1]")
        .replace("unit_time_s = 2.0", "unit_time_s = [2.0, 3.0]");
    let (settings, _) = crate::config::parse::<Settings>("design.toml", &text).unwrap();
    let all: Vec<String> =
        expand(&settings.row, "u").iter().map(|d| format!("{}: {}", d.name, d.words())).collect();
    let wanted = [
        "d01: 211, 1 s, amplitude 2",
        "d02: 211, 1 s, amplitude -2",
        "d03: 211, 1 s, amplitude 0.5",
        "d04: 211, 1 s, amplitude -0.5",
        "other-1: step, 2 s, amplitude 2, 2 times",
        "other-2: step, 3 s, amplitude 2, 2 times",
    ];
    assert_eq!(all, wanted);
}

#[test]
fn recovery_an_undetermined_design_is_last_and_a_diverging_one_leaves_the_others() {
    let (_folder, results) = results(STUDY, 2);
    let judged = &results.estimates[0];
    let told: Vec<(&str, Option<usize>, Outcome)> =
        judged.iter().map(|j| (j.design.name.as_str(), j.rank, j.outcome)).collect();
    assert_eq!(told[1], ("d02", Some(3), Outcome::Undetermined), "{told:?}");
    assert_eq!(told[2], ("d03", None, Outcome::NotFlown));
    assert!(judged[1].why.contains("c has no effect"), "{}", judged[1].why);
    assert_eq!(judged[1].determined, 0);
    for i in [0, 3] {
        let one = &judged[i];
        assert_eq!((one.outcome, one.runs, one.determined), (Outcome::Determined, 3, 3));
        let b = one.parameters.iter().find(|p| p.name == "b").unwrap();
        assert!(b.error.abs() < 4.0 * b.sd && b.sd < 0.05, "{b:?}");
        assert!(one.facts.as_ref().unwrap().excursions.0[5] == 2.0);
        let sum: f64 = one.parameters.iter().map(|p| p.crlb * p.crlb).sum();
        assert!((sum / one.trace - 1.0).abs() < 1e-9 && one.determinant > 0.0);
        assert!(one.squared_error.is_nan(), "the truth of a and c is not told");
    }
    assert!([judged[0].rank, judged[3].rank].iter().all(|r| *r < Some(3)));
    let error = results.errors.0[0].to_string();
    assert_eq!(results.errors.0.len(), 1);
    assert!(error.contains("design.toml:15:1: design d03 (211, 1 s, amplitude 20): "), "{error}");
    let table = designs(&results).unwrap();
    assert_eq!(table.rows(), 4);
    assert_eq!(table.opt_i64("rank").unwrap()[2], None);
    assert!(table.f64("c_sd").unwrap()[0] > 0.0 && table.f64("trace").unwrap()[1].is_nan());
}

/// Recordings of a design that give these values of a parameter whose true value is 1, with one bound.
fn judged_of(name: &str, values: [f64; 3], crlb: f64, truth: Option<f64>) -> Judged {
    let (settings, _) = crate::config::parse::<Settings>("design.toml", STUDY).unwrap();
    let mut design = expand(&settings.row, "u").remove(0);
    design.name = name.to_string();
    let run = |value: f64| Run {
        stop: Stop::Converged,
        parameters: vec![Parameter {
            name: "b".into(),
            unit: "1/s".into(),
            value,
            sd: Some(crlb),
            crlb: Some(crlb),
        }],
        trace: Some(crlb * crlb),
        determinant: Some(crlb * crlb),
        why: String::new(),
    };
    let values_of = truth.map(|truth| ("b".to_string(), truth)).into_iter().collect();
    let facts = Facts { duration: 1.0, excursions: Excursions([0.0; 6]), values: values_of };
    let runs = values.map(run);
    judge("plain", &design, Ok((&facts, &runs[..])))
}

#[test]
fn a_bound_that_is_no_promise_is_not_what_a_design_is_ranked_by() {
    let ranks = |truth: Option<f64>| {
        let biased = judged_of("biased", [1.09, 1.1, 1.11], 0.01, truth);
        let mut all = [biased, judged_of("sound", [0.96, 1.0, 1.05], 0.05, truth)];
        rank(&mut all);
        all
    };
    let [biased, sound] = ranks(Some(1.0));
    assert!(biased.trace < sound.trace && sound.squared_error < sound.trace);
    assert_eq!((sound.rank, biased.rank), (Some(1), Some(2)));
    assert!((biased.expected / biased.squared_error - 1.0).abs() < 1e-9);
    assert!(biased.why.contains("is 101 times what the bound promises"), "{}", biased.why);
    assert_eq!((sound.expected, sound.why.as_str()), (sound.trace, ""));
    // Where the truth is not told, the bound is all that there is.
    let [biased, sound] = ranks(None);
    assert_eq!((biased.rank, sound.rank), (Some(1), Some(2)));
    assert_eq!(biased.why, "");
}

#[test]
fn one_thread_and_two_make_the_same_bytes() {
    let bytes = |threads: usize| designs(&results(STUDY, threads).1).unwrap().to_parquet().unwrap();
    assert!(bytes(1) == bytes(2));
}

#[test]
fn a_search_keeps_its_limits_and_tells_its_tries() {
    let text = STUDY
        .replace("seeds = 3", "seeds = 3\noptimise = true")
        .replace("kind = \"211\"", "kind = \"3211\"")
        .replace("amplitude = [2.0, 0.5, 20.0]", "amplitude = [2.0]")
        + "[search]\nestimate = \"plain\"\nstep_s = [0.2, 3.0]\ntotal_s = 8.0\namplitude = 2.0\ntries = 20\nseeds = 1\nlimits = { current = 2.0 }\n";
    let (_folder, one) = results(&text, 2);
    let found = one.found.unwrap();
    assert_eq!(found.tries, 20);
    assert!(found.allowed > 0 && found.durations.len() == 4, "{found:?}");
    assert!(found.durations.iter().sum::<f64>() <= 8.0 + 1e-9);
    assert_eq!(found.reference.as_ref().unwrap().0, "d01");
    let last = one.estimates[0].last().unwrap();
    assert_eq!((last.design.name.as_str(), last.runs), ("searched", 3));
    assert!(last.facts.as_ref().unwrap().excursions.0[5] <= 2.0 + 1e-9);
    assert!(found.words().contains("20 tries"), "{}", found.words());
    // A limit below every amplitude leaves nothing.
    let (_folder, none) = results(&text.replace("current = 2.0", "current = 1.0"), 2);
    let found = none.found.unwrap();
    assert!((found.allowed, found.reference.is_none()) == (0, true) && found.best.is_none());
    assert!(found.words().contains("no 3211 of the study keeps the limits"), "{}", found.words());
}

#[test]
fn fault_every_mistake_is_told_at_once_with_its_place() {
    assert_eq!(mistakes(STUDY), Vec::<String>::new());
    let text = STUDY
        .replace("input = \"u\"", "input = \"v\"")
        .replace("b_true", "b_ture")
        .replace("current = \"u_given\"", "current = \"u_gven\"")
        .replace(
            "model = \"one.model.toml\"",
            "model = \"one.model.toml\"\nheld = [\"y\"]\nmethod = { fixed = [\"d\"] }",
        )
        .replace("kind = \"step\"", "kind = \"stop\"")
        .replace("unit_time_s = 1.0", "unit_time_s = -1.0");
    let found = mistakes(&text);
    let wanted = [
        "design.toml:19:15: ",
        "design.toml:23:8: \"stop\" is no kind of maneuver",
        "design.toml:5:9: there is no input of the truth model \"v\"",
        "design.toml:10:21: there is no output or input of the truth model \"b_ture\"",
        "design.toml:11:21: there is no output or input of the truth model \"u_gven\"",
        "design.toml:15:9: there is no signal \"y\"",
        "design.toml:16:10: fixed: model one has no parameter \"d\"",
    ];
    assert_eq!(found.len(), wanted.len(), "{found:#?}");
    for (found, wanted) in found.iter().zip(wanted) {
        assert!(found.starts_with(wanted), "{found}\n{wanted}");
    }
}

#[test]
fn fault_files_that_are_not_there_and_a_search_without_limits_of_its_own() {
    let text = STUDY
        .replace("campaign.toml", "no.toml")
        .replace("one.model.toml", "two.model.toml")
        .replace("seeds = 3", "seeds = 3\noptimise = true");
    let found = mistakes(&text);
    for (found, wanted) in found.iter().zip([
        "design.toml:3:12: there is no file no.toml",
        "design.toml:15:9: there is no file two.model.toml",
        "design.toml:10:12: nothing says what is searched",
    ]) {
        assert!(found.starts_with(wanted), "{found}\n{wanted}");
    }
    assert_eq!(found.len(), 3);
    assert!(Study::load(Path::new("nowhere/design.toml")).is_err());
}
