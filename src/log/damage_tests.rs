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
fn fault_what_has_no_checksum_is_said_to_have_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let write = |options: mcap::WriteOptions| {
        let file = std::fs::File::create(&path).unwrap();
        let mut w = options.compression_threads(0).create(std::io::BufWriter::new(file)).unwrap();
        let channel_id = w.add_channel(0, "/t", "json", &Default::default()).unwrap();
        for (i, (_, log_time, publish_time, text)) in regular(100).into_iter().enumerate() {
            let sequence = i as u32;
            let header =
                mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
            w.write_to_known_channel(&header, text.as_bytes()).unwrap();
        }
        w.finish().unwrap();
        drop(w);
        samples(&path, &std::fs::read(&path).unwrap()).unwrap()
    };
    let plain = mcap::WriteOptions::new;
    assert_eq!(write(plain()), (100, vec![]));
    let (n, notes) = write(plain().calculate_chunk_crcs(false));
    assert_eq!((n, told(&notes, "1 of 1 chunks have no checksum")), (100, true), "{notes:?}");
    let (n, notes) = write(plain().calculate_summary_section_crc(false));
    assert_eq!((n, told(&notes, "the summary has no checksum")), (100, true), "{notes:?}");
    let loose = || plain().use_chunks(false);
    assert_eq!(write(loose()), (100, vec![]));
    let (n, notes) = write(loose().calculate_data_section_crc(false));
    assert_eq!(
        (n, told(&notes, "messages outside chunks have no checksum")),
        (100, true),
        "{notes:?}"
    );
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
