//! A thousand logs with damage from seeds in; every sample that was written must be there, or be among
//! those that the notes of its topic count, and no sample that was not written.
//!
//! Damage that leaves all checksums right has tests of its own in `src/log/storm_tests.rs`.

use crate::campaign::Campaign;
use crate::damage::{damaged, records};
use koehler::log::{FlightLog, Note};
use koehler::{config, log};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const LOGS: u64 = 1000;
const START: u64 = 1_700_000_000_000_000_000;
const STEP_NS: u64 = 10_000_000;

/// What is written: a topic, its signal, and every which step it has a message at. Its value there is
/// the number of the step.
const TOPICS: [(&str, &str, u64); 2] = [("/t", "x", 1), ("/s", "y", 3)];
const STEPS: u64 = 1200;

/// A sound log with its messages in chunks of one kind, or outside chunks.
fn whole(kind: u64) -> Vec<u8> {
    let options = mcap::WriteOptions::new().chunk_size(Some(4000)).compression_threads(0);
    let options = match kind {
        0 => options,
        1 => options.compression(Some(mcap::Compression::Lz4)),
        2 => options.compression(None),
        _ => options.use_chunks(false),
    };
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut log = options.create(&mut bytes).expect("begun");
    let ids = TOPICS.map(|(topic, ..)| {
        log.add_channel(0, topic, "json", &Default::default()).expect("a channel")
    });
    for step in 0..STEPS {
        for (channel_id, (_, field, every)) in ids.into_iter().zip(TOPICS) {
            let time = START + step * STEP_NS;
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: 0,
                log_time: time,
                publish_time: time,
            };
            let text = format!("{{\"{field}\":{step},\"other\":0.5}}");
            if step % every == 0 {
                log.write_to_known_channel(&header, text.as_bytes()).expect("written");
            }
        }
    }
    log.finish().expect("finished");
    drop(log);
    bytes.into_inner()
}

/// Reads a log by one thread, because others would only be waited for.
fn alone<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    pool.install(work)
}

fn read(path: &Path) -> Option<FlightLog> {
    let of = |(topic, name, _): (&str, &str, u64)| {
        format!(
            "[signal.{name}]\ntopic = \"{topic}\"\nfield = \"{name}\"\nunit = \"1\"\ntime = \"log\"\n"
        )
    };
    let text = TOPICS.map(of).concat();
    let (map, doc) = config::parse::<log::ChannelMap>("channels.toml", &text).expect("a map");
    log::read_flight(path, &map, &doc).ok()
}

/// How many samples there are that were not written.
fn made_up(flight: &FlightLog, name: &str, every: u64) -> u64 {
    let series = &flight.signals[name].series;
    let time = |t: &f64| flight.start_ns + libm::round(t * 1e9) as u64;
    let written = |(t, x): &(&f64, &f64)| {
        let step = **x as u64;
        step as f64 == **x
            && step < STEPS
            && step.is_multiple_of(every)
            && time(t) == START + step * STEP_NS
    };
    series.t_s.iter().zip(&series.value).filter(|sample| !written(sample)).count() as u64
}

/// Samples of a topic that its notes say are lost: messages that the log counts and that are not there, less
/// those that are there and not counted, and what was dropped of those that were read.
fn told(notes: &[Note], topic: &str, name: &str) -> i64 {
    let of = |subject: &str, any: &[&str]| -> i64 {
        let is = |n: &&Note| n.subject == subject && any.iter().any(|text| n.text.contains(text));
        notes.iter().filter(is).map(|n| n.count as i64).sum()
    };
    of(topic, &["messages that the log counts are not there"]) - of(topic, &["messages more than"])
        + of(name, &[" unreadable", "have no field", "dropped"])
}

/// What is wrong with the account of a damaged log.
fn wrong(flight: &FlightLog, is_loose: bool) -> Vec<String> {
    let says = |text: &str| flight.notes.iter().any(|n| n.count > 0 && n.text.contains(text));
    let mut wrong = Vec::new();
    for (topic, name, every) in TOPICS {
        let there = flight.signals[name].series.value.len() as i64;
        let missing = STEPS.div_ceil(every) as i64 - there;
        let told = told(&flight.notes, topic, name);
        // A log that has lost its own count says so, and what was damaged; how many messages were in that
        // nobody can say.
        if missing != told && !says("the log's own count of its messages is lost") {
            wrong.push(format!("{topic}: {missing} samples are missing, {told} are told"));
        }
        let made_up = made_up(flight, name, every);
        // Outside chunks there is one checksum for all: that it does not match is said.
        if made_up > 0 && !(is_loose && says("messages outside chunks")) {
            wrong.push(format!("{topic}: {made_up} samples were not written"));
        }
    }
    wrong
}

