//! Workers that end in the middle of their work cost time and no byte.

use crate::campaign::{Campaign, assert_same, left};
use crate::processes::{Cluster, Process};
use std::io::{BufRead, BufReader};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// Waits until a worker is at work.
fn at_work(worker: &Process, run: &mut Child) {
    let before = worker.cpu();
    while worker.cpu() < before + Duration::from_millis(300) {
        assert!(run.try_wait().expect("known").is_none(), "the run ended first");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// What a run says from now on, and when it said what contains `text`.
fn heard(run: &mut Child, text: &str) -> (String, Option<Instant>) {
    let lines = BufReader::new(run.stderr.take().expect("piped")).lines();
    let (mut said, mut when) = (String::new(), None);
    for line in lines.map_while(Result::ok) {
        if line.contains(text) {
            when.get_or_insert_with(Instant::now);
        }
        said += &format!("{line}\n");
    }
    (said, when)
}

#[test]
fn one_of_two_is_killed() {
    let campaign = Campaign::of(4);
    let (alone, _) = campaign.alone();
    let mut cluster = Cluster::start(&campaign, 2);
    let mut run = campaign.run("there", &["--cluster", &cluster.address]);
    let mut run = run.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("started");
    at_work(&cluster.workers[0], &mut run);
    cluster.workers[0].kill();
    let begin = Instant::now();
    let (said, _) = heard(&mut run, "");
    println!("{:.1} s after the kill: {said}", begin.elapsed().as_secs_f64());
    assert_eq!(run.wait().expect("ended").code(), Some(0), "{said}");
    assert_same(&alone, &left(&campaign.path("there")));
}

#[test]
fn all_are_killed_and_the_run_goes_on_without() {
    let campaign = Campaign::of(4);
    let (alone, _) = campaign.alone();
    let mut cluster = Cluster::start(&campaign, 2);
    let mut run = campaign.run("there", &["--cluster", &cluster.address]);
    let mut run = run.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("started");
    at_work(&cluster.workers[1], &mut run);
    cluster.workers.iter_mut().for_each(Process::kill);
    let begin = Instant::now();
    let (said, when) = heard(&mut run, "no worker of");
    println!("{said}");
    let when = when.unwrap_or_else(|| panic!("it was not said: {said}")) - begin;
    println!("said {:.1} s after the kill", when.as_secs_f64());
    assert!(when < Duration::from_secs(60), "{when:?}");
    assert_eq!(run.wait().expect("ended").code(), Some(0), "{said}");
    assert_same(&alone, &left(&campaign.path("there")));
    // The next run finds nobody and says so at once.
    let again = campaign.run("again", &["--cluster", &cluster.address]).output().expect("run");
    assert_eq!(again.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&again.stderr).contains("does no work"));
    // Without a cluster it has nothing left to do.
    let rest = campaign.run("there", &[]).output().expect("run");
    assert!(String::from_utf8_lossy(&rest.stdout).contains("nothing to do"), "{rest:?}");
}
