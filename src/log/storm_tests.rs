//! Logs that lie with every checksum right in; every sample that was written or a counted note must come
//! out, and no sample that was not written. Damage that checksums can tell is in `tests/all/storm.rs`.

use super::memory::DEFAULT_MIB;
use super::tests::{START, one_signal, raw, read, regular, texts};
use super::{FlightLog, LogFile};
use std::path::Path;

const COUNT: u64 = 1200;
const STEP_NS: u64 = 10_000_000;

/// A sound log with its messages in chunks.
fn whole(path: &Path) -> Vec<u8> {
    let options = mcap::WriteOptions::new().chunk_size(Some(4000)).compression_threads(0);
    let file = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
    let mut log = options.create(file).unwrap();
    let channel_id = log.add_channel(0, "/t", "json", &Default::default()).unwrap();
    for (_, log_time, publish_time, text) in regular(COUNT) {
        let header =
            mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        log.write_to_known_channel(&header, text.as_bytes()).unwrap();
    }
    log.finish().unwrap();
    drop(log);
    std::fs::read(path).unwrap()
}

/// Where the records of a sound log begin.
fn records(bytes: &[u8]) -> Vec<usize> {
    let (mut all, mut at) = (Vec::new(), 8);
    while at + 17 < bytes.len() {
        all.push(at);
        at += 9 + number(bytes, at + 1) as usize;
    }
    all
}

fn number(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// How many samples there are that were not written.
fn made_up(flight: &FlightLog) -> usize {
    let series = &flight.signals["x"].series;
    let time = |t: &f64| flight.start_ns + libm::round(t * 1e9) as u64;
    let wanted = |x: &f64| START + *x as u64 * STEP_NS;
    let written = |(t, x): &(&f64, &f64)| {
        **x >= 0.0 && **x < COUNT as f64 && x.fract() == 0.0 && time(t) == wanted(x)
    };
    series.t_s.iter().zip(&series.value).filter(|sample| !written(sample)).count()
}

/// Writes the checksum of the summary anew.
fn seal(bytes: &mut [u8]) {
    let footer = bytes.len() - 37;
    let start = number(bytes, footer + 9) as usize;
    let crc = crc32fast::hash(&bytes[start..footer + 25]);
    bytes[footer + 25..footer + 29].copy_from_slice(&crc.to_le_bytes());
}

#[test]
fn fault_counts_and_sizes_that_lie_under_right_checksums_are_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let sound = whole(&path);
    let starts = records(&sound);
    let body =
        |code: u8, n: usize| starts.iter().filter(|at| sound[**at] == code).nth(n).unwrap() + 9;
    // The statistics: the count of all messages, and that of the one channel.
    let statistics = body(0x0b, 0);
    let mut bytes = sound.clone();
    bytes[statistics] ^= 1;
    bytes[statistics + 8 + 2 + 16 + 16 + 4 + 2] ^= 1;
    seal(&mut bytes);
    std::fs::write(&path, &bytes).unwrap();
    let flight = read(&path, &one_signal("log")).unwrap();
    assert!(texts(&flight).iter().any(|n| n.contains("that the log counts")), "{:?}", flight.notes);
    assert_eq!(flight.signals["x"].series.value.len() as u64, COUNT);
    // The index: a chunk at another place.
    let index = body(0x08, 3);
    let mut bytes = sound.clone();
    bytes[index + 16..index + 24].copy_from_slice(&u64::MAX.to_le_bytes());
    seal(&mut bytes);
    std::fs::write(&path, &bytes).unwrap();
    let flight = read(&path, &one_signal("log")).unwrap();
    assert!(texts(&flight).iter().any(|n| n.contains("are not there")), "{:?}", flight.notes);
    assert_eq!(flight.signals["x"].series.value.len() as u64, COUNT);
    // A chunk that says it is larger than all memory, and one that says it is as large as may be.
    for size in [u64::MAX, 1 << 62, DEFAULT_MIB << 20, (DEFAULT_MIB << 20) - 10_000] {
        let chunk = body(0x06, 2);
        let mut bytes = sound.clone();
        bytes[chunk + 16..chunk + 24].copy_from_slice(&size.to_le_bytes());
        std::fs::write(&path, &bytes).unwrap();
        let flight = read(&path, &one_signal("log")).unwrap();
        assert!(texts(&flight).iter().any(|n| n.contains("are damaged")), "{:?}", flight.notes);
        assert_eq!(made_up(&flight), 0);
    }
}

#[test]
fn fault_clocks_that_jump_under_right_checksums_move_no_other_sample() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    for (seed, time) in [0, 1, START / 2, START + (1 << 60), u64::MAX].into_iter().enumerate() {
        let mut messages = regular(COUNT);
        let at = 7 + 211 * seed;
        (messages[at].1, messages[at].2) = (time, time);
        raw(&path, "json", &messages, 4000);
        let flight = read(&path, &one_signal("log")).unwrap();
        assert_eq!(made_up(&flight), 0, "{time}: {:?}", flight.notes);
        assert_eq!(flight.signals["x"].series.value.len() as u64, COUNT - 1, "{time}");
        assert!(flight.notes.iter().any(|n| n.count == 1), "{time}: {:?}", flight.notes);
    }
}

#[test]
fn fault_hostile_names_cost_nothing_but_themselves() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let huge = "a".repeat(10_000_000);
    let hostile = ["../../../tmp/out", "\u{1b}[2J\u{1b}]0;mine\u{7}", "a\0b", "\u{202e}t/", &huge];
    let mut messages = regular(COUNT);
    messages.extend(hostile.map(|name| (name, START, START, "{\"x\":1}".to_string())));
    raw(&path, "json", &messages, 4000);
    let log = LogFile::open(&path).unwrap();
    assert!(hostile.iter().all(|name| log.channels.values().any(|c| c.topic == *name)));
    let flight = read(&path, &one_signal("log")).unwrap();
    assert_eq!((flight.signals["x"].series.value.len() as u64, made_up(&flight)), (COUNT, 0));
    // A name that is not there is compared with all that are (by the product of their lengths, this
    // would not end), and none fills the screen.
    let near = "/the/topic/of/another/recorder".repeat(4);
    let e = read(&path, &one_signal("log").replace("/t", &near)).unwrap_err();
    assert!(e.len() < 2000 && e.contains("\"/t\""), "{} bytes", e.len());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Read in time that grows with the square of its length, this would not end.
#[test]
fn fault_a_list_of_a_million_numbers_is_read() {
    const N: usize = 1_000_000;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let text = format!("{{\"list\":[{}2],\"x\":7}}", "1.5,".repeat(N));
    raw(&path, "json", &[("/t", START, START, text)], 4000);
    let map = one_signal("log") + &one_signal("log").replace("signal.x", "signal.y");
    let map = map.replacen("\"x\"", &format!("\"list.{N}\""), 1);
    let flight = read(&path, &map).unwrap();
    let values = flight.signals.values().map(|s| s.series.value[0]);
    assert_eq!(values.collect::<Vec<_>>(), [2.0, 7.0]);
}
