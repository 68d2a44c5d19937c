//! Values that one pipeline estimates are constants of another: they come with their standard
//! deviations and their covariance, the other pipeline is run first, and what is wrong with them is
//! said where they are asked for.

use crate::campaign::Campaign;
use koehler::table::{Table, read_dataset};

/// One gain and one time constant for a whole flight.
const FIRST: &str = r#"
title = "A test before the flights"
channels = "channels.toml"
logs = ["logs/flight-1.mcap"]
[derive]
rate_hz = 100.0
[[segment.input]]
name = "drive"
signal = "u"
[[estimate]]
name = "bench"
model = "lag.model.toml"
input = "drive"
group = "all"
"#;

/// The same system with what the test has found, and a gain of its own.
const HELD: &str = r#"
title = "First-order system, known from a test"
[inputs]
u = "rad"
[constants]
K = "-"
T = "s"
[parameters]
G = { unit = "-", start = 0.8 }
y_0 = { unit = "rad", start = 0.0, per = "segment" }
[states]
x = { unit = "rad", rate = "(K*u - x)/T", start = 0.0 }
[outputs]
y = { unit = "rad", value = "G*x + y_0" }
"#;

const MAIN: &str = r#"
title = "Flights with what a test has found"
channels = "channels.toml"
logs = ["logs/flight-2.mcap"]
aircraft = [{ from = "first.toml", take = ["K", "T"] }]
[derive]
rate_hz = 100.0
[[segment.input]]
name = "drive"
signal = "u"
[[estimate]]
name = "flown"
model = "held.model.toml"
input = "drive"
group = "all"
[report]
"#;

fn campaign() -> Campaign {
    let c = Campaign::new();
    c.write("first.toml", FIRST);
    c.write("held.model.toml", HELD);
    c.write("pipeline.toml", MAIN);
    c
}

/// The one number of a column in the rows where other columns have these texts.
fn number(table: &Table, column: &str, wanted: &[(&str, &str)]) -> f64 {
    let texts: Vec<Vec<Option<&str>>> =
        wanted.iter().map(|(name, _)| table.opt_strings(name).expect("a column")).collect();
    let here = |i: &usize| wanted.iter().zip(&texts).all(|((_, text), all)| all[*i] == Some(*text));
    let rows: Vec<usize> = (0..table.rows()).filter(here).collect();
    assert_eq!(rows.len(), 1, "{column} where {wanted:?}");
    table.f64(column).expect("a column")[rows[0]]
}

#[test]
fn recovery_values_come_with_their_covariance() {
    let c = campaign();
    let ran = c.run().ended(0);
    assert!(ran.out.contains("first.toml: its results are taken"), "{}", ran.out);
    let first = c.path("out/first");
    let estimates = read_dataset(&first, "estimates").expect("estimates");
    let of = |name: &str, column: &str| number(&estimates, column, &[("parameter", name)]);
    let correlations = read_dataset(&first, "correlations").expect("correlations");
    let r = number(&correlations, "value", &[("parameter", "K"), ("other", "T")]);
    assert!(r.abs() > 0.05, "the test is of a correlation: {r}");

    let out = c.path("out");
    let budget = read_dataset(&out, "budget").expect("budget");
    let of_g = |constant: &str, column: &str| {
        number(&budget, column, &[("parameter", "G"), ("constant", constant)])
    };
    for name in ["K", "T"] {
        assert_eq!(of_g(name, "constant_value"), of(name, "value"));
        assert_eq!(of_g(name, "constant_sd"), of(name, "sd_total"));
    }
    let sources = budget.opt_strings("constant_source").expect("sources");
    assert!(sources.iter().flatten().all(|s| *s == "first.toml: estimate bench"), "{sources:?}");

    // sd_total^2 = sd^2 + s' C s with the covariance C of the two values.
    let share = |name: &str| of_g(name, "sensitivity") * of_g(name, "constant_sd");
    let (k, t) = (share("K"), share("T"));
    let flown = read_dataset(&out, "estimates").expect("estimates");
    let g = |column: &str| number(&flown, column, &[("parameter", "G")]);
    let total = (g("sd").powi(2) + k * k + t * t + 2.0 * r * k * t).sqrt();
    assert!((g("sd_total") / total - 1.0).abs() < 1e-9, "{} {total}", g("sd_total"));
    let pair = of_g("K with T", "contribution");
    assert!((pair * pair.abs() - 2.0 * r * k * t).abs() < 1e-9 * (k * k + t * t), "{pair}");
    let shares: f64 = (0..budget.rows())
        .filter(|&i| budget.strings("parameter").expect("names")[i] == "G")
        .map(|i| budget.f64("share").expect("shares")[i])
        .sum();
    assert!((shares - 1.0).abs() < 1e-9, "{shares}");
    let page = std::fs::read_to_string(c.path("out/report/index.html")).expect("the page");
    assert!(page.contains("first.toml: estimate bench"), "the page says where values come from");
}

