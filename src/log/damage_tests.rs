//! Whole logs with damage in; every sample that is left, and a counted note of those that are not,
//! must come out.

use super::tests::{START, one_signal, raw, read, regular, texts};
use rand::{RngExt, SeedableRng};
use std::path::Path;

const COUNT: u64 = 2000;

/// A log of `COUNT` messages in many chunks, and where its chunk records begin.
fn whole(path: &Path) -> (Vec<u8>, Vec<usize>) {
    raw(path, "json", &regular(COUNT), 4000);
    let bytes = std::fs::read(path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let chunks: Vec<usize> =
        summary.chunk_indexes.iter().map(|c| c.chunk_start_offset as usize).collect();
    assert!(chunks.len() > 10);
    (bytes, chunks)
}

/// Reads a damaged log: every sample must be one that was written. How many there are, and the
/// notes.
fn samples(path: &Path, bytes: &[u8]) -> std::result::Result<(u64, Vec<String>), String> {
    std::fs::write(path, bytes).unwrap();
    let flight = read(path, &one_signal("log"))?;
    let zero = libm::round((flight.start_ns as i64 - START as i64) as f64 / 1e7);
    let s = &flight.signals["x"].series;
    assert!(s.t_s.iter().zip(&s.value).all(|(t, x)| libm::round(t * 100.0) + zero == *x));
    Ok((s.value.len() as u64, texts(&flight).into_iter().map(str::to_string).collect()))
}

fn told(notes: &[String], wanted: &str) -> bool {
    notes.iter().any(|n| n.contains(wanted))
}

#[test]
fn fault_a_chunk_under_any_operation_code_is_read_and_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (bytes, chunks) = whole(&path);
    // As it is, without its index, and cut off in the middle of the summary.
    let footer = bytes.len() - 37;
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let last = summary.chunk_indexes.last().unwrap();
    let end = (last.chunk_start_offset + last.chunk_length) as usize;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        for code in (0..=255).filter(|code| *code != 6) {
            let mut damaged = bytes.clone();
            damaged[chunks[5]] = code;
            let (n, notes) = samples(&path, &damaged).unwrap();
            assert_eq!(n, COUNT, "{code:#x}: {notes:?}");
            assert!(told(&notes, "1 chunks stand under the code of another record"), "{notes:?}");
            damaged[footer - 100] ^= 1;
            let (n, notes) = samples(&path, &damaged).unwrap();
            assert_eq!(n, COUNT, "{code:#x}, summary damaged: {notes:?}");
            assert!(told(&notes, "the summary's checksum does not match"), "{notes:?}");
            let (n, notes) = samples(&path, &damaged[..end + 20]).unwrap();
            assert_eq!(n, COUNT, "{code:#x}, cut off: {notes:?}");
            assert!(told(&notes, "the file is cut off"), "{notes:?}");
        }
    });
}

#[test]
fn fault_a_wrong_length_costs_its_chunk_at_most_and_the_messages_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (bytes, chunks) = whole(&path);
    for byte in 1..9 {
        for flip in [0x01, 0x40, 0x80] {
            let mut damaged = bytes.clone();
            damaged[chunks[5] + byte] ^= flip;
            let (n, notes) = samples(&path, &damaged).unwrap();
            // The index at the end has the right length.
            assert_eq!(n, COUNT, "byte {byte} {flip:#x}: {notes:?}");
            assert!(!notes.is_empty());
        }
    }
    // The sizes inside the chunk.
    let mut damaged = bytes.clone();
    damaged[chunks[5] + 9 + 16] ^= 0x10;
    let (n, notes) = samples(&path, &damaged).unwrap();
    assert!(n < COUNT && n > COUNT - 200, "{n}");
    assert!(told(&notes, "1 of") && told(&notes, "chunks are damaged and left out"), "{notes:?}");
    let missing =
        format!("/t: {} of {COUNT} messages that the log counts are not there", COUNT - n);
    assert!(told(&notes, &missing), "{notes:?}");
}

