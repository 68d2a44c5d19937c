//! What is run again, and what comes out: nothing without a reason, everything with one, and the
//! same bytes always.

use crate::campaign::{Campaign, INTERCEPT, LAG, Outcome, SLOPE};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// The Parquet files below a folder, with their bytes.
fn tables(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(f) = folders.pop() {
        for entry in std::fs::read_dir(&f).expect("a folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "parquet" || e == "html") {
                let name = path.strip_prefix(folder).expect("below").to_string_lossy().into_owned();
                all.insert(name, std::fs::read(&path).expect("readable"));
            }
        }
    }
    all
}

#[test]
fn the_truth_comes_out_at_the_end() {
    let c = Campaign::new();
    c.run().ended(0);
    let fits = koehler::table::read_dataset(&c.path("out"), "fits").expect("fits");
    let row = |name: &str| {
        fits.strings("parameter").expect("column").iter().position(|p| *p == name).expect("a row")
    };
    let of = |column: &str, name: &str| fits.f64(column).expect("column")[row(name)];
    assert_eq!(fits.i64("n").expect("column")[row("K")], 12);
    for (name, slope, intercept) in [("K", SLOPE, INTERCEPT), ("T", 0.0, LAG)] {
        // A step between two samples of the drive is 5 ms uncertain: 2% of the values is what this
        // plumbing can promise.
        let (low, high) = (60.0, 113.0);
        for v in [low, high] {
            let (value, truth) =
                (of("intercept", name) + v * of("slope", name), intercept + v * slope);
            assert!((value - truth).abs() < 0.02 * truth, "{name} at {v}: {value} for {truth}");
        }
    }
    assert!(c.path("out/report/index.html").is_file());
}

#[test]
fn a_second_run_does_nothing_and_says_so() {
    let c = Campaign::new();
    c.run().ended(0);
    let before = tables(&c.path("out"));
    // The best of some runs: the other tests want the processor as well.
    let seconds = (0..8).map(|_| {
        let begin = Instant::now();
        let again = c.run().ended(0);
        assert!(again.out.contains("nothing to do"), "{}", again.out);
        begin.elapsed().as_secs_f64()
    });
    let best = seconds.fold(f64::INFINITY, f64::min);
    assert!(best < 1.0, "took {best} s");
    assert!(c.koehler("status", &[]).ended(0).out.contains("everything is fresh"));
    assert_eq!(before, tables(&c.path("out")));
}

#[test]
fn one_thread_and_many_write_the_same_bytes() {
    let c = Campaign::new();
    c.koehler("run", &["--out", "one", "--jobs", "1"]).ended(0);
    c.koehler("run", &["--out", "many", "--jobs", "7"]).ended(0);
    let (one, many) = (tables(&c.path("one")), tables(&c.path("many")));
    assert!(one.len() > 10);
    assert_eq!(one.keys().collect::<Vec<_>>(), many.keys().collect::<Vec<_>>());
    for (name, bytes) in &one {
        assert!(many[name] == *bytes, "{name} differs");
    }
}

#[test]
fn a_setting_reruns_what_depends_on_it_and_nothing_else() {
    let c = Campaign::new();
    c.run().ended(0);
    c.edit("pipeline.toml", "against = \"V\"", "against = \"V\"\nlevel = 0.9");
    let status = c.koehler("run", &["--dry-run"]).ended(0);
    assert!(status.out.contains("stale: setting `level` changed"), "{}", status.out);
    let run = c.run().ended(0);
    assert_eq!(run.stage("estimate"), (0, 3));
    assert_eq!(run.stage("fit"), (1, 0));

    c.edit("pipeline.toml", "kinds = [\"3211\"]", "kinds = [\"3211\"]\npost_s = 1.5");
    let run = c.run().ended(0);
    assert_eq!(run.stage("ingest"), (0, 3));
    assert_eq!(run.stage("segment"), (0, 3));
    assert_eq!(run.stage("estimate"), (3, 0));
    assert_eq!(run.stage("fit"), (1, 0));

    // A comment and an order of lines are no settings.
    c.edit("pipeline.toml", "[report]", "# nothing\n[report]");
    assert!(c.run().ended(0).out.contains("nothing to do"));
}