#[test]
fn recovery_lines_carry_what_was_taken() {
    let c = campaign();
    let line = "[[fit]]\nestimate = \"flown\"\nparameters = [\"G\"]\nagainst = \"V\"\n[report]";
    c.edit("pipeline.toml", "group = \"all\"\n[report]", line);
    c.run().ended(0);
    let fits = read_dataset(&c.path("out"), "fits").expect("fits");
    for term in ["slope", "intercept"] {
        let at = |column: &str| fits.f64(&format!("{term}_{column}")).expect("a column")[0];
        println!("{term}: sd {} with what was taken {}", at("sd"), at("sd_total"));
        assert!(at("sd_total") > at("sd"), "{term}");
    }
}

#[test]
fn status_says_what_is_made_first_and_what_changed() {
    let c = campaign();
    let status = |words: &[&str]| {
        let said = c.koehler("status", &[]).ended(0).out;
        words.iter().for_each(|w| assert!(said.contains(w), "no {w:?} in {said}"));
    };
    status(&["\"K\" of bench has no value yet", "first.toml: stale: a run would make it first"]);
    c.koehler("check", &[]).ended(0);
    c.run().ended(0);
    status(&["first.toml: fresh", "everything is fresh"]);
    assert!(c.run().ended(0).out.contains("nothing to do"));
    c.edit("first.toml", "flight-1.mcap", "flight-3.mcap");
    status(&["first.toml: stale"]);
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
    let other = command.current_dir(c.folder.path()).args(["run", "first.toml"]).status();
    assert!(other.expect("started").success());
    status(&["first.toml: fresh", "setting `K (first.toml: estimate bench)` changed"]);
    let ran = c.run().ended(0).out;
    let words = |line: &str| line.split_whitespace().map(String::from).collect::<Vec<_>>();
    let counts: Vec<Vec<String>> =
        ran.lines().map(words).filter(|w| w.len() == 6 && w[0] == "estimate").collect();
    assert!(ran.contains("nothing to do"), "the test is fresh: {ran}");
    assert_eq!(counts.len(), 1, "{ran}");
    assert_eq!(counts[0][1..3], ["1", "-"], "{ran}");
}

#[test]
fn fault_what_cannot_be_taken_is_said_where_it_is_asked_for() {
    let said = |edits: &[(&str, &str, &str)]| {
        let c = campaign();
        edits.iter().for_each(|(file, old, new)| c.edit(file, old, new));
        c.run().ended(2).err
    };
    let holds = |text: String, words: &[&str]| {
        words.iter().for_each(|w| assert!(text.contains(w), "no {w:?} in {text}"));
        assert_eq!(text.matches("error").count(), 1, "{text}");
    };
    let absent = said(&[("pipeline.toml", r#""K", "T""#, r#""K", "Tau""#)]);
    holds(absent, &["pipeline.toml:5", "no estimated parameter in first.toml", "\"Tau\"", "T"]);
    let twice = "[[estimate]]\nname = \"again\"\nmodel = \"lag.model.toml\"\ninput = \"drive\"\n[[estimate]]\nname = \"bench\"";
    let several = said(&[
        ("first.toml", "[[estimate]]\nname = \"bench\"", twice),
        ("pipeline.toml", r#""K", "T""#, r#""K""#),
        ("held.model.toml", "T = \"s\"", "T = { unit = \"s\", value = 0.4 }"),
    ]);
    holds(several, &["pipeline.toml:5", "estimated 2 times", "again", "bench", "estimate = "]);
    let c = campaign();
    c.edit("first.toml", "[[estimate]]\nname = \"bench\"", twice);
    c.edit("pipeline.toml", "take =", "estimate = \"bench\", take =");
    c.run().ended(0);
    let unit = said(&[("held.model.toml", "T = \"s\"", "T = \"m\"")]);
    assert!(unit.contains("held.model.toml") && unit.contains("in first.toml"), "{unit}");
    let circle = said(&[(
        "first.toml",
        "channels =",
        "aircraft = [{ from = \"pipeline.toml\", take = [\"G\"] }]\nchannels =",
    )]);
    holds(circle, &["first.toml:3", "takes values from here"]);
    let no_file = said(&[("pipeline.toml", "from = \"first.toml\"", "from = \"frist.toml\"")]);
    holds(no_file, &["pipeline.toml:5", "there is no file"]);
}

#[test]
fn fault_values_that_a_run_did_not_find_are_said() {
    let c = campaign();
    c.edit("first.toml", "group = \"all\"", "group = \"segment\"");
    let err = c.run().ended(2).err;
    assert!(err.contains("pipeline.toml:5") && err.contains("has 4 values there"), "{err}");
    let c = campaign();
    c.edit("first.toml", "group = \"all\"", "group = \"all\"\nmethod = { max_iterations = 1 }");
    let err = c.run().ended(2).err;
    assert!(err.contains("has not converged there"), "{err}");
    assert!(err.contains("koehler run"), "{err}");
}
