//! Two workers of one thread beside one: processor time and wall time of a campaign of 24 flights.

use crate::campaign::Campaign;
use crate::processes::Cluster;
use std::time::{Duration, Instant};

#[test]
fn two_workers_are_nearly_twice_one() {
    let campaign = Campaign::of(24);
    let measured = |workers: usize| {
        let cluster = Cluster::start(&campaign, workers);
        let cpu = || cluster.workers.iter().map(|worker| worker.cpu()).sum::<Duration>();
        let (before, begin) = (cpu(), Instant::now());
        let out = format!("by-{workers}");
        let args = ["--cluster", &cluster.address, "--until", "segment", "--jobs", "1"];
        let output = campaign.run(&out, &args).output().expect("run");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        (begin.elapsed().as_secs_f64(), (cpu() - before).as_secs_f64())
    };
    let ((wall_1, cpu_1), (wall_2, cpu_2)) = (measured(1), measured(2));
    let (efficiency, speed) = (cpu_1 / cpu_2, wall_1 / wall_2);
    println!("1 worker: {wall_1:.1} s, processor {cpu_1:.1} s");
    println!("2 workers: {wall_2:.1} s, processor {cpu_2:.1} s");
    println!("processor efficiency {efficiency:.3}, {speed:.2} times as fast");
    assert!(efficiency > 0.93, "{efficiency}");
    // Wall time says something where the cores are idle alone.
    if std::env::var("KOEHLER_IDLE").as_deref() == Ok("1") {
        assert!(speed > 1.5, "{speed}");
    }
}