#[test]
fn a_model_counts_by_what_it_says() {
    let c = Campaign::new();
    c.run().ended(0);
    c.edit("lag.model.toml", "start = 0.3", "start = 0.31");
    let run = c.run().ended(0);
    assert_eq!(run.stage("segment"), (0, 3));
    assert_eq!(run.stage("estimate"), (3, 0));
}

#[test]
fn a_changed_flight_costs_its_own_estimates_and_what_takes_all_flights() {
    let c = Campaign::new();
    c.run().ended(0);
    let before = tables(&c.path("out"));
    c.fly("flight-2", 7, 4);
    let run = c.run().ended(0);
    for (stage, counts) in [
        ("ingest", (1, 2)),
        ("estimate", (1, 2)),
        ("review", (1, 0)),
        ("fit", (1, 0)),
        ("page", (1, 2)),
    ] {
        assert_eq!(run.stage(stage), counts, "{stage}");
    }
    // What a run from nothing makes is the same.
    let after = tables(&c.path("out"));
    c.koehler("run", &["--out", "anew"]).ended(0);
    assert_eq!(after, tables(&c.path("anew")));
    let of = |flight: &str| format!("estimates/part-0-{flight}.parquet");
    let is = |file: &str| before.contains_key(file) && before.get(file) == after.get(file);
    assert!(is(&of("flight-1")) && is(&of("flight-3")) && !is(&of("flight-2")));
    // A table without rows is there all the same.
    assert!(after.contains_key("profiles/part-0.parquet"));
}

#[test]
fn what_no_flight_can_say_by_itself_is_said_of_all() {
    let c = Campaign::new();
    c.edit("pipeline.toml", "kinds = [\"3211\"]", "kinds = [\"doublet\"]");
    let none = c.run().ended(1);
    assert_eq!(none.out.matches("no maneuver to estimate lag from").count(), 1, "{}", none.out);
    c.edit(
        "pipeline.toml",
        "kinds = [\"doublet\"]",
        "kinds = [\"3211\"]\n[estimate.method]\nmax_iterations = 1",
    );
    let poor = c.run().ended(1);
    assert_eq!(poor.out.matches("no estimate of lag converged: ").count(), 1, "{}", poor.out);
}

#[test]
fn a_new_a_changed_and_a_removed_flight_are_noticed() {
    let c = Campaign::new();
    c.run().ended(0);
    c.fly("flight-4", 9, 2);
    let run = c.run().ended(0);
    assert_eq!(run.stage("ingest"), (1, 3));

    c.fly("flight-2", 17, 4);
    let status = c.koehler("status", &[]).ended(0);
    assert!(status.out.contains("stale: log changed"), "{}", status.out);
    assert_eq!(c.run().ended(0).stage("ingest"), (1, 3));

    std::fs::remove_file(c.path("logs/flight-3.mcap")).expect("removed");
    let run = c.run().ended(0);
    assert_eq!(run.stage("ingest"), (0, 3));
    assert!(!c.path("out/signals/flight=flight-3").exists());
    let segments = koehler::table::read_dataset(&c.path("out"), "segments").expect("segments");
    assert_eq!(segments.rows(), 10);
}

/// How many units a run does, by what it says of its stages.
fn done(run: &Outcome) -> u64 {
    let said: serde_json::Value = serde_json::from_str(&run.out).expect("JSON");
    let stages = said["stages"].as_array().expect("stages").iter();
    let count = |stage: &serde_json::Value, what: &str| stage[what].as_u64().expect("a count");
    stages.map(|stage| count(stage, "ran") + count(stage, "failed")).sum()
}

