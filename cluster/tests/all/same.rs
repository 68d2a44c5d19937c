//! The bytes of a run do not depend on where its work was done.

use crate::campaign::{Campaign, assert_same, left};
use crate::processes::Cluster;
use std::time::Duration;

#[test]
fn one_two_and_four_workers_leave_what_one_thread_leaves() {
    let campaign = Campaign::of(4);
    let (alone, code) = campaign.alone();
    assert_eq!(code, Some(0));
    for workers in [1, 2, 4] {
        let cluster = Cluster::start(&campaign, workers);
        let out = format!("by-{workers}");
        let output = campaign.run(&out, &["--cluster", &cluster.address]).output().expect("run");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        println!("{workers} workers: {said}");
        assert_eq!(output.status.code(), Some(0), "{said}");
        assert!(!said.contains("done here"), "{said}");
        let busy = cluster.workers.iter().filter(|w| w.cpu() > Duration::from_millis(300)).count();
        assert!(busy >= workers.min(2), "{busy} of {workers} workers did something");
        assert_same(&alone, &left(&campaign.path(&out)));
    }
}

/// A log that is none is a row with the error, here as there; the other flights are done.
#[test]
fn a_flight_without_a_log_costs_itself_alone() {
    let campaign = Campaign::of(3);
    campaign.write("logs/f02.mcap", "not a log");
    let (alone, code) = campaign.alone();
    assert_eq!(code, Some(1));
    let cluster = Cluster::start(&campaign, 2);
    let output = campaign.run("there", &["--cluster", &cluster.address]).output().expect("run");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), code, "{said}");
    assert!(said.contains("f02"), "{said}");
    assert_same(&alone, &left(&campaign.path("there")));
}

/// Logs that workers do not see are errors of their items, which are then done by the run itself.
#[test]
fn what_workers_do_not_see_is_done_here() {
    let campaign = Campaign::of(2);
    let (alone, _) = campaign.alone();
    std::fs::create_dir(campaign.path("results")).expect("made");
    let cluster = Cluster::start_below(&campaign, "results");
    let output = campaign.run("results/there", &["--cluster", &cluster.address]).output();
    let output = output.expect("run");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("is in no folder of this worker"), "{said}");
    assert!(said.contains("is done here"), "{said}");
    assert_same(&alone, &left(&campaign.path("results/there")));
}
