//! Where results come from: what the commands say of an output folder whose history is known.

use crate::campaign::{Campaign, LATE};

#[test]
fn every_file_of_a_run_is_held_against_its_record() {
    let c = Campaign::new();
    let none = c.koehler("verify", &[]).ended(2);
    assert!(none.err.contains("out is no output folder"), "{}", none.err);
    c.run().ended(0);
    let sound = c.koehler("verify", &[]).ended(0);
    assert!(sound.out.contains("files as recorded, and no others"), "{}", sound.out);

    c.edit("lag.model.toml", "start = 0.3", "start = 0.31");
    std::fs::write(c.path("out/report/index.html"), b"mine").expect("written");
    std::fs::write(c.path("out/estimates/part-7.parquet"), b"mine").expect("written");
    std::fs::remove_file(c.path("out/fits/part-0.parquet")).expect("removed");
    std::fs::remove_file(c.path("logs/flight-2.mcap")).expect("removed");
    let run = c.koehler("verify", &[]).ended(1);
    let lines: Vec<&str> = run.out.lines().collect();
    assert_eq!(
        lines[..5],
        [
            "lag.model.toml: differs from its record (settings)",
            "logs/flight-2.mcap: is missing (log of flight flight-2)",
            "out/estimates/part-7.parquet: is unknown (no record names it)",
            "out/fits/part-0.parquet: is missing (made by fit of lag-V)",
            "out/report/index.html: differs from its record (made by report of campaign)",
        ]
    );
    let json = c.koehler("verify", &["--json"]).ended(1);
    let said: serde_json::Value = serde_json::from_str(&json.out).expect("JSON");
    assert_eq!(said["faults"].as_array().map(Vec::len), Some(5), "{}", json.out);
    assert_eq!(said["faults"][0]["fault"], "differs");
}

#[test]
fn the_pipelines_own_tables_are_made_good_and_otherwise_left_alone() {
    let c = Campaign::new();
    c.run().ended(0);
    let notes = c.path("out/notes/part-0.parquet");
    let sound = std::fs::read(&notes).expect("a table");
    let written = || notes.metadata().and_then(|file| file.modified()).expect("a table");
    let before = written();
    assert!(c.run().ended(0).out.contains("nothing to do"));
    assert_eq!(written(), before);
    std::fs::write(&notes, b"mine").expect("written");
    c.run().ended(0);
    assert_eq!(std::fs::read(&notes).expect("a table"), sound);
    c.koehler("verify", &[]).ended(0);
}

#[test]
fn a_setting_that_changed_is_told_with_its_old_and_new_value() {
    let c = Campaign::new();
    let new = c.koehler("explain", &["estimate", "lag"]).ended(0);
    assert_eq!(
        new.out,
        "estimate lag of flight-1, lag of flight-2, lag of flight-3: missing\n  never run here\n"
    );
    c.run().ended(0);
    let fresh = c.koehler("explain", &["ingest"]).ended(0);
    assert!(fresh.out.starts_with("ingest flight-1, flight-2, flight-3: fresh\n"), "{}", fresh.out);
    assert!(fresh.out.contains("  the log is as it was\n"), "{}", fresh.out);

    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = 50.0");
    c.edit("lag.model.toml", "start = 0.3", "start = 0.31");
    let stale = c.koehler("explain", &["derive", "flight-2"]).ended(0);
    assert_eq!(stale.out, "derive flight-2: stale\n  setting `rate_hz`: 100.0 -> 50.0\n");
    let estimate = c.koehler("explain", &["estimate", "lag"]).ended(0);
    let [old, new] = ["0.3", "0.31"]
        .map(|start| format!("\"T = {{ unit = \\\"s\\\", start = {start}, min = 0.01 }}\""));
    let of = |flight: &str| {
        let stale =
            format!("estimate lag of {flight}: stale\n  setting `model`.text: {old} -> {new}\n");
        let because = format!("  because derive of {flight} is stale:\n");
        format!("{stale}{because}    setting `rate_hz`: 100.0 -> 50.0\n")
    };
    assert_eq!(estimate.out, ["flight-1", "flight-2", "flight-3"].map(of).concat());
    let one = c.koehler("explain", &["estimate", "lag of flight-2"]).ended(0);
    assert_eq!(one.out, of("flight-2"));
    // What only waits is followed back to the beginning.
    let segment = c.koehler("explain", &["segment"]).ended(0);
    assert!(
        segment
            .out
            .contains("  because derive of flight-1 is stale:\n    setting `rate_hz`: 100.0"),
        "{}",
        segment.out
    );
    let none = c.koehler("explain", &["derive", "flight-9"]).ended(2);
    assert!(none.err.contains("it is run for flight-1, flight-2, flight-3"), "{}", none.err);
    assert!(c.koehler("explain", &["derivative"]).ended(2).err.contains("the stages are ingest"));
}

