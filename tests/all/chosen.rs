//! Which flights, maneuvers and stretches of a record are used: those that were chosen, and all
//! that can be; what was left out is said.

use crate::campaign::{Campaign, LATE, write_log};
use koehler::table::{Table, read_dataset};

fn table(c: &Campaign, name: &str) -> Table {
    read_dataset(&c.path("out"), name).expect(name)
}

/// What stands in a column of the rows of one model or diagnosis, each once, in alphabetical order.
fn column(table: &Table, key: &str, of: &str, column: &str) -> Vec<String> {
    let (keys, values) = (table.strings(key).expect(key), table.strings(column).expect(column));
    let mut all: Vec<String> = keys
        .iter()
        .zip(values)
        .filter(|(k, v)| **k == of && !v.is_empty())
        .map(|(_, v)| v.to_string())
        .collect();
    all.sort();
    all.dedup();
    all
}

/// `severity count text` of the notes of one stage.
fn notes(c: &Campaign, stage: &str) -> Vec<String> {
    let table = table(c, "notes");
    let (stages, severities) =
        (table.strings("stage").expect("column"), table.strings("severity").expect("column"));
    let (texts, counts) =
        (table.strings("text").expect("column"), table.i64("count").expect("column"));
    (0..stages.len())
        .filter(|i| stages[*i] == stage)
        .map(|i| format!("{} {} {}", severities[i], counts[i], texts[i]))
        .collect()
}

const CHOICE: &str = "kinds = [\"3211\"]\nflights = [\"flight-*\"]\nexcept = [\"flight-2\", \"flight-1.04\"]\nwhere = { V = { min = 72.0 } }";

#[test]
fn an_estimate_its_diagnosis_and_what_is_run_again_use_the_chosen_maneuvers() {
    let c = Campaign::new();
    c.edit("pipeline.toml", "kinds = [\"3211\"]", CHOICE);
    // A gain that depends on the speed is found missing.
    let diagnose = "[[diagnose]]\nestimate = \"lag\"\n\n[[fit]]";
    c.edit("pipeline.toml", "[[fit]]", diagnose);
    c.run().ended(0);
    let used = ["flight-1.02", "flight-1.03", "flight-3.02", "flight-3.03", "flight-3.04"]
        .map(String::from);
    assert_eq!(column(&table(&c, "responses"), "model", "lag", "segment"), used);
    assert_eq!(column(&table(&c, "gaps"), "diagnosis", "lag", "segment"), used);
    assert_eq!(column(&table(&c, "responses"), "model", "lag.next", "segment"), used);
    let left_out = [
        "info 1 lag: 1 of 3 flights left out by choice: flight-2",
        "info 3 lag: 3 of 8 segments left out by choice: 1 by `except`, 2 by `where`",
    ];
    // Every flight is estimated by itself.
    let of_estimate = [
        "info 1 lag: 1 of 3 flights left out by choice: flight-2",
        "info 2 lag: 2 of 4 segments left out by choice: 1 by `except`, 1 by `where`",
        "info 1 lag: 1 of 4 segments left out by choice: 0 by `except`, 1 by `where`",
    ];
    let said: Vec<String> =
        notes(&c, "estimate").into_iter().filter(|n| !n.contains(LATE)).collect();
    assert_eq!(said, of_estimate);
    assert_eq!(&notes(&c, "diagnose")[..2], left_out);
    // A flight that is left out changes nothing but its own tables.
    c.fly("flight-2", 7, 4);
    let again = c.run().ended(0);
    assert_eq!((again.stage("estimate"), again.stage("diagnose")), ((0, 2), (0, 1)));
    c.edit("pipeline.toml", "{ min = 72.0 }", "[72.0, 95.0]");
    let narrow = c.run().ended(0);
    assert_eq!(narrow.stage("estimate").0, 2);
    assert_eq!(
        column(&table(&c, "responses"), "model", "lag", "segment"),
        ["flight-1.02", "flight-1.03", "flight-3.02"]
    );
}

