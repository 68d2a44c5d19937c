//! What a command says where nobody can read it, while a run goes on, and about what a run left: answers
//! that are lost are a failure, and reasons are the true ones.

use crate::campaign::Campaign;
use std::process::{Command, Stdio};

/// A command in the campaign's folder, to be started.
fn command(c: &Campaign, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_koehler"));
    command.current_dir(c.folder.path()).args(args);
    command
}

const QUERY: &str = "SELECT * FROM estimates";

/// Verbs with an answer, after a run.
const ANSWERS: [&[&str]; 13] = [
    &["run", "pipeline.toml", "--json"],
    &["run", "pipeline.toml"],
    &["status", "pipeline.toml"],
    &["status", "pipeline.toml", "--json"],
    &["check", "pipeline.toml"],
    &["explain", "pipeline.toml"],
    &["verify", "pipeline.toml"],
    &["sql", "out", QUERY, "--csv"],
    &["sql", "out", QUERY],
    &["diff", "out", "out"],
    &["lineage", "out/fits/part-0.parquet"],
    &["inspect", "logs/flight-1.mcap"],
    &["--help"],
];

#[cfg(target_os = "linux")]
#[test]
fn fault_an_answer_that_cannot_be_written_is_a_failure() {
    let c = Campaign::new();
    c.run().ended(0);
    for args in ANSWERS {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").expect("a full disk");
        let ended = command(&c, args).stdout(full).output().expect("started");
        let err = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(2), "{args:?}: {err}");
        let told = "error: standard output could not be written: No space left on device\n";
        assert_eq!(err.matches(told).count(), 1, "{args:?}: {err}");
    }
}

#[test]
fn a_reader_that_wants_no_more_is_no_failure() {
    let c = Campaign::new();
    c.run().ended(0);
    for args in ANSWERS {
        let mut child = command(&c, args)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("started");
        drop(child.stdout.take());
        let ended = child.wait_with_output().expect("ended");
        let err = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(
            (ended.status.code(), err.contains("standard output")),
            (Some(0), false),
            "{err}"
        );
    }
}

#[test]
fn notes_of_a_flight_that_was_taken_out_are_removed_for_that_reason() {
    let c = Campaign::new();
    // A log that is cut short has a note.
    let bytes = std::fs::read(c.path("logs/flight-2.mcap")).expect("readable");
    std::fs::write(c.path("logs/flight-2.mcap"), &bytes[..bytes.len() / 2]).expect("written");
    assert!(c.run().code < 2);
    assert!(c.path("out/notes/part-0-flight-2.parquet").exists());
    std::fs::remove_file(c.path("logs/flight-2.mcap")).expect("removed");
    std::fs::write(c.path("out/fits/part-5.parquet"), b"half").expect("written");
    let status = c.koehler("status", &[]).ended(0).out;
    assert!(status.contains("flight-2 is no longer part of the campaign"), "{status}");
    assert!(!status.contains("`beside`") && !status.contains("`flights`"), "{status}");
    let mut lines: Vec<&str> = status.lines().filter(|line| line.starts_with("fit ")).collect();
    lines.dedup();
    assert_eq!(lines.len(), 1, "{status}");
    let gc = c.koehler("gc", &[]).ended(0).out;
    let of = |file: &str| gc.lines().find(|line| line.contains(file)).expect("a line");
    let notes = of("notes/part-0-flight-2.parquet");
    assert!(notes.contains("(notes on flight-2, which is no longer part of the campaign)"), "{gc}");
    assert!(of("fits/part-5.parquet").contains("(no record of a run names it)"), "{gc}");
    assert!(!gc.contains("stopped"), "{gc}");
    // What was removed is not missing afterwards.
    let verified = c.koehler("verify", &[]);
    assert!(!verified.out.contains("notes/part-0-flight-2"), "{}", verified.out);
}