#[test]
fn fault_what_stands_behind_a_flight_that_failed_is_fresh_once_it_was_made_without_it() {
    let c = Campaign::new();
    let told = || {
        let status = c.koehler("status", &["--json"]).ended(0);
        let said: serde_json::Value = serde_json::from_str(&status.out).expect("JSON");
        [&said["to_run"], &said["may_run"]].map(|count| count.as_u64().expect("a count"))
    };
    let run = |code: i32| done(&c.koehler("run", &["--json"]).ended(code));
    let [new, _] = told();
    assert!(run(0) <= new);
    assert_eq!(told(), [0, 0]);
    std::fs::write(c.path("logs/flight-2.mcap"), b"no log").expect("written");
    // That it is no log is seen before it is read. What takes all flights goes on without it; what reads
    // that may come out the same.
    let status = c.koehler("status", &[]).ended(0);
    assert!(status.out.contains("stale: it will fail: "), "{}", status.out);
    let blocked = status.out.lines().filter(|line| line.contains("blocked: ")).count();
    let [sure, most] = told();
    let first = run(1);
    assert!((sure..=sure + most).contains(&first), "{sure}, {most}, {first}");
    assert!(sure >= 2 && blocked >= 2, "{sure}, {}", status.out);
    assert_eq!(told(), [1, 0]);
    assert_eq!(run(1), 1);
    let explained = c.koehler("explain", &["ingest", "flight-2"]).ended(0);
    assert!(explained.out.contains("it failed, and is tried again: "), "{}", explained.out);
    let dry = c.koehler("run", &["--dry-run"]).ended(0);
    assert!(dry.out.ends_with("a run would do 1 unit of work\n"), "{}", dry.out);
    // What other stages have to make again changes nothing about the flight that failed.
    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = 50.0");
    let [sure, most] = told();
    let again = run(1);
    assert!((sure..=sure + most).contains(&again), "{sure}, {most}, {again}");
    assert_eq!(told(), [1, 0]);
}

#[test]
fn a_deleted_or_modified_table_is_made_again() {
    let c = Campaign::new();
    c.run().ended(0);
    let before = tables(&c.path("out"));
    std::fs::remove_file(c.path("out/samples/flight=flight-1/part-0.parquet")).expect("removed");
    std::fs::write(c.path("out/fits/part-0.parquet"), b"scribble").expect("written");
    let status = c.koehler("status", &[]).ended(0);
    assert!(
        status.out.contains("is gone") && status.out.contains("changed by something else"),
        "{}",
        status.out
    );
    let run = c.run().ended(0);
    assert_eq!(run.stage("derive"), (1, 2));
    // The samples are the same bytes again: nothing that reads them is run.
    assert_eq!(run.stage("estimate"), (0, 3));
    assert_eq!(run.stage("fit"), (1, 0));
    assert_eq!(before, tables(&c.path("out")));
}

#[test]
fn a_run_that_is_killed_leaves_nothing_that_passes_for_fresh() {
    let c = Campaign::new();
    c.koehler("run", &["--out", "whole"]).ended(0);
    let whole = tables(&c.path("whole"));
    for wait_ms in [30, 90, 150, 250, 400] {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_koehler"));
        let command =
            command.current_dir(c.folder.path()).args(["run", "pipeline.toml", "--out", "killed"]);
        let mut child = command.stdout(std::process::Stdio::null()).spawn().expect("started");
        std::thread::sleep(std::time::Duration::from_millis(wait_ms));
        child.kill().expect("killed");
        child.wait().expect("ended");
        // What is there is whole: every table file can be read.
        if c.path("killed").exists() {
            for table in ["signals", "samples", "segments", "estimates", "fits"] {
                koehler::table::read_dataset(&c.path("killed"), table).expect("whole files");
            }
        }
    }
    c.koehler("run", &["--out", "killed"]).ended(0);
    assert!(tables(&c.path("killed")) == whole);
}

#[test]
fn a_dry_run_writes_nothing() {
    let c = Campaign::new();
    let dry = c.koehler("run", &["--dry-run"]).ended(0);
    assert!(dry.out.contains("missing: never run"), "{}", dry.out);
    assert!(!c.path("out").exists());
}

/// The gain grows with airspeed, and an effect of one's own says so; the model does not know it.
const EFFECT: &str = r#"
title     = "The gain grows with airspeed"
family    = "aerodynamic"
signature = "Answers are larger at higher airspeed."
separate  = "Steps at several airspeeds."

[bind]
V = "airspeed"

[parameters]
k = { name = "K_V", unit = "s/m", null = 0.0, typical = 0.01 }

[replace]
K = "K + {k}*{V}"
"#;