#[test]
fn a_name_that_turns_out_to_be_no_maneuver_is_missing() {
    let c = Campaign::new();
    c.edit("pipeline.toml", "kinds = [\"3211\"]", "except = [\"flight-1.09\"]");
    c.run().ended(1);
    let text = "missing 1 lag: `except` names flight-1.09, and there is no such maneuver";
    let (late, said): (Vec<String>, Vec<String>) =
        notes(&c, "estimate").into_iter().partition(|n| n.contains(LATE));
    assert_eq!(said, [text]);
    assert!(late.iter().all(|n| n.contains("u 0.001")), "{late:?}");
}

const BACKWARDS: &str = r#"
title = "The drive from the response"

[inputs]
y = "rad"

[parameters]
K = { unit = "-", start = 1.0 }

[outputs]
u = { unit = "rad", value = "K*y" }
"#;

/// A campaign that estimates over whole records. The response, which drives the model, begins
/// behind the drive; in flight-2 five seconds of it are lost, and the last one before that but for
/// a moment; flight-3 has none.
fn whole(more: &str) -> Campaign {
    let c = Campaign::new();
    c.write("back.model.toml", BACKWARDS);
    let estimate = format!(
        "[[estimate]]\nname = \"back\"\nmodel = \"back.model.toml\"\ngroup = \"all\"\n{more}\n\n[[fit]]"
    );
    c.edit("pipeline.toml", "[[fit]]", &estimate);
    let lost = |t: f64| (30.0..35.0).contains(&t) && !(30.5..31.0).contains(&t);
    write_log(&c.path("logs/flight-2.mcap"), 1, 4, lost);
    write_log(&c.path("logs/flight-3.mcap"), 2, 4, |_| true);
    c
}

#[test]
fn a_whole_record_is_used_where_its_inputs_are() {
    let c = whole("");
    c.run().ended(1);
    assert_eq!(
        column(&table(&c, "responses"), "model", "back", "segment"),
        ["flight-1", "flight-2-001", "flight-2-002"]
    );
    let (late, said): (Vec<String>, Vec<String>) = notes(&c, "estimate")
        .into_iter()
        .filter(|n| n.contains("back"))
        .partition(|n| n.contains(LATE));
    // The response lags behind the drive, and the gain between them knows of no lag.
    assert!(
        late[0].contains("against the others: y 0.") && late[0].contains(" s late"),
        "{late:?}"
    );
    assert_eq!(
        said,
        [
            "info 3 back: flight-1: 0.03 s of 79.99 s are not used, because inputs have no value (`y` at 3 of 8000 samples); used: 0.01 s to 79.97 s as flight-1",
            "warning 506 back: flight-2: 5.07 s of 79.99 s are not used, because inputs have no value (`y` at 459 of 8000 samples); used: 0.01 s to 29.97 s as flight-2-001, 35.01 s to 79.97 s as flight-2-002; shorter than 1 s or 10 samples, so of no use: 30.51 s to 30.97 s",
            "missing 1 back: flight-3 is not used: the samples of the flight have no column `y`",
        ]
    );
}

#[test]
fn windows_of_a_record_with_a_gap_are_numbered_over_it() {
    let c = whole("window_s = 20.0\nexcept = [\"flight-3\", \"flight-2-002\"]");
    c.run();
    assert_eq!(
        column(&table(&c, "responses"), "model", "back", "segment"),
        [
            "flight-1-001",
            "flight-1-002",
            "flight-1-003",
            "flight-1-004",
            "flight-2-001",
            "flight-2-003",
            "flight-2-004",
            "flight-2-005"
        ]
    );
}

#[test]
fn choosing_what_there_is_not_is_a_mistake() {
    let c = Campaign::new();
    c.edit(
        "pipeline.toml",
        "kinds = [\"3211\"]",
        "flights = [\"fligth-1\"]\nexcept = [\"glider-*\"]\nwhere = { Mach = [0.3, 0.2] }",
    );
    let run = c.koehler("check", &[]).ended(2);
    let said: Vec<&str> = run.err.lines().filter_map(|line| line.strip_prefix("error: ")).collect();
    assert_eq!(
        said,
        [
            "pipeline.toml:18:12: there is no flight \"fligth-1\"",
            "pipeline.toml:19:11: no flight or maneuver matches \"glider-*\"",
            "pipeline.toml:20:18: there is no signal or column \"Mach\"",
            "pipeline.toml:20:18: no value is in a range from 0.3 to 0.2",
        ]
    );
}
