//! What a campaign costs as it grows: flights made from seeds, no two alike, in; processor time per flight, memory, reruns and sizes of
//! the report out. `cargo bench --bench campaign -- [flights]...`, 30, 100 and 300 by default.
//!
//! A block of flights (a row) is written from its seeds, run, and deleted with its logs and results before the
//! next one is written. Within a block all logs are there at once, because the program wants them: results are
//! those of the logs that are there, so that a log which is gone takes the results of its flight with it, at the
//! next run. A user who adds flights to a campaign keeps the logs of the earlier ones, and so does a block. A
//! log is about 2 MB, results 1.2 MB a flight: a block of 1000 flights takes 3.2 GB of disk, the largest
//! block is what all blocks take, and the last columns tell both.
//!
//! Each flight is eight minutes of a small system at 100 and 40 Hz with 24 maneuvers, every one of which is estimated by itself. The
//! program runs as a process of its own, and its memory and processor time are looked at twenty times a second (Linux alone).

#[allow(dead_code)]
#[path = "../tests/all/campaign.rs"]
mod campaign;

use campaign::{CHANNELS, Campaign, MODEL, PIPELINE};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const MANEUVERS: usize = 24;
const LOOK: Duration = Duration::from_millis(50);

fn main() {
    let asked: Vec<usize> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    println!("flights of {MANEUVERS} maneuvers, 8 min each");
    println!(
        "{:>7} {:>11} {:>8} {:>8} {:>9} {:>11} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "flights",
        "CPU/flight",
        "wall s",
        "anon MB",
        "rerun s",
        "1 changed s",
        "index kB",
        "page kB",
        "report MB",
        "all MB",
        "logs MB"
    );
    for flights in if asked.is_empty() { vec![30, 100, 300] } else { asked } {
        block(flights);
    }
}

/// One row; its folder is gone when it ends.
fn block(flights: usize) {
    let campaign = Campaign { folder: tempfile::tempdir().expect("a temporary folder") };
    campaign.write("channels.toml", CHANNELS);
    campaign.write("lag.model.toml", MODEL);
    campaign.write("pipeline.toml", PIPELINE);
    std::fs::create_dir(campaign.path("logs")).expect("a folder");
    (0..flights).for_each(|k| campaign.fly(&format!("flight-{k:04}"), k as u64, MANEUVERS));
    let cold = Ran::of(&campaign);
    let fresh = Ran::of(&campaign);
    campaign.fly("flight-0000", flights as u64, MANEUVERS);
    let changed = Ran::of(&campaign);
    let (out, report) = (campaign.path("out"), campaign.path("out/report"));
    let page = sizes(&report.join("flights")).into_iter().max();
    let index = std::fs::metadata(report.join("index.html")).map_or(0, |file| file.len());
    println!(
        "{flights:>7} {:>11.2} {:>8.1} {:>8.0} {:>9.2} {:>11.2} {:>9.0} {:>9.0} {:>9.0} {:>9.0} {:>9.0}",
        cold.cpu_s / flights as f64,
        cold.wall_s,
        cold.anonymous_mb,
        fresh.wall_s,
        changed.wall_s,
        index as f64 / 1e3,
        page.unwrap_or_default() as f64 / 1e3,
        total(&report) / 1e6,
        total(&out) / 1e6,
        total(&campaign.path("logs")) / 1e6,
    );
    campaign.folder.close().expect("the block is deleted");
}

/// What one run of the program took.
struct Ran {
    wall_s: f64,
    cpu_s: f64,
    anonymous_mb: f64,
}

impl Ran {
    fn of(campaign: &Campaign) -> Ran {
        let clock = Instant::now();
        let mut child = Command::new(env!("CARGO_BIN_EXE_koehler"))
            .current_dir(campaign.folder.path())
            .args(["run", "pipeline.toml", "--quiet"])
            .stdout(Stdio::null())
            .spawn()
            .expect("started");
        let (mut cpu_s, mut anonymous_mb) = (0.0, 0.0f64);
        while child.try_wait().expect("a child").is_none() {
            cpu_s = cpu(child.id()).unwrap_or(cpu_s);
            anonymous_mb = anonymous_mb.max(anonymous(child.id()).unwrap_or(0.0));
            std::thread::sleep(LOOK);
        }
        Ran { wall_s: clock.elapsed().as_secs_f64(), cpu_s, anonymous_mb }
    }
}

/// Processor time of a process, seconds: fields 14 and 15 of `/proc/PID/stat`, in hundredths.
fn cpu(pid: u32) -> Option<f64> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |k: usize| fields.get(k)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

/// Anonymous memory that a process holds, MB.
fn anonymous(pid: u32) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find(|line| line.starts_with("RssAnon:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

/// Sizes of the files in a folder.
fn sizes(folder: &Path) -> Vec<u64> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let files = entries.filter_map(|e| e.metadata().ok()).filter(|file| file.is_file());
    files.map(|file| file.len()).collect()
}

/// Bytes of all files below a folder.
fn total(folder: &Path) -> f64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let of = |e: std::fs::DirEntry| match e.metadata() {
        Ok(file) if file.is_dir() => total(&e.path()),
        Ok(file) => file.len() as f64,
        Err(_) => 0.0,
    };
    entries.map(of).sum()
}
