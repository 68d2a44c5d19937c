//! The log of a run's times: a line for each unit, at once, and no part of what is compared.

use crate::campaign::Campaign;

/// The lines about this, with begin and seconds.
fn lines<'a>(log: &'a str, what: &str) -> Vec<(f64, f64, &'a str)> {
    let parts = |line: &'a str| {
        let (begin, rest) = line.trim_start().split_once(' ')?;
        let (seconds, rest) = rest.trim_start().split_once("  ")?;
        Some((begin.parse().ok()?, seconds.parse().ok()?, rest))
    };
    log.lines().filter_map(parts).filter(|(.., text)| text.starts_with(what)).collect()
}

#[test]
fn every_unit_of_a_run_has_a_line_with_its_times() {
    let c = Campaign::new();
    let log = || std::fs::read_to_string(c.path("out/log.txt")).expect("a log");
    c.run().ended(0);
    let first = log();
    assert!(
        first.starts_with("# koehler ") && first.contains(", run of pipeline.toml\n"),
        "{first}"
    );
    let made = lines(&first, "ingest of flight-");
    assert_eq!(made.len(), 3, "{first}");
    assert!(made.iter().all(|(.., text)| text.ends_with(": made")), "{first}");
    let (begin, seconds, _) = lines(&first, "estimate of lag of flight-1: made")[0];
    assert!(begin > made[0].0 && seconds > 0.0, "{first}");
    assert!(first.trim_end().ends_with("ended: everything asked for is there"), "{first}");
    let total = first.lines().find(|line| line.ends_with("  derive")).expect("a total");
    let words: Vec<&str> = total.split_whitespace().collect();
    assert_eq!(words[2..], ["3", "0", "0", "0", "derive"], "{total}");

    // It is no result: no record names it, and it may be anything.
    c.koehler("verify", &[]).ended(0);
    assert!(c.koehler("gc", &[]).ended(0).out.contains("nothing to remove"));
    assert!(c.run().ended(0).out.contains("nothing to do"));
    let second = log();
    assert!(lines(&second, "ingest of flight-").iter().all(|(.., t)| t.ends_with(": kept")));
    assert!(!second.contains(": made"), "{second}");
    c.koehler("diagnose", &[]);
    assert!(
        log().contains(", diagnose of pipeline.toml\n") && log().contains("diagnose of lag: made")
    );
}

#[test]
fn a_run_that_fails_ends_its_log() {
    let c = Campaign::new();
    let log = || std::fs::read_to_string(c.path("out/log.txt")).expect("a log");
    c.write("logs/flight-2.mcap", "no log");
    c.run().ended(1);
    let some = log();
    let failed = lines(&some, "ingest of flight-2");
    assert!(failed.len() == 1 && failed[0].2.ends_with(": failed"), "{some}");
    assert!(some.contains("                     error: "), "{some}");
    assert!(some.contains("derive of flight-2: blocked, "), "{some}");
    assert!(some.trim_end().ends_with("ended: something is missing, or a problem"), "{some}");

    c.edit("channels.toml", "\"/air\"", "\"/nowhere\"");
    c.run().ended(2);
    let none = log();
    assert!(none.contains("look at the logs: failed"), "{none}");
    assert!(none.contains("ended: nothing more could be done\n"), "{none}");
    assert!(none.contains("error: "), "{none}");
}

#[test]
fn fault_a_file_of_others_is_not_written_over() {
    let c = Campaign::new();
    c.run().ended(0);
    c.write("out/log.txt", "mine\n");
    let run = c.run().ended(0);
    assert!(run.err.contains("warning: this run keeps no whole log of its times: "), "{}", run.err);
    assert_eq!(std::fs::read_to_string(c.path("out/log.txt")).expect("readable"), "mine\n");
    let verify = c.koehler("verify", &[]).ended(1);
    assert!(verify.out.contains("out/log.txt: is unknown"), "{}", verify.out);
}