/// Every record as a program wrote it that kept no values of settings: in a file of its own.
fn without_values(c: &Campaign) {
    let path = c.path("out/.koehler/records.jsonl");
    for line in std::fs::read_to_string(&path).expect("records").lines() {
        let mut value: serde_json::Value = serde_json::from_str(line).expect("JSON");
        let all = value.as_object_mut().expect("an object");
        ["settings", "version"].iter().for_each(|key| drop(all.remove(*key)));
        let name = |key: &str| value[key].as_str().expect("a name");
        let folder = c.path("out/.koehler").join(name("stage"));
        std::fs::create_dir_all(&folder).expect("a folder");
        let record = folder.join(format!("{}.json", name("unit")));
        std::fs::write(record, value.to_string()).expect("written");
    }
    std::fs::remove_file(path).expect("removed");
    std::fs::remove_file(c.path("out/.koehler/form")).expect("removed");
    std::fs::remove_file(c.path("out/.koehler/tables")).expect("removed");
    std::fs::remove_file(c.path("out/.koehler/run.json")).expect("removed");
}

#[test]
fn a_folder_of_an_earlier_program_is_read_and_completed_and_one_of_a_later_is_refused() {
    let c = Campaign::new();
    c.run().ended(0);
    without_values(&c);
    assert!(c.koehler("status", &[]).ended(0).out.contains("everything is fresh"));
    assert!(c.koehler("verify", &[]).ended(2).err.contains("`koehler run PIPELINE` keeps it"));
    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = 50.0");
    let unknown = c.koehler("explain", &["derive"]).ended(0);
    assert!(unknown.out.contains("it is 50.0 now; what it was is not known"), "{}", unknown.out);
    c.edit("pipeline.toml", "rate_hz = 50.0", "rate_hz = 100.0");
    assert!(c.run().ended(0).out.contains("nothing to do"));
    assert!(!c.path("out/.koehler/ingest").exists(), "the records of an earlier form are left");
    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = 50.0");
    let known = c.koehler("explain", &["derive"]).ended(0);
    assert!(known.out.contains("setting `rate_hz`: 100.0 -> 50.0"), "{}", known.out);

    std::fs::write(c.path("out/.koehler/form"), "4\n").expect("written");
    for verb in ["run", "status", "verify", "explain"] {
        let run = c.koehler(verb, &[]).ended(2);
        assert!(run.err.contains("have form 4; this program reads 1 to 3"), "{}", run.err);
    }
}