/// A campaign with an estimate per maneuver (lag) and one over all of them (all), and an effect of
/// one's own.
fn with_effect() -> Campaign {
    let c = Campaign::new();
    c.edit("lag.model.toml", "u = \"rad\"", "u = \"rad\"\nV = \"m/s\"");
    let all = "[[estimate]]\nname = \"all\"\nmodel = \"lag.model.toml\"\ninput = \"drive\"\ngroup = \"all\"\n\n[[fit]]";
    c.edit("pipeline.toml", "[[fit]]", all);
    // Half the samples and two thirds of the maneuvers are plenty, and a third of the time.
    c.edit("pipeline.toml", "rate_hz = 100.0", "rate_hz = 50.0");
    std::fs::remove_file(c.path("logs/flight-3.mcap")).expect("removed");
    std::fs::create_dir(c.path("effects")).expect("made");
    c.write("effects/gain-speed.toml", EFFECT);
    c
}

/// A campaign whose diagnosis a command asks for, and its results.
fn diagnosed() -> Campaign {
    let c = with_effect();
    let told = c.koehler("diagnose", &["--estimate", "all", "--effects", "effects"]).ended(3);
    assert!(told.out.contains("The gain grows with airspeed"), "{}", told.out);
    assert!(told.out.contains("all: NAMED"), "{}", told.out);
    assert!(told.out.contains("| use (95%, estimate over all maneuvers): "), "{}", told.out);
    assert!(told.out.contains("estimated with it: all.next"), "{}", told.out);
    c
}

#[test]
fn what_a_diagnosis_adds_is_estimated_as_the_pipeline_does() {
    let c = diagnosed();
    let t = koehler::table::read_dataset(&c.path("out"), "estimates").expect("estimates");
    let (models, parameters, values) = (
        t.strings("model").expect("column"),
        t.strings("parameter").expect("column"),
        t.f64("value").expect("column"),
    );
    let of = |name: &str| {
        let row = (0..t.rows()).find(|&i| models[i] == "all.next" && parameters[i] == name);
        values[row.unwrap_or_else(|| panic!("{name} of all.next"))]
    };
    assert!((of("K_V") - SLOPE).abs() < 0.02 * SLOPE, "{}", of("K_V"));
    let page = std::fs::read_to_string(c.path("out/report/index.html")).expect("a report");
    assert!(page.contains("Estimated again with what was added"));

    // A run keeps what the command asked for, as long as nothing behind it changes, and says when
    // it goes.
    let before = tables(&c.path("out"));
    assert!(c.run().ended(0).out.contains("nothing to do"));
    assert_eq!(before, tables(&c.path("out")));
    c.edit("lag.model.toml", "start = 0.3", "start = 0.31");
    let run = c.run().ended(0);
    assert!(run.out.contains("removed: diagnose of all"), "{}", run.out);
    assert!(!c.path("out/findings").exists());
    // the estimates leave theirs
    let models = std::fs::read_dir(c.path("out/models")).into_iter().flatten().flatten();
    let names: Vec<String> =
        models.map(|file| file.file_name().to_string_lossy().into_owned()).collect();
    assert!(names.iter().all(|name| name.ends_with(".identified.model.toml")), "{names:?}");
}

/// What takes long is left to `koehler diagnose`; a run keeps it until something behind it changes.
#[test]
fn a_diagnosis_that_is_left_to_the_command_is_made_by_it_alone() {
    let c = with_effect();
    let asked = "[[diagnose]]\nestimate = \"all\"\neffects = [\"effects\"]\nrun = false\n";
    c.edit("pipeline.toml", "\n[[fit]]", &format!("\n{asked}\n[[fit]]"));
    c.run().ended(0);
    assert!(!c.path("out/findings").exists());
    let told = c.koehler("diagnose", &[]).ended(3);
    assert!(told.out.contains("all: NAMED") && !told.out.contains("\nlag\n"), "{}", told.out);
    let made = tables(&c.path("out"));
    assert!(c.run().ended(0).out.contains("nothing to do"));
    assert!(c.koehler("diagnose", &[]).ended(3).out.contains("all: NAMED"));
    assert_eq!(made, tables(&c.path("out")));
    // Other settings of it, and it is another one.
    c.edit("pipeline.toml", "run = false", "run = false\nrerun = false");
    let run = c.run().ended(0);
    assert!(run.out.contains("removed: diagnose of all"), "{}", run.out);
    assert!(!c.path("out/findings").exists());
    // Its mistakes are mistakes of the pipeline.
    c.edit("pipeline.toml", "[\"effects\"]", "[\"nowhere\"]");
    assert!(c.koehler("check", &[]).ended(2).err.contains("nowhere"));
}