#[test]
fn fault_whatever_is_lost_by_random_damage_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (bytes, _) = whole(&path);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (mut read, mut all) = (0, 0);
    pool.install(|| {
        for seed in 0..400 {
            let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
            let mut damaged = bytes.clone();
            let at = rng.random_range(8..bytes.len() - 8);
            let n = rng.random_range(1..200).min(bytes.len() - at);
            match seed % 5 {
                0 => damaged[at] ^= 1 << rng.random_range(0..8),
                1 => damaged[at..at + n].fill(0),
                2 => drop(damaged.drain(at..at + n)),
                3 => drop(damaged.splice(at..at, (0..n).map(|_| rng.random::<u8>()))),
                _ => drop(damaged.splice(at..at, bytes[at..at + n].iter().copied())),
            }
            let Ok((n, notes)) = samples(&path, &damaged) else { continue };
            read += 1;
            all += u64::from(n == COUNT);
            let heavy = |n: &&String| !n.contains("gaps, the longest");
            assert!(n == COUNT || notes.iter().any(|n| heavy(&n)), "seed {seed}: {n} {notes:?}");
            assert!(n > COUNT - 300, "seed {seed}: {n} {notes:?}");
        }
    });
    assert!(read > 380 && all > 50, "{read} read, {all} of them whole");
}

#[test]
fn fault_what_stands_behind_the_end_and_chunks_that_stand_there_twice_are_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (bytes, chunks) = whole(&path);
    let (n, notes) = samples(&path, &[&bytes[..], b"0123456789"].concat()).unwrap();
    assert_eq!((n, told(&notes, "10 bytes behind the end of the log are not read")), (COUNT, true));
    // The last chunk once more, in front of what follows it: the summary is then no longer where the
    // footer says.
    let last = chunks[chunks.len() - 1];
    let length = 9 + u64::from_le_bytes(bytes[last + 1..last + 9].try_into().unwrap()) as usize;
    let mut twice = bytes.clone();
    drop(twice.splice(last..last, bytes[last..last + length].iter().copied()));
    let (n, notes) = samples(&path, &twice).unwrap();
    assert_eq!((n, told(&notes, "repeat a time stamp, dropped")), (COUNT, true), "{notes:?}");
}

/// A footer that tells of no summary, with the closing magic.
fn footer() -> Vec<u8> {
    [&[2, 20][..], &[0; 7 + 20], mcap::MAGIC].concat()
}

#[test]
fn fault_a_footer_inside_ends_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (bytes, chunks) = whole(&path);
    let mut damaged = bytes.clone();
    drop(damaged.splice(chunks[5]..chunks[5], footer()));
    let (n, notes) = samples(&path, &damaged).unwrap();
    assert_eq!((n, told(&notes, "1 stretches of the file are no records")), (COUNT, true));
    assert!(told(&notes, "not where the footer says"), "{notes:?}");
    // the summary is found all the same, so that what is lost besides is counted
    let lost = chunks[8] + 37 + 100;
    damaged[lost] ^= 1;
    let (n, notes) = samples(&path, &damaged).unwrap();
    let missing = format!("{} of {COUNT} messages that the log counts are not there", COUNT - n);
    assert!(n < COUNT && told(&notes, &missing), "{n} {notes:?}");
    let named = super::LogFile::summary(&path).unwrap();
    assert!(named.is_some_and(|channels| channels.values().any(|c| c.topic == "/t")));
}

#[test]
fn fault_a_log_behind_the_first_is_missing_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (bytes, chunks) = whole(&path);
    let both = [&bytes[..], &bytes].concat();
    let (n, notes) = samples(&path, &both).unwrap();
    let at = format!("another log begins at byte {}, behind the first", bytes.len());
    assert_eq!((n, told(&notes, &at)), (COUNT, true), "{notes:?}");
    assert!(told(&notes, "(2000 messages) are not read"), "{notes:?}");
    let flight = read(&path, &one_signal("log")).unwrap();
    let is_missing = |n: &super::Note| n.severity == super::Severity::Missing;
    assert_eq!(flight.notes.iter().filter(|n| is_missing(n)).count(), 1);
    // the summary at the end of the file is that of the second log
    assert!(super::LogFile::summary(&path).unwrap().is_none());
    // behind one that was cut off
    let cut = [&bytes[..chunks[9] + 50], &bytes].concat();
    let (n, notes) = samples(&path, &cut).unwrap();
    assert!(n < COUNT && told(&notes, "another log begins at byte"), "{n} {notes:?}");
    assert!(told(&notes, "the file is cut off: its last 50 bytes"), "{notes:?}");
}