#[test]
fn fault_tables_of_a_later_program_are_refused_by_name() {
    let c = Campaign::new();
    c.run().ended(0);
    let later = koehler::table::SCHEMA_VERSION + 1;
    // One file of a folder whose last run was of this program.
    let path = c.path("out/fits/part-0.parquet");
    let mut bytes = std::fs::read(&path).expect("a table");
    let key = b"schema_version";
    let key = bytes.windows(key.len()).position(|w| w == key).expect("in its metadata") + key.len();
    let digit = bytes[key..].iter().position(u8::is_ascii_digit).expect("a version") + key;
    bytes[digit] += 1;
    std::fs::write(&path, bytes).expect("written");
    let sql = c.command("sql", &["out", "SELECT slope FROM fits"]).ended(2);
    let wanted = format!("fits/part-0.parquet: this file of a table has schema_version {later};");
    assert!(sql.err.contains(&wanted) && sql.err.contains("a later koehler"), "{}", sql.err);
    c.command("sql", &["out", "SELECT value FROM estimates"]).ended(0);

    // A folder that a later one began to write.
    std::fs::write(c.path("out/.koehler/tables"), format!("{later}\n")).expect("written");
    for verb in ["run", "status", "verify", "explain", "gc"] {
        let run = c.koehler(verb, &[]).ended(2);
        assert!(run.err.contains(&format!("have schema_version {later}")), "{}", run.err);
    }
    assert!(c.command("diff", &["out", "out"]).ended(2).err.contains("have schema_version"));
}

#[test]
fn two_runs_differ_in_what_moved_and_in_what_one_alone_has() {
    let c = Campaign::new();
    c.run().ended(0);
    c.koehler("run", &["--out", "same", "--jobs", "1"]).ended(0);
    let same = c.command("diff", &["out", "same"]).ended(0);
    assert!(same.out.starts_with("no differences; compared were "), "{}", same.out);

    c.fly("flight-2", 7, 4);
    let more = "[[estimate]]\nname = \"all\"\nmodel = \"lag.model.toml\"\ninput = \"drive\"\ngroup = \"all\"\n\n[[fit]]";
    c.edit("pipeline.toml", "[[fit]]", more);
    c.koehler("run", &["--out", "other"]).ended(0);
    let other = c.command("diff", &["pipeline.toml", "other"]).ended(1);
    let moved = other.out.lines().find(|line| line.starts_with("estimate lag, flight-2"));
    let moved = moved.unwrap_or_else(|| panic!("{}", other.out));
    assert!(
        moved.contains(", K: ") && moved.contains(" -> ") && moved.ends_with(" sd)"),
        "{moved}"
    );
    assert!(!other.out.contains("estimate lag, flight-1"), "{}", other.out);
    assert!(other.out.contains("estimate all: only in other: "), "{}", other.out);

    // A file that another run left there is no result of this one.
    let [from, to] = ["other", "same"].map(|run| c.path(run).join("fits/part-0.parquet"));
    std::fs::copy(&from, to.with_file_name("part-7.parquet")).expect("copied");
    let with = c.command("diff", &["out", "same"]).ended(0);
    assert_eq!(with.out, same.out);
    let place = std::path::Path::new("same").join("fits/part-7.parquet");
    let wanted = format!("no record of a run names it: {} (", place.display());
    assert!(with.err.contains(&wanted), "{}", with.err);

    let json = c.command("diff", &["out", "other", "--json"]).ended(1);
    let said: serde_json::Value = serde_json::from_str(&json.out).expect("JSON");
    let first = &said["differences"][0];
    assert_eq!((&first["kind"], &first["of"][0]), (&"estimate".into(), &"lag".into()), "{first}");
    assert!(first["sds"].as_f64().expect("a number") > 2.0, "{first}");
    assert!(
        c.command("diff", &["out", "logs"]).ended(2).err.contains("logs: this is no output folder")
    );
}