/// The gain is one number in "all", and grows with airspeed. In "lag" every maneuver has its own,
/// and the pipeline says that they lie on a line: nothing is missing in that, and nothing in
/// maneuvers that have a value each without a line.
#[test]
fn a_diagnosis_takes_the_base_as_the_pipeline_estimates_it() {
    let c = with_effect();
    // Steps of the input become ramps of one sample: that is seen, as a delay. The gain is the line
    // that the pipeline fits.
    let told = c.koehler("diagnose", &["--estimate", "lag", "--effects", "effects"]).ended(3);
    assert!(
        !told.out.contains("The gain grows with airspeed")
            && told.out.contains("K, T are lines in V"),
        "{}",
        told.out
    );
    assert!(told.err.contains("lag: round 1: screening"), "{}", told.err);
    let why = |c: &Campaign| {
        let t = koehler::table::read_dataset(&c.path("out"), "candidates").expect("candidates");
        let row = t
            .strings("effect")
            .expect("column")
            .iter()
            .position(|e| *e == "gain-speed")
            .expect("the effect");
        t.strings("why").expect("column")[row].to_string()
    };
    assert!(why(&c).contains("K per V"), "{}", why(&c));
    c.edit("pipeline.toml", "parameters = [\"K\", \"T\"]", "parameters = [\"T\"]");
    let told = c.koehler("diagnose", &["--estimate", "lag", "--effects", "effects"]).ended(3);
    assert!(!told.out.contains("The gain grows with airspeed"), "{}", told.out);
    assert!(
        told.out.contains("T is a line in V; what has no line has one value per maneuver"),
        "{}",
        told.out
    );
    assert!(why(&c).contains("a value of its own in every maneuver"), "{}", why(&c));
}

/// A diagnosis that only a command asked for gives its place to one of the pipeline file: its files
/// are taken away, and not those that the other one has just written there.
#[test]
fn what_gives_its_place_away_takes_no_file_of_its_successor() {
    let c = Campaign::new();
    let second = "[[estimate]]\nname = \"second\"\nmodel = \"lag.model.toml\"\ninput = \"drive\"\n";
    c.edit("pipeline.toml", "\n[[fit]]", &format!("\n{second}\n[[fit]]"));
    c.koehler("diagnose", &["--estimate", "second"]);
    let asked = std::fs::read(c.path("out/findings/part-0.parquet")).expect("its findings");
    c.edit("pipeline.toml", "\n[[fit]]", "\n[[diagnose]]\nestimate = \"lag\"\n\n[[fit]]");
    let run = c.run();
    let taken = std::fs::read(c.path("out/findings/part-0.parquet"))
        .unwrap_or_else(|e| panic!("{e}: {run:?}"));
    assert_ne!(asked, taken);
    let again = c.koehler("status", &[]);
    assert!(!again.out.contains("is gone"), "{}", again.out);
}

/// Places go by the order of the pipeline file. Two estimates that swap them each write where the
/// other one was, and neither removes what the other has just written.
#[test]
fn estimates_that_swap_their_places_keep_what_they_made() {
    let c = Campaign::new();
    let second = "[[estimate]]\nname = \"second\"\nmodel = \"lag.model.toml\"\ninput = \"drive\"\n";
    c.edit("pipeline.toml", "\n[[fit]]", &format!("\n{second}\n[[fit]]"));
    c.run().ended(0);
    for (old, new) in [("lag", "@"), ("second", "lag"), ("@", "second")] {
        c.edit("pipeline.toml", &format!("name = \"{old}\""), &format!("name = \"{new}\""));
    }
    c.run().ended(0);
    let swapped = tables(&c.path("out"));
    let again = c.run().ended(0);
    assert!(again.out.contains("nothing to do"), "{}", again.out);
    std::fs::remove_dir_all(c.path("out")).expect("removed");
    c.run().ended(0);
    let anew = tables(&c.path("out"));
    assert_eq!(swapped.keys().collect::<Vec<_>>(), anew.keys().collect::<Vec<_>>());
    assert!(anew.iter().all(|(path, bytes)| swapped[path] == *bytes));
}