#[test]
fn fault_a_thousand_damaged_logs_give_what_was_written_or_a_counted_note() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.mcap");
    let sound = [0, 1, 2, 3].map(whole);
    let (mut refused, mut complete, mut uncounted, mut accounted) = (0, 0, 0, 0);
    let mut all = Vec::new();
    alone(|| {
        for seed in 0..LOGS {
            let sound = &sound[seed as usize % 4];
            let mut rng = Pcg64::seed_from_u64(seed);
            let bytes = damaged(sound, &records(sound), seed / 4, &mut rng);
            std::fs::write(&path, &bytes).expect("written");
            let Some(flight) = read(&path) else {
                refused += 1;
                continue;
            };
            let is_whole = |(_, name, every): &(&str, &str, u64)| {
                flight.signals[*name].series.value.len() as u64 == STEPS.div_ceil(*every)
            };
            let is_complete = TOPICS.iter().all(is_whole);
            let is_uncounted = flight.notes.iter().any(|n| n.text.contains("own count"));
            complete += u64::from(is_complete);
            uncounted += u64::from(is_uncounted);
            accounted += u64::from(!is_complete && !is_uncounted);
            let wrong = wrong(&flight, seed % 4 == 3);
            if !wrong.is_empty() {
                all.push(format!("seed {seed}: {wrong:?}\n  {:?}", flight.notes));
            }
        }
    });
    assert!(all.is_empty(), "{} logs\n{}", all.len(), all.join("\n"));
    assert!(refused < LOGS / 8 && complete > LOGS / 8, "{refused} refused, {complete} complete");
    println!(
        "{refused} refused, {complete} complete, {accounted} accounted for, {uncounted} lost their count"
    );
    assert!(accounted > LOGS * 2 / 5, "{accounted}: little is held against the notes");
    assert!(uncounted < LOGS / 3, "{uncounted} lost their own count");
}

/// The files that a run wrote of one flight, by name.
fn files(folder: &Path, flight: &str, found: &mut BTreeMap<PathBuf, Vec<u8>>) {
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            files(&path, flight, found);
        } else if path.components().any(|c| c.as_os_str() == flight) {
            found.insert(path.clone(), std::fs::read(&path).expect("readable"));
        }
    }
}

/// The tables of the flight that is sound, by their names inside the campaign.
fn of_sound(c: &Campaign) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    files(&c.path("out"), "flight=flight-1", &mut found);
    let inside = |path: PathBuf| path.strip_prefix(c.folder.path()).expect("inside").to_path_buf();
    found.into_iter().map(|(path, bytes)| (inside(path), bytes)).collect()
}

#[test]
fn fault_a_run_over_damaged_logs_leaves_the_sound_flight_as_it_is() {
    const DAMAGED: u64 = 20;
    let c = Campaign::new();
    let sound = std::fs::read(c.path("logs/flight-2.mcap")).expect("a log");
    for other in ["flight-2", "flight-3"] {
        std::fs::remove_file(c.path(&format!("logs/{other}.mcap"))).expect("removed");
    }
    c.run().ended(0);
    let alone = of_sound(&c);
    assert!(alone.len() > 2, "{:?}", alone.keys());
    std::fs::remove_dir_all(c.path("out")).expect("removed");
    let starts = records(&sound);
    for seed in 0..DAMAGED {
        let bytes = damaged(&sound, &starts, seed, &mut Pcg64::seed_from_u64(seed));
        std::fs::write(c.path(&format!("logs/storm-{seed}.mcap")), bytes).expect("written");
    }
    let run = c.run();
    assert!(run.code == 0 || run.code == 1, "{}\n{}\n{}", run.code, run.out, run.err);
    assert!(!run.err.contains("panicked"), "{}", run.err);
    let beside = of_sound(&c);
    assert_eq!(alone.keys().collect::<Vec<_>>(), beside.keys().collect::<Vec<_>>());
    let other: Vec<_> = alone.iter().filter(|(path, bytes)| beside[*path] != **bytes).collect();
    assert!(other.is_empty(), "{:?}", other.iter().map(|(path, _)| path).collect::<Vec<_>>());
    // Every damaged log is there, or is told to be missing.
    let said = run.out + &run.err;
    for seed in 0..DAMAGED {
        let there = c.path(&format!("out/signals/flight=storm-{seed}")).exists();
        assert!(there || said.contains(&format!("storm-{seed}.mcap")), "storm-{seed}\n{said}");
    }
}