#[test]
fn a_table_is_followed_back_to_its_logs_over_settings_with_values() {
    let c = Campaign::new();
    c.run().ended(0);
    let line = c.command("lineage", &["out/fits/part-0.parquet"]).ended(0);
    for wanted in [
        "  fit of lag-V (koehler ",
        "  estimate of lag of flight-1, lag of flight-2, lag of flight-3 (koehler ",
        "  ingest of flight-1, flight-2, flight-3 (koehler ",
        "    setting `rate_hz`: 100.0",
        "  lag.model.toml  ",
    ] {
        assert!(line.out.contains(wanted), "{wanted:?} is not in\n{}", line.out);
    }
    let log = line.out.lines().find(|line| line.starts_with("  logs/flight-2.mcap  "));
    assert!(log.is_some_and(|log| log.contains(" samples of 3 signals, 0.0")), "{}", line.out);
    assert!(!line.out.contains("report of campaign"), "{}", line.out);

    let json = c.command("lineage", &["out/samples/flight=flight-1", "--json"]).ended(0);
    let said: serde_json::Value = serde_json::from_str(&json.out).expect("JSON");
    assert_eq!(said["logs"].as_array().map(Vec::len), Some(1), "{}", json.out);
    assert_eq!(said["stages"][1]["settings"]["setting `rate_hz`"], 100.0, "{}", json.out);

    std::fs::write(c.path("out/fits/mine.txt"), b"mine").expect("written");
    let unknown = c.command("lineage", &["out/fits/mine.txt"]).ended(2);
    assert!(unknown.err.contains("no record names this file"), "{}", unknown.err);
    let outside = c.command("lineage", &["pipeline.toml"]).ended(2);
    assert!(outside.err.contains("no folder above it is an output folder"), "{}", outside.err);
}

