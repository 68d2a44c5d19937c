//! Any bytes in; every reader of files that people give must answer or refuse, and never panic.
//!
//! The targets are plain functions of bytes. First come the files of `tests/corpus`, a folder per target:
//! what readers were written with in view, and whatever broke one. Then bytes that a generator of this file
//! makes of these and of sound files, damaged piece by piece, from one number per run: what fails comes
//! again by that number, here and elsewhere.

use crate::counted::peak;
use koehler::config;
use koehler::log::decode::{self, FieldInfo};
use koehler::log::{Buffer, ChannelMap, LogFile, import};
use koehler::model::{Constants, Model};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::path::{Path, PathBuf};

/// Inputs of each target; a hundred times as many with `KOEHLER_SLOW=1`.
const RUNS: u64 = 10_000;

fn runs() -> u64 {
    let slow = std::env::var("KOEHLER_SLOW").as_deref() == Ok("1");
    if slow { 100 * RUNS } else { RUNS }
}

/// Pieces that a reader looks for.
const WORDS: [&[u8]; 8] =
    [b"[[", b"]]", b"\"\"\"", b"{\"a\":", b"\xff\xff\xff\xff", b"\0\0\0\0", b"((((", b"1e999"];

/// Bytes made from one of the seeds.
fn made(rng: &mut Pcg64, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = seeds[rng.random_range(0..seeds.len())].clone();
    for _ in 0..rng.random_range(0..6) {
        let at = rng.random_range(0..=bytes.len());
        let n = rng.random_range(0..40).min(bytes.len() - at);
        match rng.random_range(0..7) {
            0 if n > 0 => bytes[at] ^= 1 << rng.random_range(0..8),
            1 => bytes[at..at + n].iter_mut().for_each(|b| *b = rng.random()),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..at + n)),
            4 => {
                let again = bytes[at..at + n].to_vec();
                drop(bytes.splice(at..at, again));
            }
            5 => drop(bytes.splice(at..at, WORDS[rng.random_range(0..WORDS.len())].to_vec())),
            _ => bytes[at..at + n].fill(rng.random()),
        }
    }
    bytes
}

/// Memory that reading `bytes` may hold at once: a file that says how long it is may lie.
fn allowed(bytes: usize) -> usize {
    64 * bytes + (16 << 20)
}

fn within_memory(run: u64, bytes: &[u8], target: impl FnOnce(&[u8])) {
    let ((), most) = peak(|| target(bytes));
    assert!(most <= allowed(bytes.len()), "run {run}: {most} bytes held for {}", bytes.len());
}

/// What is kept for a target, by name.
fn corpus(of: &str) -> Vec<Vec<u8>> {
    let folder = std::fs::read_dir(shipped("tests/corpus").join(of)).expect("a corpus");
    let mut files: Vec<PathBuf> = folder.map(|file| file.expect("a file").path()).collect();
    files.sort();
    assert!(!files.is_empty(), "{of} has no corpus");
    files.iter().map(|file| std::fs::read(file).expect("readable")).collect()
}

/// Drives a target with its corpus, and with what is made of that and of `seeds`.
fn drive(of: &str, runs: u64, seeds: &[Vec<u8>], mut target: impl FnMut(&[u8])) {
    let kept = corpus(of);
    kept.iter().for_each(|bytes| within_memory(0, bytes, &mut target));
    let seeds = [seeds, &kept].concat();
    for run in 0..runs {
        let bytes = made(&mut Pcg64::seed_from_u64(run), &seeds);
        within_memory(run, &bytes, &mut target);
    }
}

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// A folder that no write waits for a disk in, where there is one.
fn in_memory() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder")
}

/// A small log in chunks of some messages.
fn log() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().chunk_size(Some(300)).compression_threads(0);
    let mut log = options.create(&mut bytes).expect("begun");
    let channel_id = log.add_channel(0, "/t", "json", &Default::default()).expect("a channel");
    for i in 0..40 {
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: i,
            log_time: u64::from(i) * 1000,
            publish_time: 0,
        };
        log.write_to_known_channel(&header, b"{\"x\":1.5}").expect("written");
    }
    log.finish().expect("finished");
    drop(log);
    bytes.into_inner()
}

#[test]
fn fault_any_bytes_are_walked_as_a_log() {
    let folder = in_memory();
    let path = folder.path().join("a.mcap");
    drive("log", runs(), &[log()], |bytes| {
        std::fs::write(&path, bytes).expect("written");
        let Ok(log) = LogFile::open(&path) else { return };
        let mut buffer = Buffer::default();
        for part in 0..log.parts() {
            log.messages(part, &mut buffer, |_| ()).expect("the file stays as it is");
        }
    });
}

