//! Figures that a pipeline file asks for: their numbers, their place on the page, their mistakes.

use crate::campaign::{Campaign, INTERCEPT, SLOPE};
use koehler::table::read_dataset;

const FIGURE: &str = r#"
[[figure]]
name = "gain"
title = "Gain against speed"
x_title = "V"

[[figure.series]]
table = "points"
where = { parameter = "K" }
x = "x"
y = "value"
sd = "sd"
colour = "flight"

[[figure.series]]
table = "bands"
where = { parameter = "K" }
x = "x"
y = "value"
ends = ["pointwise_lower", "pointwise_upper"]
joined = true
label = "line"

[[figure.reference]]
label = "truth"
"#;

fn campaign(rest: &str) -> Campaign {
    let c = Campaign::new();
    c.edit("pipeline.toml", "[report]", &format!("{FIGURE}{rest}\n[report]"));
    c
}

#[test]
fn a_figure_shows_points_with_their_line_and_a_reference() {
    let c = campaign(&format!("line = {{ slope = {SLOPE}, intercept = {INTERCEPT} }}"));
    c.run().ended(0);
    let table = read_dataset(&c.path("out"), "figures").expect("a table");
    let (kinds, labels) =
        (table.strings("kind").expect("column"), table.strings("label").expect("column"));
    let count = |kind: &str| kinds.iter().filter(|k| **k == kind).count();
    assert_eq!((count("points"), count("line"), count("reference")), (12, 61, 2));
    assert!(labels.contains(&"flight-2") && labels.contains(&"line") && labels.contains(&"truth"));
    assert!(table.strings("x_unit").expect("column").iter().all(|unit| *unit == "m/s"));
    let points = read_dataset(&c.path("out"), "points").expect("points");
    let (y, lower) = (table.f64("y").expect("column"), table.f64("lower").expect("column"));
    let own = points.strings("parameter").expect("column").iter().position(|p| *p == "K");
    let own = own.expect("a row");
    let (value, sd) =
        (points.f64("value").expect("column")[own], points.f64("sd").expect("column")[own]);
    assert!(
        y[0] == value && (lower[0] - (value - 1.959964 * sd)).abs() < 1e-6 * sd,
        "{} {value}",
        y[0]
    );
    let page = std::fs::read_to_string(c.path("out/report/index.html")).expect("a page");
    assert!(page.contains("Gain against speed") && page.contains("12 points"));
    assert!(page.contains("r.m.s. distance from truth") && page.contains("of 12 intervals hold"));
    // The line of this campaign is next to that which it was made from, outside its narrow band.
    assert!(page.contains("The band of line does not hold truth everywhere: it is "));
}

#[test]
fn fault_mistakes_of_a_figure_are_told_at_once() {
    let c = campaign("line = { slope = 1.0, intercept = 0.0 }\npoints = [[1.0, 2.0]]");
    c.edit("pipeline.toml", "table = \"points\"", "table = \"pints\"");
    c.edit("pipeline.toml", "ends = [\"pointwise_lower\"", "ends = [\"parameter\"");
    let run = c.koehler("check", &[]).ended(2);
    for wanted in [
        "\"pints\"",
        "did you mean \"points\"",
        "does not hold numbers",
        "either a `line` or `points`",
    ] {
        assert!(run.err.contains(wanted), "{wanted} is not in\n{}", run.err);
    }
}

#[test]
fn fault_a_series_without_rows_is_missing() {
    let c = campaign("points = [[80.0, 2.0]]");
    c.edit(
        "pipeline.toml",
        "where = { parameter = \"K\" }\nx = \"x\"\ny = \"value\"\nsd",
        "where = { parameter = \"Q\" }\nx = \"x\"\ny = \"value\"\nsd",
    );
    let run = c.run().ended(1);
    assert!(
        run.out.contains("gain: the table `points` has no rows with parameter = Q to draw"),
        "{}",
        run.out
    );
}

#[test]
fn fault_a_reference_line_with_nothing_to_compare_is_not_drawn() {
    let c = campaign("line = { slope = 1.0, intercept = 0.0 }");
    c.edit("pipeline.toml", "where = { parameter = \"K\" }", "where = { parameter = \"Q\" }");
    let run = c.run().ended(1);
    assert!(run.out.contains("no rows with parameter = Q to draw"), "{}", run.out);
    assert!(!run.err.contains("has no value in row"), "{}", run.err);
}

#[test]
fn signals_before_each_maneuver_are_drawn_against_each_other() {
    let c = Campaign::new();
    let figure = "[[figure]]\nname = \"trim\"\ntitle = \"V and u\"\nseries = [{ table = \"conditions\", x = \"V\", y = \"u\", colour = \"flight\" }]";
    c.edit("pipeline.toml", "[report]", &format!("{figure}\n[report]"));
    c.run().ended(0);
    let table = read_dataset(&c.path("out"), "figures").expect("a table");
    let column = |name: &str| table.f64(name).expect("column").to_vec();
    let conditions = read_dataset(&c.path("out"), "conditions").expect("conditions");
    let of = |signal: &str| -> Vec<f64> {
        let names = conditions.strings("signal").expect("signals");
        let values = conditions.f64("value").expect("values");
        (0..names.len()).filter(|i| names[*i] == signal).map(|i| values[i]).collect()
    };
    assert_eq!((column("x"), column("y")), (of("V"), of("u")));
    assert_eq!(table.strings("x_unit").expect("column")[0], "m/s");
}

#[test]
fn a_series_of_one_maneuver_is_of_its_flight_and_time() {
    let figure = |during: &str| {
        format!(
            "[[figure]]\nname = \"V\"\ntitle = \"Airspeed\"\nseries = [{{ table = \"samples\", during = \"{during}\", x = \"t_s\", y = \"V\" }}]\n\n[report]"
        )
    };
    let c = Campaign::new();
    c.edit("pipeline.toml", "[report]", &figure("flight-2.01"));
    c.run().ended(0);
    let segments = read_dataset(&c.path("out"), "segments").expect("segments");
    let row = segments.strings("segment").expect("names").iter().position(|s| *s == "flight-2.01");
    let at = |column: &str| segments.f64(column).expect("times")[row.expect("a maneuver")];
    let (from, to) = (at("t_start_s") - 1.0, at("t_end_s") + 2.0);
    let table = read_dataset(&c.path("out"), "figures").expect("a table");
    let samples = read_dataset(&c.path("out"), "samples").expect("samples");
    let (flights, t) = (samples.strings("flight").expect("names"), samples.f64("t_s").expect("t"));
    let wanted: Vec<f64> = (0..samples.rows())
        .filter(|&k| flights[k] == "flight-2" && (from..=to).contains(&t[k]))
        .map(|k| t[k])
        .collect();
    assert!(!wanted.is_empty() && table.f64("x").expect("x") == wanted);

    c.edit("pipeline.toml", "flight-2.01", "flight-2.77");
    let run = c.run().ended(1);
    assert!(run.out.contains("has no rows during flight-2.77 to draw"), "{}", run.out);
    c.edit("pipeline.toml", "table = \"samples\", during", "table = \"points\", during");
    c.edit("pipeline.toml", "x = \"t_s\", y = \"V\"", "x = \"x\", y = \"value\"");
    let check = c.koehler("check", &[]).ended(2);
    assert!(check.err.contains("t_s"), "{}", check.err);
}