#[test]
fn what_no_unit_needs_is_removed_and_nothing_else() {
    let c = Campaign::new();
    assert!(c.koehler("gc", &[]).ended(0).out.contains("nothing to remove"));
    assert!(!c.path("out").exists());
    c.run().ended(0);
    assert!(c.koehler("gc", &[]).ended(0).out.contains("nothing to remove"));
    std::fs::remove_file(c.path("logs/flight-2.mcap")).expect("removed");
    std::fs::write(c.path("out/fits/part-5.parquet"), b"half").expect("written");
    std::fs::write(c.path("out/report/.unfinished-1"), b"half").expect("written");
    std::fs::write(c.path("out/fits/mine.txt"), b"mine").expect("written");
    let of_2 = c.path("out/signals/flight=flight-2/part-0.parquet");
    let bytes = of_2.metadata().expect("a table").len();

    let dry = c.koehler("gc", &["--dry-run"]).ended(0);
    let line = format!(
        "out/signals/flight=flight-2/part-0.parquet: {bytes} bytes (ingest of flight-2 is no longer part of the campaign)"
    );
    assert!(dry.out.contains(&line), "{}", dry.out);
    assert!(dry.out.contains("would be removed") && of_2.exists(), "{}", dry.out);
    let done = c.koehler("gc", &[]).ended(0);
    assert_eq!(done.out.replace(", removed", ", would be removed"), dry.out);
    let records = std::fs::read_to_string(c.path("out/.koehler/records.jsonl")).expect("records");
    assert!(!of_2.exists() && records.contains(r#""unit":"flight-1""#));
    assert!(!records.contains(r#""unit":"flight-2""#));
    assert!(!c.path("out/fits/part-5.parquet").exists());
    assert!(!c.path("out/report/.unfinished-1").exists());
    assert!(c.path("out/fits/mine.txt").exists() && c.path("out/fits/part-0.parquet").exists());
    assert!(c.koehler("gc", &[]).ended(0).out.contains("nothing to remove"));
}

#[test]
fn a_part_of_a_run_leaves_the_rest_as_it_is() {
    let c = Campaign::new();
    let part = c.koehler("run", &["--until", "derive", "--flight", "flight-2"]).ended(0);
    assert_eq!((part.stage("ingest"), part.stage("derive")), ((1, 0), (1, 0)), "{}", part.out);
    assert!(part.out.contains(
        "because the run ends with derive: segment, estimate, review, repeats, fit, page, report"
    ));
    assert!(!c.path("out/segments").exists() && !c.path("out/samples/flight=flight-1").exists());
    let flights = c.koehler("run", &["--flight", "flight-2", "--flight", "flight-3"]).ended(0);
    let skipped = "all flights together (--flight names flight-2, flight-3): review, repeats, fit, page, report";
    assert!(flights.out.contains(skipped), "{}", flights.out);
    assert_eq!(flights.stage("ingest"), (1, 1), "{}", flights.out);
    c.run().ended(0);

    // What is not taken stays: tables of the campaign, and of other flights.
    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = 50.0");
    c.koehler("run", &["--flight", "flight-1"]).ended(0);
    assert!(c.path("out/fits/part-0.parquet").exists());
    assert!(c.path("out/samples/flight=flight-3/part-0.parquet").exists());
    c.koehler("verify", &[]).ended(0);
    let status = c.koehler("status", &[]).ended(0);
    assert!(status.out.contains("derive       flight-3             stale"), "{}", status.out);
    assert!(status.out.contains("derive       flight-1             fresh"), "{}", status.out);
    c.run().ended(0);

    let dry = c.koehler("run", &["--from", "fit", "--dry-run"]).ended(0);
    assert!(dry.out.contains("fit          lag-V                stale: it is asked for"));
    let again = c.koehler("run", &["--from", "fit"]).ended(0);
    assert_eq!((again.stage("estimate"), again.stage("fit")), ((0, 3), (1, 0)), "{}", again.out);
    assert!(c.run().ended(0).out.contains("nothing to do"));
    let wrong =
        c.koehler("run", &["--from", "fits", "--flight", "f", "--until", "ingest"]).ended(2);
    for wanted in ["--from: there is no stage \"fits\"", "the campaign has no flight \"f\""] {
        assert!(wrong.err.contains(wanted), "{}", wrong.err);
    }
    let order = c.koehler("run", &["--from", "fit", "--until", "ingest"]).ended(2);
    assert!(order.err.contains("--from names a stage behind"), "{}", order.err);
}

#[test]
fn a_command_says_less_more_or_one_json_document() {
    let c = Campaign::new();
    let json = |run: &crate::campaign::Outcome| -> serde_json::Value {
        serde_json::from_str(&run.out).unwrap_or_else(|e| panic!("{e}: {}", run.out))
    };
    let missing = json(&c.koehler("status", &["--json"]).ended(0));
    assert_eq!(missing["units"][0]["state"], "missing");
    let run = json(&c.koehler("run", &["--json"]).ended(0));
    assert_eq!((&run["stages"][0]["ran"], &run["exit_code"]), (&3.into(), &0.into()), "{run}");
    assert_eq!(run["report"], "out/report/index.html");
    let quiet = c.koehler("run", &["--quiet", "--from", "fit"]).ended(0);
    let late = ["warning:", "all of them are in log.txt", LATE];
    let is_late = |line: &str| line.is_empty() || late.iter().any(|text| line.contains(text));
    assert!(quiet.err.is_empty() && quiet.out.lines().all(is_late), "{}", quiet.out);
    let verbose = c.koehler("run", &["-v", "--from", "fit"]).ended(0);
    assert!(verbose.err.contains("fit of lag-V: done"), "{}", verbose.err);
    let check = json(&c.koehler("check", &["--json"]).ended(0));
    assert_eq!((&check["flights"], &check["errors"]), (&3.into(), &serde_json::json!([])));
    let log = json(&c.command("inspect", &["logs/flight-1.mcap", "--json"]).ended(0));
    assert_eq!(log["topics"][0]["fields"][0]["path"], "speed", "{log}");

    c.edit("pipeline.toml", "against = \"V\"", "against = \"Mach\"");
    for verb in ["check", "run", "status"] {
        let wrong = json(&c.koehler(verb, &["--json"]).ended(2));
        assert_eq!(wrong["exit_code"], 2);
        assert_eq!(wrong["errors"][0]["place"]["line"], 23, "{wrong}");
    }
}

#[test]
fn nothing_is_coloured_where_no_colour_is_wanted() {
    let c = Campaign::new();
    for args in [&["--help"][..], &["run"], &["status", "pipeline.toml"]] {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"))
            .current_dir(c.folder.path())
            .args(args)
            .env("NO_COLOR", "1")
            .env("CLICOLOR_FORCE", "0")
            .output()
            .expect("started");
        assert!(![output.stdout, output.stderr].concat().contains(&0x1b), "{args:?}");
    }
}