/// A log of messages outside chunks, and where the one of a number begins.
fn unchunked(path: &Path, number: usize) -> (Vec<u8>, usize) {
    let file = std::fs::File::create(path).unwrap();
    let options = mcap::WriteOptions::new().use_chunks(false);
    let mut w = options.create(std::io::BufWriter::new(file)).unwrap();
    let channel_id = w.add_channel(0, "/t", "json", &Default::default()).unwrap();
    for (i, (_, log_time, publish_time, text)) in regular(COUNT).into_iter().enumerate() {
        let sequence = i as u32;
        let header = mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
        w.write_to_known_channel(&header, text.as_bytes()).unwrap();
    }
    w.finish().unwrap();
    drop(w);
    let bytes = std::fs::read(path).unwrap();
    let text = format!("{{\"x\":{number},");
    let at = bytes.windows(text.len()).position(|w| w == text.as_bytes()).unwrap();
    (bytes, at - 9 - 22)
}

#[test]
fn fault_behind_a_damaged_message_outside_chunks_the_next_one_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (bytes, at) = unchunked(&path, 500);
    type Damage = (&'static str, u64, fn(&mut Vec<u8>, usize));
    let damages: [Damage; 6] = [
        ("footer", 1, |b, at| b[at] = 2),
        ("a little longer", 2, |b, at| b[at + 1] ^= 0x40),
        ("longer", 1, |b, at| b[at + 2] ^= 0x40),
        ("beyond the end", 1, |b, at| b[at + 5] ^= 0x40),
        ("bytes added", 1, |b, at| drop(b.splice(at + 30..at + 30, [0x5a; 50]))),
        ("bytes lost", 2, |b, at| drop(b.drain(at + 10..at + 60))),
    ];
    for (name, most, damage) in damages {
        let mut damaged = bytes.clone();
        damage(&mut damaged, at);
        let (n, notes) = samples(&path, &damaged).unwrap();
        assert!(n < COUNT && n >= COUNT - most, "{name}: {n} {notes:?}");
        assert!(told(&notes, "the first from byte"), "{name}: {notes:?}");
        let is_missing = told(&notes, "messages that the log counts are not there");
        // one that is there and holds bytes of nobody is unreadable
        assert!(is_missing || name == "bytes added", "{name}: {notes:?}");
    }
}

#[test]
fn fault_a_count_is_held_against_the_log_whose_summary_is_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (mut bytes, chunks) = whole(&path);
    // the footer says that the summary begins elsewhere, and a chunk is lost
    let footer = bytes.len() - 37;
    bytes[footer + 9] ^= 1;
    bytes[chunks[5] + 100] ^= 1;
    let (n, notes) = samples(&path, &bytes).unwrap();
    let missing = format!("{} of {COUNT} messages that the log counts are not there", COUNT - n);
    assert!(n < COUNT && told(&notes, &missing), "{n} {notes:?}");
    // without the record that counts them, that is said
    let at = bytes.len() - 37;
    let counts = (0..at).rev().find(|k| bytes[*k..].starts_with(&[0x0b, 56, 0, 0])).unwrap();
    bytes[counts + 9..counts + 20].fill(0xff);
    let (_, notes) = samples(&path, &bytes).unwrap();
    assert!(told(&notes, "the log's own count of its messages is lost"), "{notes:?}");
}

#[test]
fn fault_a_topic_whose_channel_record_is_damaged_is_not_called_absent() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (mut bytes, _) = unchunked(&path, 0);
    // every record of the channel: its length no longer fits its texts
    let topic = [&2u32.to_le_bytes()[..], b"/t"].concat();
    let found: Vec<usize> = (0..bytes.len()).filter(|k| bytes[*k..].starts_with(&topic)).collect();
    found.iter().for_each(|k| bytes[*k + 3] = 0x7f);
    let why = samples(&path, &bytes).unwrap_err();
    assert!(why.contains("topic \"/t\" cannot be found in a.mcap, whose channel records"), "{why}");
    assert!(why.contains("2000 messages are of channels that it does not name"), "{why}");
}

#[cfg(unix)]
#[test]
fn fault_a_pipe_a_folder_and_a_loop_of_links_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let made = std::process::Command::new("mkfifo").arg(at("pipe.mcap")).status().unwrap();
    assert!(made.success());
    std::os::unix::fs::symlink(at("b.mcap"), at("a.mcap")).unwrap();
    std::os::unix::fs::symlink(at("a.mcap"), at("b.mcap")).unwrap();
    std::fs::create_dir(at("folder.mcap")).unwrap();
    for (name, wanted) in [
        ("pipe.mcap", "is a pipe or a device"),
        ("folder.mcap", "is a folder"),
        ("a.mcap", "cannot read"),
    ] {
        let e = read(&at(name), &one_signal("log")).unwrap_err();
        assert!(e.contains(wanted) && e.contains(name), "{e}");
    }
}