#[test]
fn fault_any_bytes_are_decoded_as_messages_and_read_as_schemas() {
    for encoding in ["json", "protobuf", "ros2"] {
        let log = LogFile::open(&shipped(&format!("tests/logs/{encoding}.mcap"))).expect("a log");
        for (id, channel) in &log.channels {
            let mut messages: Vec<Vec<u8>> = Vec::new();
            for part in 0..log.parts() {
                let take = |m: koehler::log::file::Message| {
                    if m.channel == *id && messages.len() < 5 {
                        messages.push(m.data.to_vec());
                    }
                };
                log.messages(part, &mut Buffer::default(), take).expect("readable");
            }
            let Some(known) = decode::encoding_of(channel) else { continue };
            let paths = |fields: Vec<FieldInfo>| -> Vec<String> {
                fields.into_iter().map(|f| f.path).take(50).collect()
            };
            let sound =
                paths((known.fields)(channel, messages.first().map(Vec::as_slice).as_slice()));
            let prepared = (known.prepare)(channel, &sound).expect("a sound schema");
            let mut row = vec![0.0; sound.len()];
            let mut reader = prepared();
            drive(encoding, runs(), &messages, |bytes| reader(bytes, &mut row));
            drive(encoding, runs() / 10, std::slice::from_ref(&channel.schema), |bytes| {
                let mut other = channel.clone();
                other.schema = bytes.to_vec();
                let paths =
                    paths((known.fields)(&other, messages.first().map(Vec::as_slice).as_slice()));
                let Ok(prepared) = (known.prepare)(&other, &paths) else { return };
                let mut row = vec![0.0; paths.len()];
                messages.iter().for_each(|message| prepared()(message, &mut row));
            });
        }
    }
}

/// A MAT file with one matrix.
fn mat() -> Vec<u8> {
    let element = |kind: u32, data: &[u8]| {
        let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
        out.extend(data);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    };
    let numbers: Vec<u8> = (0..12).flat_map(|i| f64::from(i).to_le_bytes()).collect();
    let sizes = [6u32, 2].map(u32::to_le_bytes).concat();
    let flags = [6u32, 0].map(u32::to_le_bytes).concat();
    let parts = [element(6, &flags), element(5, &sizes), element(1, b"data"), element(9, &numbers)];
    let mut out = b"MATLAB 5.0 MAT-file".to_vec();
    out.resize(124, b' ');
    out.extend([0, 1, b'I', b'M']);
    out.extend(element(14, &parts.concat()));
    out
}

/// A ULog with one topic.
fn ulog() -> Vec<u8> {
    let mut out = [b"ULog\x01\x12\x35\x01".to_vec(), 0u64.to_le_bytes().to_vec()].concat();
    let mut record = |kind: u8, body: &[u8]| {
        out.extend((body.len() as u16).to_le_bytes());
        out.push(kind);
        out.extend(body);
    };
    record(b'B', &[0; 40]);
    record(b'F', b"outer:uint64_t timestamp;float x;");
    record(b'A', b"\0\0\0outer");
    for i in 0..5u64 {
        let body = [&[0, 0], &(1000 * i).to_le_bytes()[..], &1.5f32.to_le_bytes()].concat();
        record(b'D', &body);
    }
    out
}

#[test]
fn fault_any_bytes_are_imported_or_refused() {
    let folder = in_memory();
    let at = |name: &str| folder.path().join(name);
    let column = "fields = [{ column = \"x\", name = \"x\", unit = \"1\" }]\n";
    let topic = |more: &str| format!("[[topic]]\nname = \"/o\"\n{more}{column}");
    let head = "input = [\"a.bin\"]\noutput = \"a.mcap\"\n";
    let time = "[time]\ncolumn = \"t\"\nunit = \"s\"\n";
    let text = format!("separator = \"comma\"\nheader_lines = 1\n{head}{time}{}", topic(""));
    let of_mat = format!("{head}{time}{}", topic(""))
        .replace("\"t\"", "1")
        .replace("\"x\", name", "2, name");
    let kinds = [
        ("text", text, b"t,x\n0,1\n0.1,2\n0.2,\"3\"\n".to_vec()),
        ("mat", of_mat, mat()),
        ("ulog", format!("{head}{}", topic("from = \"outer\"\n")), ulog()),
    ];
    for (kind, description, seed) in kinds {
        std::fs::write(at("import.toml"), &description).expect("written");
        let run = |bytes: &[u8]| {
            std::fs::write(at("a.bin"), bytes).expect("written");
            import::run(&at("import.toml"), None, true).map(|(done, errors)| (done.len(), errors))
        };
        let sound = run(&seed);
        assert!(sound.as_ref().is_ok_and(|s| s.0 == 1), "{description}{sound:?}");
        drive(kind, runs(), std::slice::from_ref(&seed), |bytes| drop(run(bytes)));
    }
}

#[test]
fn fault_any_bytes_are_read_as_a_channel_map() {
    let seeds = [
        crate::campaign::CHANNELS.as_bytes().to_vec(),
        std::fs::read(shipped("pipelines/citation/channels.toml")).expect("a channel map"),
    ];
    drive("channels", runs(), &seeds, |bytes| {
        let text = String::from_utf8_lossy(bytes);
        if let Ok((map, doc)) = config::parse::<ChannelMap>("channels.toml", &text) {
            let _ = map.check(&doc);
        }
    });
}

#[test]
fn fault_any_bytes_are_read_as_a_model() {
    let seeds = [
        crate::campaign::MODEL.as_bytes().to_vec(),
        std::fs::read(shipped("pipelines/hfb320/hfb320.model.toml")).expect("a model"),
    ];
    drive("model", runs(), &seeds, |bytes| {
        let text = String::from_utf8_lossy(bytes);
        let _ = Model::parse("a.model.toml", &text, &Constants::default());
    });
}
