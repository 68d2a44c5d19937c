//! Whole flights through the program, which runs as a process of its own: processor time of ingest
//! and of the report's pages per flight, beside what their bytes alone take: decompressing the
//! chunks of the log and writing the tables, writing the pages (Linux alone).
//!
//! A flight is the difference between some flights and one, so that what a run takes at all is left
//! out. Times are the least of some runs.

use crate::campaign::Campaign;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

const FLIGHTS: usize = 5;
const RUNS: usize = 5;
/// Maneuvers of a flight of the campaign whose pages are made.
const MANEUVERS: usize = 24;
const PIPELINE: &str = "title = \"Flights\"\nchannels = \"channels.toml\"\nlogs = [\"logs/*\"]\n\n[derive]\nrate_hz = 100.0\n";

/// Ingest: `write` makes the log of a flight from its number, `bare` decompresses its chunks and nothing else.
pub fn ingest(name: &str, map: &str, write: impl Fn(&Path, u64), bare: impl Fn(&Path) -> usize) {
    let campaign = Campaign { folder: tempfile::tempdir().expect("a folder") };
    campaign.write("channels.toml", map);
    campaign.write("pipeline.toml", PIPELINE);
    std::fs::create_dir(campaign.path("logs")).expect("a folder");
    let log = |k: usize| campaign.path(&format!("logs/flight-{k}.mcap"));
    let program = per_flight(|flights| {
        (0..flights).filter(|k| !log(*k).is_file()).for_each(|k| write(&log(k), k as u64));
        let fresh = || drop(std::fs::remove_dir_all(campaign.path("out")));
        processor(&campaign, fresh, &["--until", "ingest"])
    });
    let zstd = least(|| {
        black_box(bare(&log(0)));
    });
    say(&format!("ingest, {name}"), program, zstd, &written(&campaign.path("out")));
}

/// The pages of flights of eight minutes, three signals and 24 maneuvers that are estimated.
pub fn pages() {
    let campaign = Campaign::new();
    std::fs::remove_dir_all(campaign.path("logs")).expect("a folder");
    std::fs::create_dir(campaign.path("logs")).expect("a folder");
    let program = per_flight(|flights| {
        (0..flights).for_each(|k| campaign.fly(&format!("flight-{k}"), k as u64, MANEUVERS));
        processor(&campaign, || (), &[]);
        processor(&campaign, || (), &["--from", "page", "--until", "page"])
    });
    say("pages of a flight", program, 0.0, &written(&campaign.path("out/report/flights")));
}

/// Milliseconds of one flight more.
fn per_flight(of: impl Fn(usize) -> f64) -> f64 {
    let [one, all] = [1, FLIGHTS].map(of);
    1e3 * (all - one) / (FLIGHTS - 1) as f64
}

/// Least processor seconds of some runs of the program on one thread.
fn processor(campaign: &Campaign, before: impl Fn(), arguments: &[&str]) -> f64 {
    let run = |_| {
        before();
        let from = children();
        let outcome = campaign.koehler("run", &[&["--quiet", "--jobs", "1"], arguments].concat());
        assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
        children() - from
    };
    (0..RUNS).map(run).fold(f64::INFINITY, f64::min)
}

/// Processor time of processes that have ended, s: fields 16 and 17 of `/proc/self/stat`, in hundredths.
fn children() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").expect("Linux");
    let fields: Vec<&str> = stat.rsplit_once(')').expect("a name").1.split_whitespace().collect();
    [13, 14].map(|k| fields[k].parse::<f64>().expect("a number")).iter().sum::<f64>() / 100.0
}

/// The files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let of = |entry: std::fs::DirEntry| match entry.path() {
        path if path.is_dir() => files(&path),
        path => vec![path],
    };
    entries.flat_map(of).collect()
}

/// Megabytes of the files below a folder, and milliseconds of writing them elsewhere, both for one of its flights.
fn written(folder: &Path) -> [f64; 2] {
    let bytes: Vec<Vec<u8>> =
        files(folder).iter().map(|file| std::fs::read(file).expect("a file")).collect();
    let elsewhere = tempfile::tempdir().expect("a folder");
    let ms = least(|| {
        for (k, bytes) in bytes.iter().enumerate() {
            std::fs::write(elsewhere.path().join(k.to_string()), bytes).expect("written");
        }
    });
    let all: usize = bytes.iter().map(Vec::len).sum();
    [all as f64 / 1e6, ms].map(|x| x / FLIGHTS as f64)
}

/// Least milliseconds of some runs.
fn least(work: impl Fn()) -> f64 {
    let run = |_| {
        let clock = Instant::now();
        work();
        1e3 * clock.elapsed().as_secs_f64()
    };
    (0..RUNS).map(run).fold(f64::INFINITY, f64::min)
}

fn say(name: &str, program: f64, zstd: f64, [mb, write]: &[f64; 2]) {
    println!(
        "{name:24} {mb:8.2} {zstd:9.1} {write:9.1} {program:9.1} {:8.1}",
        program / (zstd + write)
    );
}
